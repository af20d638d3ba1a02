//! `s3://bucket/key` and its kin.

use std::{
    fmt,
    path::{Component, Path, PathBuf},
};

/// Longest URI, bytes.
const MAX_URI: usize = 4096;

/// Where a URI leads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Scheme {
    /// Amazon S3 and what speaks like it.
    S3,
    /// Google Cloud Storage.
    Gcs,
    /// Azure Blob Storage.
    Azure,
    /// A web server.
    Http,
    /// Files of this machine.
    File,
}

/// A place in a store.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Uri {
    /// Where it leads.
    pub scheme: Scheme,
    /// Scheme and bucket, container or host, e.g. `s3://lab`; empty for files.
    pub root: String,
    /// What follows, without a slash at either end; for files the absolute path.
    pub path: String,
    /// Whether it ends with a slash: a prefix, no object.
    pub is_prefix: bool,
}

/// Why a URI is none that is served.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UriError {
    /// Another scheme.
    #[error("`{0}`: its scheme is not known; there are s3, gs, az, http, https and file")]
    Scheme(String),
    /// No bucket, container or host.
    #[error("`{0}` names no bucket, container or host")]
    Root(String),
    /// A path of a file that is not absolute.
    #[error("`{0}`: give an absolute path, file:///...")]
    Relative(String),
    /// A path with empty parts, `.`, `..`, a query, or of too many bytes.
    #[error("`{0}`: its path is empty, too long, or holds `//`, `.`, `..`, `?`, `#` or a control character")]
    Path(String),
}

impl Uri {
    /// Reads a URI; `None` where a text has no scheme and is a path.
    ///
    /// # Errors
    /// One that is not served.
    pub fn parse(text: &str) -> Result<Option<Self>, UriError> {
        let Some((scheme, rest)) = text.split_once("://").filter(|(s, _)| is_scheme(s)) else {
            return Ok(None);
        };
        let shown = || text.chars().take(200).collect::<String>();
        let lower = scheme.to_ascii_lowercase();
        let scheme = match lower.as_str() {
            "s3" | "s3a" => Scheme::S3,
            "gs" => Scheme::Gcs,
            "az" | "azure" => Scheme::Azure,
            "http" | "https" => Scheme::Http,
            "file" => Scheme::File,
            _ => return Err(UriError::Scheme(shown())),
        };
        let (authority, path) = rest.split_once('/').unwrap_or((rest, ""));
        if scheme == Scheme::File {
            return Self::file(authority, path).ok_or_else(|| UriError::Relative(shown()));
        }
        if authority.is_empty() {
            return Err(UriError::Root(shown()));
        }
        let is_prefix = path.is_empty() || path.ends_with('/');
        let path = path.trim_end_matches('/');
        let plain = |part: &str| !part.is_empty() && part != "." && part != "..";
        let bad = |c: char| c.is_control() || "?#\\".contains(c);
        if text.len() > MAX_URI || text.contains(bad) || !(path.is_empty() || path.split('/').all(plain)) {
            return Err(UriError::Path(shown()));
        }
        let root = format!("{lower}://{authority}");
        Ok(Some(Self { scheme, root, path: path.to_owned(), is_prefix }))
    }

    fn file(authority: &str, path: &str) -> Option<Option<Self>> {
        let absolute = format!("/{path}");
        let is_absolute = ["", "localhost"].contains(&authority);
        let plain = Path::new(&absolute).components().all(|c| c != Component::ParentDir);
        (is_absolute && plain).then(|| {
            let is_prefix = absolute.ends_with('/');
            let path = absolute.trim_end_matches('/').to_owned();
            Some(Self { scheme: Scheme::File, root: String::new(), path, is_prefix })
        })
    }

    /// The path of a file of this machine; `None` for what lies elsewhere.
    #[must_use]
    pub fn local(&self) -> Option<PathBuf> {
        (self.scheme == Scheme::File).then(|| PathBuf::from(&self.path))
    }

    /// What lies below.
    #[must_use]
    pub fn join(&self, below: &str) -> Self {
        let path = if self.path.is_empty() && self.scheme != Scheme::File {
            below.to_owned()
        } else {
            format!("{}/{below}", self.path)
        };
        Self { path, is_prefix: false, ..self.clone() }
    }

    /// A relative path that keeps the parts of the URI: `bucket/key`.
    #[must_use]
    pub fn relative(&self) -> PathBuf {
        let authority = self.root.split_once("://").map_or("", |(_, a)| a);
        // A host may have a port or a user.
        let plain = |c: char| if c.is_ascii_alphanumeric() || ".-_".contains(c) { c } else { '_' };
        let first: String = authority.chars().map(plain).collect();
        Path::new(&format!("_{first}")).join(&self.path)
    }
}

impl fmt::Display for Uri {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.scheme {
            Scheme::File => write!(f, "file://{}", self.path),
            _ => write!(f, "{}/{}", self.root, self.path),
        }
    }
}

fn is_scheme(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic())
        && text.chars().all(|c| c.is_ascii_alphanumeric() || "+.-".contains(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_have_a_scheme_and_paths_have_none() {
        let parse = |text: &str| Uri::parse(text);
        for path in ["bags/drawer", "/x", "C:/x", "a:b", "://x", "./s3:/x"] {
            assert_eq!(parse(path), Ok(None), "{path}");
        }
        let uri = parse("s3://lab/day 1/drawer/").unwrap().unwrap();
        assert_eq!((uri.root.as_str(), uri.path.as_str(), uri.is_prefix), ("s3://lab", "day 1/drawer", true));
        assert_eq!(uri.join("state0").to_string(), "s3://lab/day 1/drawer/state0");
        assert_eq!(uri.relative(), Path::new("_lab/day 1/drawer"));
        let file = parse("file:///x/y").unwrap().unwrap();
        assert_eq!((file.local(), file.to_string()), (Some("/x/y".into()), "file:///x/y".into()));
        assert_eq!(
            parse("https://host:8080/a.mcap").unwrap().unwrap().relative(),
            Path::new("_host_8080/a.mcap")
        );
        assert_eq!(parse("s3://lab").unwrap().unwrap().join("a").to_string(), "s3://lab/a");
        for wrong in
            ["ftp://x/y", "s3:///x", "s3://a/../b", "s3://a//b", "file://x/y", "http://a/b?c", "file:///../x"]
        {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
