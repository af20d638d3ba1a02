//! Merging of configuration layers, with the origin of every value.

use std::{collections::BTreeMap, fmt::Write as _, io::ErrorKind, path::Path};

use serde::{Serialize, de::DeserializeOwned};
use serde_norway::{Mapping, Value};

use super::{error::ConfigError, lines::key_lines, nearest, origins::Origins, preset::preset, removed};
use common::files;
use common::limits::{CONFIG, YamlError, parse_yaml};

/// Deepest nesting of groups; deeper nesting is refused.
const MAX_DEPTH: usize = 8;

/// Layers merged so far. Values stay YAML until [`Self::resolve`].
#[derive(Clone, Debug)]
pub struct Layers {
    defaults: Value,
    merged: Value,
    origins: BTreeMap<String, String>,
}

/// A configuration and the origins of its values.
#[derive(Clone, Debug)]
pub struct Resolved<T> {
    /// The configuration.
    pub config: T,
    /// Origin of every leaf.
    pub origins: Origins,
    values: Value,
}

impl Layers {
    /// Starts with the lowest layer, the defaults; their keys are the valid ones.
    ///
    /// # Errors
    /// If the defaults cannot be written as YAML.
    pub fn new(defaults: &impl Serialize) -> Result<Self, ConfigError> {
        let defaults = to_value(defaults)?;
        Ok(Self { merged: defaults.clone(), defaults, origins: BTreeMap::new() })
    }

    /// Adds a preset of `launch_configs/` by name.
    ///
    /// # Errors
    /// If there is no preset of this name, or as [`Self::add_text`].
    pub fn add_preset(&mut self, name: &str) -> Result<(), ConfigError> {
        let (path, text) = preset(name)?;
        self.add_text(&path, text)
    }

    /// Adds a YAML file, bounded by `limits::CONFIG`.
    ///
    /// # Errors
    /// If it cannot be read, is too large, or as [`Self::add_text`].
    pub fn add_file(&mut self, path: &Path) -> Result<(), ConfigError> {
        let bytes = files::read_limited(path, CONFIG).map_err(|source| match source.kind() {
            ErrorKind::FileTooLarge => ConfigError::TooLarge { path: path.to_owned() },
            _ => ConfigError::Read { path: path.to_owned(), source },
        })?;
        let name = path.display().to_string();
        let text = std::str::from_utf8(&bytes).map_err(|error| ConfigError::Syntax {
            origin: name.clone(),
            reason: format!("not UTF-8 text: {error}"),
        })?;
        self.add_text(&name, text)
    }

    /// Adds YAML text; messages call it `name`.
    ///
    /// # Errors
    /// If it is not YAML, or holds an unknown key or a group in place of a value.
    pub fn add_text(&mut self, name: &str, text: &str) -> Result<(), ConfigError> {
        let layer: Value = parse_yaml(text).map_err(|error| syntax_error(name.to_owned(), &error))?;
        // The parser gives no positions of values, so keys are looked up in the text.
        let lines = key_lines(text);
        self.add_layer(layer, &|key| match nearest_ancestor(&lines, key) {
            Some(line) => format!("{name}:{line}"),
            None => name.to_owned(),
        })
    }

    /// Adds `group.key=value`; the value is YAML.
    ///
    /// # Errors
    /// If it has another form, or as [`Self::add_text`].
    pub fn add_setting(&mut self, assignment: &str) -> Result<(), ConfigError> {
        let malformed = || ConfigError::Assignment { text: assignment.to_owned() };
        // Split at the first `=`: the value may contain more.
        let (key, text) = assignment.split_once('=').ok_or_else(malformed)?;
        if key.trim().is_empty() || text.trim().is_empty() {
            return Err(malformed());
        }
        let value = parse_yaml(text).map_err(|error| syntax_error(format!("--set {assignment}"), &error))?;
        self.add_option("--set", key.trim(), value)
    }

    /// Adds the value of a command-line option that sets a key.
    ///
    /// # Errors
    /// As [`Self::add_text`].
    pub fn add_option(&mut self, option: &str, key: &str, value: Value) -> Result<(), ConfigError> {
        if key.split('.').count() > MAX_DEPTH {
            return Err(ConfigError::Syntax {
                origin: option.to_owned(),
                reason: format!("{key} has more than {MAX_DEPTH} parts"),
            });
        }
        let mut layer = value;
        for part in key.rsplit('.') {
            layer = Value::Mapping(Mapping::from_iter([(Value::from(part), layer)]));
        }
        self.add_layer(layer, &|_| option.to_owned())
    }

