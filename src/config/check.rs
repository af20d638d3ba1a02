//! Unusable values are refused, with their key, before any work.
//!
//! Groups with special rules check themselves; the ranges of all other values are listed here.

use super::{Config, Engine, Method, error::ConfigError};
use articulate::TrainerError;
use capture::CaptureError;
use field::FieldError;

/// Smallest positive value. chosen: above zero, below any meaningful value
const POSITIVE: f64 = 1e-9;

impl Config {
    /// Refuses unusable values.
    ///
    /// # Errors
    /// [`ConfigError::Unusable`] with the key of the first one.
    pub fn check(&self) -> Result<(), ConfigError> {
        self.run.check()?;
        // Checked here, since otherwise the error would only appear when frames are matched.
        if self.matching.onnx.is_some() && !cfg!(feature = "onnx") {
            let reason = "this binary was built without ONNX models; build it with `cargo build --release \
                --features onnx`";
            return Err(unusable("matching.onnx", reason));
        }
        // Groups with special rules give the reason; the key is added here.
        self.capture.check().map_err(|error| match error {
            CaptureError::Setting { key, reason } => unusable(key, reason),
            other => unusable("capture", other),
        })?;
        self.train.validate().map_err(|error| unusable_field("train", error))?;
        self.radiance.validate().map_err(|error| unusable_field("radiance", error))?;
        if cfg!(not(feature = "gpu")) && self.run.engine == Engine::Gpu {
            let reason =
                "this binary was built without GPU support: build it with `--features gpu`, or give cpu";
            return Err(unusable("run.engine", reason));
        }
        if self.run.method == Method::Radiance && self.run.engine != Engine::Cpu {
            return Err(unusable("run.engine", "radiance fields are trained on the CPU alone; give cpu"));
        }
        self.articulation.check().map_err(|error| match error {
            TrainerError::Setting { name, value, remedy } => {
                unusable(format!("articulation.{name}"), format!("{value}; {remedy}"))
            }
            other => unusable("articulation", other),
        })?;
        self.export.check_values().map_err(|(key, reason)| unusable(format!("export.{key}"), reason))?;
        ranges(self).into_iter().try_for_each(|(key, value, low, high)| match value {
            // False for NaN.
            v if v >= low && v <= high => Ok(()),
            v => Err(outside(key, v, low, high)),
        })
    }
}

fn unusable_field(group: &str, error: FieldError) -> ConfigError {
    match error {
        FieldError::Config { key, value, low, high } => outside(&format!("{group}.{key}"), value, low, high),
        other => unusable(group, other),
    }
}

fn unusable(key: impl Into<String>, reason: impl ToString) -> ConfigError {
    ConfigError::Unusable { key: key.into(), reason: reason.to_string() }
}

fn outside(key: &str, value: f64, low: f64, high: f64) -> ConfigError {
    unusable(key, format!("{value}; give {low} to {high}"))
}

/// Key, value, minimum and maximum of every number not checked by its group.
fn ranges(config: &Config) -> Vec<(&'static str, f64, f64, f64)> {
    [
        capture(config),
        surface(config),
        matching(config),
        register(config),
        joint(config),
        model(config),
        look(config),
    ]
    .concat()
}

