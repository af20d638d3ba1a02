//! Parameters of the node from defaults, files and the command line (later ones win), read at the start.

use ros2_client::NodeName;
use serde::{Deserialize, Serialize};
use serde_norway::{Mapping, Value};

use super::{
    parameter_file::{ParameterFileError, parameters_of_file},
    ros_args::{ParameterSource, RosArgs},
    ros_names::means_node,
};

/// All parameters with their defaults. Empty text means not given.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Parameters {
    /// Whether the time comes from `/clock`.
    pub use_sim_time: bool,
    /// Color images; with `compressed` transport `/compressed` is appended.
    pub color_topic: String,
    /// `raw` or `compressed`.
    pub color_transport: String,
    /// Depth images; `/compressedDepth` is appended with that transport. Depth of another camera than color's
    /// is brought to color's pixels by `/tf_static`.
    pub depth_topic: String,
    /// `raw` or `compressedDepth`.
    pub depth_transport: String,
    /// CameraInfo of the color images.
    pub camera_info_topic: String,
    /// CameraInfo of the depth images; empty: that of color.
    pub depth_info_topic: String,
    /// Object masks; empty: none. If given, images without a mask are not used.
    pub mask_topic: String,
    /// `raw` or `compressed`.
    pub mask_transport: String,
    /// Camera poses in place of `/tf`; empty: `/tf`.
    pub pose_topic: String,
    /// `pose` (PoseStamped) or `odometry`.
    pub pose_type: String,
    /// Frame of the poses of a PoseStamped; empty: the optical frame of the color images.
    pub pose_frame: String,
    /// Frame of the twin; empty: the root of the camera's transform chain.
    pub world_frame: String,
    /// Whether the camera is tracked by its images: `auto` (if there is no transform for it), `always` or
    /// `never`; empty: as in the settings.
    pub tracking: String,
    /// QoS of the image subscriptions: `sensor_data` (best effort) or `default` (reliable).
    pub image_qos: String,
    /// QoS of the camera_info subscriptions.
    pub info_qos: String,
    /// Queue length of subscriptions.
    pub queue_depth: i64,
    /// Most images of each kind that wait for a match, and most sets that wait for a pose.
    pub sync_queue: i64,
    /// Number of rigid parts, the static one included; 0: given by the goal.
    pub parts: i64,
    /// Name of the twin.
    pub twin_name: String,
    /// Folder for the session folders.
    pub out_folder: String,
    /// Name of the session folder; empty: from the time. A restarted node with a name continues in the same
    /// folder.
    pub session: String,
    /// Name of a settings preset.
    pub preset: String,
    /// YAML file with settings.
    pub config_file: String,
    /// Single settings, `KEY=VALUE`.
    pub settings: Vec<String>,
    /// A view is kept if it is at least this far from every kept view, meters ...
    pub keyframe_translation_m: f64,
    /// ... or rotated by at least this angle, degrees.
    pub keyframe_rotation_deg: f64,
    /// Most kept views per state.
    pub max_keyframes: i64,
    /// Whether states start and finish automatically.
    pub automatic_states: bool,
    /// Time without motion after which the object counts as at rest, seconds.
    pub still_secs: f64,
    /// Fewest views of an automatic state.
    pub min_keyframes: i64,
    /// Number of views at which an automatic state 1 finishes.
    pub enough_keyframes: i64,
    /// Rate of `joint_states` and `/tf`, Hz.
    pub joint_state_rate_hz: f64,
    /// Most points of the preview cloud.
    pub cloud_points: i64,
    /// Whether a live map is computed during collection.
    pub live_map: bool,
    /// Memory of the live map, megabytes.
    pub live_map_megabytes: i64,
    /// Prefix of the link frames.
    pub frame_prefix: String,
    /// Whether the poses of the parts are published on `/tf`.
    pub publish_tf: bool,
    /// How the URDF names its meshes: `file` or `package`.
    pub mesh_uri: String,
    /// Receive buffer size requested from the system, bytes.
    pub receive_buffer_bytes: i64,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            use_sim_time: false,
            color_topic: "/camera/camera/color/image_raw".into(),
            color_transport: "raw".into(),
            depth_topic: "/camera/camera/aligned_depth_to_color/image_raw".into(),
            depth_transport: "raw".into(),
            camera_info_topic: "/camera/camera/color/camera_info".into(),
            depth_info_topic: "/camera/camera/aligned_depth_to_color/camera_info".into(),
            mask_topic: String::new(),
            mask_transport: "raw".into(),
            pose_topic: String::new(),
            pose_type: "pose".into(),
            pose_frame: String::new(),
            world_frame: String::new(),
            tracking: String::new(),
            image_qos: "sensor_data".into(),
            info_qos: "sensor_data".into(),
            queue_depth: 10,
            sync_queue: 30,
            parts: 0,
            twin_name: "twin".into(),
            out_folder: "artitwin_sessions".into(),
            session: String::new(),
            preset: String::new(),
            config_file: String::new(),
            settings: Vec::new(),
            keyframe_translation_m: 0.02,
            keyframe_rotation_deg: 2.0,
            max_keyframes: 300,
            automatic_states: false,
            still_secs: 2.0,
            min_keyframes: 12,
            enough_keyframes: 30,
            joint_state_rate_hz: 10.0,
            cloud_points: 5000,
            live_map: true,
            live_map_megabytes: 64,
            frame_prefix: String::new(),
            publish_tf: true,
            mesh_uri: "file".into(),
            receive_buffer_bytes: 8 << 20,
        }
    }
}

