//! Plain panels slid within their plane: opens the surface between the strip they left and the one they
//! reached.

use crate::{
    pair::{point_to_plane::SAMPLES_PER_READING, surface_pair::SurfacePair, unexplained::Unexplained},
    propose::patch::{Band, Patch, faces_of_open, largest_patches},
};

/// Number of patches tried per state.
const PATCHES: usize = 12;
/// Least share of a state's samples in a patch that is tried: a panel slid within its plane leaves only a
/// strip, and explains more.
/// tuned: shared/bags
const LEAST_PATCH: f64 = 0.001;
/// Least ratio of the samples between two strips of one plane to those of a full area, if it is surface.
/// chosen: the majority
const FILLED: f64 = 0.5;

/// Patches of the `faces` of a state that contain moved samples.
pub(crate) fn moved_patches(
    left: &Unexplained,
    pair: &SurfacePair<'_>,
    state: usize,
    faces: &[Vec<usize>],
) -> Vec<Patch> {
    let least = (LEAST_PATCH * left.open[state].len() as f64).max(SAMPLES_PER_READING) as usize;
    largest_patches(pair, state, faces, &left.moved[state], least, PATCHES)
}

/// Opens the samples between two strips of one plane, one left in state 0 and one reached in state 1: when a
/// plain panel slides within its plane, the surface it covers in both states seems to stand still.
pub(crate) fn join_slid(unexplained: &mut Unexplained, pair: &SurfacePair<'_>) {
    let strips =
        [0, 1].map(|s| moved_patches(unexplained, pair, s, &faces_of_open(pair, s, &unexplained.moved[s])));
    for left in &strips[0] {
        for reached in &strips[1] {
            let Some(between) = Band::between(left, reached, 0.5 * pair.reach_m) else { continue };
            let inside: [Vec<usize>; 2] = pair.samples.map(|of| {
                (0..of.points.len()).filter(|&i| between.holds(&of.points[i], &of.normals[i])).collect()
            });
            // An empty opening between two strips is no panel: it must be filled in both states.
            let is_full = (0..2)
                .all(|s| inside[s].len() as f64 > FILLED * between.area_m2() / pair.spacing_m[s].powi(2));
            if is_full {
                for (s, inside) in inside.iter().enumerate() {
                    for &i in inside {
                        (unexplained.open[s][i], unexplained.moved[s][i]) = (true, true);
                    }
                }
            }
        }
    }
}
