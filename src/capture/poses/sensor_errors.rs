//! Parameters of a sensor's systematic errors: the depth error per pixel, the shift of color, and the delay
//! of the poses.

use nalgebra::{DMatrix, DVector};

use super::depth_warp::DepthWarp;
use geometry::Intrinsics;

/// Standard deviation of a depth sensor's scale error: data sheets of stereo cameras allow 2 % at 2 m, and
/// factory calibration leaves about a fifth of it. chosen: a quarter of the data sheet's bound
const SCALE: f64 = 0.005;
/// Standard deviation of the rotation of color against depth about either axis, radians: about two pixels of
/// an image of 640, as left by calibration (Basso, Menegatti and Pretto 2018).
/// chosen: of the order in this paper
const COLOR_SHIFT: f64 = 0.003;
/// Standard deviation of the poses' delay against the images, seconds: clocks of two devices differ by
/// milliseconds to tens of them (Furgale, Rehder and Siegwart 2013; Qin and Shen 2018).
/// chosen: of the order in these papers
const LAG_S: f64 = 0.02;

/// Errors of a sensor: coefficients of the depth warp, shift of color, and delay of the poses.
#[derive(Clone, Debug)]
pub(crate) struct SensorErrors {
    pub warp: DepthWarp,
    /// Offset of color against depth along the image axes, in focal lengths.
    pub color_shift: [f64; 2],
    /// Delay of the reported poses against the images, seconds.
    pub lag_s: f64,
}

impl SensorErrors {
    /// No errors, for images of this size.
    pub fn without_errors(intrinsics: &Intrinsics) -> Self {
        Self { warp: DepthWarp::without_errors(intrinsics), color_shift: [0.0; 2], lag_s: 0.0 }
    }

    /// Number of parameters.
    pub fn count(&self) -> usize {
        self.warp.values.len() + self.color_shift.len() + 1
    }

    /// Index of the delay among the parameters.
    pub fn lag_index(&self) -> usize {
        self.count() - 1
    }

    /// Index of the first color shift among the parameters.
    pub fn first_of_shift(&self) -> usize {
        self.warp.values.len()
    }

    /// All parameters.
    pub fn values(&self) -> DVector<f64> {
        DVector::from_iterator(self.count(), self.all().copied())
    }

    fn all(&self) -> impl Iterator<Item = &f64> {
        self.warp.values.iter().chain(&self.color_shift).chain([&self.lag_s])
    }

    /// Adds a step to all parameters.
    pub fn add_step(&mut self, step: &DVector<f64>) {
        let all = self.warp.values.iter_mut().chain(&mut self.color_shift).chain([&mut self.lag_s]);
        all.zip(step.iter()).for_each(|(v, s)| *v += s);
    }

    /// Prior covariance of the parameters, for smooth errors of a size: docs/method.md (2.20).
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
