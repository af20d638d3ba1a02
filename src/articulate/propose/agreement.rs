//! How well samples of unexplained surface agree with a motion.

use nalgebra::Vector3;

use crate::pair::{
    reprojection::{CONTRADICTED, FREE, HALF_COST},
    surface_pair::{EDGE, SurfacePair},
    unexplained::Unexplained,
};
use geometry::Pose;

/// Ratio of the tolerated distance from a plane to its scale while motions are polished.
/// tuned: shared/bags
const SOFT: f64 = 1.5;
/// Standard deviation of the angle between two colors of one surface, radians.
/// tuned: shared/bags
const HUE_SIGMA: f64 = 0.12;
/// Length below which a color has no hue.
/// tuned: shared/bags
const DARK: f64 = 0.08;

/// Agreement of a sample with a motion that is up to a step off: 1 to 0.5 on unexplained surface of the other
/// state, falling with the distance; -1 in empty space; 0 where nothing was seen or the surface there is
/// explained.
pub(crate) fn rough_agreement(
    pair: &SurfacePair<'_>,
    left: &Unexplained,
    state: usize,
    sample: usize,
    other_from_this: &Pose,
) -> f64 {
    let these = pair.samples[state];
    let others = pair.samples[1 - state];
    let (point, nearest) = pair.moved_and_nearest(state, sample, other_from_this);
    match nearest {
        // A step is most of the reach: a sample beside its true partner must count nearly as much as one on
        // it.
        Some(j) if left.open[1 - state][j] => {
            let near = 1.0 - 0.5 * (point - others.points[j]).norm_squared() / pair.reach_m.powi(2);
            near * same_hue(these.colors[sample], others.colors[j])
        }
        Some(_) => 0.0,
        None => pair.free[1 - state].map_or(0.0, |is_free| if is_free(&point) { -1.0 } else { 0.0 }),
    }
}

/// Mean agreement of samples with a motion that is up to a step off.
pub(crate) fn mean_rough(
    pair: &SurfacePair<'_>,
    left: &Unexplained,
    state: usize,
    samples: &[usize],
    other_from_this: &Pose,
) -> f64 {
    samples.iter().map(|&i| rough_agreement(pair, left, state, i, other_from_this)).sum::<f64>()
        / samples.len().max(1) as f64
}

/// Agreement of a sample while a motion is polished: up to 1 on unexplained surface within its edges,
/// -[`CONTRADICTED`] in empty space.
pub(crate) fn sharp_agreement(
    pair: &SurfacePair<'_>,
    left: &Unexplained,
    state: usize,
    sample: usize,
    other_from_this: &Pose,
) -> f64 {
    let (point, nearest) = pair.moved_and_nearest(state, sample, other_from_this);
    let partner = nearest.and_then(|j| {
        let (off_m, aside) = pair.offset_from_plane(1 - state, j, &point);
        let z = off_m / (SOFT * pair.scales.plane_m);
        // One minus the cost of docs/method.md (6.5), on a wider scale: a motion that is not there yet must
        // still feel the surface.
        (aside < EDGE).then_some(HALF_COST / (HALF_COST + z * z) * hue_likeness(pair, left, state, sample, j))
    });
    match partner {
        Some(v) if v > 0.5 => v,
        // A poor partner does not outweigh a place seen empty.
        _ if pair.free[1 - state].is_some_and(|f| f(&point)) => -CONTRADICTED,
        v => v.unwrap_or(0.0),
    }
}

/// Gain of each unexplained sample from a motion, face by face: a face with more samples moved into empty
/// space than onto surface counts nothing.
pub(crate) fn gains_by_motion(
    pair: &SurfacePair<'_>,
    motion: &Pose,
    left: &Unexplained,
    faces: &[Vec<Vec<usize>>; 2],
) -> [Vec<f64>; 2] {
    [0, 1].map(|s| {
        let other_from_this = if s == 0 { *motion } else { motion.inverse() };
        let mut gains = vec![0.0; left.open[s].len()];
        for face in &faces[s] {
            let open = face.iter().filter(|&&i| left.open[s][i]);
            let own: Vec<(usize, f64)> =
                open.map(|&i| (i, gain_of_sample(pair, left, s, i, &other_from_this))).collect();
            // A face moves as a whole: if a few samples are on a surface by chance, this is no evidence for a
            // motion that moves the rest into empty space.
            if own.iter().map(|v| v.1).sum::<f64>() > 0.0 {
                own.iter().for_each(|(i, v)| gains[*i] = *v);
            }
        }
        gains
    })
}

/// Gain of a sample from a motion: 1 on a perfect partner of the same hue, -1 in empty space, 0 where nothing
/// was seen or something else is.
fn gain_of_sample(
    pair: &SurfacePair<'_>,
    left: &Unexplained,
    state: usize,
    sample: usize,
    other_from_this: &Pose,
) -> f64 {
    let (cost, partner) = pair.shape_cost(state, sample, other_from_this);
    if cost >= FREE {
        return -1.0;
    }
    let likeness = partner.map_or(0.0, |j| hue_likeness(pair, left, state, sample, j));
    likeness * (1.0 - 2.0 * f64::from(cost)).max(0.0)
}

/// How alike in hue a sample and its partner in the other state are; 0 if no unexplained surface calls for
/// the partner.
fn hue_likeness(
    pair: &SurfacePair<'_>,
    left: &Unexplained,
    state: usize,
    sample: usize,
    partner: usize,
) -> f64 {
    if !left.calls_for(state, sample, partner) {
        return 0.0;
    }
    same_hue(pair.samples[state].colors[sample], pair.samples[1 - state].colors[partner])
}

/// Likeness of two colors as of one surface in different light (which scales all channels alike): 1 to 0 by
/// the angle between them.
fn same_hue(a: [f32; 3], b: [f32; 3]) -> f64 {
    let [a, b] = [a, b].map(|c| Vector3::from(c).cast::<f64>());
    // The angle of a dark color is only noise.
    if a.norm().min(b.norm()) < DARK { 1.0 } else { (-0.5 * (a.angle(&b) / HUE_SIGMA).powi(2)).exp() }
}
