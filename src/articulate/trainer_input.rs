//! Checks of what the articulation trainer is given.

use nalgebra::Point3;

use super::{
    articulation_config::{ArticulationConfig, SdfResidual},
    evidence::LiftedMatch,
    state_model::StateModel,
};
use crate::geometry::Pose;

/// Fewest parts: a static and a moving one.
pub(super) const MIN_PARTS: usize = 2;
/// Most parts that a segmentation can have.
pub const MAX_PARTS: usize = 64;
/// Most grid nodes along a side of the segmentation field.
const MAX_GRID_NODES: usize = 200;
/// Most samples, points or matches of one step.
const MAX_SAMPLES: usize = 4_000_000;

/// Labelled surface points of a state: world points in metres, one part index each.
pub type LabelledPoints = (Vec<Point3<f64>>, Vec<u8>);

/// The articulation trainer cannot work with what it was given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrainerError {
    /// Number of parts out of range.
    #[error("{parts} parts were asked for; between 2 (a static and a moving one) and {MAX_PARTS} can be separated")]
    Parts {
        /// What was asked for.
        parts: usize,
    },
    /// A setting out of range.
    #[error("articulation.{name} = {value} is out of range; {remedy}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: String,
        /// What would be accepted.
        remedy: &'static str,
    },
    /// A state without rays.
    #[error("state {state} has no surface ray; its frames hold no usable object depth: check masks, depth and workspace")]
    NoRays {
        /// Which state.
        state: usize,
    },
    /// An input that does not fit the others.
    #[error("{what} of state {state}: {problem}")]
    Mismatch {
        /// Which input.
        what: &'static str,
        /// Which state.
        state: usize,
        /// What is wrong and what would be right.
        problem: String,
    },
    /// Initial motions that do not fit the number of parts.
    #[error("{got} initial motions for {parts} parts; give one finite motion a part, the first the identity")]
    InitialMotions {
        /// Motions given.
        got: usize,
        /// Parts asked for.
        parts: usize,
    },
    /// A checkpoint of another problem.
    #[error("the checkpoint belongs to another run ({what} differs); start again without --resume")]
    Checkpoint {
        /// What differs.
        what: &'static str,
    },
}

/// Refuses settings that make no sense.
pub(super) fn check_settings(config: &ArticulationConfig, parts: usize, truncation_m: f64) -> Result<(), TrainerError> {
    if !(MIN_PARTS..=MAX_PARTS).contains(&parts) {
        return Err(TrainerError::Parts { parts });
    }
    let setting = |ok: bool, name, value: String, remedy| if ok { Ok(()) } else { Err(TrainerError::Setting { name, value, remedy }) };
    setting(truncation_m > 0.0 && truncation_m.is_finite(), "truncation_m", truncation_m.to_string(), "use a positive length in metres")?;
    let nodes = config.grid_nodes;
    setting((2..=MAX_GRID_NODES).contains(&nodes), "grid_nodes", nodes.to_string(), "use 2 to 200")?;
    let counts = [
        ("rays", config.rays),
        ("samples_per_ray", config.samples_per_ray),
        ("uniform_points", config.uniform_points),
        ("matches", config.matches),
        ("label_points", config.label_points),
        ("rays * samples_per_ray", config.rays.saturating_mul(config.samples_per_ray)),
    ];
    for (name, count) in counts {
        setting((1..=MAX_SAMPLES).contains(&count), name, count.to_string(), "use 1 to 4000000")?;
    }
    for (name, range) in [
        ("field_rate", config.field_rate),
        ("identity_motion_rate", config.identity_motion_rate),
        ("refine_motion_rate", config.refine_motion_rate),
    ] {
        let ok = range.iter().all(|r| r.is_finite() && *r > 0.0);
        setting(ok, name, format!("{range:?}"), "use two positive rates")?;
    }
    let w = &config.weights;
    let weights = [w.sdf, w.color, w.occupancy, w.collision, w.matching, w.matching_3d];
    setting(weights.iter().all(|w| w.is_finite() && *w >= 0.0), "weights", format!("{weights:?}"), "use weights of 0 or more")?;
    let ramp = config.occupancy_ramp_m;
    setting(ramp.is_none_or(|r| r > 0.0 && r.is_finite()), "occupancy_ramp_m", format!("{ramp:?}"), "use a positive length in metres")?;
    for (name, steps) in
        [("identity_steps", config.identity_steps), ("refine_steps", config.refine_steps), ("label_steps", config.label_steps)]
    {
        setting(steps <= MAX_SAMPLES, name, steps.to_string(), "use 0 to 4000000")?;
    }
    if let SdfResidual::NoiseScaled { sigmas } = config.sdf_residual {
        setting(sigmas > 0.0 && sigmas.is_finite(), "sdf_residual", sigmas.to_string(), "use a positive number of sigmas")?;
    }
    for (name, share) in [("late_start", config.late_start), ("unseen_weight", config.unseen_weight)] {
        setting((0.0..=1.0).contains(&share), name, share.to_string(), "use 0 to 1")?;
    }
    Ok(())
}

