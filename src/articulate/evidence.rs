//! What the search for parts and motions works on.

use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// A surface point seen in both states: a pixel match lifted to 3D by both depths.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LiftedMatch {
    /// World point in state 0, metres.
    pub point0: Point3<f64>,
    /// World point in state 1, metres.
    pub point1: Point3<f64>,
    /// Expected standard deviation of their distance after the true motion, metres.
    pub sigma_m: f64,
    /// Frame of state 0 and of state 1.
    pub frames: [usize; 2],
    /// Pixel (u, v) in each of them.
    pub pixels: [[f32; 2]; 2],
}

/// Points on the surface of one state.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SurfaceSamples {
    /// World points, metres.
    #[serde(with = "crate::geometry::bytes")]
    pub points: Vec<Point3<f64>>,
    /// Unit normals, outward.
    #[serde(with = "crate::geometry::bytes")]
    pub normals: Vec<Vector3<f64>>,
    /// Colour in `[0, 1]`.
    #[serde(with = "crate::geometry::bytes")]
    pub colors: Vec<[f32; 3]>,
}

/// Colour at a point with its derivative by position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ColorSample {
    /// Colour in `[0, 1]`.
    pub rgb: Vector3<f32>,
    /// `d rgb / d position`, one row a channel, per metre.
    pub jacobian: Matrix3<f32>,
}

/// A frozen colour field of one state.
pub trait ColorField: Sync {
    /// Colours at world points seen along unit world directions, with exact derivatives by position.
    fn colors(&self, points: &[Point3<f64>], directions: &[Vector3<f64>]) -> Vec<ColorSample>;
}
