//! The messages of ROS 2's parameter and logger services (`rcl_interfaces`).

use serde::{Deserialize, Serialize};
use serde_norway::Value;

use io::ros2msg::Time;

/// Values of `ParameterValue.type`; 0 is not set.
mod kind {
    pub(super) const BOOL: u8 = 1;
    pub(super) const INTEGER: u8 = 2;
    pub(super) const DOUBLE: u8 = 3;
    pub(super) const STRING: u8 = 4;
    pub(super) const STRING_ARRAY: u8 = 9;
}

/// `rcl_interfaces/msg/ParameterValue`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct ParameterValue {
    /// One of [`kind`]; it says which of the others counts.
    pub kind: u8,
    bool_value: bool,
    integer_value: i64,
    double_value: f64,
    string_value: String,
    byte_array_value: Vec<u8>,
    bool_array_value: Vec<bool>,
    integer_array_value: Vec<i64>,
    double_array_value: Vec<f64>,
    string_array_value: Vec<String>,
}

impl ParameterValue {
    /// A parameter's value as a message.
    #[must_use]
    pub(crate) fn from_yaml(value: &Value) -> Self {
        let unset = Self::default();
        match value {
            Value::Bool(b) => Self { kind: kind::BOOL, bool_value: *b, ..unset },
            Value::Number(n) => match n.as_i64() {
                Some(i) => Self { kind: kind::INTEGER, integer_value: i, ..unset },
                None => Self { kind: kind::DOUBLE, double_value: n.as_f64().unwrap_or(f64::NAN), ..unset },
            },
            Value::String(s) => Self { kind: kind::STRING, string_value: s.clone(), ..unset },
            Value::Sequence(list) => Self {
                kind: kind::STRING_ARRAY,
                string_array_value: list.iter().filter_map(|v| v.as_str().map(str::to_owned)).collect(),
                ..unset
            },
            _ => unset,
        }
    }

    /// The value of a message; `None` for kinds that no parameter of this node has.
    #[must_use]
    pub(crate) fn to_yaml(&self) -> Option<Value> {
        match self.kind {
            kind::BOOL => Some(Value::from(self.bool_value)),
            kind::INTEGER => Some(Value::from(self.integer_value)),
            kind::DOUBLE => Some(Value::from(self.double_value)),
            kind::STRING => Some(Value::from(self.string_value.as_str())),
            kind::STRING_ARRAY => {
                Some(self.string_array_value.iter().map(|s| Value::from(s.as_str())).collect())
            }
            _ => None,
        }
    }
}

/// `rcl_interfaces/msg/Parameter`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Parameter {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: ParameterValue,
}

/// `rcl_interfaces/msg/FloatingPointRange`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct FloatingPointRange {
    /// Least value.
    pub from_value: f64,
    /// Largest value.
    pub to_value: f64,
    /// 0: every value between.
    pub step: f64,
}

/// `rcl_interfaces/msg/IntegerRange`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct IntegerRange {
    /// Least value.
    pub from_value: i64,
    /// Largest value.
    pub to_value: i64,
    /// 1: every value between.
    pub step: u64,
}

/// `rcl_interfaces/msg/ParameterDescriptor`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct ParameterDescriptor {
    /// Its name.
    pub name: String,
    /// One of [`kind`].
    pub kind: u8,
    /// What it does.
    pub description: String,
    /// Allowed values, and why it cannot be set.
    pub additional_constraints: String,
    /// Whether it cannot be set while the node runs.
    pub read_only: bool,
    /// Whether its type may change; never here.
    pub dynamic_typing: bool,
    /// At most one.
    pub floating_point_range: Vec<FloatingPointRange>,
    /// At most one.
    pub integer_range: Vec<IntegerRange>,
}

/// Requests of the services that are asked about parameters by name.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
pub(crate) struct NamesRequest {
    /// Names.
    pub names: Vec<String>,
}

/// Response of `GetParameters`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct GetParametersResponse {
    /// A value a name; not set where there is no such parameter.
    pub values: Vec<ParameterValue>,
}

/// Response of `GetParameterTypes`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct GetParameterTypesResponse {
    /// A type a name.
    pub types: Vec<u8>,
}

/// Response of `DescribeParameters`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct DescribeParametersResponse {
    /// A descriptor a name.
    pub descriptors: Vec<ParameterDescriptor>,
}

/// Request of `ListParameters`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
pub(crate) struct ListParametersRequest {
    /// Only parameters with one of these prefixes; empty: all.
    pub prefixes: Vec<String>,
    /// How deep; no parameter of this node has a prefix.
    pub depth: u64,
}

/// Response of `ListParameters`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct ListParametersResponse {
    /// `rcl_interfaces/msg/ListParametersResult`: names and prefixes.
    pub result: (Vec<String>, Vec<String>),
}

/// Request of `SetParameters` and `SetParametersAtomically`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub(crate) struct SetParametersRequest {
    /// Parameters with their new values.
    pub parameters: Vec<Parameter>,
}

/// `rcl_interfaces/msg/SetParametersResult` and `SetLoggerLevelsResult`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct SetResult {
    /// Whether it was set.
    pub successful: bool,
    /// Why not.
    pub reason: String,
}

/// Response of `SetParameters` and `SetLoggerLevels`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct SetResultsResponse {
    /// A result each.
    pub results: Vec<SetResult>,
}

/// Response of `SetParametersAtomically`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct SetAtomicallyResponse {
    /// One result for all.
    pub result: SetResult,
}

/// `rcl_interfaces/msg/ParameterEvent`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct ParameterEvent {
    /// When it was.
    pub stamp: Time,
    /// Full name of the node.
    pub node: String,
    /// Declared parameters.
    pub new_parameters: Vec<Parameter>,
    /// Changed parameters.
    pub changed_parameters: Vec<Parameter>,
    /// Deleted parameters.
    pub deleted_parameters: Vec<Parameter>,
}

/// `rcl_interfaces/msg/LoggerLevel`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct LoggerLevel {
    /// Name of the logger: that of the node.
    pub name: String,
    /// 10 debug, 20 info, 30 warn, 40 error, 50 fatal; 0: that of the start.
    pub level: u32,
}

/// Levels of loggers: response of `GetLoggerLevels`, request of `SetLoggerLevels`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct LoggerLevels {
    /// A level a logger.
    pub levels: Vec<LoggerLevel>,
}

impl From<Result<(), String>> for SetResult {
    fn from(result: Result<(), String>) -> Self {
        match result {
            Ok(()) => Self { successful: true, reason: String::new() },
            Err(reason) => Self { successful: false, reason },
        }
    }
}
