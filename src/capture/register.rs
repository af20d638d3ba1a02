//! Depth of one camera brought to the pixels of another.
//!
//! The readings are the corners of a mesh over the depth image, cut where neighbors lie on different
//! surfaces. Its triangles are drawn into the other camera with a depth buffer, so nearer surface hides
//! what is behind it, and depth of fewer pixels than color fills all of color's pixels. See
//! docs/method.md (2.3).

use nalgebra::{Point3, Vector3};

use super::Distortion;
use geometry::{Intrinsics, Pose};

/// Steepest surface that joins two neighboring readings, as the tangent of its angle to the image plane.
/// chosen: at 80 deg, where sensors hardly read
const STEEPEST: f64 = 5.67;
/// Depth step that noise makes between neighboring readings, share of the depth.
/// chosen: three deviations of a stereo camera at 2 m
const NOISE_SHARE: f64 = 0.01;
/// Rounds of the inversion of a lens. derived: each divides the error by ten at least for lenses of data
/// sheets
const LENS_ROUNDS: usize = 20;

/// Brings depth images of one camera to another camera.
#[derive(Clone, Debug)]
pub struct DepthRegistration {
    depth: Intrinsics,
    color: Intrinsics,
    color_from_depth: Pose,
    /// x and y at z = 1 of the ray of each pixel of the depth image; NaN outside the lens's image.
    rays: Vec<[f32; 2]>,
    /// Largest ratio of neighboring depths on one surface, less one.
    edge_share: f64,
}

/// A reading in the color camera: its place there, pixels, and its inverse depth, 1/m.
type Corner = Option<[f64; 3]>;

/// The ray of a pixel through the lens at depth 1; not a number where the lens has none.
fn ray_of_pixel(depth: &Intrinsics, lens: &Distortion, pixel: usize) -> [f32; 2] {
    let ray = lens.ideal_ray(depth, (pixel % depth.width) as f64, (pixel / depth.width) as f64);
    ray.map_or([f32::NAN; 2], |r| [r.x as f32, r.y as f32])
}

impl DepthRegistration {
    /// A registration of images of the camera `depth` with a lens to the ideal camera `color`.
    #[must_use]
    pub fn new(depth: Intrinsics, lens: &Distortion, color: Intrinsics, color_from_depth: Pose) -> Self {
        let pixels = 0..depth.width * depth.height;
        let rays = pixels.map(|p| ray_of_pixel(&depth, lens, p)).collect();
        let edge_share = STEEPEST / depth.fx.min(depth.fy) + NOISE_SHARE;
        Self { depth, color, color_from_depth, rays, edge_share }
    }

    /// The image in the color camera, meters; 0 where no reading shows the depth.
    #[must_use]
    pub fn registered(&self, depth_m: &[f32]) -> Vec<f32> {
        let mut inverse = vec![0.0f32; self.color.width * self.color.height];
        let width = self.depth.width;
        let mut above: Vec<Corner> = Vec::new();
        for y in 0..self.depth.height {
            let row: Vec<Corner> = (y * width..(y + 1) * width).map(|p| self.corner(p, depth_m[p])).collect();
            row.iter().flatten().for_each(|corner| self.draw_point(&mut inverse, *corner));
            for x in 0..if above.is_empty() { 0 } else { width - 1 } {
                // Both halves of the square.
                let triangles = [[above[x], above[x + 1], row[x]], [above[x + 1], row[x + 1], row[x]]];
                for triangle in triangles {
                    if let [Some(a), Some(b), Some(c)] = triangle
                        && self.is_one_surface([a[2], b[2], c[2]])
                    {
                        self.draw_triangle(&mut inverse, [a, b, c]);
                    }
                }
            }
            above = row;
        }
        inverse.iter().map(|i| if *i > 0.0 { 1.0 / i } else { 0.0 }).collect()
    }

    /// Whether three readings, by their inverse depths, lie on one surface.
    fn is_one_surface(&self, inverse_depths: [f64; 3]) -> bool {
        let least = inverse_depths.iter().copied().fold(f64::INFINITY, f64::min);
        let most = inverse_depths.iter().copied().fold(0.0, f64::max);
        most <= least * (1.0 + self.edge_share)
    }

    fn corner(&self, pixel: usize, depth_m: f32) -> Corner {
        let [x, y] = self.rays[pixel].map(f64::from);
        (depth_m > 0.0 && x.is_finite()).then_some(())?;
        let point = self.color_from_depth * Point3::from(Vector3::new(x, y, 1.0) * f64::from(depth_m));
        let (u, v) = self.color.project(&point)?;
        Some([u, v, 1.0 / point.z])
    }

    fn draw_point(&self, inverse: &mut [f32], [u, v, i]: [f64; 3]) {
        if let Some(pixel) = self.color.pixel_at(u, v) {
            inverse[pixel] = inverse[pixel].max(i as f32);
        }
    }

