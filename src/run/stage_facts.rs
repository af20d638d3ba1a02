//! Selects the facts about a run on which the result of a stage depends: settings of later stages do not
//! count.

use super::Fingerprint;

/// Stages in their order, by the first word of their names. For any other stage all facts count.
const ORDER: [&str; 9] =
    ["capture", "match", "align", "surface", "register", "unite", "articulate", "joints", "assemble"];

/// Facts, by the beginning of their names, with the first stage that reads them. Any other fact counts from
/// the first stage on, and those of `LAST` after the last stage of `ORDER`.
const FIRST_READ: [(&str, &str); 12] = [
    ("config.matching.", "match"),
    ("matcher", "match"),
    ("config.register.", "align"),
    ("config.surface.", "surface"),
    ("config.train.", "surface"),
    // These settings decide whether fields are trained.
    ("config.articulation.", "surface"),
    ("config.run.parts", "register"),
    ("config.joint.", "joints"),
    ("config.model.", "assemble"),
    ("name", "assemble"),
    ("config.look.", LAST),
    ("config.export.", LAST),
];

const LAST: &str = "export";

/// Position of a stage in the order.
fn rank(stage: &str) -> usize {
    let word = stage.split('/').next().unwrap_or_default();
    ORDER.iter().position(|known| *known == word).unwrap_or(ORDER.len())
}

/// The facts on which the results of a stage and of those before it depend.
pub(super) fn of_stage(facts: &Fingerprint, stage: &str) -> Fingerprint {
    let at = rank(stage);
    facts.only(|fact| {
        let first = FIRST_READ.iter().find(|(begin, _)| fact.starts_with(begin));
        first.is_none_or(|(_, stage)| rank(stage) <= at)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use config::Config;

    #[test]
    fn a_fact_counts_from_the_stage_that_reads_it() {
        let facts = Fingerprint::default()
            .with_settings("config", &Config::default())
            .unwrap()
            .with("name", "box")
            .with("matcher", "1 file");
        let counts = |stage: &str, fact: &str| {
            of_stage(&facts.clone().with(fact, "other"), stage) != of_stage(&facts, stage)
        };
        let names = serde_json::to_value(&facts).unwrap();
        let names = names.as_object().unwrap();
        for (begin, stage) in FIRST_READ {
            let known = names.keys().find(|name| name.starts_with(begin));
            let fact = known.unwrap_or_else(|| panic!("{begin} is no fact"));
            let at = rank(stage);
            let before: Vec<&str> = ORDER[..at].iter().copied().filter(|s| counts(s, fact)).collect();
            assert!(before.is_empty(), "{fact} counts in {before:?}");
            let from = ORDER[at..].iter().copied().chain([LAST, "anything"]);
            let missing: Vec<&str> = from.filter(|s| !counts(s, fact)).collect();
            assert!(missing.is_empty(), "{fact} does not count in {missing:?}");
        }
        for fact in
            ["config.capture.stride", "config.run.seed", "version", "source0", "config.radiance.steps"]
        {
            assert!(counts("capture", fact), "{fact}");
        }
        assert!(counts("match/state2", "config.matching.any") && !counts("match/state2", "config.joint.any"));
    }
}
