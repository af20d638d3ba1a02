//! The node's DDS participant: topics with their quality of service, publishers and subscriptions.

use std::{sync::Arc, time::Duration};

use futures::{StreamExt as _, pin_mut};
use ros2_client::{
    Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile,
    qos::{Durability, History, WhenFull},
};

use super::{
    environment::Environment,
    error::NodeError,
    input_count::InputCount,
    parameters::Parameters,
    ros_args::RosArgs,
    ros_names::{NameError, NodeIdentity, check_full_name},
};
use io::ros2msg::definitions::RosMessage;

/// Least receive buffer that loses no images, bytes.
const GOOD_BUFFER_BYTES: u64 = 4 << 20;
/// Longest time a writer waits for slow readers.
const WAIT: Duration = Duration::from_millis(100);

/// The node's DDS participant.
pub(crate) struct Participant {
    node: Node,
    /// Remappings and other ROS arguments.
    arguments: RosArgs,
    /// Name and namespace of the node.
    pub identity: NodeIdentity,
}

/// Reliable, with `depth` samples.
#[must_use]
pub(crate) fn reliable_profile(depth: usize) -> QosProfile {
    QosProfile::publisher_default()
        // A writer without a limit would stop with its slowest reader.
        .reliability_reliable(WhenFull::Wait(WAIT))
        .durability(Durability::Volatile)
        // Bounded, so that a stopped reader does not fill the writer's memory.
        .history(History::KeepLast { depth })
}

/// Best effort, which matches every publisher.
#[must_use]
pub(crate) fn sensor_data(depth: usize) -> QosProfile {
    reliable_profile(depth).reliability_best_effort()
}

/// Reliable and latched: late subscribers get the last samples.
#[must_use]
pub(crate) fn latched_profile(depth: usize) -> QosProfile {
    reliable_profile(depth).durability(Durability::TransientLocal)
}

/// The QoS profile with a name.
#[must_use]
pub(crate) fn profile_by_name(profile: &str, depth: usize) -> QosProfile {
    if profile == "default" { reliable_profile(depth) } else { sensor_data(depth) }
}

impl Participant {
    /// Joins the DDS domain.
    ///
    /// # Errors
    /// If the network reports an error or a name is invalid.
    pub(crate) fn join_domain(
        environment: &Environment,
        arguments: &RosArgs,
        identity: &NodeIdentity,
        parameters: &Parameters,
    ) -> Result<Self, NodeError> {
        let mut builder = rustdds::DomainParticipantBuilder::new(environment.domain)
            .socket_receive_buffer_size(usize::try_from(parameters.receive_buffer_bytes).unwrap_or(8 << 20));
        // Sockets are bound to these addresses too (vendor/rustdds); the released RustDDS binds to all.
        if let Some(networks) = environment.networks() {
            builder = builder.with_only_networks(networks);
        }
        let participant = builder.build().map_err(|e| NodeError::network_error("joining the domain", e))?;
        let context = Context::from_domain_participant(participant)
            .map_err(|e| NodeError::network_error("joining the domain", e))?;
        let name = NodeName::new(&identity.namespace, &identity.name)
            .map_err(|e| NodeError::network_error("naming the node", e))?;
        let mut options = NodeOptions::new().enable_rosout(!arguments.no_rosout);
        // Declared for `ros2 param`. They are read only at the start, so changes are refused.
        for (name, value) in super::parameter_values::declared_values(parameters) {
            options = options.declare_parameter(&name, value);
        }
        let options =
            options.parameter_validator(Box::new(super::parameter_values::refuse_changes(parameters)));
        let node =
            context.new_node(name, options).map_err(|e| NodeError::network_error("making the node", e))?;
        Ok(Self { node, arguments: arguments.clone(), identity: identity.clone() })
    }

    /// Starts the library's own tasks: parameters, discovery.
    ///
    /// # Errors
    /// If the network reports an error.
    pub(crate) fn start_spinner(&mut self) -> Result<(), NodeError> {
        let spinner = self.node.spinner().map_err(|e| NodeError::network_error("starting the node", e))?;
        tokio::spawn(async move {
            if let Err(error) = spinner.spin().await {
                log::error!("the node's own work ended: {error}");
            }
        });
        Ok(())
    }

