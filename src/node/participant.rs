//! The node's DDS participant: topics with their quality of service, publishers and subscriptions.

use std::{sync::Arc, time::Duration};

use futures::{StreamExt as _, pin_mut};
use ros2_client::{Name, NodeName};
use rustdds::{
    CDRDeserializerAdapter, DomainParticipant, DomainParticipantBuilder, QosPolicies, QosPolicyBuilder,
    RTPSEntity as _, Timestamp, Topic, TopicKind,
    no_key::{DataWriter, DataWriterCdr, DeserializerAdapter, SerializerAdapter, SimpleDataReader},
    policy::{Deadline, Durability, History, Lifespan, Liveliness, Reliability},
};
use serde::Serialize;

use super::{
    dds_names::{endpoint_user_data, topic_dds_name, type_dds_name},
    environment::Environment,
    error::NodeError,
    graph::{Endpoints, GRAPH_TOPIC, GRAPH_TYPE, GraphWriter},
    input_count::InputCount,
    parameters::Parameters,
    peers::Peers,
    ros_args::RosArgs,
    ros_names::checked_full_name,
};
use io::ros2msg::definitions::RosMessage;

/// Least receive buffer that loses no images, bytes.
const GOOD_BUFFER_BYTES: u64 = 4 << 20;
/// Longest time a writer waits for slow readers.
const WAIT: Duration = Duration::from_millis(100);

/// The node's DDS participant.
pub(crate) struct Participant {
    domain: DomainParticipant,
    publisher: rustdds::Publisher,
    subscriber: rustdds::Subscriber,
    graph: GraphWriter,
    endpoints: Endpoints,
    /// What discovery shows of others.
    pub peers: Arc<Peers>,
    /// Number of services offered so far.
    services: u32,
    /// Remappings and other ROS arguments.
    arguments: RosArgs,
    /// Name and namespace of the node.
    pub identity: NodeName,
}

/// Publishes messages of one topic.
pub(crate) struct Publisher<M: Serialize> {
    writer: DataWriterCdr<M>,
}

/// A message could not be published.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the message was not published")]
pub(crate) struct NotPublished;

impl<M: Serialize> Publisher<M> {
    /// Publishes a message; waits for slow readers, but not longer than [`WAIT`].
    ///
    /// # Errors
    /// If it does not fit into the writer's history in time, or the middleware reports an error.
    pub(crate) async fn async_publish(&self, message: M) -> Result<(), NotPublished> {
        match self.writer.async_write(message, Some(Timestamp::now())).await {
            Ok(()) => Ok(()),
            Err(_) => Err(NotPublished),
        }
    }
}

/// Name, type and quality of service of an endpoint.
pub(crate) struct EndpointOptions<'a> {
    /// Name of the topic in DDS.
    pub dds_name: &'a str,
    /// Its ROS type, e.g. `sensor_msgs/msg/Image`.
    pub ros_type: &'a str,
    /// Quality of service.
    pub qos: &'a QosPolicies,
    /// Further `key=value;` of its USER_DATA.
    pub user_data: &'a str,
}

/// Reliable, with `depth` samples.
#[must_use]
pub(crate) fn reliable_profile(depth: usize) -> QosPolicies {
    profile(depth, Durability::Volatile, reliability())
}

/// Best effort, which matches every publisher.
#[must_use]
pub(crate) fn sensor_data(depth: usize) -> QosPolicies {
    profile(depth, Durability::Volatile, Reliability::BestEffort)
}

/// Reliable and latched: late subscribers get the last samples.
#[must_use]
pub(crate) fn latched_profile(depth: usize) -> QosPolicies {
    profile(depth, Durability::TransientLocal, reliability())
}

fn reliability() -> Reliability {
    // A writer without a limit would stop with its slowest reader.
    Reliability::Reliable { max_blocking_time: WAIT.into() }
}

