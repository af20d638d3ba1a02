//! Where the values of a configuration come from.

use std::collections::BTreeMap;

use serde::Serialize;

/// Origin of every value, by key path: `file:line`, an option or `default`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Origins(pub BTreeMap<String, String>);
