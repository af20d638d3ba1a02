//! Finds the line of each key in a YAML file.

use std::collections::BTreeMap;

/// Line (from 1) of every key in block style, by its path. Keys inside braces are not found; they get the
/// line of the nearest key around them.
pub(crate) fn key_lines(text: &str) -> BTreeMap<String, usize> {
    let mut lines = BTreeMap::new();
    let mut open: Vec<(usize, String)> = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let content = line.trim_start();
        // Line by line, without a parser: a missed key gets the line of the group around it.
        let Some(key) = key_of_line(content) else { continue };
        let indent = line.len() - content.len();
        // In block style, a line indented no further than a group ends it.
        while open.last().is_some_and(|(i, _)| *i >= indent) {
            open.pop();
        }
        let path = open.last().map_or_else(|| key.to_owned(), |(_, parent)| format!("{parent}.{key}"));
        lines.insert(path.clone(), number + 1);
        open.push((indent, path));
    }
    lines
}

/// The key at the start of a line.
fn key_of_line(content: &str) -> Option<&str> {
    // Comments, list entries and flow style do not start a key of a block.
    if content.starts_with(['#', '-', '{', '[']) {
        return None;
    }
    let (key, rest) = content.split_once(':')?;
    // A colon not followed by a space is part of a value, as in a time or a path.
    (rest.is_empty() || rest.starts_with([' ', '\t'])).then(|| key.trim().trim_matches(['"', '\'']))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_found_at_any_depth() {
        let text = "# settings: none\nrun:\n  seed: 3\n\n'field':\n  levels: 4\n  noise:\n    - \
            1\n    edge: a:b\n  hidden:   8\ntop: {x: 1}\n";
        let expected = [
            ("run", 2),
            ("run.seed", 3),
            ("field", 5),
            ("field.levels", 6),
            ("field.noise", 7),
            ("field.noise.edge", 9),
            ("field.hidden", 10),
            ("top", 11),
        ];
        assert_eq!(key_lines(text), expected.map(|(k, l)| (k.to_owned(), l)).into());
    }
}