fn profile(depth: usize, durability: Durability, reliability: Reliability) -> QosPolicies {
    let forever = rustdds::Duration::INFINITE;
    QosPolicyBuilder::new()
        .durability(durability)
        .reliability(reliability)
        // Bounded, so that a stopped reader does not fill the writer's memory.
        .history(History::KeepLast { depth: i32::try_from(depth).unwrap_or(i32::MAX) })
        .liveliness(Liveliness::Automatic { lease_duration: forever })
        .deadline(Deadline(forever))
        .lifespan(Lifespan { duration: forever })
        .build()
}

/// The QoS profile with a name.
#[must_use]
pub(crate) fn profile_by_name(profile: &str, depth: usize) -> QosPolicies {
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
        identity: &NodeName,
        parameters: &Parameters,
    ) -> Result<Self, NodeError> {
        let failed = |e: rustdds::dds::result::CreateError| NodeError::network_error("joining the domain", e);
        let mut builder = DomainParticipantBuilder::new(environment.domain)
            .socket_receive_buffer_size(usize::try_from(parameters.receive_buffer_bytes).unwrap_or(8 << 20))
            .same_host_loopback(!environment.is_alone())
            .spdp_peers(environment.discovery_peers());
        // Sockets are bound to these addresses too (vendor/rustdds); the released RustDDS binds to all.
        if let Some(networks) = environment.networks.clone() {
            builder = builder.with_only_networks(networks);
        }
        let domain = builder.build().map_err(failed)?;
        let peers = Peers::follow(&domain, environment.reach);
        let publisher = domain.create_publisher(&QosPolicies::qos_none()).map_err(failed)?;
        let subscriber = domain.create_subscriber(&QosPolicies::qos_none()).map_err(failed)?;
        // As rmw_dds_common: who comes later gets the last state of the graph.
        let qos = latched_profile(1).with_user_data(endpoint_user_data(GRAPH_TYPE, ""));
        let topic = domain
            .create_topic(GRAPH_TOPIC.to_owned(), type_dds_name(GRAPH_TYPE), &qos, TopicKind::NoKey)
            .map_err(failed)?;
        let graph = publisher.create_datawriter_no_key_cdr(&topic, Some(qos)).map_err(failed)?;
        Ok(Self {
            domain,
            publisher,
            subscriber,
            graph,
            endpoints: Endpoints::new(identity),
            peers,
            services: 0,
            arguments: arguments.clone(),
            identity: identity.clone(),
        })
    }

    /// Shows the node with all its endpoints in the ROS graph; after the last one was made.
    ///
    /// # Errors
    /// If the network reports an error.
    pub(crate) fn announce_node(&self) -> Result<(), NodeError> {
        let message = self.endpoints.message(self.domain.guid());
        self.graph
            .write(message, Some(Timestamp::now()))
            .map_err(|e| NodeError::network_error("announcing the node", e))
    }

    /// An identifier of a service that no other service has, as rmw_cyclonedds writes it: bytes with dots.
    pub(crate) fn next_service_id(&mut self) -> String {
        self.services += 1;
        let participant = self.domain.guid().to_bytes();
        let bytes =
            participant[..12].iter().chain(&self.services.to_be_bytes()).copied().collect::<Vec<u8>>();
        bytes.iter().map(|b| format!("{b:x}")).collect::<Vec<_>>().join(".")
    }

    /// A name after expansion and remapping.
    #[must_use]
    pub(crate) fn resolved_name(&self, name: &str) -> String {
        self.arguments.resolved_name(name, &self.identity)
    }

    /// A name after expansion and remapping, checked.
    ///
    /// # Errors
    /// If the name is invalid.
    pub(crate) fn checked_name(&self, name: &str) -> Result<Name, NodeError> {
        let full = self.resolved_name(name);
        checked_full_name(&full).map_err(|reason| NodeError::Name { name: full, reason })
    }

    /// Creates the topic of an endpoint, with the endpoint's quality of service.
    fn create_topic(&self, options: &EndpointOptions<'_>) -> Result<(Topic, QosPolicies), NodeError> {
        let user_data = endpoint_user_data(options.ros_type, options.user_data);
        let qos = options.qos.clone().with_user_data(user_data);
        let name = options.dds_name.to_owned();
        match self.domain.create_topic(name, type_dds_name(options.ros_type), &qos, TopicKind::NoKey) {
            Ok(topic) => Ok((topic, qos)),
            Err(e) => Err(NodeError::network_error(&format!("making the topic {}", options.dds_name), e)),
        }
    }

    /// Creates a writer with its own serialization.
    ///
    /// # Errors
    /// If the network reports an error.
    pub(crate) fn create_writer<M, S: SerializerAdapter<M>>(
        &mut self,
        options: &EndpointOptions<'_>,
    ) -> Result<DataWriter<M, S>, NodeError> {
        let (topic, qos) = self.create_topic(options)?;
        let writer = self
            .publisher
            .create_datawriter_no_key::<M, S>(&topic, Some(qos))
            .map_err(|e| NodeError::network_error(&format!("publishing {}", options.dds_name), e))?;
        self.endpoints.add_writer(writer.guid());
        Ok(writer)
    }

    /// Creates a reader with its own deserialization.
    ///
    /// # Errors
    /// If the network reports an error.
    pub(crate) fn create_reader<M: 'static, D: DeserializerAdapter<M> + 'static>(
        &mut self,
        options: &EndpointOptions<'_>,
    ) -> Result<SimpleDataReader<M, D>, NodeError> {
        let (topic, qos) = self.create_topic(options)?;
        let reader = self
            .subscriber
            .create_simple_datareader_no_key::<M, D>(&topic, Some(qos))
            .map_err(|e| NodeError::network_error(&format!("subscribing to {}", options.dds_name), e))?;
        self.endpoints.add_reader(reader.guid());
        Ok(reader)
    }

    /// Creates a publisher of messages without a `RosMessage`, by their ROS type; keep it, as its latched
    /// messages disappear with it.
    ///
    /// # Errors
    /// If the name is invalid or the network reports an error.
    pub(crate) fn create_publisher_of_type<M: Serialize>(
        &mut self,
        name: &str,
        ros_type: &str,
        qos: &QosPolicies,
    ) -> Result<Publisher<M>, NodeError> {
        let dds_name = topic_dds_name(&self.checked_name(name)?, &self.identity);
        let options = EndpointOptions { dds_name: &dds_name, ros_type, qos, user_data: "" };
        Ok(Publisher { writer: self.create_writer(&options)? })
    }

    /// Creates a publisher; keep it, as its latched messages disappear with it.
    ///
    /// # Errors
    /// If the name is invalid or the network reports an error.
    pub(crate) fn create_publisher<M: RosMessage>(
        &mut self,
        name: &str,
        qos: &QosPolicies,
    ) -> Result<Publisher<M>, NodeError> {
        self.create_publisher_of_type(name, M::TYPE, qos)
    }

    /// Passes on every message of a topic (by full name) while the node runs; undecodable messages are
    /// counted.
    ///
    /// # Errors
    /// If the name is invalid or the network reports an error.
    pub(crate) fn subscribe_topic<M: RosMessage>(
        &mut self,
        name: &str,
        qos: &QosPolicies,
        count: Arc<InputCount>,
        mut take: impl FnMut(M) + Send + 'static,
    ) -> Result<(), NodeError> {
        let dds_name = topic_dds_name(&self.checked_name(name)?, &self.identity);
        let options = EndpointOptions { dds_name: &dds_name, ros_type: M::TYPE, qos, user_data: "" };
        let reader = self.create_reader::<M, CDRDeserializerAdapter<M>>(&options)?;
        let name = name.to_owned();
        tokio::spawn(async move {
            let stream = reader.as_async_stream();
            pin_mut!(stream);
            while let Some(sample) = stream.next().await {
                match sample {
                    Ok(sample) => {
                        count.count_received(
                            sample.writer_guid().to_bytes(),
                            i64::from(sample.sequence_number),
                        );
                        take(sample.into_value());
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