/// Allowed values of the parameters that are a choice.
pub(crate) const CHOICES: &[(&str, &[&str])] = &[
    ("color_transport", &["raw", "compressed"]),
    ("depth_transport", &["raw", "compressedDepth"]),
    ("mask_transport", &["raw", "compressed"]),
    ("pose_type", &["pose", "odometry"]),
    ("tracking", &["", "auto", "always", "never"]),
    ("image_qos", &["sensor_data", "default"]),
    ("info_qos", &["sensor_data", "default"]),
    ("mesh_uri", &["file", "package"]),
];
/// Least and largest values of whole numbers.
pub(crate) const WHOLE_RANGES: &[(&str, i64, i64)] = &[
    ("queue_depth", 1, 1000),
    ("sync_queue", 2, 300),
    ("parts", 0, 16),
    ("max_keyframes", 1, 5000),
    ("min_keyframes", 1, 5000),
    ("enough_keyframes", 1, 5000),
    ("cloud_points", 0, 100_000),
    ("live_map_megabytes", 8, 1024),
    ("receive_buffer_bytes", 1 << 16, 1 << 30),
];
/// Least and largest values of real numbers.
/// chosen: beyond them a value is a slip of the keyboard or of its unit
pub(crate) const REAL_RANGES: &[(&str, f64, f64)] = &[
    ("keyframe_translation_m", 0.0, 10.0),
    ("keyframe_rotation_deg", 0.0, 180.0),
    ("still_secs", 0.1, 600.0),
    ("joint_state_rate_hz", 0.1, 200.0),
];

/// Why the parameters cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ParameterError {
    /// A value is invalid.
    #[error("parameter `{name}`: {reason}")]
    Value {
        /// Name of the parameter.
        name: String,
        /// The reason and its remedy.
        reason: String,
    },
    /// A parameter file is invalid.
    #[error(transparent)]
    File(#[from] ParameterFileError),
}

/// The value's type differs from the parameter's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("it must be {wanted}, not {given}")]
struct WrongType {
    wanted: &'static str,
    given: &'static str,
}

/// Loaded parameters and unknown names.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Loaded {
    /// The parameters.
    pub parameters: Parameters,
    /// Unknown names, each with the most similar known one.
    pub unknown: Vec<String>,
}

impl Parameters {
    /// Merges defaults, files and single values in the given order.
    ///
    /// # Errors
    /// If a file cannot be read, or a value is invalid or has the wrong type.
    pub(crate) fn load(arguments: &RosArgs, node: &NodeName) -> Result<Loaded, ParameterError> {
        // As YAML, so that the default gives the type of each value.
        let mut merged = Self::default().to_mapping();
        let mut unknown = Vec::new();
        for source in &arguments.parameters {
            let found = match source {
                ParameterSource::File(path) => parameters_of_file(path, node)?,
                ParameterSource::Value { node: Some(n), .. } if !means_node(n, node) => continue,
                ParameterSource::Value { name, value, .. } => vec![(name.clone(), value.clone())],
            };
            for (name, value) in found {
                match merged.get(name.as_str()) {
                    Some(default) => {
                        let value = coerced_value(default, value).map_err(|e| ParameterError::Value {
                            name: name.clone(),
                            reason: e.to_string(),
                        })?;
                        merged.insert(name.into(), value);
                    }
                    // Parameters of the middleware, e.g. qos_overrides, and of other programs in the same
                    // file.
                    None => unknown.push(name),
                }
            }
        }
        let parameters: Self = serde_norway::from_value(Value::Mapping(merged))
            .map_err(|e| ParameterError::Value { name: "?".into(), reason: e.to_string() })?;
        parameters.check()?;
        Ok(Loaded { parameters, unknown })
    }

    /// Names and values of all parameters.
    #[must_use]
    pub(crate) fn to_mapping(&self) -> Mapping {
        match serde_norway::to_value(self) {
            Ok(Value::Mapping(mapping)) => mapping,
            _ => Mapping::new(),
        }
    }

    /// The parameters with another value of one of them.
    ///
    /// # Errors
    /// If the name is unknown, or the value is invalid or has the wrong type.
    pub(crate) fn with_value(&self, name: &str, value: Value) -> Result<Self, ParameterError> {
        let refuse = |reason: String| ParameterError::Value { name: name.to_owned(), reason };
        let mut values = self.to_mapping();
        let present = values.get(name).ok_or_else(|| refuse("is not a parameter of this node".to_owned()))?;
        let value = coerced_value(present, value).map_err(|e| refuse(e.to_string()))?;
        values.insert(name.into(), value);
        let changed: Self =
            serde_norway::from_value(Value::Mapping(values)).map_err(|e| refuse(e.to_string()))?;
        changed.check()?;
        Ok(changed)
    }

