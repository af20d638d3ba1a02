//! Start, run and shutdown of the node.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

use ros2_client::NodeName;
use tokio::sync::{mpsc, oneshot, watch};

use super::{
    action,
    clock::NodeClock,
    collection::{Command, Core, IMAGE_QUEUE, Inbox, SMALL_QUEUE, Shared, Tracking},
    collector::Collector,
    diagnosis::Diagnoser,
    diagnostics::Diagnostics,
    environment::Environment,
    error::NodeError,
    inputs::{self, Outbox},
    last_results::{last_report, last_twin},
    live_map::{self, LiveQueue},
    live_outputs::LiveOutputs,
    live_parameters::{CurrentParameters, LiveParameters},
    live_tracking, logger,
    motion_watch::MotionWatch,
    outputs::{OutputSources, Outputs},
    parameter_services,
    parameters::{Loaded, Parameters},
    participant::{Participant, small_buffer_warning},
    reach,
    reconstruction::Reconstructor,
    ros_args::RosArgs,
    rosout,
    services::{self, ServiceContext},
    session_folder::free_folder,
    session_lock::SessionLock,
    settings, work_ahead,
};
use config::Config;

/// Name of the node if none is given.
const DEFAULT_NAME: &str = "artitwin";
/// Queue length for camera poses to publish.
const POSE_QUEUE: usize = 16;
/// Longest time for the shutdown.
const END_WAIT: Duration = Duration::from_secs(10);

/// Runs the node until Ctrl-C or SIGTERM. `arguments` are those after `artitwin node`.
///
/// # Errors
/// [`NodeError`] if it cannot start.
pub fn run(arguments: &[String]) -> Result<(), NodeError> {
    let start = Start::read_inputs(arguments, DEFAULT_NAME)?;
    in_runtime(run_live(&start))
}

/// Parses arguments and parameter files like [`run()`], without starting anything. Returns the names of
/// unknown parameters.
///
/// # Errors
/// [`NodeError`] if the node would not start with these arguments.
pub fn check_arguments(arguments: &[String]) -> Result<Vec<String>, NodeError> {
    let arguments = without_stray(arguments)?;
    let identity = arguments.node_identity(DEFAULT_NAME)?;
    let Loaded { parameters, unknown } = Parameters::load(&arguments, &identity)?;
    // Also checks the settings of a run, as an error would otherwise show after minutes of collecting.
    let topics = inputs::topic_names(&arguments, &identity, &parameters);
    settings::run_settings(settings::base_layers(&parameters)?, &parameters, &topics)?;
    Ok(unknown)
}

/// Parses the arguments; unknown ones are errors.
fn without_stray(arguments: &[String]) -> Result<RosArgs, NodeError> {
    let arguments = RosArgs::parse(arguments)?;
    match arguments.rest.first() {
        Some(stray) => Err(NodeError::Stray(stray.clone())),
        None => Ok(arguments),
    }
}

/// Input for starting a node.
pub(super) struct Start {
    /// ROS arguments, such as remappings.
    pub arguments: RosArgs,
    /// Name and namespace of the node.
    pub identity: NodeName,
    /// Domain and reach.
    pub environment: Environment,
    /// Parameters.
    pub parameters: Parameters,
}

impl Start {
    /// Reads arguments, environment and parameters; starts the log and logs warnings.
    pub(crate) fn read_inputs(arguments: &[String], name: &str) -> Result<Self, NodeError> {
        let arguments = without_stray(arguments)?;
        let identity = arguments.node_identity(name)?;
        // Before reading the environment, so that its warnings are logged.
        logger::start_log(identity.base_name(), arguments.log_level.as_deref(), arguments.no_stdout);
        arguments.unknown.iter().for_each(|a| log::warn!("`{a}` is not known here and is left out"));
        let environment = Environment::read(|name| std::env::var(name).ok())?;
        environment.warnings.iter().for_each(|w| log::warn!("{w}"));
        if arguments.enclave.as_deref().is_some_and(|e| e != "/") {
            log::warn!("--enclave is left out: this build has no DDS security");
        }
        let loaded = Parameters::load(&arguments, &identity)?;
        loaded
            .unknown
            .iter()
            .for_each(|name| log::warn!("parameter `{name}` is not known here and is left out"));
        small_buffer_warning().into_iter().for_each(|w| log::warn!("{w}"));
        Ok(Self { arguments, identity, environment, parameters: loaded.parameters })
    }

