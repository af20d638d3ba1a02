//! Where the values of a configuration came from.

use std::collections::BTreeMap;

use serde::Serialize;

/// Where every value came from: key path to `file:line`, an option or `default`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Origins(pub BTreeMap<String, String>);
