//! Variance components: errors not named as effects, of the twin, of the camera's poses, and of patches.

use crate::{
    camera::model::scales::{GATE, Scales},
    record::off_axis::MAX_LEFT,
};

/// Largest component as a share of the gate: anything larger is an effect.
///
/// derived: the share of an effect's standard deviation an explanation may leave (`MAX_LEFT`); the gate is a
/// multiple of that deviation
const LARGEST: f64 = MAX_LEFT / GATE;
/// Number of values of each component in the grid.
const STEPS: [usize; 3] = [4, 3, 3];

/// Standard deviations of the unnamed errors, meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VarianceComponents {
    /// Of the twin's surface, and of the placement of its parts and joints.
    pub surface_m: f64,
    /// Of the camera's pose in a frame, as displacement at the object.
    pub frame_m: f64,
    /// Of each patch in each frame, independently.
    pub rest_m: f64,
}

impl VarianceComponents {
    /// The searched grid. Each component runs from the twin's accuracy to a share of the gate in equal steps
    /// of its logarithm, since the evidence varies slowly over it.
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

    /// The middle of the grid, used while a hypothesis is being moved.
    pub fn middle_of_grid(scales: &Scales) -> Self {
        // The geometric mean, since the grid is even on a logarithmic scale.
        let m = (scales.accuracy_m * largest_m(scales)).sqrt();
        Self { surface_m: m, frame_m: m, rest_m: m }
    }

    /// Standard deviation of all three together, for a single reading.
    pub fn total_m(&self) -> f64 {
        self.surface_m.hypot(self.frame_m).hypot(self.rest_m)
    }
}

/// The largest value of a component, meters.
pub fn largest_m(scales: &Scales) -> f64 {
    // Where the twin's accuracy is worse than that, the grid has one value.
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