    /// Turns the merged values into a configuration.
    ///
    /// # Errors
    /// [`ConfigError::Value`] with key and origin of a value of the wrong form.
    pub fn resolve<T: Serialize + DeserializeOwned>(self) -> Result<Resolved<T>, ConfigError> {
        // Converted once from all layers, so a value explicitly set to its default counts as set.
        let config: T = serde_norway::from_value(self.merged.clone())
            .map_err(|error| self.value_error::<T>(&error.to_string()))?;
        let values = to_value(&config)?;
        let mut origins = BTreeMap::new();
        for (key, _) in leaf_values(&values) {
            // A list or an optional group is set as a whole, so its entries share its origin.
            let origin = nearest_ancestor(&self.origins, &key).map_or("default", String::as_str).to_owned();
            origins.insert(key, origin);
        }
        Ok(Resolved { config, origins: Origins(origins), values })
    }

    /// Merges a layer; `origin` returns the place of one of its keys.
    fn add_layer(&mut self, layer: Value, origin: &dyn Fn(&str) -> String) -> Result<(), ConfigError> {
        let Self { defaults, merged, origins } = self;
        let valid = || all_keys(defaults);
        merge_layer(&mut Target { origins, origin, valid: &valid }, "", defaults, merged, layer)
    }

    /// Finds the value that cannot be read even alone on the defaults; otherwise the error has no place.
    fn value_error<T: DeserializeOwned>(&self, reason: &str) -> ConfigError {
        // The parser does not name the key, so each given value is tried alone on the defaults.
        for (key, origin) in &self.origins {
            let Some(value) = get(&self.merged, key) else { continue };
            let mut alone = self.defaults.clone();
            if put_value(&mut alone, key, value.clone()).is_some()
                && let Err(error) = serde_norway::from_value::<T>(alone)
            {
                let origin = origin.clone();
                let key = key.clone();
                return ConfigError::Value { origin, key, value: one_line(value), reason: error.to_string() };
            }
        }
        ConfigError::Syntax { origin: "configuration".to_owned(), reason: reason.to_owned() }
    }
}

impl<T> Resolved<T> {
    /// The configuration as YAML, as accepted by `--config`.
    ///
    /// # Errors
    /// If it cannot be written as YAML.
    pub fn to_yaml(&self) -> Result<String, ConfigError> {
        serde_norway::to_string(&self.values).map_err(unwritable_error)
    }

    /// One line per leaf: `group.key = value   # origin`.
    #[must_use]
    pub fn to_lines_with_origins(&self) -> String {
        let lines: Vec<(String, &str)> = leaf_values(&self.values)
            .into_iter()
            .map(|(key, value)| {
                (
                    format!("{key} = {}", one_line(value)),
                    self.origins.0.get(&key).map_or("default", String::as_str),
                )
            })
            .collect();
        let width = lines.iter().map(|(text, _)| text.len()).max().unwrap_or(0);
        lines.iter().fold(String::new(), |mut all, (text, origin)| {
            // Writing to a String cannot fail.
            writeln!(all, "{text:width$}   # {origin}").ok();
            all
        })
    }
}

fn syntax_error(origin: String, error: &YamlError) -> ConfigError {
    ConfigError::Syntax { origin, reason: error.to_string() }
}

/// State of a recursive merge.
struct Target<'a> {
    origins: &'a mut BTreeMap<String, String>,
    origin: &'a dyn Fn(&str) -> String,
    valid: &'a dyn Fn() -> Vec<String>,
}