    /// Draws a triangle: on a plane the inverse depth is an affine function of the pixel.
    fn draw_triangle(&self, inverse: &mut [f32], [a, b, c]: [[f64; 3]; 3]) {
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area.abs() < 1e-9 {
            return;
        }
        let least = |k: usize| a[k].min(b[k]).min(c[k]).ceil().max(0.0);
        let most = |k: usize, size: usize| a[k].max(b[k]).max(c[k]).floor().min(size as f64 - 1.0);
        let mut v = least(1);
        while v <= most(1, self.color.height) {
            let mut u = least(0);
            while u <= most(0, self.color.width) {
                let share_b = ((u - a[0]) * (c[1] - a[1]) - (v - a[1]) * (c[0] - a[0])) / area;
                let share_c = ((b[0] - a[0]) * (v - a[1]) - (b[1] - a[1]) * (u - a[0])) / area;
                let share_a = 1.0 - share_b - share_c;
                // Sides are drawn from both triangles, so that none is left open by rounding.
                if share_a >= -1e-9 && share_b >= -1e-9 && share_c >= -1e-9 {
                    let pixel = v as usize * self.color.width + u as usize;
                    let i = share_a * a[2] + share_b * b[2] + share_c * c[2];
                    inverse[pixel] = inverse[pixel].max(i as f32);
                }
                u += 1.0;
            }
            v += 1.0;
        }
    }
}

impl Distortion {
    /// The ray, z = 1, that the lens shows at a pixel; `None` where it shows none.
    #[must_use]
    pub fn ideal_ray(&self, camera: &Intrinsics, u: f64, v: f64) -> Option<Vector3<f64>> {
        let shown = camera.ray_at(u, v);
        if self.is_pinhole() {
            return Some(shown);
        }
        let mut ray = shown;
        for _ in 0..LENS_ROUNDS {
            let (x, y) = self.distorted_point(ray.x, ray.y);
            ray.x += shown.x - x;
            ray.y += shown.y - y;
        }
        let (x, y) = self.distorted_point(ray.x, ray.y);
        let off_px = ((x - shown.x) * camera.fx).hypot((y - shown.y) * camera.fy);
        // Beyond where the lens folds back, the search does not end.
        (off_px < 0.1).then_some(ray)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLOR: Intrinsics =
        Intrinsics { width: 160, height: 120, fx: 150.0, fy: 150.0, cx: 79.5, cy: 59.5 };

    /// Depth of a wall at 1.5 m and a board before it at 1 m, right of x = 0, along the ray of each pixel.
    fn scene(camera: &Intrinsics, lens: &Distortion, at: Vector3<f64>) -> Vec<f32> {
        let depth = |p: usize| {
            let Some(ray) = lens.ideal_ray(camera, (p % camera.width) as f64, (p / camera.width) as f64)
            else {
                return 0.0;
            };
            let board = 1.0 - at.z;
            let is_board = at.x + ray.x * board > 0.0;
            (if is_board { board } else { 1.5 - at.z }) as f32
        };
        (0..camera.width * camera.height).map(depth).collect()
    }

    /// Largest difference from the true depth away from the edge, and the share of the pixels with depth.
    fn compared(found: &[f32]) -> (f32, f64) {
        let truth = scene(&COLOR, &Distortion::default(), Vector3::zeros());
        let mut worst = 0.0f32;
        let mut read = 0;
        for (p, (a, b)) in found.iter().zip(&truth).enumerate() {
            if *a > 0.0 {
                read += 1;
                if (p % COLOR.width).abs_diff(80) > 12 {
                    worst = worst.max((a - b).abs());
                }
            }
        }
        (worst, f64::from(read) / truth.len() as f64)
    }

    #[test]
    fn depth_of_a_quarter_of_the_size_fills_all_pixels() {
        let small = Intrinsics { width: 40, height: 30, fx: 37.5, fy: 37.5, cx: 19.5, cy: 14.5 };
        let none = Distortion::default();
        let registration = DepthRegistration::new(small, &none, COLOR, Pose::identity());
        let (worst, read) = compared(&registration.registered(&scene(&small, &none, Vector3::zeros())));
        assert!(worst < 1e-4 && read > 0.9, "{worst} {read}");
    }

    #[test]
    fn depth_of_a_wider_camera_beside_color_with_a_lens_lies_where_color_sees_it() {
        let wide = Intrinsics { fx: 105.0, fy: 105.0, ..COLOR };
        let lens = Distortion { radial: [-0.1, 0.02, 0.0], ..Distortion::default() };
        let at = Vector3::new(-0.05, 0.01, -0.02);
        let registration =
            DepthRegistration::new(wide, &lens, COLOR, Pose::from_parts(at.into(), Default::default()));
        let (worst, read) = compared(&registration.registered(&scene(&wide, &lens, at)));
        assert!(worst < 1e-3 && read > 0.9, "{worst} {read}");
    }

    #[test]
    fn what_is_near_hides_what_is_behind() {
        let none = Distortion::default();
        let at = Vector3::new(0.3, 0.0, 0.0);
        let registration =
            DepthRegistration::new(COLOR, &none, COLOR, Pose::from_parts(at.into(), Default::default()));
        let found = registration.registered(&scene(&COLOR, &none, at));
        // From the right the camera sees wall that the board hides from color.
        assert!(found[60 * 160 + 100] - 1.0 < 1e-3, "{}", found[60 * 160 + 100]);
    }
}
