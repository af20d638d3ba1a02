//! A pixel compared with the twin: a residual, or a conflict.

use crate::camera::model::posed::SurfacePoint;

/// How a measured pixel conflicts with the twin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conflict {
    /// The object is seen in front of the twin's surface, or where the twin has none.
    Nearer,
    /// The object is seen behind the twin's surface.
    Farther,
    /// The twin has a surface where the object is not.
    Empty,
}

/// Outcome of a sampled pixel.
#[derive(Clone, Copy, Debug)]
pub enum Sample {
    /// Reading and surface match: residual across the surface and its standard deviation, meters.
    Match {
        /// The seen surface point.
        seen: SurfacePoint,
        /// Measured minus predicted, meters, positive towards the camera.
        residual_m: f64,
        /// Standard deviation expected from the camera's noise, meters.
        sigma_m: f64,
        /// Measured point, world frame.
        measured: nalgebra::Point3<f64>,
    },
    /// Reading and surface conflict: measured world point (the predicted one without a reading) and predicted
    /// part.
    Conflict {
        /// Kind of conflict.
        kind: Conflict,
        /// World point.
        point: nalgebra::Point3<f64>,
        /// Part of the twin at the pixel.
        part: Option<usize>,
    },
}

impl Sample {
    /// Measured world point; the predicted one without a reading.
    pub fn measured_point(&self) -> nalgebra::Point3<f64> {
        match self {
            Self::Match { measured, .. } => *measured,
            Self::Conflict { point, .. } => *point,
        }
    }
}

/// A sampled pixel with its outcome.
#[derive(Clone, Copy, Debug)]
pub struct PixelSample {
    /// Run.
    pub run: usize,
    /// Frame in the run.
    pub frame: usize,
    /// Pixel index.
    pub pixel: usize,
    /// Area of the sample, square meters on a surface facing the camera.
    pub area_m2: f64,
    /// Its outcome.
    pub sample: Sample,
}
