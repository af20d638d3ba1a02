//! The node in the ROS graph: `ros_discovery_info` says which endpoints belong to which node.

use ros2_client::{
    Gid, NodeName,
    entities_info::{NodeEntitiesInfo, ParticipantEntitiesInfo},
};
use rustdds::{GUID, no_key::DataWriterCdr};

/// DDS name of the topic.
pub(crate) const GRAPH_TOPIC: &str = "ros_discovery_info";
/// ROS type of the topic.
pub(crate) const GRAPH_TYPE: &str = "rmw_dds_common/msg/ParticipantEntitiesInfo";

/// The node's endpoints.
#[derive(Clone, Debug)]
pub(crate) struct Endpoints {
    node: NodeEntitiesInfo,
}

impl Endpoints {
    /// No endpoints of a node.
    #[must_use]
    pub(crate) fn new(node: &NodeName) -> Self {
        Self { node: NodeEntitiesInfo::new(node.clone()) }
    }

    /// Adds a reader.
    pub(crate) fn add_reader(&mut self, guid: GUID) {
        self.node.add_reader(Gid::from(guid));
    }

    /// Adds a writer.
    pub(crate) fn add_writer(&mut self, guid: GUID) {
        self.node.add_writer(Gid::from(guid));
    }

    /// The message that says what belongs to the node of a participant.
    #[must_use]
    pub(crate) fn message(&self, participant: GUID) -> ParticipantEntitiesInfo {
        ParticipantEntitiesInfo::new(Gid::from(participant), vec![self.node.clone()])
    }
}

/// Writer of the graph's topic.
pub(crate) type GraphWriter = DataWriterCdr<ParticipantEntitiesInfo>;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service_server::tests::cdr;

    #[test]
    fn the_message_has_the_bytes_of_its_definition() {
        let mut endpoints = Endpoints::new(&NodeName::new("/lab", "twin").unwrap());
        endpoints.add_reader(GUID::from_bytes([2; 16]));
        endpoints.add_writer(GUID::from_bytes([3; 16]));
        let message = endpoints.message(GUID::from_bytes([1; 16]));
        let node = ("/lab", "twin", vec![[2_u8; 16]], vec![[3_u8; 16]]);
        assert_eq!(cdr(&message), cdr(&([1_u8; 16], vec![node])));
    }
}
