//! The parameters while the node runs: what they are, what they mean, and which can be set.

use std::sync::{Arc, Mutex, PoisonError};

use serde_norway::{Mapping, Value};
use tokio::sync::mpsc;

use super::{
    collection::{Command, Followed},
    parameter_messages::{
        FloatingPointRange, IntegerRange, Parameter, ParameterDescriptor, ParameterType, ParameterValue,
        value_from_yaml, value_to_yaml,
    },
    parameters::{CHOICES, Parameters, REAL_RANGES, WHOLE_RANGES},
    settings,
    state_bag::Topics,
};
use config::{Config, Layers, Resolved};

/// The file of the defaults; its comments describe the parameters.
const DESCRIBED: &str = include_str!("../../launch_configs/ros/node.yaml");
/// Parameters that can be set while the node runs.
const SETTABLE: [&str; 4] = ["live_map", "parts", "tracking", "twin_name"];

/// Parameters with the settings that follow from them.
pub(crate) struct CurrentParameters {
    /// The parameters.
    pub parameters: Parameters,
    /// Settings of a run.
    pub resolved: Resolved<Config>,
    /// Names and values of the parameters.
    values: Mapping,
}

impl CurrentParameters {
    /// Parameters with the settings of a run with them.
    #[must_use]
    pub(crate) fn new(parameters: Parameters, resolved: Resolved<Config>) -> Self {
        Self { values: parameters.to_mapping(), parameters, resolved }
    }
}

/// The current parameters, read and set by other threads.
pub(crate) struct LiveParameters {
    current: Mutex<Arc<CurrentParameters>>,
    /// Preset, file and single settings, which are fixed.
    layers: Layers,
    topics: Topics,
    commands: mpsc::Sender<Command>,
}

impl LiveParameters {
    /// Begins with the parameters of the start; the collection hears of changes by `commands`.
    #[must_use]
    pub(crate) fn new(
        current: CurrentParameters,
        layers: Layers,
        topics: Topics,
        commands: mpsc::Sender<Command>,
    ) -> Self {
        Self { current: Mutex::new(Arc::new(current)), layers, topics, commands }
    }

