//! Observations used in the search for parts and motions: lifted matches and surface samples.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// A surface point seen in both states: a pixel match lifted to 3D by both depths.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LiftedMatch {
    /// World point in state 0, meters.
    pub point0: Point3<f64>,
    /// World point in state 1, meters.
    pub point1: Point3<f64>,
    /// Expected standard deviation of the distance between the points after the true motion, meters.
    pub sigma_m: f64,
    /// Frame of state 0 and of state 1.
    pub frames: [usize; 2],
    /// Pixel (u, v) in each of them.
    pub pixels: [[f32; 2]; 2],
}

/// Points on the surface of one state.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SurfaceSamples {
    /// World points, meters.
    #[serde(with = "geometry::bytes")]
    pub points: Vec<Point3<f64>>,
    /// Unit normals, outward.
    #[serde(with = "geometry::bytes")]
    pub normals: Vec<Vector3<f64>>,
    /// Color in `[0, 1]`.
    #[serde(with = "geometry::bytes")]
    pub colors: Vec<[f32; 3]>,
}

impl SurfaceSamples {
    /// The chosen samples only.
    #[must_use]
    pub fn chosen_samples(&self, samples: &[usize]) -> Self {
        Self {
            points: samples.iter().map(|&i| self.points[i]).collect(),
            normals: samples.iter().map(|&i| self.normals[i]).collect(),
            colors: samples.iter().map(|&i| self.colors[i]).collect(),
        }
    }
}
