//! Plain panels that slid within their plane: surface between what they left and what they reached.

use crate::{
    pair::{point_to_plane::SAMPLES_PER_READING, surface_pair::SurfacePair, unexplained::Unexplained},
    propose::patch::{Band, Patch, faces, patches},
};

/// Patches tried per state.
const PATCHES: usize = 12;
/// A patch that is tried must have this share of a state's samples: what slid within its plane leaves but a
/// strip, and explains more.
/// tuned: shared/bags
const LEAST_PATCH: f64 = 0.001;
/// What lies between two strips of one plane is surface if it has this share of the samples of its area.
/// chosen: the majority
const FILLED: f64 = 0.5;

/// Patches of those `faces` of a state that hold samples which moved.
pub(crate) fn moved_patches(
    left: &Unexplained,
    pair: &SurfacePair<'_>,
    state: usize,
    faces: &[Vec<usize>],
) -> Vec<Patch> {
    let least = (LEAST_PATCH * left.open[state].len() as f64).max(SAMPLES_PER_READING) as usize;
    patches(pair, state, faces, &left.moved[state], least, PATCHES)
}

/// Opens what lies between two strips of one plane, one left in state 0 and one reached in state 1: where a
/// plain panel slides within its plane, what it covers in both states seems to stand still.
pub(crate) fn join_slid(unexplained: &mut Unexplained, pair: &SurfacePair<'_>) {
    let strips = [0, 1].map(|s| moved_patches(unexplained, pair, s, &faces(pair, s, &unexplained.moved[s])));
    for left in &strips[0] {
        for reached in &strips[1] {
            let Some(between) = Band::between(left, reached, 0.5 * pair.reach_m) else { continue };
            let inside = pair.samples.map(|of| {
                let holds = |i: &usize| between.holds(&of.points[*i], &of.normals[*i]);
                (0..of.points.len()).filter(holds).collect::<Vec<usize>>()
            });
            // An opening between two strips is no panel: it must be filled in both states.
            let full =
                |s: usize| inside[s].len() as f64 > FILLED * between.area_m2() / pair.spacing_m[s].powi(2);
            if full(0) && full(1) {
                for (s, inside) in inside.iter().enumerate() {
                    for &i in inside {
                        (unexplained.open[s][i], unexplained.moved[s][i]) = (true, true);
                    }
                }
            }
        }
    }
}
