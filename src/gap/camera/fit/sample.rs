//! A pixel compared with the twin: a residual, or a conflict.

use crate::camera::model::posed::SurfacePoint;

/// How a measured pixel conflicts with the twin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conflict {
    /// The object is seen before the twin's surface, or where the twin has none.
    Nearer,
    /// The object is seen behind the twin's surface.
    Farther,
    /// The twin has a surface where the object is not.
    Empty,
}

/// Outcome of a sampled pixel.
#[derive(Clone, Copy, Debug)]
pub enum Sample {
    /// Surface and reading belong together: residual across the surface and its standard deviation, meters.
    Match {
        /// The seen surface point.
        seen: SurfacePoint,
        /// Measured less predicted, meters, positive towards the camera.
        residual_m: f64,
        /// Standard deviation expected of the camera.
        sigma_m: f64,
        /// World point measured.
        measured: nalgebra::Point3<f64>,
    },
    /// They do not; the world point measured (predicted, where nothing was) and the part predicted.
    Conflict {
        /// How.
        kind: Conflict,
        /// World point.
        point: nalgebra::Point3<f64>,
        /// Part of the twin there.
        part: Option<usize>,
    },
}

impl Sample {
    /// World point measured; the predicted one where nothing was.
    #[must_use]
    pub fn measured_point(&self) -> nalgebra::Point3<f64> {
        match self {
            Self::Match { measured, .. } => *measured,
            Self::Conflict { point, .. } => *point,
        }
    }
}

/// A sampled pixel with its place.
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
