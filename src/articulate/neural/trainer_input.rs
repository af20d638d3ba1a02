//! Checks the inputs of the articulation trainer.

use nalgebra::Point3;

use crate::{
    neural::{
        state_model::{StateModel, SurfaceRay},
        trainer_error::{MAX_PARTS, MIN_PARTS, TrainerError},
    },
    observations::LiftedMatch,
};
use geometry::Pose;

/// Labelled surface points of a state: world points in meters, and a part index for each.
pub(crate) type LabelledPoints = (Vec<Point3<f64>>, Vec<u8>);

/// Refuses an unusable number of parts or scale.
pub(crate) fn check_scale(parts: usize, truncation_m: f64) -> Result<(), TrainerError> {
    if !(MIN_PARTS..=MAX_PARTS).contains(&parts) {
        return Err(TrainerError::Parts { parts });
    }
    TrainerError::unless(
        truncation_m > 0.0 && truncation_m.is_finite(),
        "truncation_m",
        truncation_m.to_string(),
        "use a positive length in meters",
    )
}

/// Whether all values of a ray are finite, and it has a direction, a depth and depth noise.
fn is_valid(r: &SurfaceRay) -> bool {
    r.origin.coords.iter().chain(r.direction.iter()).all(|v| v.is_finite())
        && r.direction.norm() > 0.0
        && r.depth_m.is_finite()
        && r.depth_m > 0.0
}

/// Refuses a state that cannot be sampled.
pub(crate) fn check_state(state: usize, model: &StateModel<'_>) -> Result<(), TrainerError> {
    let mismatch = |what, problem: String| Err(TrainerError::Mismatch { what, state, problem });
    if model.rays.is_empty() {
        return Err(TrainerError::NoRays { state });
    }
    if let Some(index) = model.rays.iter().position(|r| !is_valid(r)) {
        return mismatch(
            "ray",
            format!("ray {index} is not finite, or has no direction or depth; drop invalid pixels first"),
        );
    }
    for (what, dims, values) in [
        ("distance grid", model.sdf.dims, model.sdf.values.len()),
        ("visibility grid", model.visible.dims, model.visible.values.len()),
    ] {
        // Interpolation needs two nodes a side, and voxel indices have 32 bits.
        if dims.iter().any(|d| *d < 2)
            || dims.iter().product::<usize>() != values
            || values > u32::MAX as usize
        {
            return mismatch(
                what,
                format!("{values} values for {dims:?} nodes; give every node one value, at least 2 a side"),
            );
        }
    }
    if model.sdf.values.iter().any(|v| !v.is_finite()) {
        return mismatch(
            "distance grid",
            "holds values that are not finite; extract the surface again".to_owned(),
        );
    }
    Ok(())
}

/// Refuses matches that refer to missing frames or have values that are not finite.
pub(crate) fn check_matches(
    states: &[StateModel<'_>; 2],
    matches: &[LiftedMatch],
) -> Result<(), TrainerError> {
    for (index, pair) in matches.iter().enumerate() {
        for (state, point) in [pair.point0, pair.point1].into_iter().enumerate() {
            let frame = pair.frames[state];
            let frames = states[state].cameras.len();
            let finite = point.coords.iter().all(|v| v.is_finite())
                && pair.pixels[state].iter().all(|v| v.is_finite());
            if frame >= frames || !finite || pair.sigma_m.is_nan() {
                let problem = format!(
                    "match {index} lies in frame {frame} of {frames} or is not finite; lift matches again \
                     from these frames"
                );
                return Err(TrainerError::Mismatch { what: "match", state, problem });
            }
        }
    }
    Ok(())
}

/// Refuses initial motions unless there is one for each part and all are finite.
pub(crate) fn check_motions(init: Option<&[Pose]>, parts: usize) -> Result<(), TrainerError> {
    let Some(init) = init else { return Ok(()) };
    let is_finite = init.iter().all(|m| m.to_homogeneous().iter().all(|v| v.is_finite()));
    // All motions are relative to part 0, so it must not move.
    let is_static =
        init.first().is_some_and(|m| m.translation.vector.norm() < 1e-9 && m.rotation.angle() < 1e-9);
    if init.len() == parts && is_finite && is_static {
        Ok(())
    } else {
        Err(TrainerError::InitialMotions { got: init.len(), parts })
    }
}

/// Refuses labels that do not fit the points and parts.
pub(crate) fn check_labels(labels: Option<[&LabelledPoints; 2]>, parts: usize) -> Result<(), TrainerError> {
    for (state, (points, labels)) in labels.into_iter().flatten().enumerate() {
        let fits = points.len() == labels.len()
            && !points.is_empty()
            && labels.iter().all(|l| usize::from(*l) < parts);
        if !fits || points.iter().any(|p| p.coords.iter().any(|v| !v.is_finite())) {
            let problem = format!(
                "{} points with {} labels; give each finite point a label below {parts}",
                points.len(),
                labels.len()
            );
            return Err(TrainerError::Mismatch { what: "labels", state, problem });
        }
    }
    Ok(())
}