    /// The library's node, for services and actions.
    pub(crate) fn node(&mut self) -> &mut Node {
        &mut self.node
    }

    /// A name after expansion and remapping.
    #[must_use]
    pub(crate) fn resolved_name(&self, name: &str) -> String {
        self.arguments.resolved_name(name, &self.identity)
    }

    /// The library's type for a name, after expansion and remapping.
    ///
    /// # Errors
    /// If the name is invalid.
    pub(crate) fn library_name(&self, name: &str) -> Result<Name, NodeError> {
        library_name(&self.resolved_name(name))
    }

    /// Creates a topic by its full name.
    fn create_topic<M: RosMessage>(&self, full: &str, qos: &QosProfile) -> Result<rustdds::Topic, NodeError> {
        // The type on the wire is `sensor_msgs::msg::dds_::Image_`; the library builds it from both names.
        let (package, kind) = M::TYPE.split_once("/msg/").unwrap_or(("", M::TYPE));
        let name = library_name(full)?;
        self.node
            .create_topic(&name, MessageTypeName::new(package, kind), qos)
            .map_err(|e| NodeError::network_error(&format!("making the topic {name}"), e))
    }

    /// Creates a publisher; keep it, as its latched messages disappear with it.
    ///
    /// # Errors
    /// If the name is invalid or the network reports an error.
    pub(crate) fn create_publisher<M: RosMessage>(
        &mut self,
        name: &str,
        qos: &QosProfile,
    ) -> Result<Publisher<M>, NodeError> {
        let topic = self.create_topic::<M>(&self.resolved_name(name), qos)?;
        self.node
            .create_publisher(&topic, None)
            .map_err(|e| NodeError::network_error(&format!("publishing {name}"), e))
    }

    /// Passes on every message of a topic (by full name) while the node runs; undecodable messages are
    /// counted.
    ///
    /// # Errors
    /// If the name is invalid or the network reports an error.
    pub(crate) fn subscribe_topic<M: RosMessage>(
        &mut self,
        name: &str,
        qos: &QosProfile,
        count: Arc<InputCount>,
        mut take: impl FnMut(M) + Send + 'static,
    ) -> Result<(), NodeError> {
        let topic = self.create_topic::<M>(name, qos)?;
        let subscription = self
            .node
            .create_subscription::<M>(&topic, None)
            .map_err(|e| NodeError::network_error(&format!("subscribing to {name}"), e))?;
        let name = name.to_owned();
        tokio::spawn(async move {
            let stream = subscription.async_stream();
            pin_mut!(stream);
            while let Some(message) = stream.next().await {
                match message {
                    Ok((message, info)) => {
                        count.count_received(gid_bytes(&info), info.sequence_number());
                        take(message);
                    }
                    // A malformed message is counted and must not end the subscription.
                    Err(error) => {
                        count.count_malformed();
                        log::debug!("{name}: {error}");
                    }
                }
            }
        });
        Ok(())
    }
}

fn library_name(full: &str) -> Result<Name, NodeError> {
    check_full_name(full).map_err(|reason| NodeError::Name { name: full.to_owned(), reason })?;
    Name::parse(full)
        .map_err(|e| NodeError::Name { name: full.to_owned(), reason: NameError::Middleware(e.to_string()) })
}

/// Identifier of the publisher.
fn gid_bytes(info: &ros2_client::MessageInfo) -> [u8; 16] {
    *info.publisher_gid().as_bytes()
}

/// A warning if the system's receive buffer is too small for images.
#[must_use]
pub(crate) fn small_buffer_warning() -> Option<String> {
    // The kernel limits larger requests silently. Measured with 212,992 bytes, the default of Linux: half of
    // the reliable and nine tenths of the best-effort images of 640 x 480 at 30 Hz were lost.
    let text = std::fs::read_to_string("/proc/sys/net/core/rmem_max").ok()?;
    let bytes: u64 = text.trim().parse().ok()?;
    (bytes < GOOD_BUFFER_BYTES).then(|| {
        format!(
            "net.core.rmem_max is {bytes} bytes: images will be lost; raise it with \
             `sysctl -w net.core.rmem_max=8388608 net.core.rmem_default=8388608`"
        )
    })
}
