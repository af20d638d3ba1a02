//! Ablations of the neural method: its optional terms are left out one at a time.

/// Name of each ablation, with its settings on top of the preset `paper`.
pub const ABLATIONS: [(&str, &[&str]); 8] = [
    ("visibility", &["articulation.unseen_weight=1"]),
    ("consistency", &["articulation.weights.sdf=0", "articulation.weights.color=0"]),
    ("matching", &["articulation.weights.matching=0"]),
    ("collision", &["articulation.weights.collision=0"]),
    ("occupancy", &["articulation.weights.occupancy=0"]),
    ("free_space", &["train.empty_weight=0", "train.background=off"]),
    ("surface", &["train.surface_weight=0"]),
    // Without the published start (the identity), the registration is the start.
    ("start", &["run.init=registration", "articulation.refine=true"]),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Config, Layers};

    #[test]
    fn an_ablation_changes_its_own_settings_only() {
        let flat = |config: &Config| {
            fn leaves(at: &str, value: &serde_json::Value, all: &mut Vec<(String, String)>) {
                match value {
                    serde_json::Value::Object(map) => {
                        map.iter().for_each(|(k, v)| leaves(&format!("{at}.{k}"), v, all));
                    }
                    leaf => all.push((at[1..].to_owned(), leaf.to_string())),
                }
            }
            let mut all = Vec::new();
            leaves("", &serde_json::to_value(config).unwrap(), &mut all);
            all
        };
        let paper = flat(&Config::preset("paper").unwrap());
        for (name, settings) in ABLATIONS {
            let mut layers = Layers::new(&Config::default()).unwrap();
            layers.add_preset("paper").unwrap();
            settings.iter().for_each(|s| layers.add_setting(s).unwrap());
            let config: Config = layers.resolve().unwrap().config;
            config.check().unwrap();
            let changed: Vec<String> = paper
                .iter()
                .zip(flat(&config))
                .filter(|(a, b)| **a != *b)
                .map(|(a, _)| a.0.clone())
                .collect();
            let mut asked: Vec<&str> = settings.iter().map(|s| s.split('=').next().unwrap()).collect();
            asked.sort_unstable();
            let mut changed: Vec<&str> = changed.iter().map(String::as_str).collect();
            changed.sort_unstable();
            assert_eq!(changed, asked, "{name}");
        }
    }
}
