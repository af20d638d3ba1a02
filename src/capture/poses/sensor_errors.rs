//! The constant errors of a sensor: of depth by the pixel, the place of color against depth, and the age of
//! its poses.

use nalgebra::{DMatrix, DVector};

use super::depth_warp::DepthWarp;
use geometry::Intrinsics;

/// Error of a depth sensor's scale, one standard deviation: data sheets of stereo cameras allow 2 % at 2 m,
/// and factory calibration leaves about a fifth of it. chosen: a quarter of the data sheet's bound
const SCALE: f64 = 0.005;
/// Turn of color against depth about either axis, one standard deviation, radians: about two pixels of an
/// image of 640, left by the calibration of two imagers (Basso, Menegatti and Pretto 2018).
/// chosen: of the order of this paper
const COLOR_SHIFT: f64 = 0.003;
/// Age of poses against images, one standard deviation, seconds: clocks of two devices differ by milliseconds
/// to tens of them (Furgale, Rehder and Siegwart 2013; Qin and Shen 2018).
/// chosen: of the order of these papers
const LAG_S: f64 = 0.02;

/// Errors of a sensor: the values of the warp, the shift of color, and the lag of the poses.
#[derive(Clone, Debug)]
pub(crate) struct SensorErrors {
    pub warp: DepthWarp,
    /// Offset of color against depth along the image, in focal lengths.
    pub color_shift: [f64; 2],
    /// By how much the reported poses are older than the images, seconds.
    pub lag_s: f64,
}

impl SensorErrors {
    /// None, for images of a size.
    pub fn without_errors(intrinsics: &Intrinsics) -> Self {
        Self { warp: DepthWarp::without_errors(intrinsics), color_shift: [0.0; 2], lag_s: 0.0 }
    }

    /// Number of its values.
    pub fn count(&self) -> usize {
        self.warp.values.len() + self.color_shift.len() + 1
    }

    /// Index of the lag among the values.
    pub fn lag_index(&self) -> usize {
        self.count() - 1
    }

    /// Index of the first value of the shift of color.
    pub fn first_of_shift(&self) -> usize {
        self.warp.values.len()
    }

    /// All values.
    pub fn values(&self) -> DVector<f64> {
        DVector::from_iterator(self.count(), self.all().copied())
    }

    fn all(&self) -> impl Iterator<Item = &f64> {
        self.warp.values.iter().chain(&self.color_shift).chain([&self.lag_s])
    }

    /// Moves all values by a step.
    pub fn add_step(&mut self, step: &DVector<f64>) {
        let all = self.warp.values.iter_mut().chain(&mut self.color_shift).chain([&mut self.lag_s]);
        all.zip(step.iter()).for_each(|(v, s)| *v += s);
    }

    /// Expected covariance of the values, by the size of smooth errors: docs/method.md (2.20).
    pub fn expected_covariance(&self, size: f64) -> DMatrix<f64> {
        let warp = (self.warp.smooth_covariance() * size.powi(2)).add_scalar(SCALE.powi(2));
        let of_warp = self.first_of_shift();
        let count = self.count();
        let mut expected = DMatrix::from_diagonal_element(count, count, COLOR_SHIFT.powi(2));
        expected.view_mut((0, 0), (of_warp, of_warp)).copy_from(&warp);
        expected[(self.lag_index(), self.lag_index())] = LAG_S.powi(2);
        expected
    }
}
