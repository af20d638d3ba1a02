//! Pinhole cameras without distortion. Integer pixel coordinates are pixel centers.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// An undistorted pinhole camera; the optical frame has x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Intrinsics {
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Focal length in pixels, horizontal.
    pub fx: f64,
    /// Focal length in pixels, vertical.
    pub fy: f64,
    /// Principal point, horizontal pixel coordinate.
    pub cx: f64,
    /// Principal point, vertical pixel coordinate.
    pub cy: f64,
}

impl Intrinsics {
    /// Pixel coordinates of a point in the camera's optical frame; `None` at or behind the camera.
    pub fn project(&self, point_in_camera: &Point3<f64>) -> Option<(f64, f64)> {
        let z = point_in_camera.z;
        // docs/method.md (1.1).
        (z > 1e-9)
            .then(|| (self.fx * point_in_camera.x / z + self.cx, self.fy * point_in_camera.y / z + self.cy))
    }

    /// Index of the pixel at the projection of a point, row-major; `None` outside the image.
    pub fn pixel_of(&self, point_in_camera: &Point3<f64>) -> Option<usize> {
        let (u, v) = self.project(point_in_camera)?;
        self.pixel_at(u, v)
    }

    /// Index of the pixel at a place in the image, row-major; `None` outside the image.
    pub fn pixel_at(&self, u: f64, v: f64) -> Option<usize> {
        // With the half added, the cast rounds; `round` is a library call on processors without SSE 4.1.
        let x = u + 0.5;
        let y = v + 0.5;
        (x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64)
            .then(|| y as usize * self.width + x as usize)
    }

    /// Direction of a pixel's ray in the optical frame with z = 1, so the ray parameter is the z-depth.
    pub fn ray_at(&self, u: f64, v: f64) -> Vector3<f64> {
        Vector3::new((u - self.cx) / self.fx, (v - self.cy) / self.fy, 1.0)
    }

    /// The point seen at a pixel at the given z-depth in meters, in the optical frame.
    pub fn unproject(&self, u: f64, v: f64, depth_m: f64) -> Point3<f64> {
        Point3::from(self.ray_at(u, v) * depth_m)
    }

    /// The camera of the same view at another size.
    #[must_use]
    pub fn at_size(&self, width: usize, height: usize) -> Self {
        let x = width as f64 / self.width as f64;
        let y = height as f64 / self.height as f64;
        // The border of the image, at -0.5, scales.
        Self {
            width,
            height,
            fx: self.fx * x,
            fy: self.fy * y,
            cx: (self.cx + 0.5) * x - 0.5,
            cy: (self.cy + 0.5) * y - 0.5,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unproject_inverts_project() {
        let k = Intrinsics { width: 640, height: 480, fx: 577.3, fy: 571.0, cx: 322.7, cy: 236.8 };
        let p = k.unproject(17.25, 401.5, 1.7);
        let (u, v) = k.project(&p).unwrap();
        assert!((u - 17.25).abs() < 1e-9 && (v - 401.5).abs() < 1e-9);
        assert_eq!(k.pixel_of(&k.unproject(12.2, 3.4, 0.5)), Some(3 * 640 + 12));
        assert_eq!(k.project(&Point3::new(0.0, 0.0, -1.0)), None);
    }
}