type Ranges = Vec<(&'static str, f64, f64, f64)>;

fn capture(config: &Config) -> Ranges {
    let noise = &config.capture.noise;
    vec![
        ("capture.noise.constant_m", noise.constant_m, 0.0, 1.0),
        ("capture.noise.quadratic_per_m", noise.quadratic_per_m, 0.0, 1.0),
        // Without any noise all weights would be infinite.
        (
            "capture.noise.constant_m + capture.noise.quadratic_per_m",
            noise.constant_m + noise.quadratic_per_m,
            POSITIVE,
            2.0,
        ),
        ("capture.noise.edge_sigmas", noise.edge_sigmas, 0.0, 1e3),
        ("capture.noise.grazing_cosine", noise.grazing_cosine, POSITIVE, 1.0),
    ]
}

fn surface(config: &Config) -> Ranges {
    let s = &config.surface;
    vec![
        ("surface.nodes", s.nodes as f64, 16.0, 1024.0),
        ("surface.distance_nodes", s.distance_nodes as f64, 16.0, 512.0),
        ("surface.points", s.points as f64, 100.0, 1e7),
        ("surface.min_component", s.min_component, 0.0, 1.0),
        ("surface.truncation_normalized", s.truncation_normalized.unwrap_or(1.0), 1e-3, 1.0),
    ]
}

fn matching(config: &Config) -> Ranges {
    let m = &config.matching;
    vec![
        ("matching.neighbors", m.neighbors as f64, 1.0, 1e4),
        ("matching.onnx_max_side_px", m.onnx_max_side_px as f64, 32.0, 4096.0),
        ("matching.onnx_min_confidence", f64::from(m.onnx_min_confidence), 0.0, 1.0),
    ]
}

fn register(config: &Config) -> Ranges {
    let r = &config.register;
    vec![("register.rounds", r.rounds as f64, 0.0, 1e3)]
}

fn joint(config: &Config) -> Ranges {
    vec![("joint.square.share", config.joint.square.share, 0.0, 1.0)]
}

fn model(config: &Config) -> Ranges {
    let m = &config.model;
    vec![
        ("model.density_kg_m3", m.density_kg_m3.unwrap_or(1.0), 1e-3, 1e5),
        ("model.wall_thickness_m", m.wall_thickness_m, 1e-6, 10.0),
        ("model.effort", m.effort, POSITIVE, 1e9),
        ("model.velocity", m.velocity, POSITIVE, 1e9),
    ]
}

fn look(config: &Config) -> Ranges {
    let l = &config.look;
    vec![
        ("look.max_faces", l.max_faces as f64, 100.0, 1e7),
        ("look.max_error_m", l.max_error_m, 0.0, 1.0),
        ("look.max_texture_px", l.max_texture_px as f64, 64.0, 16384.0),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Layers;

    /// The message for `--set key=value`.
    fn refused(assignment: &str) -> String {
        let mut layers = Layers::new(&Config::default()).unwrap();
        layers.add_setting(assignment).unwrap();
        let resolved = layers.resolve::<Config>().unwrap();
        let error = resolved.config.check().expect_err(assignment);
        error.with_origin(&resolved.origins).to_string()
    }

    #[test]
    fn defaults_and_presets_are_usable() {
        Config::default().check().unwrap();
        for (name, _) in crate::preset::PRESETS {
            let mut layers = Layers::new(&Config::default()).unwrap();
            layers.add_preset(name).unwrap();
            layers.resolve::<Config>().unwrap().config.check().unwrap();
        }
    }

    #[test]
    fn every_group_refuses_what_it_cannot_use_by_key_and_origin() {
        for assignment in [
            "run.parts=1",
            "capture.frames_per_state=0",
            "capture.noise.grazing_cosine=0",
            "train.rays=0",
            "train.field.levels=99",
            "radiance.rays=0",
            "surface.nodes=1",
            "surface.truncation_normalized=-1",
            "matching.neighbors=0",
            "matching.onnx_max_side_px=31",
            "matching.onnx_max_side_px=4097",
            "matching.onnx_min_confidence=1.5",
            "register.rounds=2000",
            "articulation.grid_nodes=1",
            "articulation.unseen_weight=2",
            "joint.square.share=1.5",
            "model.density_kg_m3=0",
            "export.prefix=2_",
            "export.license=''",
            "export.maintainer=me",
        ] {
            let message = refused(assignment);
            let (key, _) = assignment.split_once('=').unwrap();
            assert!(message.starts_with(&format!("{key}: ")) && message.ends_with("(--set)"), "{message}");
        }
    }

    #[test]
    fn every_range_names_a_setting() {
        let defaults = serde_norway::to_value(Config::default()).unwrap();
        for (keys, ..) in ranges(&Config::default()) {
            for key in keys.split(" + ") {
                assert!(key.split('.').try_fold(&defaults, |v, part| v.get(part)).is_some(), "{key}");
            }
        }
    }

    #[test]
    fn what_a_run_measures_is_no_setting() {
        let mut layers = Layers::new(&Config::default()).unwrap();
        for assignment in ["train.noise.constant_m=1", "train.truncation_m=1", "capture.seed=1"] {
            let message = layers.add_setting(assignment).unwrap_err().to_string();
            assert!(message.contains("unknown key"), "{message}");
        }
    }
}