/// Merges `layer` into `merged` at `path`; `schema` is the default there. Groups are merged, anything else is
/// replaced as a whole.
fn merge_layer(
    target: &mut Target,
    path: &str,
    schema: &Value,
    merged: &mut Value,
    layer: Value,
) -> Result<(), ConfigError> {
    let origin = (target.origin)(path);
    let Value::Mapping(group) = schema else {
        // A list is one value: its entries do not merge with those of a lower layer.
        check_leaf(&origin, path, &layer, 0)?;
        target.origins.insert(path.to_owned(), origin);
        *merged = layer;
        return Ok(());
    };
    // In the defaults this is a group, so each of its keys has its own default.
    let given = match layer {
        // A group without entries, such as `train:` alone, is null in YAML.
        Value::Null => return Ok(()),
        Value::Mapping(given) => given,
        _ if path.is_empty() => {
            return Err(ConfigError::Syntax { origin, reason: "not a mapping of groups".to_owned() });
        }
        _ => {
            return Err(ConfigError::Group {
                origin,
                key: path.to_owned(),
                keys: group_names(group).collect::<Vec<_>>().join(", "),
            });
        }
    };
    for (key, value) in given {
        let Value::String(name) = key else {
            return Err(ConfigError::Syntax {
                origin,
                reason: format!("key {} is not text", one_line(&key)),
            });
        };
        let below = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
        let (Some(schema), Some(merged)) = (group.get(&name), merged.get_mut(&name)) else {
            let hint = removed::replacement_hint(&below)
                .unwrap_or_else(|| nearest::nearest_hint(&below, &(target.valid)()));
            return Err(ConfigError::UnknownKey { origin: (target.origin)(&below), key: below, hint });
        };
        merge_layer(target, &below, schema, merged, value)?;
    }
    Ok(())
}

/// Refuses infinite numbers, NaN and deep nesting.
fn check_leaf(origin: &str, key: &str, value: &Value, depth: usize) -> Result<(), ConfigError> {
    let reason = match value {
        _ if depth > MAX_DEPTH => "nested too deeply",
        // YAML's `.nan` and `.inf` are numbers.
        Value::Number(n) if n.as_f64().is_some_and(|v| !v.is_finite()) => "not a finite number",
        Value::Sequence(items) => {
            return items.iter().try_for_each(|v| check_leaf(origin, key, v, depth + 1));
        }
        Value::Tagged(tagged) => return check_leaf(origin, key, &tagged.value, depth + 1),
        Value::Mapping(map) => {
            return map.values().try_for_each(|v| check_leaf(origin, key, v, depth + 1));
        }
        _ => return Ok(()),
    };
    Err(ConfigError::Value {
        origin: origin.to_owned(),
        key: key.to_owned(),
        value: one_line(value),
        reason: reason.to_owned(),
    })
}

/// Paths and values of all leaves, in order.
fn leaf_values(value: &Value) -> Vec<(String, &Value)> {
    all_entries(value).into_iter().filter(|(_, v)| !matches!(v, Value::Mapping(_))).collect()
}

/// Paths of all groups and leaves.
fn all_keys(value: &Value) -> Vec<String> {
    all_entries(value).into_iter().map(|(key, _)| key).collect()
}

/// Paths and values of all groups and leaves, in order.
fn all_entries(value: &Value) -> Vec<(String, &Value)> {
    let Value::Mapping(map) = value else { return Vec::new() };
    let mut all = Vec::new();
    for (key, inner) in map {
        let key = key.as_str().unwrap_or_default();
        all.push((key.to_owned(), inner));
        all.extend(all_entries(inner).into_iter().map(|(rest, v)| (format!("{key}.{rest}"), v)));
    }
    all
}

fn group_names(map: &Mapping) -> impl Iterator<Item = &str> {
    map.keys().filter_map(Value::as_str)
}

fn get<'a>(value: &'a Value, path: &str) -> Option<&'a Value> {
    path.split('.').try_fold(value, |v, part| v.get(part))
}

fn put_value(value: &mut Value, path: &str, new: Value) -> Option<()> {
    *path.split('.').try_fold(value, |v, part| v.get_mut(part))? = new;
    Some(())
}

/// The entry of a path, or else of the innermost group around it.
fn nearest_ancestor<'a, V>(map: &'a BTreeMap<String, V>, path: &str) -> Option<&'a V> {
    let mut path = path;
    loop {
        if let Some(found) = map.get(path) {
            return Some(found);
        }
        path = path.rsplit_once('.')?.0;
    }
}

/// A value on one line. Single-precision settings are printed as written: `0.1`, not `0.10000000149011612`.
fn one_line(value: &Value) -> String {
    match value {
        Value::Sequence(items) => format!("[{}]", items.iter().map(one_line).collect::<Vec<_>>().join(", ")),
        Value::Tagged(tagged) => format!("{} {}", tagged.tag, one_line(&tagged.value)),
        Value::Mapping(map) => {
            format!(
                "{{{}}}",
                map.iter()
                    .map(|(k, v)| format!("{}: {}", one_line(k), one_line(v)))
                    .collect::<Vec<_>>()
                    .join(", ")
            )
        }
        Value::Number(n) if n.is_f64() => match n.as_f64() {
            // Converting single precision to double adds digits nobody wrote.
            Some(v) if f64::from(v as f32).to_bits() == v.to_bits() => format!("{:?}", v as f32),
            _ => n.to_string(),
        },
        _ => {
            serde_norway::to_string(value).map_or_else(|_| format!("{value:?}"), |s| s.trim_end().to_owned())
        }
    }
}

