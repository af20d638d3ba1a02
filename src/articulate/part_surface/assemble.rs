//! One surface per part from all states: each state's field, carried through the part's motion.
//!
//! The published method cuts a part from one state's TSDF by setting it to `+1` where another part has the
//! label. Here the states vote together, so that a drawer gets the inside that only the open state shows.

use nalgebra::Point3;
use rayon::prelude::*;

use crate::geometry::{Grid3, Pose};

/// The surface of one state with a part for every place near it.
pub struct LabelledState {
    /// Truncated signed distance, meters; NaN where nothing was observed.
    pub tsdf: Grid3<f32>,
    /// Weight of the observation at the same nodes.
    pub weight: Grid3<f32>,
    /// Part of the nearest surface at the same nodes; [`NO_LABEL`] away from every surface.
    pub labels: Grid3<u8>,
    /// Truncation distance, meters.
    pub truncation_m: f64,
}

/// Marks a node that is away from every surface.
pub const NO_LABEL: u8 = u8::MAX;

/// Truncated signed distance of a part in the world as it stands in state 0, meters; NaN where no state says
/// anything. `motions` take the part from state 0 to each of the `states`; the first is the identity.
#[must_use]
pub fn part_tsdf(part: u8, motions: &[Pose], states: &[LabelledState]) -> Grid3<f32> {
    let template = &states[0].tsdf;
    let mut out = Grid3 {
        origin: template.origin,
        spacing_m: template.spacing_m,
        dims: template.dims,
        values: vec![f32::NAN; template.values.len()],
    };
    let layer = template.dims[0] * template.dims[1];
    out.values.par_chunks_mut(layer).enumerate().for_each(|(z, values)| {
        for (i, value) in values.iter_mut().enumerate() {
            let x = template.position(z * layer + i);
            *value = vote(part, &x, motions, states);
        }
    });
    out
}

/// Weighted mean of what all states say about one place. See docs/method.md (9.1).
fn vote(part: u8, place: &Point3<f64>, motions: &[Pose], states: &[LabelledState]) -> f32 {
    let (mut sum, mut weight, mut elsewhere) = (0.0, 0.0, None::<f32>);
    for (k, (motion, state)) in motions.iter().zip(states).enumerate() {
        // State 0 stays where it is: even the identity would round.
        let place = if k == 0 { *place } else { motion * place };
        let Some(node) = state.tsdf.nearest(&place) else { continue };
        let distance = state.tsdf.sample(&place);
        // No vote where nothing was observed, so that no surface is invented.
        if !distance.is_finite() {
            continue;
        }
        let free = state.truncation_m as f32;
        let label = state.labels.values[node];
        let w = state.weight.values[node].max(1e-3);
        if label == part {
            sum += w * distance;
            weight += w;
        // Seen empty in this state: the part is not here.
        } else if label == NO_LABEL || distance > 0.5 * free {
            sum += w * free;
            weight += w;
        } else {
            // Another part stands here and may hide this one: a vote only where no state has a better one.
            elsewhere = Some(free);
        }
    }
    if weight > 0.0 { sum / weight } else { elsewhere.unwrap_or(f32::NAN) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::SceneBox;

    /// Two slabs normal to z: part 0 at z < -0.2, part 1 at z < 0 in state 0 and z < 0.1 in state 1.
    fn state(top: f64, seen_below: bool) -> LabelledState {
        let scene = SceneBox::around(&Point3::new(-0.5, -0.5, -0.5), &Point3::new(0.5, 0.5, 0.5));
        let mut tsdf = Grid3::over(&scene, 61, f32::NAN);
        let mut labels = Grid3::over(&scene, 61, NO_LABEL);
        for i in 0..tsdf.values.len() {
            let p = tsdf.position(i);
            let d = if p.x > 0.0 { p.z - top } else { p.z + 0.2 };
            if d > -0.08 && (seen_below || p.x > 0.0) {
                tsdf.values[i] = d.min(0.08) as f32;
            }
            if d.abs() < 0.08 {
                labels.values[i] = u8::from(p.x > 0.0);
            }
        }
        LabelledState { weight: Grid3::over(&scene, 61, 1.0), tsdf, labels, truncation_m: 0.08 }
    }

    #[test]
    fn each_part_gets_its_own_surface_from_the_state_that_saw_it() {
        let states = [state(0.0, false), state(0.1, true)];
        let moved = part_tsdf(1, &[Pose::identity(), Pose::translation(0.0, 0.0, 0.1)], &states);
        let at = |g: &Grid3<f32>, x: f64, z: f64| g.sample(&Point3::new(x, 0.0, z));
        assert!(at(&moved, 0.3, 0.03) > 0.02 && at(&moved, 0.3, -0.03) < -0.02);
        assert!(at(&moved, -0.3, 0.03) > 0.0, "free space of the other part");
        let still = part_tsdf(0, &[Pose::identity(); 2], &states);
        assert!(at(&still, -0.3, -0.17) > 0.02 && at(&still, -0.3, -0.23) < -0.02, "seen in state 1 only");
        assert!(at(&still, 0.3, 0.05) > 0.0);
    }
}
