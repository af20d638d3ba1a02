//! Names of nodes, topics and services.

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

/// Name and namespace of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct NodeIdentity {
    /// Namespace, `/` or `/a/b`.
    pub namespace: String,
    /// Name without slashes.
    pub name: String,
}

impl NodeIdentity {
    /// Checks name and namespace; adds a leading slash to the namespace if it has none.
    ///
    /// # Errors
    /// [`NameError`].
    pub(crate) fn new(namespace: &str, name: &str) -> Result<Self, NameError> {
        // Launch files write it with or without slashes.
        let namespace = format!("/{}", namespace.trim_matches('/'));
        check_token(name)?;
        namespace
            .split('/')
            .skip(1)
            .filter(|t| !t.is_empty() || namespace != "/")
            .try_for_each(check_token)?;
        Ok(Self { namespace, name: name.to_owned() })
    }

    /// Namespace and name, joined.
    #[must_use]
    pub(crate) fn full_name(&self) -> String {
        format!("{}/{}", self.namespace.trim_end_matches('/'), self.name)
    }
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

/// Checks that DDS allows a full name.
///
/// # Errors
/// [`NameError`].
pub(crate) fn check_full_name(name: &str) -> Result<(), NameError> {
    let tokens = name.strip_prefix('/').ok_or_else(|| NameError::NoSlash(name.to_owned()))?;
    if name.len() > MAX_NAME {
        return Err(NameError::Long(name.len()));
    }
    tokens.split('/').try_for_each(check_token)
}

/// The full name: `/a` is unchanged, `~/a` is below the node, `a` in its namespace.
#[must_use]
pub(crate) fn expanded_name(name: &str, node: &NodeIdentity) -> String {
    match name.strip_prefix('~') {
        Some(rest) => {
            format!("{}/{}", node.full_name(), rest.trim_start_matches('/')).trim_end_matches('/').to_owned()
        }
        None if name.starts_with('/') => name.to_owned(),
        None => format!("{}/{name}", node.namespace.trim_end_matches('/')),
    }
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
            assert_eq!(NodeIdentity::new(given, "n").unwrap().namespace, kept);
        }
        for (namespace, name) in [("/a//b", "n"), ("/a", ""), ("/a", "1n"), ("/a-b", "n"), ("/", "n__m")] {
            assert!(NodeIdentity::new(namespace, name).is_err(), "{namespace} {name}");
        }
        assert!(check_full_name("/a/b_1").is_ok());
        assert!(
            check_full_name("/a b").is_err()
                && check_full_name("a").is_err()
                && check_full_name("/").is_err()
        );
    }
}