    fn check(&self) -> Result<(), ParameterError> {
        let refuse =
            |name: &str, reason: String| Err(ParameterError::Value { name: name.to_owned(), reason });
        let values = self.to_mapping();
        for (name, allowed) in CHOICES {
            let value = values.get(*name).and_then(Value::as_str).unwrap_or_default();
            if !allowed.contains(&value) {
                return refuse(name, format!("`{value}` is not one of {}", allowed.join(", ")));
            }
        }
        for (name, low, high) in WHOLE_RANGES {
            let value = values.get(*name).and_then(Value::as_i64).unwrap_or(i64::MIN);
            if !(*low..=*high).contains(&value) {
                return refuse(name, format!("{value} does not lie in {low} to {high}"));
            }
        }
        for (name, low, high) in REAL_RANGES {
            let value = values.get(*name).and_then(Value::as_f64).unwrap_or(f64::NAN);
            if !(*low..=*high).contains(&value) {
                return refuse(name, format!("{value} does not lie in {low} to {high}"));
            }
        }
        if !model::is_plain_name(&self.twin_name) {
            return refuse(
                "twin_name",
                format!(
                    "`{}` is not a letter followed by letters, digits and _",
                    self.twin_name.escape_debug()
                ),
            );
        }
        // It is joined to out_folder, and a slash or `..` would leave it.
        let plain = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
        if !self.session.chars().all(plain) || self.session.starts_with('.') {
            return refuse("session", format!("`{}` is no plain folder name", self.session.escape_debug()));
        }
        Ok(())
    }
}

/// The value in the type of the default; integers are accepted for reals.
fn coerced_value(default: &Value, value: Value) -> Result<Value, WrongType> {
    match (default, &value) {
        // `-p still_secs:=2` is an integer in YAML.
        (Value::Number(d), Value::Number(v)) if d.is_f64() => Ok(Value::from(v.as_f64().unwrap_or(f64::NAN))),
        (Value::Number(_), Value::Number(v)) if !v.is_f64() => Ok(value),
        (Value::String(_), Value::String(_)) | (Value::Bool(_), Value::Bool(_)) => Ok(value),
        (Value::Sequence(_), Value::Sequence(list)) if list.iter().all(|v| matches!(v, Value::String(_))) => {
            Ok(value)
        }
        _ => Err(WrongType { wanted: type_name(default), given: type_name(&value) }),
    }
}

fn type_name(value: &Value) -> &'static str {
    match value {
        Value::Bool(_) => "a truth value",
        Value::Number(n) if n.is_f64() => "a number",
        Value::Number(_) => "a whole number",
        Value::String(_) => "a text",
        Value::Sequence(_) => "a list of texts",
        _ => "something else",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(line: &str) -> Result<Loaded, ParameterError> {
        let args = RosArgs::parse(&line.split(' ').map(str::to_owned).collect::<Vec<_>>()).unwrap();
        let node = args.node_identity("artitwin").unwrap();
        Parameters::load(&args, &node)
    }

    #[test]
    fn later_wins_and_whole_numbers_do_for_real_ones() {
        let found = load(
            "--ros-args -p parts:=3 -p parts:=2 -p still_secs:=3 -p settings:=[a=1] -p \
            other:parts:=9 -p strange:=1",
        )
        .unwrap();
        assert_eq!((found.parameters.parts, found.parameters.still_secs), (2, 3.0));
        assert_eq!(found.parameters.settings, ["a=1"]);
        assert_eq!(found.unknown, ["strange"]);
    }

    #[test]
    fn the_shipped_file_holds_the_defaults() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch_configs/ros/node.yaml");
        let found = load(&format!("--ros-args --params-file {file}")).unwrap();
        assert_eq!(found, Loaded::default());
        let text = std::fs::read_to_string(file).unwrap();
        for (name, _) in Parameters::default().to_mapping() {
            let name = name.as_str().unwrap().to_owned();
            // An empty list cannot be written in a parameter file of ROS 2.
            assert!(name == "settings" || text.contains(&format!("    {name}: ")), "{name}");
        }
    }

    #[test]
    fn what_cannot_be_used_is_refused_by_name() {
        for (line, words) in [
            ("--ros-args -p parts:=two", "whole number"),
            ("--ros-args -p parts:=99", "0 to 16"),
            ("--ros-args -p still_secs:=.nan", "still_secs"),
            ("--ros-args -p image_qos:=best", "sensor_data"),
            ("--ros-args -p twin_name:=../x", "twin_name"),
            ("--ros-args -p session:=..", "session"),
            ("--ros-args --params-file /nope.yaml", "/nope.yaml"),
        ] {
            let text = load(line).unwrap_err().to_string();
            assert!(text.contains(words), "{text}");
        }
    }
}
