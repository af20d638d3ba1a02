//! Flying pixels: readings between the two surfaces at a depth edge, whose matching windows contain both.

use rand_core::Rng;

use crate::{View, edge::depth_step};
use geometry::Intrinsics;
use numeric::random;

/// Share of pixels at deep edges with a depth in between. chosen: a third
const SHARE: f64 = 0.35;
/// Least depth step at a deep edge, meters. chosen: a matching window does not notice less
const DEEP_M: f64 = 0.03;
/// Least distance of a reading in between from either surface, share of the step.
/// chosen: closer ones are no errors
const MARGIN: f64 = 0.1;

/// By pixel, depth between two surfaces, meters; `None` for an ordinary reading.
pub(super) fn between_m(level: f64, view: &View, k: &Intrinsics, rng: &mut impl Rng) -> Vec<Option<f64>> {
    let mut between_m = Vec::with_capacity(k.width * k.height);
    for i in 0..k.width * k.height {
        // Drawn for every pixel, so that the view does not shift later draws.
        let [draw, share] = [random::unit_uniform(rng), random::uniform_in(rng, MARGIN, 1.0 - MARGIN)];
        let depth_m = view.depth_m[i];
        let step = depth_step(&view.depth_m, k, i);
        let other_m = view.depth_m[step.neighbor];
        let is_edge = depth_m > 0.0 && other_m > 0.0 && step.is_beyond(DEEP_M);
        between_m.push((is_edge && draw < level * SHARE).then_some(depth_m + share * (other_m - depth_m)));
    }
    between_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::test_view::wall;
    use numeric::random::stage_rng;

    #[test]
    fn a_share_of_the_pixels_on_deep_edges_flies_between_both_surfaces() {
        let (mut view, k) = wall(2.0);
        let w = k.width;
        (0..k.height * w).filter(|i| i % w < w / 2).for_each(|i| view.depth_m[i] = 1.0);
        for level in [0.0, 0.5, 1.0] {
            let mut flying = 0;
            let mut edges = 0;
            for seed in 0..20 {
                let between = between_m(level, &view, &k, &mut stage_rng(seed, "fly", 0));
                for (i, b) in between.iter().enumerate() {
                    let on_edge = i % w == w / 2 || i % w == w / 2 - 1;
                    edges += usize::from(on_edge);
                    flying += usize::from(b.is_some());
                    assert!(b.is_none_or(|b| on_edge && (1.1..=1.9).contains(&b)));
                }
            }
            let share = flying as f64 / edges as f64;
            assert!((share - 0.35 * level).abs() < 0.02, "{share}");
        }
        (0..k.height * w).filter(|i| i % w < w / 2).for_each(|i| view.depth_m[i] = 1.98);
        assert!(between_m(1.0, &view, &k, &mut stage_rng(1, "fly", 0)).iter().all(Option::is_none));
    }
}
