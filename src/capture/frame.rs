//! One RGB-D view with its camera and pose.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::NoiseConfig;
use geometry::{Intrinsics, Pose};
use numeric::statistics::median;

/// One view: color and depth share one undistorted camera.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RgbdFrame {
    /// Name for reports and match files: `<state>_<index>`, four digits, e.g. `0_0007`.
    pub id: String,
    /// Header stamp, nanoseconds.
    pub stamp_nanos: i64,
    /// Camera of both images; `width * height` pixels each.
    pub intrinsics: Intrinsics,
    /// Pose of the optical frame in the world frame.
    pub world_from_camera: Pose,
    /// Color, row-major.
    #[serde(with = "geometry::bytes")]
    pub rgb: Vec<[u8; 3]>,
    /// z-depth in meters, row-major; 0 = unknown; never NaN.
    #[serde(with = "geometry::bytes")]
    pub depth_m: Vec<f32>,
    /// Object pixels, row-major; `None` until the object was isolated.
    #[serde(with = "geometry::bytes::option")]
    pub mask: Option<Vec<bool>>,
    /// Number of independent sensor readings that each pixel's depth counts for; empty: one each.
    #[serde(with = "geometry::bytes")]
    pub readings: Vec<f32>,
}

impl RgbdFrame {
    /// Whether a pixel shows the object; true for every pixel without a mask.
    #[must_use]
    pub fn is_object(&self, pixel: usize) -> bool {
        self.mask.as_ref().is_none_or(|m| m[pixel])
    }

    /// Expected standard deviation of a pixel's depth, meters.
    #[must_use]
    pub fn sigma_m(&self, pixel: usize, noise: &NoiseConfig) -> f64 {
        // Raw depth has no list. A pixel dropped by denoising counts for none; the bound keeps its deviation
        // finite.
        let readings = self.readings.get(pixel).map_or(1.0, |r| f64::from(r.max(1e-3)));
        noise.sigma_m(f64::from(self.depth_m[pixel])) / readings.sqrt()
    }

    /// World point seen at a pixel index; `None` where the depth is unknown.
    #[must_use]
    pub fn world_point(&self, pixel: usize) -> Option<Point3<f64>> {
        let d = f64::from(self.depth_m[pixel]);
        let u = (pixel % self.intrinsics.width) as f64;
        let v = (pixel / self.intrinsics.width) as f64;
        (d > 0.0).then(|| self.world_from_camera * self.intrinsics.unproject(u, v, d))
    }

    /// Position of a world point in the optical frame, meters.
    #[must_use]
    pub fn in_camera(&self, point_in_world: &Point3<f64>) -> Point3<f64> {
        self.world_from_camera.inverse_transform_point(point_in_world)
    }
}

/// The distinct cameras of frames, in order of first use.
#[must_use]
pub fn cameras<'a>(frames: impl Iterator<Item = &'a RgbdFrame>) -> Vec<Intrinsics> {
    let mut all = Vec::new();
    for frame in frames {
        if !all.contains(&frame.intrinsics) {
            all.push(frame.intrinsics);
        }
    }
    all
}

/// Median of a value over every 97th object pixel with depth; `None` where there is none.
#[must_use]
pub fn median_over_object<'a>(
    frames: impl Iterator<Item = &'a RgbdFrame>,
    value: impl Fn(&RgbdFrame, usize) -> f64,
) -> Option<f64> {
    // 97 divides no usual image width, so samples come from many columns.
    const EVERY: usize = 97;
    let mut all = Vec::new();
    for f in frames {
        all.extend(
            (0..f.depth_m.len())
                .step_by(EVERY)
                .filter(|&i| f.depth_m[i] > 0.0 && f.is_object(i))
                .map(|i| value(f, i)),
        );
    }
    median(all)
}