    /// Joins the domain, logs from where the node can be reached, and begins `/rosout`.
    pub(crate) fn join_domain(&self) -> Result<Participant, NodeError> {
        let mut participant =
            Participant::join_domain(&self.environment, &self.arguments, &self.identity, &self.parameters)?;
        // Only after joining are the sockets open.
        reach::check_sockets(&self.environment)?;
        if !self.arguments.no_rosout {
            rosout::publish_log(&mut participant)?;
        }
        Ok(participant)
    }
}

/// Runs a future in a runtime of the node.
pub(super) fn in_runtime<T>(work: impl Future<Output = Result<T, NodeError>>) -> Result<T, NodeError> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        // These threads only pass messages; the work has its own.
        .worker_threads(2)
        .enable_all()
        .build()
        .map_err(|source| NodeError::System { what: "starting the threads", source })?;
    let done = runtime.block_on(work);
    // Tasks of subscriptions and services never end by themselves.
    runtime.shutdown_timeout(Duration::from_secs(1));
    done
}

async fn run_live(start: &Start) -> Result<(), NodeError> {
    let environment = &start.environment;
    let identity = &start.identity;
    let p = &start.parameters;
    let topics = inputs::topic_names(&start.arguments, identity, p);
    // Invalid settings are refused before the node becomes visible.
    let layers = settings::base_layers(p)?;
    let resolved = settings::run_settings(layers.clone(), p, &topics)?;
    let config = resolved.config.clone();
    // Other programs read results by these paths, and run elsewhere.
    let out_folder = std::path::absolute(&p.out_folder)
        .map_err(|source| NodeError::System { what: "finding the folder of the sessions", source })?;
    // `~/reset` also uses it to continue in the next free folder.
    let next_session: Arc<dyn Fn() -> PathBuf + Send + Sync> = {
        let out = out_folder.clone();
        let name = p.session.clone();
        Arc::new(move || free_folder(&out, &name))
    };
    // A session with a name is continued; one named by time is always new.
    let first = if p.session.is_empty() { next_session() } else { out_folder.join(&p.session) };
    // The folder before the network: a second node with this folder must end before it disturbs the first.
    let lock = SessionLock::take(&first)?;
    let mut participant = start.join_domain()?;
    let clock = Arc::new(NodeClock::new(p.use_sim_time));
    let shared = Arc::new(Shared::default());
    // The collection, the only owner of the collector, has its own thread, as decoding and writing block.
    let collector = Collector::new(settings::collector_settings(p, topics.clone(), &config), &first);
    let watch = settings::watch_rule(p).map(MotionWatch::new);
    let (queue, tracked) = live_tracking::start_thread(settings::track_settings(p, topics.clone(), &config))
        .map_err(|source| NodeError::System { what: "starting the tracker", source })?;
    let live = start_live(p, &config, &shared)?;
    let shown = live.results();
    let (sender, poses) = mpsc::channel(POSE_QUEUE);
    let core = Core::new(
        (collector, lock),
        watch,
        usize::try_from(p.cloud_points).unwrap_or(0),
        Arc::clone(&clock),
        Arc::clone(&shared),
        Tracking { queue, tracked, poses: sender },
        (live, p.live_map),
    );
    let (outbox, inbox) = core_queues(IMAGE_QUEUE);
    let commands = outbox.commands.clone();
    let handle = tokio::runtime::Handle::current();
    let core = tokio::task::spawn_blocking(move || handle.block_on(core.run(inbox)));

    let current = CurrentParameters::new(p.clone(), resolved);
    let parameters = Arc::new(LiveParameters::new(current, layers, topics.clone(), commands.clone()));
    // Only the last twin and report matter, so the channels hold one value.
    let (twins, twin) = watch::channel(None);
    let reconstructor = Arc::new(Reconstructor {
        ahead: work_ahead::start_thread(&shared, &parameters)?,
        parameters: Arc::clone(&parameters),
        shared: Arc::clone(&shared),
        twins,
    });
    let (reports, report) = watch::channel(None);
    let diagnoser = Arc::new(Diagnoser { shared: Arc::clone(&shared), twins: twin.clone(), reports });
    let outputs = Outputs::new(&mut participant, p, Arc::clone(&clock))?;
    let live_outputs = LiveOutputs::new(&mut participant)?.run(shown);
    let context = ServiceContext { commands: commands.clone(), shared: Arc::clone(&shared), next_session };
    services::offer_services(&mut participant, &context)?;
    parameter_services::offer_parameters(&mut participant, &parameters, &clock)?;
    action::offer_action(&mut participant, &clock, Arc::clone(&reconstructor))?;
    action::offer_action(&mut participant, &clock, Arc::clone(&diagnoser))?;
    // Subscriptions come last, when all receivers exist.
    let inputs = inputs::subscribe_topics(&mut participant, p, &topics, &outbox, &clock)?;
    let diagnostics = Diagnostics::new(&identity.fully_qualified_name(), inputs);
    participant.announce_node()?;
    publish_again(&first, &reconstructor, &diagnoser);
    tokio::spawn(outputs.run(OutputSources { twin, report, poses }, shared, diagnostics));
    tokio::spawn(live_outputs);
    log::info!(
        "{} in domain {}, session {}",
        identity.fully_qualified_name(),
        environment.domain,
        first.display()
    );

    end_requested().await?;
    log::info!("ending");
    end_log();
    let (done, ended) = oneshot::channel();
    // The collection closes the open bag; a blocked disk must not keep the node running.
    commands.send(Command::Stop(done)).await.ok();
    tokio::time::timeout(END_WAIT, ended).await.ok();
    tokio::time::timeout(END_WAIT, core).await.ok();
    Ok(())
}

