//! Names of nodes, topics and services.

use ros2_client::{Name, NodeName};

/// Longest accepted name, bytes.
const MAX_NAME: usize = 255;

/// Why a name is invalid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NameError {
    /// An invalid part between slashes.
    #[error("`{0}` is not made of letters, digits and single underscores")]
    Token(String),
    /// A full name must start with a slash.
    #[error("`{0}` does not begin with a slash")]
    NoSlash(String),
    /// The name is longer than DDS allows; its length.
    #[error("it has {0} bytes, more than {MAX_NAME}")]
    Long(usize),
    /// Message of the middleware.
    #[error("{0}")]
    Middleware(String),
}

/// Checks name and namespace of a node; adds a leading slash to the namespace if it has none.
///
/// # Errors
/// [`NameError`].
pub(crate) fn checked_node_name(namespace: &str, name: &str) -> Result<NodeName, NameError> {
    // Launch files write it with or without slashes.
    let namespace = format!("/{}", namespace.trim_matches('/'));
    // ros2-client allows repeated underscores and slashes, and any length.
    check_token(name)?;
    namespace.split('/').skip(1).filter(|t| !t.is_empty() || namespace != "/").try_for_each(check_token)?;
    NodeName::new(&namespace, name).map_err(|e| NameError::Middleware(e.to_string()))
}

fn check_token(token: &str) -> Result<(), NameError> {
    let valid = token.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
        && !token.starts_with(|c: char| c.is_ascii_digit());
    // ROS 2 forbids repeated underscores.
    match valid && !token.is_empty() && !token.contains("__") && token.len() <= MAX_NAME {
        true => Ok(()),
        false => Err(NameError::Token(token.escape_debug().to_string())),
    }
}

/// Reads a full name and checks that DDS allows it.
///
/// # Errors
/// [`NameError`].
pub(crate) fn checked_full_name(name: &str) -> Result<Name, NameError> {
    let tokens = name.strip_prefix('/').ok_or_else(|| NameError::NoSlash(name.to_owned()))?;
    if name.len() > MAX_NAME {
        return Err(NameError::Long(name.len()));
    }
    tokens.split('/').try_for_each(check_token)?;
    Name::parse(name).map_err(|e| NameError::Middleware(e.to_string()))
}

/// The full name: `/a` is unchanged, `~/a` is below the node, `a` in its namespace.
#[must_use]
pub(crate) fn expanded_name(name: &str, node: &NodeName) -> String {
    match name.strip_prefix('~') {
        Some(rest) => format!("{}/{}", node.fully_qualified_name(), rest.trim_start_matches('/'))
            .trim_end_matches('/')
            .to_owned(),
        None if name.starts_with('/') => name.to_owned(),
        None => format!("{}/{name}", node.namespace().trim_end_matches('/')),
    }
}

/// Whether a name before a remapping or parameter means the node: its name, or its full name.
#[must_use]
pub(crate) fn means_node(name: &str, node: &NodeName) -> bool {
    name.trim_start_matches('/') == node.base_name() || name == node.fully_qualified_name()
}

/// Removes `rostopic://` and `rosservice://`.
#[must_use]
pub(crate) fn strip_transport(name: &str) -> &str {
    ["rostopic://", "rosservice://"].iter().find_map(|p| name.strip_prefix(p)).unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn namespaces_are_normalized_and_nonsense_is_refused() {
        for (given, kept) in [("", "/"), ("/", "/"), ("a", "/a"), ("/a/b/", "/a/b")] {
            assert_eq!(checked_node_name(given, "n").unwrap().namespace(), kept);
        }
        for (namespace, name) in [("/a//b", "n"), ("/a", ""), ("/a", "1n"), ("/a-b", "n"), ("/", "n__m")] {
            assert!(checked_node_name(namespace, name).is_err(), "{namespace} {name}");
        }
        assert!(checked_full_name("/a/b_1").is_ok());
        assert!(
            checked_full_name("/a b").is_err()
                && checked_full_name("a").is_err()
                && checked_full_name("/").is_err()
        );
    }
}
