//! Suggests the most likely valid key for a mistyped one.

/// Longest key to be corrected: an edit distance costs the product of both lengths.
const MAX_KEY: usize = 128;

/// Advice for a wrong `key`: the nearest of `valid` by edit distance, or where to look.
pub(crate) fn nearest_hint(key: &str, valid: &[String]) -> String {
    let near = valid.iter().filter(|_| key.len() <= MAX_KEY);
    match near.map(|v| (key_distance(key, v), v)).min() {
        // Two typos, or a third of a long key; anything farther is not a typo.
        Some((d, nearest)) if d <= 2.max(key.len() / 3) => format!("did you mean {nearest}?"),
        _ => "`artitwin config show` lists the valid ones".to_owned(),
    }
}

/// Edit distance of two keys. The right key in a wrong group, or without a group, counts as nearer than the
/// edit distance of the whole paths.
fn key_distance(key: &str, candidate: &str) -> usize {
    let of_path = strsim::osa_distance(key, candidate);
    of_path.min(1 + strsim::osa_distance(last_part(key), last_part(candidate)))
}

fn last_part(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(key: &str, expected: &str) {
        let valid = ["run.seed", "run.parts", "field.levels", "field.hidden", "capture.noise.edge_sigmas"]
            .map(str::to_owned);
        assert!(nearest_hint(key, &valid).contains(expected), "{key}: {}", nearest_hint(key, &valid));
    }

    #[test]
    fn the_nearest_key_is_offered() {
        check("field.level", "field.levels?");
        check("filed.levels", "field.levels?");
        check("seed", "run.seed?");
        check("run.hidden", "field.hidden?");
        check("edge_sigma", "capture.noise.edge_sigmas?");
    }

    #[test]
    fn nothing_is_offered_for_nonsense() {
        check("xyzzy.quux", "config show");
        check(&"field.level".repeat(100_000), "config show");
    }
}
