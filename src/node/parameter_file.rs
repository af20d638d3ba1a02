//! ROS 2 parameter files: node names, wildcards, `ros__parameters`.

use std::path::{Path, PathBuf};

use ros2_client::NodeName;
use serde_norway::{Mapping, Value};

use common::files;
use common::limits::{PARAMETERS, YamlError, parse_yaml};

/// Why a parameter file cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("parameter file `{}`: {fault}", path.display())]
pub struct ParameterFileError {
    /// The file.
    path: PathBuf,
    /// What is wrong with it.
    fault: ParameterFileFault,
}

/// What is wrong with a parameter file.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ParameterFileFault {
    /// It cannot be read.
    #[error(transparent)]
    Read(#[from] std::io::Error),
    /// It is not valid YAML.
    #[error(transparent)]
    Yaml(#[from] YamlError),
    /// Its root is no mapping.
    #[error("it is no map of node names")]
    NoMap,
    /// A value stands where a node name or group is expected.
    #[error("`{0}` holds something that is no map; parameters stand below `ros__parameters`")]
    NoParameters(String),
}

/// The parameters of a file for a node, in file order; nested names are joined by dots.
///
/// # Errors
/// If the file cannot be read or is no parameter file.
pub(crate) fn parameters_of_file(
    path: &Path,
    node: &NodeName,
) -> Result<Vec<(String, Value)>, ParameterFileError> {
    files::read_text(path, PARAMETERS)
        .map_err(ParameterFileFault::Read)
        .and_then(|text| parameters_of_text(&text, node))
        .map_err(|fault| ParameterFileError { path: path.to_owned(), fault })
}

fn parameters_of_text(text: &str, node: &NodeName) -> Result<Vec<(String, Value)>, ParameterFileFault> {
    match parse_yaml(text)? {
        Value::Mapping(map) => {
            let mut found = Vec::new();
            parameters_of_nodes(&map, "", node, &mut found)?;
            Ok(found)
        }
        Value::Null => Ok(Vec::new()),
        _ => Err(ParameterFileFault::NoMap),
    }
}

fn parameters_of_nodes(
    map: &Mapping,
    path: &str,
    node: &NodeName,
    found: &mut Vec<(String, Value)>,
) -> Result<(), ParameterFileFault> {
    for (key, value) in map {
        // A parameter outside `ros__parameters`; ROS rejects such files too.
        let (Some(key), Value::Mapping(inner)) = (key.as_str(), value) else {
            return Err(ParameterFileFault::NoParameters(path.to_owned()));
        };
        if key == "ros__parameters" {
            if is_for(path, node) {
                flatten_names(inner, "", found);
            }
        } else {
            // Namespaces may be nested groups or part of the key: `a: {b: ...}` or `/a/b: ...`.
            parameters_of_nodes(inner, &format!("{path}/{}", key.trim_matches('/')), node, found)?;
        }
    }
    Ok(())
}

fn flatten_names(map: &Mapping, prefix: &str, found: &mut Vec<(String, Value)>) {
    for (key, value) in map {
        let Some(key) = key.as_str() else { continue };
        match value {
            // ROS joins nested names by dots.
            Value::Mapping(inner) => flatten_names(inner, &format!("{prefix}{key}."), found),
            value => found.push((format!("{prefix}{key}"), value.clone())),
        }
    }
}

/// Whether a path of names and wildcards matches the node: `*` is one name, `**` any number.
fn is_for(path: &str, node: &NodeName) -> bool {
    let tokens =
        |text: &str| text.split('/').filter(|t| !t.is_empty()).map(str::to_owned).collect::<Vec<_>>();
    let pattern = tokens(path);
    let name = tokens(&node.fully_qualified_name());
    // A name without namespace matches the node in the root namespace, or wherever `__ns` has put it.
    fits_pattern(&pattern, &name) || matches!(pattern.as_slice(), [only] if *only == node.base_name())
}

fn fits_pattern(pattern: &[String], name: &[String]) -> bool {
    match (pattern, name) {
        ([], []) => true,
        // `**` matches any number of names, including none.
        ([first, rest @ ..], _) if first == "**" => (0..=name.len()).any(|k| fits_pattern(rest, &name[k..])),
        ([first, rest @ ..], [token, others @ ..]) => {
            (first == "*" || first == token) && fits_pattern(rest, others)
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::{super::ros_names::checked_node_name, *};

    fn names(text: &str) -> Vec<String> {
        let node = checked_node_name("/lab/arm", "artitwin").unwrap();
        parameters_of_text(text, &node).unwrap().into_iter().map(|(name, _)| name).collect()
    }

    #[test]
    fn nodes_are_named_in_every_way_of_the_format() {
        for key in ["/**", "/lab/arm/artitwin", "artitwin", "/*/arm/artitwin", "/**/artitwin", "/lab/**"] {
            assert_eq!(
                names(&format!("{key}:\n  ros__parameters:\n    a: 1\n    b:\n      c: x\n")),
                ["a", "b.c"],
                "{key}"
            );
        }
        assert_eq!(names("lab:\n  arm:\n    artitwin:\n      ros__parameters: {a: 1}\n"), ["a"]);
        for key in ["/lab/artitwin", "/*/artitwin", "other", "/lab/arm/artitwin/x"] {
            assert_eq!(
                names(&format!("{key}:\n  ros__parameters: {{a: 1}}\n")),
                Vec::<String>::new(),
                "{key}"
            );
        }
    }

    #[test]
    fn what_is_no_parameter_file_is_refused() {
        let node = checked_node_name("/", "n").unwrap();
        for text in ["[1]", "a: 1", "a: {b: 1}", "{"] {
            assert!(parameters_of_text(text, &node).is_err(), "{text}");
        }
        assert_eq!(parameters_of_text("", &node).unwrap(), Vec::new());
    }
}