/// Refuses a state that cannot be sampled.
pub(super) fn check_state(state: usize, model: &StateModel<'_>) -> Result<(), TrainerError> {
    let mismatch = |what, problem: String| Err(TrainerError::Mismatch { what, state, problem });
    if model.rays.is_empty() {
        return Err(TrainerError::NoRays { state });
    }
    let bad = |r: &super::SurfaceRay| {
        let finite = r.origin.coords.iter().chain(r.direction.iter()).all(|v| v.is_finite());
        !(finite && r.direction.norm() > 0.0 && r.depth_m.is_finite() && r.depth_m > 0.0 && r.sigma_m.is_finite() && r.sigma_m > 0.0)
    };
    if let Some(index) = model.rays.iter().position(bad) {
        return mismatch("ray", format!("ray {index} is not finite, or has no direction, depth or noise; drop invalid pixels first"));
    }
    for (what, dims, values) in
        [("distance grid", model.sdf.dims, model.sdf.values.len()), ("visibility grid", model.visible.dims, model.visible.values.len())]
    {
        if dims.iter().any(|d| *d < 2) || dims.iter().product::<usize>() != values || values > u32::MAX as usize {
            return mismatch(what, format!("{values} values for {dims:?} nodes; give every node one value, at least 2 a side"));
        }
    }
    if model.sdf.values.iter().any(|v| !v.is_finite()) {
        return mismatch("distance grid", "holds values that are not finite; extract the surface again".to_owned());
    }
    Ok(())
}

/// Refuses matches that name a frame that is not there, or are not finite.
pub(super) fn check_matches(states: &[StateModel<'_>; 2], matches: &[LiftedMatch]) -> Result<(), TrainerError> {
    for (index, pair) in matches.iter().enumerate() {
        for (state, point) in [pair.point0, pair.point1].into_iter().enumerate() {
            let (frame, frames) = (pair.frames[state], states[state].cameras.len());
            let finite = point.coords.iter().all(|v| v.is_finite()) && pair.pixels[state].iter().all(|v| v.is_finite());
            if frame >= frames || !finite || pair.sigma_m.is_nan() {
                let problem =
                    format!("match {index} lies in frame {frame} of {frames} or is not finite; lift matches again from these frames");
                return Err(TrainerError::Mismatch { what: "match", state, problem });
            }
        }
    }
    Ok(())
}

/// Refuses motions that do not fit.
pub(super) fn check_motions(init: Option<&[Pose]>, parts: usize) -> Result<(), TrainerError> {
    let Some(init) = init else { return Ok(()) };
    let finite = |m: &Pose| m.to_homogeneous().iter().all(|v| v.is_finite());
    let still = |m: &Pose| m.translation.vector.norm() < 1e-9 && m.rotation.angle() < 1e-9;
    if init.len() == parts && init.iter().all(finite) && still(&init[0]) {
        Ok(())
    } else {
        Err(TrainerError::InitialMotions { got: init.len(), parts })
    }
}

/// Refuses labels that do not fit.
pub(super) fn check_labels(labels: Option<[&LabelledPoints; 2]>, parts: usize) -> Result<(), TrainerError> {
    for (state, (points, labels)) in labels.into_iter().flatten().enumerate() {
        let fits = points.len() == labels.len() && !points.is_empty() && labels.iter().all(|l| usize::from(*l) < parts);
        if !fits || points.iter().any(|p| p.coords.iter().any(|v| !v.is_finite())) {
            let problem = format!("{} points with {} labels; give each finite point a label below {parts}", points.len(), labels.len());
            return Err(TrainerError::Mismatch { what: "labels", state, problem });
        }
    }
    Ok(())
}
