//! The node in the ROS graph: `ros_discovery_info` says which endpoints belong to which node.

use rustdds::{GUID, no_key::DataWriterCdr};
use serde::{Deserialize, Serialize};

use super::ros_names::NodeIdentity;

/// DDS name of the topic.
pub(crate) const GRAPH_TOPIC: &str = "ros_discovery_info";
/// ROS type of the topic.
pub(crate) const GRAPH_TYPE: &str = "rmw_dds_common/msg/ParticipantEntitiesInfo";

/// `rmw_dds_common/msg/Gid` from Iron on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Gid {
    data: [u8; 16],
}

/// `rmw_dds_common/msg/NodeEntitiesInfo`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct NodeEntitiesInfo {
    node_namespace: String,
    node_name: String,
    reader_gid_seq: Vec<Gid>,
    writer_gid_seq: Vec<Gid>,
}

/// `rmw_dds_common/msg/ParticipantEntitiesInfo`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct ParticipantEntitiesInfo {
    gid: Gid,
    node_entities_info_seq: Vec<NodeEntitiesInfo>,
}

/// The node's endpoints.
#[derive(Clone, Debug, Default)]
pub(crate) struct Endpoints {
    readers: Vec<Gid>,
    writers: Vec<Gid>,
}

impl Endpoints {
    /// Adds a reader.
    pub(crate) fn add_reader(&mut self, guid: GUID) {
        self.readers.push(gid_of_guid(guid));
    }

    /// Adds a writer.
    pub(crate) fn add_writer(&mut self, guid: GUID) {
        self.writers.push(gid_of_guid(guid));
    }

    /// The message that says what belongs to the node of a participant.
    #[must_use]
    pub(crate) fn message(&self, participant: GUID, node: &NodeIdentity) -> ParticipantEntitiesInfo {
        ParticipantEntitiesInfo {
            gid: gid_of_guid(participant),
            node_entities_info_seq: vec![NodeEntitiesInfo {
                node_namespace: node.namespace.clone(),
                node_name: node.name.clone(),
                reader_gid_seq: self.readers.clone(),
                writer_gid_seq: self.writers.clone(),
            }],
        }
    }
}

/// Writer of the graph's topic.
pub(crate) type GraphWriter = DataWriterCdr<ParticipantEntitiesInfo>;

fn gid_of_guid(guid: GUID) -> Gid {
    Gid { data: guid.to_bytes() }
}
