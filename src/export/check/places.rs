//! Indices of names.

use std::collections::{BTreeMap, BTreeSet};

use super::{finding::Findings, rule::Rule};

/// Index of the first occurrence of each name.
pub(super) fn first_places<'a>(names: impl Iterator<Item = &'a str>) -> BTreeMap<&'a str, usize> {
    let mut places = BTreeMap::new();
    for (place, name) in names.enumerate() {
        places.entry(name).or_insert(place);
    }
    places
}

/// Index of the first occurrence of each name; repeated names are reported.
pub(super) fn unique_places<'a>(
    what: &str,
    names: impl Iterator<Item = &'a str> + Clone,
    found: &mut Findings,
) -> BTreeMap<&'a str, usize> {
    let places = first_places(names.clone());
    let again = names.enumerate().filter(|(place, name)| places.get(name) != Some(place));
    let mut reported = BTreeSet::new();
    for (_, name) in again.filter(|(_, name)| reported.insert(*name)) {
        found.add_error(Rule::Name, name, format!("is the name of more than one of the {what}"));
    }
    places
}
