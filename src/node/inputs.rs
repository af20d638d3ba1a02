//! The subscriptions of the node, each with its counts.

use std::sync::Arc;

use ros2_client::NodeName;
use tokio::sync::mpsc::{self, error::TrySendError};

use super::{
    clock::NodeClock,
    collection::Command,
    error::NodeError,
    input_count::InputCount,
    parameters::Parameters,
    participant::{Participant, latched_profile, profile_by_name, reliable_profile, sensor_data},
    ros_args::RosArgs,
    sample::{Picture, Sample},
    state_bag::Topics,
};
use io::ros2msg::{
    CameraInfo, CompressedImage, Image, PoseStamped, definitions::RosMessage, odometry::FullOdometry,
    text::Clock,
};

/// Queue length for transforms, as a robot's tree comes in many small messages.
const TF_DEPTH: usize = 100;

/// Name and counts of a subscription.
#[derive(Clone, Debug)]
pub(crate) struct Input {
    /// Role of the topic.
    pub role: &'static str,
    /// Name of the topic.
    pub topic: String,
    /// Its counts.
    pub count: Arc<InputCount>,
}

/// Channels to the collection thread.
#[derive(Clone)]
pub(crate) struct Outbox {
    /// Image messages.
    pub images: mpsc::Sender<Sample>,
    /// All other messages.
    pub small: mpsc::Sender<Sample>,
    /// Commands.
    pub commands: mpsc::Sender<Command>,
}

/// Names of the subscribed topics after remapping.
#[must_use]
pub(crate) fn topic_names(arguments: &RosArgs, node: &NodeName, p: &Parameters) -> Topics {
    let resolve = |name: &str| arguments.resolved_name(name, node);
    // An empty parameter means not given, as ROS parameters have no null.
    let given = |name: &str| (!name.is_empty()).then(|| resolve(name));
    Topics {
        color: resolve(&image_topic(&p.color_topic, &p.color_transport)),
        depth: resolve(&image_topic(&p.depth_topic, &p.depth_transport)),
        color_info: resolve(&p.camera_info_topic),
        depth_info: given(&p.depth_info_topic),
        mask: (!p.mask_topic.is_empty()).then(|| resolve(&image_topic(&p.mask_topic, &p.mask_transport))),
        pose: given(&p.pose_topic).map(|name| (name, p.pose_type == "odometry")),
    }
}

/// Image transports append their name to that of the raw topic.
fn image_topic(name: &str, transport: &str) -> String {
    match transport {
        "raw" => name.to_owned(),
        other => format!("{name}/{other}"),
    }
}

/// Creates subscriptions.
struct Subscriber<'a> {
    participant: &'a mut Participant,
    outbox: &'a Outbox,
    inputs: Vec<Input>,
}

impl Subscriber<'_> {
    /// Subscribes to a topic and forwards its messages; those that find the queue full are counted.
    fn add_topic<M: RosMessage>(
        &mut self,
        role: &'static str,
        topic: &str,
        qos: &rustdds::QosPolicies,
        wrap: impl Fn(M) -> Sample + Send + 'static,
    ) -> Result<(), NodeError> {
        let count = Arc::new(InputCount::default());
        // Images have their own queue, so that they cannot displace their transforms.
        let images = matches!(role, "color" | "depth" | "mask");
        let sink = if images { self.outbox.images.clone() } else { self.outbox.small.clone() };
        let overrun = Arc::clone(&count);
        self.participant.subscribe_topic(topic, qos, Arc::clone(&count), move |message: M| {
            // Never blocks: if the collection is busy, images are dropped and counted instead of blocking the
            // middleware.
            if let Err(TrySendError::Full(_)) = sink.try_send(wrap(message)) {
                overrun.count_overrun();
            }
        })?;
        self.inputs.push(Input { role, topic: topic.to_owned(), count });
        Ok(())
    }

    fn add_image_topic(
        &mut self,
        role: &'static str,
        topic: &str,
        raw: bool,
        qos: &rustdds::QosPolicies,
        wrap: fn(Picture) -> Sample,
    ) -> Result<(), NodeError> {
        match raw {
            true => self.add_topic(role, topic, qos, move |m: Image| wrap(Picture::Raw(m))),
            false => self.add_topic(role, topic, qos, move |m: CompressedImage| wrap(Picture::Compressed(m))),
        }
    }
}

/// Subscribes to all topics of the parameters.
///
/// # Errors
/// If a name is invalid or the network reports an error.
pub(crate) fn subscribe_topics(
    participant: &mut Participant,
    p: &Parameters,
    topics: &Topics,
    outbox: &Outbox,
    clock: &Arc<NodeClock>,
) -> Result<Vec<Input>, NodeError> {
    let depth = usize::try_from(p.queue_depth).unwrap_or(10);
    let images = profile_by_name(&p.image_qos, depth);
    let infos = profile_by_name(&p.info_qos, depth);
    let mut s = Subscriber { participant, outbox, inputs: Vec::new() };
    let tf = s.participant.resolved_name("/tf");
    let tf_static = s.participant.resolved_name("/tf_static");
    // Explicit profiles, as the library's default is best effort with a depth of 1. Best effort matches every
    // publisher; reliable does not, and a mismatch is silent. tf2 publishes reliably, with /tf_static
    // latched.
    s.add_topic("tf", &tf, &reliable_profile(TF_DEPTH), Sample::Transforms)?;
    s.add_topic("tf_static", &tf_static, &latched_profile(TF_DEPTH), Sample::StaticTransforms)?;
    s.add_image_topic("color", &topics.color, p.color_transport == "raw", &images, Sample::Color)?;
    s.add_image_topic("depth", &topics.depth, p.depth_transport == "raw", &images, Sample::Depth)?;
    if let Some(mask) = &topics.mask {
        s.add_image_topic("mask", mask, p.mask_transport == "raw", &images, Sample::Mask)?;
    }
    s.add_topic("camera_info", &topics.color_info, &infos, |m: CameraInfo| Sample::ColorInfo(Box::new(m)))?;
    // If both use one topic, a second subscription would duplicate messages.
    if let Some(info) = topics.depth_info.as_ref().filter(|t| **t != topics.color_info) {
        s.add_topic("depth_info", info, &infos, |m: CameraInfo| Sample::DepthInfo(Box::new(m)))?;
    }
    match &topics.pose {
        Some((topic, true)) => s.add_topic("pose", topic, &sensor_data(TF_DEPTH), |m: FullOdometry| {
            Sample::Odometry(Box::new(m))
        })?,
        Some((topic, false)) => {
            s.add_topic("pose", topic, &sensor_data(TF_DEPTH), |m: PoseStamped| Sample::Pose(m))?
        }
        None => {}
    }
    let mut inputs = s.inputs;
    if p.use_sim_time {
        let count = Arc::new(InputCount::default());
        let clock = Arc::clone(clock);
        let commands = outbox.commands.clone();
        let topic = participant.resolved_name("/clock");
        participant.subscribe_topic(&topic, &sensor_data(1), Arc::clone(&count), move |m: Clock| {
            // After a restarted replay or a reset simulator, waiting images are from another time.
            if clock.set_time(m.clock) {
                commands.try_send(Command::TimeJump).ok();
            }
        })?;
        inputs.push(Input { role: "clock", topic, count });
    }
    Ok(inputs)
}