    /// What holds now.
    #[must_use]
    pub(crate) fn current(&self) -> Arc<CurrentParameters> {
        Arc::clone(&self.current.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Sets parameters, all or none; gives those that have another value now.
    ///
    /// # Errors
    /// The reason for a person, with the remedy.
    pub(crate) fn set_all(&self, asked: &[Parameter]) -> Result<Vec<Parameter>, String> {
        let mut current = self.current.lock().unwrap_or_else(PoisonError::into_inner);
        let mut parameters = current.parameters.clone();
        for Parameter { name, value } in asked {
            let value =
                value_to_yaml(value).ok_or_else(|| format!("`{name}` cannot have a value of this type"))?;
            let changed = parameters.with_value(name, value).map_err(|e| e.to_string())?;
            let is_same = changed == parameters;
            if let Some(reason) = why_fixed(name).filter(|_| !is_same) {
                return Err(format!("`{name}` {reason}; start the node with `-p {name}:=VALUE`"));
            }
            parameters = changed;
        }
        // Settings that a run would refuse are refused now.
        let layers = self.layers.clone();
        let resolved =
            settings::run_settings(layers, &parameters, &self.topics).map_err(|e| e.to_string())?;
        let followed = Followed { tracking: resolved.config.capture.tracking, live_map: parameters.live_map };
        let next = CurrentParameters::new(parameters, resolved);
        let mut changed = Vec::new();
        for (name, value) in next.values.iter().filter(|(n, v)| current.values.get(n) != Some(*v)) {
            let name = name.as_str().unwrap_or_default().to_owned();
            changed.push(Parameter { name, value: value_from_yaml(value) });
        }
        // A queue that is full means that the collection is stuck; then nothing is changed.
        if self.commands.try_send(Command::Follow(followed)).is_err() {
            return Err("the collection is busy".to_owned());
        }
        *current = Arc::new(next);
        Ok(changed)
    }

    /// Names of all parameters.
    #[must_use]
    pub(crate) fn names(&self) -> Vec<String> {
        let current = self.current();
        current.values.iter().filter_map(|(name, _)| name.as_str().map(str::to_owned)).collect()
    }

    /// The value of a parameter; not set if there is none of this name.
    #[must_use]
    pub(crate) fn value(&self, name: &str) -> ParameterValue {
        value_from_yaml(self.current().values.get(name).unwrap_or(&Value::Null))
    }

    /// What a parameter means and allows.
    #[must_use]
    pub(crate) fn descriptor(&self, name: &str) -> ParameterDescriptor {
        let value_type = self.value(name).ptype;
        if value_type == ParameterType::NOT_SET {
            return empty_descriptor(name);
        }
        let mut constraints = Vec::new();
        if let Some((_, allowed)) = CHOICES.iter().find(|(n, _)| *n == name) {
            let quoted: Vec<String> = allowed.iter().map(|a| format!("\"{a}\"")).collect();
            constraints.push(format!("one of {}", quoted.join(", ")));
        }
        let fixed = why_fixed(name);
        constraints.extend(fixed.map(str::to_owned));
        let whole = WHOLE_RANGES.iter().filter(|(n, ..)| *n == name);
        let real = REAL_RANGES.iter().filter(|(n, ..)| *n == name);
        ParameterDescriptor {
            name: name.to_owned(),
            r#type: value_type,
            description: description(name),
            additional_constraints: constraints.join("; "),
            read_only: fixed.is_some(),
            dynamic_typing: false,
            floating_point_range: real
                .map(|&(_, from_value, to_value)| FloatingPointRange { from_value, to_value, step: 0.0 })
                .collect(),
            integer_range: whole
                .map(|&(_, from_value, to_value)| IntegerRange { from_value, to_value, step: 1 })
                .collect(),
        }
    }
}

/// The descriptor of a parameter that is not there.
fn empty_descriptor(name: &str) -> ParameterDescriptor {
    ParameterDescriptor {
        name: name.to_owned(),
        r#type: ParameterType::NOT_SET,
        description: String::new(),
        additional_constraints: String::new(),
        read_only: false,
        dynamic_typing: false,
        floating_point_range: Vec::new(),
        integer_range: Vec::new(),
    }
}

/// Why a parameter cannot be set while the node runs; `None` if it can.
fn why_fixed(name: &str) -> Option<&'static str> {
    match name {
        _ if SETTABLE.contains(&name) => None,
        "use_sim_time" => Some("is fixed, as stamps of two clocks cannot be compared"),
        "out_folder" | "session" => Some("is fixed, as the session's folder is open"),
        "pose_type" | "queue_depth" | "receive_buffer_bytes" => Some("is fixed, as the subscriptions stand"),
        _ if name.ends_with("_topic") || name.ends_with("_qos") || name.ends_with("_transport") => {
            Some("is fixed, as the subscriptions stand")
        }
        "preset" | "config_file" | "settings" | "pose_frame" | "world_frame" | "sync_queue" => {
            Some("is fixed, as what was collected so far follows from it")
        }
        _ if name.contains("keyframe") || name.ends_with("_states") || name.ends_with("_secs") => {
            Some("is fixed, as what was collected so far follows from it")
        }
        _ => Some("is fixed, as the outputs follow from it since the start"),
    }
}

/// The comment of a parameter in the shipped file.
fn description(name: &str) -> String {
    let prefix = format!("{name}: ");
    // One that cannot stand in a file is a comment there.
    let mut lines = DESCRIBED.lines().skip_while(|l| !uncommented(l).starts_with(&prefix));
    let Some((_, first)) = lines.next().and_then(|l| uncommented(l).split_once(" # ")) else {
        return String::new();
    };
    // A comment goes on in lines that hold nothing else.
    let more = lines.map(str::trim_start).map_while(|l| l.strip_prefix("# "));
    let mut said = vec![first.trim()];
    said.extend(more.map(str::trim));
    said.join(" ")
}

fn uncommented(line: &str) -> &str {
    line.trim_start_matches([' ', '#'])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn live() -> (LiveParameters, mpsc::Receiver<Command>) {
        let (commands, inbox) = mpsc::channel(4);
        let parameters = Parameters::default();
        let topics = Topics::default();
        let layers = settings::base_layers(&parameters).unwrap();
        let resolved = settings::run_settings(layers.clone(), &parameters, &topics).unwrap();
        let current = CurrentParameters::new(parameters, resolved);
        (LiveParameters::new(current, layers, topics, commands), inbox)
    }

    fn parameter(name: &str, value: impl Into<Value>) -> Parameter {
        Parameter { name: name.to_owned(), value: value_from_yaml(&value.into()) }
    }

    #[test]
    fn some_parameters_can_be_set_and_others_give_the_reason() {
        let (live, mut inbox) = live();
        assert_eq!(live.set_all(&[parameter("tracking", "never")]).unwrap().len(), 1);
        assert!(
            matches!(inbox.try_recv(), Ok(Command::Follow(f)) if f.tracking == capture::TrackCamera::Never)
        );
        assert_eq!(live.current().resolved.config.capture.tracking, capture::TrackCamera::Never);
        for (name, value, words) in [
            ("color_topic", Value::from("/x"), "subscriptions"),
            ("tracking", Value::from("perhaps"), "not one of"),
            ("parts", Value::from("two"), "whole number"),
            ("parts", Value::from(99), "0 to 16"),
            ("nope", Value::from(1), "not a parameter"),
        ] {
            let reason = live.set_all(&[parameter("parts", 3), parameter(name, value)]).unwrap_err();
            assert!(reason.contains(words), "{reason}");
        }
        assert_eq!(live.current().parameters.parts, 0);
        // The present value is no change.
        assert!(live.set_all(&[parameter("queue_depth", 10)]).unwrap().is_empty());
    }

    #[test]
    fn every_parameter_is_described() {
        let (live, _inbox) = live();
        for name in live.names() {
            let found = live.descriptor(&name);
            assert!(
                !found.description.is_empty() && found.r#type != ParameterType::NOT_SET,
                "{name}: {found:?}"
            );
            assert_eq!(found.read_only, !SETTABLE.contains(&name.as_str()), "{name}");
        }
        let found = live.descriptor("tracking");
        assert!(found.description.ends_with("`map`.") && found.additional_constraints.contains("\"always\""));
        assert_eq!(live.descriptor("parts").integer_range[0].to_value, 16);
        assert_eq!(live.descriptor("nope").r#type, ParameterType::NOT_SET);
    }
}
