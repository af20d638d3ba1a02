//! Parameters for the parameter services. They are read at the start; changes are refused.

use ros2_client::{ParameterValue, parameters::SetParametersResult};
use serde_norway::Value;

use super::parameters::Parameters;

/// Names and values of all parameters.
#[must_use]
pub(crate) fn declared_values(parameters: &Parameters) -> Vec<(String, ParameterValue)> {
    let mut declared = Vec::new();
    for (name, value) in parameters.to_mapping() {
        // The library itself declares `use_sim_time`.
        if let Some(name) = name.as_str().filter(|name| *name != "use_sim_time") {
            declared.push((name.to_owned(), ros_value(&value)));
        }
    }
    declared
}

fn ros_value(value: &Value) -> ParameterValue {
    match value {
        Value::Bool(b) => ParameterValue::Boolean(*b),
        Value::Number(n) => match n.as_i64() {
            Some(i) => ParameterValue::Integer(i),
            None => ParameterValue::Double(n.as_f64().unwrap_or(f64::NAN)),
        },
        Value::String(s) => ParameterValue::String(s.clone()),
        Value::Sequence(list) => {
            ParameterValue::StringArray(list.iter().filter_map(|v| v.as_str().map(str::to_owned)).collect())
        }
        _ => ParameterValue::NotSet,
    }
}

/// Accepts the current value and refuses any other, with the remedy.
pub(crate) fn refuse_changes(
    parameters: &Parameters,
) -> impl Fn(&str, &ParameterValue) -> SetParametersResult + Send + Sync + 'static {
    let present = declared_values(parameters);
    move |name, value| match present.iter().find(|(n, _)| n == name) {
        Some((_, v)) if v != value => {
            Err(format!("`{name}` is read at the start only; start the node with `-p {name}:=VALUE`"))
        }
        _ => Ok(()),
    }
}
