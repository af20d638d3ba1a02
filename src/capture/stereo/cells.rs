//! A view at half size: brightness, depth, and the holes in depth on the object.

use nalgebra::Vector3;

use crate::{NoiseConfig, RgbdFrame, dilated_mask, luma};
use geometry::{Intrinsics, Pose};
use numeric::statistics::{SIGMAS_PER_MAD, median};

/// Readings of a cell further apart than this share of their depth belong to two surfaces.
/// chosen: the depth change of a surface at 75 degrees to the ray over two pixels of a usual camera
const STEP: f32 = 0.02;
/// Border of the mask in which a cell may be on either side, cells.
const GUARD: usize = 1;

/// A view in cells of 2 x 2 pixels, row-major.
pub(super) struct Cells {
    /// Camera at this size.
    pub camera: Intrinsics,
    pub world_from_camera: Pose,
    /// Brightness in `[0, 1]`.
    pub luma: Vec<f32>,
    /// Standard deviation of the brightness noise.
    pub luma_sigma: f32,
    /// Measured depth, meters; 0 where it is unknown or discontinuous.
    pub depth_m: Vec<f32>,
    /// Expected standard deviation of the depth, meters.
    pub sigma_m: Vec<f32>,
    /// Whether a cell shows only the object.
    pub on_object: Vec<bool>,
    /// Whether a cell is certainly off the object.
    pub off_object: Vec<bool>,
    /// Whether a cell is on the object without depth.
    pub hole: Vec<bool>,
}

impl Cells {
    pub fn of_frame(frame: &RgbdFrame, noise: &NoiseConfig) -> Self {
        let full = &frame.intrinsics;
        let width = full.width / 2;
        let height = full.height / 2;
        let camera = Intrinsics {
            width,
            height,
            fx: 0.5 * full.fx,
            fy: 0.5 * full.fy,
            // The center between the first two pixels has the coordinate 0.5.
            cx: 0.5 * (full.cx - 0.5),
            cy: 0.5 * (full.cy - 0.5),
        };
        let count = width * height;
        let mut cells = Self {
            camera,
            world_from_camera: frame.world_from_camera,
            luma: vec![0.0; count],
            luma_sigma: 0.0,
            depth_m: vec![0.0; count],
            sigma_m: vec![0.0; count],
            on_object: vec![false; count],
            off_object: vec![false; count],
            hole: vec![false; count],
        };
        for cell in 0..count {
            let pixels = cells.pixels_of_cell(cell, full.width);
            cells.luma[cell] = pixels.iter().map(|&p| luma(frame.rgb[p])).sum::<f32>() / 4.0;
            let objects = pixels.iter().filter(|&&p| frame.is_object(p)).count();
            let depths = pixels.map(|p| frame.depth_m[p]);
            let read = depths.iter().filter(|d| **d > 0.0).count();
            let least = depths.iter().filter(|d| **d > 0.0).fold(f32::MAX, |a, &d| a.min(d));
            let most = depths.iter().fold(0f32, |a, &d| a.max(d));
            if read >= 3 && most - least < STEP * least {
                cells.depth_m[cell] = depths.iter().sum::<f32>() / read as f32;
                cells.sigma_m[cell] = noise.sigma_m(f64::from(cells.depth_m[cell])) as f32;
            }
            cells.on_object[cell] = objects == 4;
            cells.hole[cell] = objects == 4 && read <= 1;
        }
        let object: Vec<bool> = (0..count)
            .map(|cell| cells.pixels_of_cell(cell, full.width).iter().any(|&p| frame.is_object(p)))
            .collect();
        cells.off_object =
            dilated_mask(&object, width, height, GUARD).into_iter().map(|near| !near).collect();
        cells.luma_sigma = cells.noise_of_luma();
        cells
    }

    /// Number of cells on the object, and of those with no reading within `reach`.
    pub fn unread_counts(&self, reach: usize) -> [usize; 2] {
        let w = self.camera.width;
        let h = self.camera.height;
        let read: Vec<bool> =
            self.depth_m.iter().zip(&self.on_object).map(|(d, on)| *d > 0.0 && *on).collect();
        let near = dilated_mask(&read, w, h, reach);
        let object = self.on_object.iter().filter(|on| **on).count();
        [object, self.hole.iter().zip(near).filter(|(hole, near)| **hole && !near).count()]
    }

    /// The pixels of a cell in an image of the given width.
    pub fn pixels_of_cell(&self, cell: usize, width: usize) -> [usize; 4] {
        let x = 2 * (cell % self.camera.width);
        let y = 2 * (cell / self.camera.width);
        [y * width + x, y * width + x + 1, (y + 1) * width + x, (y + 1) * width + x + 1]
    }

    /// Direction of the ray through a cell's middle, z = 1.
    pub fn ray_of_cell(&self, cell: usize) -> Vector3<f32> {
        let x = cell % self.camera.width;
        let y = cell / self.camera.width;
        self.camera.ray_at(x as f64, y as f64).cast()
    }

    /// Brightness noise from the residuals of planes in 3 x 3 cells (Immerkaer 1996; by the median, to be
    /// robust to texture).
    fn noise_of_luma(&self) -> f32 {
        let w = self.camera.width;
        let h = self.camera.height;
        let at = |x: usize, y: usize| f64::from(self.luma[y * w + x]);
        let mut left = Vec::new();
        for y in 1..h.saturating_sub(1) {
            for x in (1..w.saturating_sub(1)).filter(|&x| self.on_object[y * w + x]) {
                let corners = at(x - 1, y - 1) + at(x + 1, y - 1) + at(x - 1, y + 1) + at(x + 1, y + 1);
                let sides = at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1);
                // The weights 1, -2 and 4 have a sum of squares of 36.
                left.push((corners - 2.0 * sides + 4.0 * at(x, y)).abs() / 6.0);
            }
        }
        // At least the quantization of 8 bits.
        (SIGMAS_PER_MAD * median(left).unwrap_or(0.0)).max(1.0 / (255.0 * 12f64.sqrt())) as f32
    }
}
