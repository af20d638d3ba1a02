//! Colors at any point of a state, from a surface or a trained field, for comparing states.

use nalgebra::{Matrix3, Point3, Vector3};

/// Color at a point, and its derivative by position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ColorSample {
    /// Color in `[0, 1]`.
    pub rgb: Vector3<f32>,
    /// `d rgb / d position`, one row a channel, per meter.
    pub jacobian: Matrix3<f32>,
}

/// A frozen color field of one state.
pub trait ColorField: Sync {
    /// Colors at world points seen along unit world directions, with exact derivatives by position.
    fn colors(&self, points: &[Point3<f64>], directions: &[Vector3<f64>]) -> Vec<ColorSample>;
}
