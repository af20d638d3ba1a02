//! Values of options, with the wanted form if they are something else.

use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser};

/// The wanted form of the value of an option.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("give {0}")]
pub(super) struct Wanted(pub &'static str);

/// Reads three numbers.
pub(super) fn vector(text: &str) -> Result<[f64; 3], Wanted> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, z]) if [x, y, z].iter().all(|v| v.is_finite()) => Ok([x, y, z]),
        _ => Err(Wanted("three numbers x,y,z")),
    }
}

/// Reads a topic and its link.
pub(super) fn topic_of_link(text: &str) -> Result<(String, String), Wanted> {
    match text.split_once('=') {
        Some((topic, link)) if !topic.is_empty() && !link.is_empty() => {
            Ok((topic.to_owned(), link.to_owned()))
        }
        _ => Err(Wanted("TOPIC=LINK, such as /gauge=handle")),
    }
}

/// Reads a joint of the twin with its recorded name.
pub(super) fn recorded_joint(text: &str) -> Result<(String, String), Wanted> {
    match text.split_once('=') {
        Some((joint, recorded)) if !joint.is_empty() && !recorded.is_empty() => {
            Ok((joint.to_owned(), recorded.to_owned()))
        }
        _ => Err(Wanted("JOINT=RECORDED, such as left_door=door")),
    }
}

/// Reads a path of this machine.
pub(super) fn local() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new()
        .try_map(|path| if is_uri(&path.to_string_lossy()) { Err(Uri) } else { Ok(path) })
}

/// A URI in place of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "a URI is no path: download it and give its path, or let `artitwin fleet` of the Python package fetch \
     inputs and put results"
)]
pub(super) struct Uri;

fn is_uri(text: &str) -> bool {
    text.split_once("://").is_some_and(|(scheme, _)| {
        scheme.starts_with(|c: char| c.is_ascii_alphabetic())
            && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+.-".contains(c))
    })
}

pub(super) fn name(text: &str) -> Result<String, Wanted> {
    let mut chars = text.chars();
    let valid = chars.next().is_some_and(|c| c.is_ascii_alphabetic())
        && chars.all(|c| c.is_ascii_alphanumeric() || c == '_');
    if valid && text.len() <= 64 {
        Ok(text.to_owned())
    } else {
        Err(Wanted("a letter, then letters, digits and _, 64 at most"))
    }
}
