//! `--ros-args`: remappings, parameters, log level, as `ros2 run` and `ros2 launch` pass them.

use std::path::PathBuf;

use serde_norway::Value;

use ros2_client::NodeName;

use super::ros_names::{checked_node_name, expanded_name, means_node, strip_transport};

/// Arguments between `--ros-args` and `--`, and the rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct RosArgs {
    /// Remappings in order; the first match applies.
    pub remaps: Vec<Remap>,
    /// Parameters in order; later ones win.
    pub parameters: Vec<ParameterSource>,
    /// `debug`, `info`, `warn`, `error` or `fatal`.
    pub log_level: Option<String>,
    /// Security enclave.
    pub enclave: Option<String>,
    /// Whether `/rosout` is disabled.
    pub no_rosout: bool,
    /// Whether standard error is disabled.
    pub no_stdout: bool,
    /// Unknown arguments between `--ros-args` and `--`.
    pub unknown: Vec<String>,
    /// Arguments before `--ros-args` and after `--`.
    pub rest: Vec<String>,
}

/// Source of parameters.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum ParameterSource {
    /// A file of `--params-file`.
    File(PathBuf),
    /// A value of `-p`, for a named node or for all.
    Value {
        /// Node to which it applies; `None` for all.
        node: Option<String>,
        /// Name of the parameter.
        name: String,
        /// Its value.
        value: Value,
    },
}

/// `from:=to`, for one node or for all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Remap {
    /// Node to which it applies; `None` for all.
    pub node: Option<String>,
    /// Name used by the node, or `__node` or `__ns`.
    pub from: String,
    /// Its new name.
    pub to: String,
}

/// An argument that cannot be parsed.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("`{argument}`: {reason}")]
pub struct RosArgsError {
    argument: String,
    reason: String,
}

impl RosArgs {
    /// Parses the arguments of a program, without its name. Unknown ones between `--ros-args` and `--` are
    /// kept in `unknown`, as a newer launch may pass more.
    ///
    /// # Errors
    /// If an option has no value or the value cannot be parsed.
    pub(crate) fn parse(arguments: &[String]) -> Result<Self, RosArgsError> {
        let mut parsed = Self::default();
        let mut ros = false;
        let mut list = arguments.iter();
        while let Some(argument) = list.next() {
            match (ros, argument.as_str()) {
                (_, "--ros-args") => ros = true,
                // After `--` come the program's own arguments.
                (true, "--") => ros = false,
                (true, option) => parsed.read_option(option, &mut list)?,
                (false, _) => parsed.rest.push(argument.clone()),
            }
        }
        Ok(parsed)
    }

    fn read_option<'a>(
        &mut self,
        option: &str,
        rest: &mut impl Iterator<Item = &'a String>,
    ) -> Result<(), RosArgsError> {
        let fail = |reason: &str| RosArgsError { argument: option.to_owned(), reason: reason.to_owned() };
        let missing = |what: &str| fail(&format!("is the last argument; give {what} after it"));
        let mut value = |what: &str| rest.next().cloned().ok_or_else(|| missing(what));
        match option {
            "-r" | "--remap" => {
                let text = value("FROM:=TO")?;
                self.remaps.push(parsed_remap(&text)?);
            }
            "-p" | "--param" => {
                let text = value("NAME:=VALUE")?;
                self.parameters.push(parsed_parameter(&text)?);
            }
            "--params-file" => self.parameters.push(ParameterSource::File(value("FILE")?.into())),
            "--log-level" => self.log_level = Some(log_level(&value("LEVEL")?)?),
            "-e" | "--enclave" => self.enclave = Some(value("ENCLAVE")?),
            // Not used, but their values must not be parsed as options.
            "--log-config-file" | "--log-file-name" => {
                self.unknown.push(format!("{option} {}", value("FILE")?))
            }
            "--disable-rosout-logs" => self.no_rosout = true,
            "--disable-stdout-logs" => self.no_stdout = true,
            "--enable-rosout-logs" => self.no_rosout = false,
            "--enable-stdout-logs" => self.no_stdout = false,
            "--enable-external-lib-logs" | "--disable-external-lib-logs" => {}
            // The old form without a dash.
            text if text.contains(":=") => self.remaps.push(parsed_remap(text)?),
            other => self.unknown.push(other.to_owned()),
        }
        Ok(())
    }

    /// Name and namespace of the node after `__node` and `__ns`.
    ///
    /// # Errors
    /// If they are not valid names.
    pub(crate) fn node_identity(&self, default_name: &str) -> Result<NodeName, RosArgsError> {
        // Matched by the default name: `node:__node:=other` refers to the node before it is renamed.
        let mut remaps = self.remaps.iter().filter(|r| self.is_for(r, default_name));
        let name = remaps.clone().find(|r| ["__node", "__name"].contains(&r.from.as_str()));
        let name = name.map_or(default_name, |r| r.to.as_str());
        let namespace = remaps.find(|r| r.from == "__ns").map_or("/", |r| r.to.as_str());
        checked_node_name(namespace, name).map_err(|reason| RosArgsError {
            argument: format!("{namespace} {name}"),
            reason: format!("the node cannot have this name: {reason}"),
        })
    }

    fn is_for(&self, remap: &Remap, default_name: &str) -> bool {
        remap.node.as_ref().is_none_or(|n| n.trim_start_matches('/') == default_name)
    }

    /// The full name of a topic, service or action after expansion and remapping.
    #[must_use]
    pub(crate) fn resolved_name(&self, name: &str, node: &NodeName) -> String {
        let full = expanded_name(strip_transport(name), node);
        for r in &self.remaps {
            let is_own = r.node.as_ref().is_none_or(|n| means_node(n, node));
            if is_own && !r.from.starts_with("__") && expanded_name(strip_transport(&r.from), node) == full {
                return expanded_name(strip_transport(&r.to), node);
            }
        }
        full
    }
}