/// Publishes the results of an earlier node again, as latched messages disappear with their publisher.
fn publish_again(session: &Path, reconstructor: &Reconstructor, diagnoser: &Diagnoser) {
    if let Some(twin) = last_twin(session) {
        reconstructor.twins.send_replace(Some(Arc::new(twin)));
    }
    if let Some(report) = last_report(session) {
        diagnoser.reports.send_replace(Some(Arc::new(report)));
    }
}

/// Starts the thread of the live map, which waits for views.
fn start_live(p: &Parameters, config: &Config, shared: &Arc<Shared>) -> Result<LiveQueue, NodeError> {
    let settings = settings::live_settings(p, config);
    let shared = Arc::clone(shared);
    let started = live_map::start_thread(settings, move || shared.is_read());
    started.map_err(|source| NodeError::System { what: "starting the live map", source })
}

/// Queues with this capacity for images.
pub(super) fn core_queues(images: usize) -> (Outbox, Inbox) {
    let (images, image_inbox) = mpsc::channel(images);
    let (small, small_inbox) = mpsc::channel(SMALL_QUEUE);
    let (commands, command_inbox) = mpsc::channel(16);
    (
        Outbox { images, small, commands },
        Inbox { images: image_inbox, small: small_inbox, commands: command_inbox },
    )
}

/// Ends the log, as the middleware logs errors about its own threads during shutdown.
pub(super) fn end_log() {
    log::set_max_level(log::LevelFilter::Off);
}

/// Waits for Ctrl-C or SIGTERM.
pub(super) async fn end_requested() -> Result<(), NodeError> {
    let fail = |source| NodeError::System { what: "listening for signals", source };
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let mut terminate = signal(SignalKind::terminate()).map_err(fail)?;
        tokio::select! {
            done = tokio::signal::ctrl_c() => done.map_err(fail),
            _ = terminate.recv() => Ok(()),
        }
    }
    #[cfg(not(unix))]
    {
        tokio::signal::ctrl_c().await.map_err(fail)
    }
}
