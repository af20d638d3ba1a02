//! The messages of ROS 2's parameter and logger services, those of ros2-client, with what they lack.

use serde::{Deserialize, Serialize};
use serde_norway::Value;

pub(crate) use ros2_client::{
    ParameterValue as TypedValue,
    parameters::raw::{
        FloatingPointRange, IntegerRange, Parameter, ParameterDescriptor, ParameterEvent, ParameterType,
        ParameterValue, SetParametersResult,
    },
    rcl_interfaces::{
        DescribeParametersRequest, DescribeParametersResponse, GetParameterTypesRequest,
        GetParameterTypesResponse, GetParametersRequest, GetParametersResponse, ListParametersRequest,
        ListParametersResponse, ListParametersResult, SetParametersAtomicallyResponse, SetParametersRequest,
        SetParametersResponse,
    },
};

/// A parameter's value as a message.
#[must_use]
pub(crate) fn value_from_yaml(value: &Value) -> ParameterValue {
    let typed = match value {
        Value::Bool(b) => TypedValue::Boolean(*b),
        Value::Number(n) => match n.as_i64() {
            Some(i) => TypedValue::Integer(i),
            None => TypedValue::Double(n.as_f64().unwrap_or(f64::NAN)),
        },
        Value::String(s) => TypedValue::String(s.clone()),
        Value::Sequence(list) => {
            TypedValue::StringArray(list.iter().filter_map(|v| v.as_str().map(str::to_owned)).collect())
        }
        _ => TypedValue::NotSet,
    };
    typed.into()
}

/// The value of a message; `None` for types that no parameter of this node has.
#[must_use]
pub(crate) fn value_to_yaml(value: &ParameterValue) -> Option<Value> {
    match TypedValue::from(value.clone()) {
        TypedValue::Boolean(b) => Some(Value::from(b)),
        TypedValue::Integer(i) => Some(Value::from(i)),
        TypedValue::Double(d) => Some(Value::from(d)),
        TypedValue::String(s) => Some(Value::from(s)),
        TypedValue::StringArray(list) => Some(list.into_iter().map(Value::from).collect()),
        _ => None,
    }
}

// ros2-client has no messages of loggers.

/// Request of `GetLoggerLevels`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
pub(crate) struct GetLoggerLevelsRequest {
    /// Names of loggers.
    pub names: Vec<String>,
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

/// Response of `SetLoggerLevels`; `SetLoggerLevelsResult` has the fields of `SetParametersResult`.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SetLoggerLevelsResponse {
    /// A result a logger.
    pub results: Vec<SetParametersResult>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service_server::tests::cdr;

    #[test]
    fn values_have_the_bytes_of_their_definition_and_are_read_back() {
        let list: Value = ["a", "bc"].into_iter().map(Value::from).collect();
        for (value, kind, bool_value, integer_value, double_value, text, texts) in [
            (Value::Null, 0_u8, false, 0_i64, 0.0_f64, "", vec![]),
            (Value::from(true), 1, true, 0, 0.0, "", vec![]),
            (Value::from(-5), 2, false, -5, 0.0, "", vec![]),
            (Value::from(2.5), 3, false, 0, 2.5, "", vec![]),
            (Value::from("abc"), 4, false, 0, 0.0, "abc", vec![]),
            (list, 9, false, 0, 0.0, "", vec!["a", "bc"]),
        ] {
            let message = value_from_yaml(&value);
            // In the order of ParameterValue.msg, as a list of bytes, truth values, integers, reals, texts.
            let scalars = (kind, bool_value, integer_value, double_value, text);
            let lists = (Vec::<u8>::new(), Vec::<bool>::new(), Vec::<i64>::new(), Vec::<f64>::new(), texts);
            assert_eq!(cdr(&message), cdr(&(scalars, lists)), "{value:?}");
            assert_eq!(value_to_yaml(&message), Some(value).filter(|v| !v.is_null()));
        }
    }

    #[test]
    fn descriptors_have_the_bytes_of_their_definition() {
        let found = ParameterDescriptor {
            name: "parts".to_owned(),
            r#type: ParameterType::INTEGER,
            description: "d".to_owned(),
            additional_constraints: "c".to_owned(),
            read_only: true,
            dynamic_typing: false,
            floating_point_range: vec![FloatingPointRange { from_value: 1.0, to_value: 2.0, step: 0.0 }],
            integer_range: vec![IntegerRange { from_value: -1, to_value: 16, step: 1 }],
        };
        let head = ("parts", 2_u8, "d", "c", true, false);
        let ranges = (vec![(1.0_f64, 2.0_f64, 0.0_f64)], vec![(-1_i64, 16_i64, 1_u64)]);
        assert_eq!(cdr(&found), cdr(&(head, ranges)));
    }
}