fn parsed_remap(text: &str) -> Result<Remap, RosArgsError> {
    let fail = |reason: &str| RosArgsError { argument: text.to_owned(), reason: reason.to_owned() };
    let (left, to) = text.split_once(":=").ok_or_else(|| fail("is no remapping; give FROM:=TO"))?;
    // `rostopic://` and `rosservice://` contain a colon that separates no node.
    let (node, from) = match left.split_once(':') {
        Some((node, from)) if !from.starts_with("//") => (Some(node.to_owned()), from),
        _ => (None, left),
    };
    if from.is_empty() || to.is_empty() {
        return Err(fail("a side of the remapping is empty"));
    }
    Ok(Remap { node, from: from.to_owned(), to: to.to_owned() })
}

fn parsed_parameter(text: &str) -> Result<ParameterSource, RosArgsError> {
    let fail = |reason: String| RosArgsError { argument: text.to_owned(), reason };
    let (left, value) =
        text.split_once(":=").ok_or_else(|| fail("is no parameter; give NAME:=VALUE".into()))?;
    let (node, name) =
        left.split_once(':').map_or((None, left), |(node, name)| (Some(node.to_owned()), name));
    if name.is_empty() {
        return Err(fail("the parameter has no name".into()));
    }
    let value = common::limits::parse_yaml(value).map_err(|e| fail(format!("the value is no YAML: {e}")))?;
    Ok(ParameterSource::Value { node, name: name.to_owned(), value })
}

/// Level from `LEVEL` or `LOGGER:=LEVEL`; the logger is ignored, as there is only one.
fn log_level(text: &str) -> Result<String, RosArgsError> {
    let level = text.rsplit(":=").next().unwrap_or(text).to_ascii_lowercase();
    if ["debug", "info", "warn", "error", "fatal"].contains(&level.as_str()) {
        return Ok(level);
    }
    Err(RosArgsError {
        argument: text.to_owned(),
        reason: "is no log level; give debug, info, warn, error or fatal".into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> RosArgs {
        RosArgs::parse(&line.split_whitespace().map(str::to_owned).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn what_a_launch_file_passes_is_understood() {
        let args = parse(
            "a --ros-args -r __node:=twin -r __ns:=/lab -r color:=/rgb --params-file p.yaml -p parts:=3 -p \
             n:q:=[1,2] --log-level x:=WARN -- b",
        );
        assert_eq!(args.rest, ["a", "b"]);
        let node = args.node_identity("artitwin").unwrap();
        assert_eq!(node.fully_qualified_name(), "/lab/twin");
        assert_eq!(args.log_level.as_deref(), Some("warn"));
        assert_eq!(args.parameters[0], ParameterSource::File("p.yaml".into()));
        let value = |node: Option<&str>, name: &str, yaml: &str| ParameterSource::Value {
            node: node.map(str::to_owned),
            name: name.to_owned(),
            value: serde_norway::from_str(yaml).unwrap(),
        };
        assert_eq!(args.parameters[1..], [value(None, "parts", "3"), value(Some("n"), "q", "[1, 2]")]);
    }

    #[test]
    fn names_are_expanded_before_they_are_compared() {
        let args = parse(
            "--ros-args -r image:=/cam/image -r ~/save:=store -r other:image:=/x -r rostopic:///a/b:=c",
        );
        let node = checked_node_name("/ns", "twin").unwrap();
        assert_eq!(args.resolved_name("image", &node), "/cam/image");
        assert_eq!(args.resolved_name("/ns/image", &node), "/cam/image");
        assert_eq!(args.resolved_name("~/save", &node), "/ns/store");
        assert_eq!(args.resolved_name("/ns/twin/save", &node), "/ns/store");
        assert_eq!(args.resolved_name("/image", &node), "/image");
        assert_eq!(args.resolved_name("/a/b", &node), "/ns/c");
        assert_eq!(args.resolved_name("~/reset", &node), "/ns/twin/reset");
    }

    #[test]
    fn nonsense_is_refused_and_the_unknown_is_kept() {
        let error = |line: &str| {
            RosArgs::parse(&line.split(' ').map(str::to_owned).collect::<Vec<_>>()).unwrap_err().to_string()
        };
        assert!(error("--ros-args -r a=b").contains("FROM:=TO"));
        assert!(error("--ros-args -p").contains("last argument"));
        assert!(error("--ros-args -p a:=[1").contains("no YAML"));
        assert!(error("--ros-args --log-level loud").contains("debug"));
        assert_eq!(parse("--ros-args --shiny -r a:=b").unknown, ["--shiny"]);
        assert!(parse("--ros-args -r __node:=no/name").node_identity("artitwin").is_err());
    }
}
