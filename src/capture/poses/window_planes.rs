//! Planes fitted around the pixels of a grid.

use nalgebra::{Matrix3, Vector3};

use crate::{NoiseConfig, RgbdFrame, window::WindowPlane};

/// Largest scatter of the readings about a plane, in standard deviations of the noise.
/// chosen: four times the variance, beyond chance
const MISFIT: f64 = 2.0;
/// Reach of the neighborhood used for a normal, cells, and the fewest cells in it.
const AROUND: i64 = 2;
const LEAST_AROUND: usize = 8;

/// The plane around a pixel; `None` if its readings scatter too much.
pub(super) fn plane_about_pixel(
    frame: &RgbdFrame,
    noise: &NoiseConfig,
    x: usize,
    y: usize,
) -> Option<WindowPlane> {
    let plane = WindowPlane::fit_with_holes(frame, x, y)?;
    (plane.reading_sigma_m() < MISFIT * noise.sigma_m(plane.mean_depth_m)).then_some(plane)
}

/// The planes of all cells.
pub(super) struct WindowPlanes {
    pub columns: usize,
    pub rows: usize,
    /// Pixels from one cell to the next.
    pub step: usize,
    /// Row by row.
    pub all: Vec<Option<WindowPlane>>,
}

impl WindowPlanes {
    /// Slopes of inverse depth at a cell, smoothed over neighbors on the same plane, 1/(meter pixel). The
    /// noise of single windows' normals would look like information about undetermined motions.
    pub fn smoothed_slopes(&self, cell: usize) -> Option<[f64; 2]> {
        let own = self.all[cell].as_ref()?;
        let x = (cell % self.columns) as i64;
        let y = (cell / self.columns) as i64;
        let gate = own.variance.sqrt();
        let mut moments = Matrix3::zeros();
        let mut right = Vector3::zeros();
        let mut count = 0;
        for (dx, dy) in (-AROUND..=AROUND).flat_map(|dy| (-AROUND..=AROUND).map(move |dx| (dx, dy))) {
            let column = x + dx;
            let row = y + dy;
            if column < 0 || row < 0 || column >= self.columns as i64 || row >= self.rows as i64 {
                continue;
            }
            let Some(there) = &self.all[row as usize * self.columns + column as usize] else { continue };
            let at = Vector3::new(1.0, (dx * self.step as i64) as f64, (dy * self.step as i64) as f64);
            // Neighbors on another plane would tilt the fit.
            let residual = there.inverse - own.inverse - own.slopes[0] * at.y - own.slopes[1] * at.z;
            if residual.abs() <= 3.0 * gate {
                moments += at * at.transpose();
                right += at * residual;
                count += 1;
            }
        }
        // A few cells, or cells in a line, give no better normal than the window.
        let change = if count > LEAST_AROUND {
            moments.try_inverse().map_or_else(Vector3::zeros, |m| m * right)
        } else {
            Vector3::zeros()
        };
        Some([own.slopes[0] + change.y, own.slopes[1] + change.z])
    }
}
