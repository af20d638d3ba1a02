//! Measures how much of the surface of two states a motion takes onto itself, from depth alone.

use nalgebra::Point3;
use rayon::prelude::*;

use capture::{NoiseConfig, RgbdFrame};
use geometry::Pose;

/// One of this many pixels is compared.
const EVERY: usize = 97;
/// Readings that differ by more than this many standard deviations are of different surfaces.
///
/// chosen: three, 0.3 % of a normal distribution
const SAME: f64 = 3.0;

/// How much of what two states see a motion takes onto itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StandingShares {
    /// Share of the object's surface.
    pub object: f64,
    /// Share of the surface of the object and of what is around it.
    pub everything: f64,
}

/// Shares of the surface of state 1 that state 0 sees where it came from under a motion. Surface out of sight
/// of state 0 does not count. 0 if nothing counts.
pub fn standing_shares(
    states: [&[RgbdFrame]; 2],
    state1_from_state0: &Pose,
    noise: &NoiseConfig,
) -> StandingShares {
    let back = state1_from_state0.inverse();
    let counts = states[1].par_iter().map(|frame| standing_pixels(frame, &back, states[0], noise));
    let sum = |a: [[usize; 2]; 2], b: [[usize; 2]; 2]| [0, 1].map(|k| [a[k][0] + b[k][0], a[k][1] + b[k][1]]);
    let [object, around] = counts.reduce(|| [[0; 2]; 2], sum);
    let share = |[still, compared]: [usize; 2]| still as f64 / compared.max(1) as f64;
    StandingShares {
        object: share(object),
        everything: share([object[0] + around[0], object[1] + around[1]]),
    }
}

/// Number of pixels that stand still, and of all compared ones: of the object, and around it. `back` is the
/// motion from the frame's state to the state of `others`.
fn standing_pixels(
    frame: &RgbdFrame,
    back: &Pose,
    others: &[RgbdFrame],
    noise: &NoiseConfig,
) -> [[usize; 2]; 2] {
    let mut counts = [[0; 2]; 2];
    for i in (0..frame.depth_m.len()).step_by(EVERY) {
        let Some(point) = frame.world_point(i) else { continue };
        if let Some(stands) = is_surface_seen_at(&(back * point), frame.sigma_m(i, noise), others, noise) {
            let counts = &mut counts[usize::from(!frame.is_object(i))];
            counts[0] += usize::from(stands);
            counts[1] += 1;
        }
    }
    counts
}

/// Whether more frames see a surface at a point than see through it; `None` if no frame does either.
/// `sigma_m` is the standard deviation of the point along the ray.
pub fn is_surface_seen_at(
    point_in_world: &Point3<f64>,
    sigma_m: f64,
    frames: &[RgbdFrame],
    noise: &NoiseConfig,
) -> Option<bool> {
    // A reading in front of the point hides it and does not count.
    let mut seen = 0;
    let mut through = 0;
    for frame in frames {
        let point = frame.in_camera(point_in_world);
        let Some(pixel) = frame.intrinsics.pixel_of(&point).filter(|&i| frame.depth_m[i] > 0.0) else {
            continue;
        };
        let behind_m = f64::from(frame.depth_m[pixel]) - point.z;
        // A slanted surface varies in depth by this much within a pixel.
        let gate_m = SAME * sigma_m.hypot(frame.sigma_m(pixel, noise)) + point.z / frame.intrinsics.fx;
        seen += usize::from(behind_m.abs() <= gate_m);
        through += usize::from(behind_m > gate_m);
    }
    (seen + through > 0).then_some(seen > through)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use capture::analytic::{cuboid, looking_at_origin, view_of};
    use geometry::Intrinsics;

    #[test]
    fn what_stands_still_is_not_what_moved() {
        let noise =
            NoiseConfig { constant_m: 0.001, quadratic_per_m: 0.0, edge_sigmas: 6.0, grazing_cosine: 0.15 };
        let k = Intrinsics { width: 160, height: 120, fx: 170.0, fy: 165.0, cx: 81.0, cy: 58.0 };
        let motion = Pose::new(Vector3::new(0.05, -0.04, 0.03), Vector3::new(0.0, 0.1, 0.3));
        let block = cuboid(Vector3::new(0.2, 0.15, 0.1));
        let moved = |p: &Point3<f64>| block(&motion.inverse_transform_point(p));
        let eyes = [Point3::new(0.7, 0.5, 0.4), Point3::new(0.6, -0.6, 0.45)];
        let state0 = eyes.map(|eye| view_of(&block, k, looking_at_origin(eye)));
        let state1 = eyes.map(|eye| view_of(&moved, k, looking_at_origin(eye)));
        let share = |states: [&[RgbdFrame]; 2], motion: &Pose| standing_shares(states, motion, &noise).object;
        let shares = [share([&state0, &state0], &Pose::identity()), share([&state0, &state1], &motion)];
        assert!(shares.iter().all(|s| *s > 0.85), "{shares:?}");
        assert!(
            share([&state0, &state1], &Pose::identity()) < 0.25,
            "{}",
            share([&state0, &state1], &Pose::identity())
        );
    }
}
