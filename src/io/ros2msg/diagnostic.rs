//! `diagnostic_msgs`.

use serde::{Deserialize, Serialize};

use super::Header;

/// `diagnostic_msgs/msg/KeyValue`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeyValue {
    /// Key.
    pub key: String,
    /// Value, as text.
    pub value: String,
}

/// `diagnostic_msgs/msg/DiagnosticStatus`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnosticStatus {
    /// 0 OK, 1 warning, 2 error, 3 stale.
    pub level: u8,
    /// Its subject: `node: part`.
    pub name: String,
    /// A sentence.
    pub message: String,
    /// The device.
    pub hardware_id: String,
    /// Details as keys and values.
    pub values: Vec<KeyValue>,
}

/// `diagnostic_msgs/msg/DiagnosticArray`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DiagnosticArray {
    /// Stamp of the statuses.
    pub header: Header,
    /// One status per part.
    pub status: Vec<DiagnosticStatus>,
}