fn to_value(value: &impl Serialize) -> Result<Value, ConfigError> {
    serde_norway::to_value(value).map_err(unwritable_error)
}

fn unwritable_error(error: serde_norway::Error) -> ConfigError {
    ConfigError::Syntax { origin: "configuration".to_owned(), reason: error.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde::Deserialize;

    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Settings {
        run: Run,
        noise: Noise,
    }

    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Run {
        steps: usize,
        rate: f32,
        parts: Option<usize>,
    }

    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Noise {
        name: String,
        window: Option<[f64; 2]>,
        edge: Option<Edge>,
        shape: Shape,
    }

    #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Shape {
        #[default]
        Flat,
        Bent {
            sigmas: f64,
        },
    }

    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Edge {
        sigmas: f64,
        width: usize,
    }

    impl Default for Run {
        fn default() -> Self {
            Self { steps: 1, rate: 0.1, parts: None }
        }
    }

    fn layers(file: &str, sets: &[&str]) -> Result<Resolved<Settings>, ConfigError> {
        let mut layers = Layers::new(&Settings::default())?;
        layers.add_text("a.yaml", file)?;
        sets.iter().try_for_each(|s| layers.add_setting(s))?;
        layers.resolve()
    }

    fn refused(file: &str, sets: &[&str]) -> String {
        layers(file, sets).unwrap_err().to_string()
    }

    #[test]
    fn later_layers_win_and_origins_are_kept() {
        let resolved = layers(
            "# differences\nrun:\n  steps: 5\n  rate: 0.5\nnoise: {name: a:b, edge: {width: 3}}\n",
            &["run.rate=1", "noise.window=[0, 1.5]", "noise.shape=!bent {sigmas: 2.5}"],
        )
        .unwrap();
        let expected = Settings {
            run: Run { steps: 5, rate: 1.0, parts: None },
            noise: Noise {
                name: "a:b".to_owned(),
                window: Some([0.0, 1.5]),
                edge: Some(Edge { sigmas: 0.0, width: 3 }),
                shape: Shape::Bent { sigmas: 2.5 },
            },
        };
        assert_eq!(resolved.config, expected);
        let lines = resolved.to_lines_with_origins();
        let expected = [
            "run.steps = 5              # a.yaml:3",
            "run.rate = 1.0             # --set",
            "run.parts = null           # default",
            "noise.name = a:b           # a.yaml:5",
            "noise.window = [0.0, 1.5]   # --set",
            "noise.edge.sigmas = 0.0    # a.yaml:5",
            "noise.edge.width = 3       # a.yaml:5",
            "noise.shape = !bent {sigmas: 2.5} # --set",
        ];
        let words = |line: &str| line.split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(lines.lines().map(words).collect::<Vec<_>>(), expected.map(words));
    }

    #[test]
    fn what_is_shown_can_be_given_back() {
        let shown =
            layers("run: {steps: 7, parts: 3}", &["run.rate=0.3", "noise.shape=!bent {sigmas: 2}"]).unwrap();
        let again = layers(&shown.to_yaml().unwrap(), &[]).unwrap();
        assert_eq!(again.config, shown.config);
    }

    #[test]
    fn empty_layers_and_empty_groups_change_nothing() {
        for text in ["", "# nothing\n", "run:\n", "{}"] {
            let resolved = layers(text, &[]).unwrap();
            assert_eq!(resolved.config, Settings::default(), "{text:?}");
            assert!(resolved.origins.0.values().all(|o| o == "default"));
        }
        assert_eq!(layers("run: {parts: 2}", &["run.parts=null"]).unwrap().config.run.parts, None);
    }

    #[test]
    fn mistakes_are_named_with_their_place() {
        assert_eq!(
            refused("run:\n  step: 5\n", &[]),
            "a.yaml:2: unknown key run.step; did you mean run.steps?"
        );
        assert_eq!(
            refused("", &["noise.windw=3"]),
            "--set: unknown key noise.windw; did you mean noise.window?"
        );
        assert_eq!(
            refused("run: 3", &[]),
            "a.yaml:1: run is a group of keys, not a value; it has: steps, rate, parts"
        );
        let message = refused("run:\n  rate: 2\n  steps: many\n", &["noise.name=x"]);
        assert_eq!(message, "a.yaml:3: run.steps = many: invalid type: string \"many\", expected usize");
        let message = refused("", &["run.steps=-1"]);
        assert!(message.starts_with("--set: run.steps = -1: invalid value"), "{message}");
        let message = refused("noise: {edge: {sigma: 1}}", &[]);
        assert!(
            message.contains("noise.edge") && message.contains("sigma") && message.contains("sigmas"),
            "{message}"
        );
        assert!(refused("", &["noise.shape=!bent {sigmas: .inf}"]).contains("not a finite number"));
        assert!(refused("", &["run.rate=.nan"]).contains("not a finite number"));
        assert!(refused("", &["noise.window=[0, .inf]"]).contains("not a finite number"));
        assert!(refused("", &["run.steps"]).contains("group.key=value"));
        assert!(refused("", &["run.steps="]).contains("group.key=value"));
        assert!(refused("", &["a.b.c.d.e.f.g.h.i=1"]).contains("more than 8"));
        assert!(refused("- 1\n", &[]).contains("not a mapping"));
        assert!(refused("run: {steps: 1, steps: 2}", &[]).contains("duplicate"));
        assert!(refused("run: [", &[]).starts_with("a.yaml: "));
        assert!(refused("3: 4", &[]).contains("key 3 is not text"));
    }

    #[test]
    fn files_are_bounded() {
        let path = std::env::temp_dir().join(format!("artitwin-layers-{}.yaml", std::process::id()));
        let read = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            Layers::new(&Settings::default()).unwrap().add_file(&path)
        };
        assert!(matches!(read(&vec![b'#'; CONFIG.bytes as usize + 1]), Err(ConfigError::TooLarge { .. })));
        assert!(matches!(read(&[0xff, 0xfe]), Err(ConfigError::Syntax { .. })));
        assert!(read(b"run: {steps: 3}").is_ok());
        std::fs::remove_file(&path).unwrap();
        assert!(matches!(
            Layers::new(&Settings::default()).unwrap().add_file(&path),
            Err(ConfigError::Read { .. })
        ));
    }

    #[test]
    fn every_preset_is_valid_and_changes_only_what_it_names() {
        for (name, text) in crate::preset::PRESETS {
            assert!(text.lines().count() <= 32, "{name}");
            let mut layers = Layers::new(&crate::Config::default()).unwrap();
            layers.add_preset(name).unwrap();
            let resolved: Resolved<crate::Config> = layers.resolve().unwrap();
            resolved.config.check().unwrap();
            let defaults = to_value(&crate::Config::default()).unwrap();
            for (key, origin) in &resolved.origins.0 {
                let same = get(&defaults, key) == get(&resolved.values, key);
                assert!(same == (origin == "default"), "{name}: {key} repeats the default");
                assert!(same || origin.starts_with(&format!("launch_configs/{name}.yaml:")), "{origin}");
            }
        }
        assert!(
            Layers::new(&Settings::default())
                .unwrap()
                .add_preset("papr")
                .unwrap_err()
                .to_string()
                .contains("default, fields, preview, paper")
        );
    }

    proptest! {
        /// Merging layers one by one equals merging the last value of every key.
        #[test]
        fn the_last_value_of_a_key_counts(values in prop::collection::vec((0usize..3, 0usize..100), 0..12)) {
            let keys = ["run.steps", "run.parts", "noise.edge.width"];
            let noise = Noise { edge: Some(Edge::default()), ..Noise::default() };
            let mut layers = Layers::new(&Settings { noise, ..Settings::default() }).unwrap();
            let mut last = [None; 3];
            for (key, value) in values {
                layers.add_setting(&format!("{}={value}", keys[key])).unwrap();
                last[key] = Some(value);
            }
            let config: Settings = layers.resolve().unwrap().config;
            prop_assert_eq!(config.run.steps, last[0].unwrap_or(1));
            prop_assert_eq!(config.run.parts, last[1]);
            prop_assert_eq!(config.noise.edge.unwrap().width, last[2].unwrap_or(0));
        }

        /// No text makes the reader panic.
        #[test]
        fn any_text_is_read_or_refused(text in "[ a-z:{}\\[\\],#\n&*!|>\"'-]{0,60}") {
            layers(&text, &[]).ok();
            Layers::new(&Settings::default()).unwrap().add_setting(&text).ok();
        }
    }
}
