//! The variance components: errors without names, of the twin, of the camera's poses, and of single patches.

use crate::{
    camera::model::scales::{GATE, Scales},
    record::off_axis::MAX_LEFT,
};

/// Largest component over the gate: a larger one is an effect.
///
/// derived: the share of one standard deviation of an effect's motion left open by an explanation; the gate
/// is a multiple of that deviation
const LARGEST: f64 = MAX_LEFT / GATE;
/// Values of each component in the grid.
const STEPS: [usize; 3] = [4, 3, 3];

/// Standard deviations of the errors without names, meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VarianceComponents {
    /// Of the surface of the twin, and of where its parts and joints stand.
    pub surface_m: f64,
    /// Of the camera's pose in a frame, at the object.
    pub frame_m: f64,
    /// Of a patch in a frame by itself.
    pub rest_m: f64,
}

impl VarianceComponents {
    /// The searched grid: each component from the twin's accuracy to a share of the gate, evenly on a
    /// logarithmic scale: the evidence is flat on it.
    #[must_use]
    pub fn search_grid(scales: &Scales) -> Vec<Self> {
        let [surface, frame, rest] = STEPS.map(|n| component_values(scales, n));
        let mut all = Vec::new();
        for &surface_m in &surface {
            for &frame_m in &frame {
                all.extend(rest.iter().map(|&rest_m| Self { surface_m, frame_m, rest_m }));
            }
        }
        all
    }

    /// The middle of the grid, while a hypothesis is being moved.
    #[must_use]
    pub fn middle_of_grid(scales: &Scales) -> Self {
        // The geometric mean, since the grid is even on a logarithmic scale.
        let m = (scales.accuracy_m * largest_m(scales)).sqrt();
        Self { surface_m: m, frame_m: m, rest_m: m }
    }

    /// All of them together, for a single reading.
    #[must_use]
    pub fn total_m(&self) -> f64 {
        self.surface_m.hypot(self.frame_m).hypot(self.rest_m)
    }
}

/// The largest value of a component, meters.
#[must_use]
pub fn largest_m(scales: &Scales) -> f64 {
    // A twin of less accuracy leaves a grid of one value.
    (LARGEST * scales.gate_m()).max(scales.accuracy_m)
}

fn component_values(scales: &Scales, steps: usize) -> Vec<f64> {
    let ratio = largest_m(scales) / scales.accuracy_m;
    (0..steps).map(|k| scales.accuracy_m * ratio.powf(k as f64 / (steps - 1) as f64)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_runs_from_the_accuracy_to_a_share_of_the_gate() {
        let scales = Scales { radius_m: 0.4, range_m: 1.2, reading_m: 0.004, accuracy_m: 0.0003 };
        let grid = VarianceComponents::search_grid(&scales);
        assert_eq!(grid.len(), 36);
        let first = grid[0];
        let last = grid[35];
        assert!((first.surface_m - 0.0003).abs() < 1e-12 && (first.rest_m - 0.0003).abs() < 1e-12);
        assert!((last.frame_m - largest_m(&scales)).abs() < 1e-12);
        // A twin that errs by more than all errors without names leaves one value.
        let rough = Scales { accuracy_m: 0.1, ..scales };
        assert!(VarianceComponents::search_grid(&rough).iter().all(|c| (c.surface_m - 0.1).abs() < 1e-12));
    }
}
