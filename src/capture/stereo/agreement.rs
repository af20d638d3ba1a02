//! Consistency of the depth found in several views.

use nalgebra::Point3;

use super::{cells::Cells, likeness::Side, planes::Planes};
use common::stop::{Stop, Stopped};
use numeric::statistics::{SIGMAS_PER_MAD, median};

/// Largest cost of an accepted plane: a correlation of 0.6.
/// chosen: two more views must find the same point
const LARGEST_COST: f32 = 0.4;
/// Largest relative difference of agreeing depths.
/// chosen: a cell of disparity between views 15 degrees apart at the focal length of a usual camera
const SAME: f32 = 0.01;
/// Fewest other views that must agree.
const WITNESSES: usize = 2;

/// What another view says about a point.
enum Word {
    /// It finds the same point, with this relative difference of depth.
    Same(f32),
    /// It sees through the point.
    Through,
    Nothing,
}

/// By cell, whether at least two other views find the same point, and more find it than see through it.
pub(super) fn agreed_cells(views: &[Cells], planes: &[Planes], reference: usize) -> Vec<bool> {
    let view = &views[reference];
    let mut agreed = vec![false; view.hole.len()];
    for (cell, agreed) in agreed.iter_mut().enumerate() {
        let Some(point) = confirmed_point(view, &planes[reference], cell) else { continue };
        let mut same = 0;
        let mut through = 0;
        for other in (0..views.len()).filter(|&o| o != reference) {
            match verdict_of_view(&views[other], &planes[other], &point) {
                Word::Same(_) => same += 1,
                Word::Through => through += 1,
                Word::Nothing => {}
            }
        }
        *agreed = same >= WITNESSES && same > 2 * through;
    }
    agreed
}

/// Relative standard deviation of agreed depths: of the differences between two views, over the root of two.
pub(super) fn relative_spread(
    views: &[Cells],
    planes: &[Planes],
    agreed: &[Vec<bool>],
    stop: &Stop,
) -> Result<f64, Stopped> {
    let mut differences = Vec::new();
    for (reference, view) in views.iter().enumerate() {
        stop.check()?;
        // A stride, since neighboring cells share their patch.
        for cell in (0..view.hole.len()).step_by(7).filter(|&c| agreed[reference][c]) {
            let Some(point) = confirmed_point(view, &planes[reference], cell) else { continue };
            for other in (0..views.len()).filter(|&o| o != reference) {
                if let Word::Same(difference) = verdict_of_view(&views[other], &planes[other], &point) {
                    differences.push(f64::from(difference.abs()));
                }
            }
        }
    }
    Ok(SIGMAS_PER_MAD * median(differences).unwrap_or(0.0) / 2f64.sqrt())
}

/// The world point of a cell, if its plane is accepted.
fn confirmed_point(view: &Cells, planes: &Planes, cell: usize) -> Option<Point3<f64>> {
    let inverse = borne_out(view, planes, cell)?;
    Some(view.world_from_camera * Point3::from((view.ray_of_cell(cell) / inverse).cast::<f64>()))
}

/// The inverse depth of a cell in a hole, if its plane is accepted.
fn borne_out(view: &Cells, planes: &Planes, cell: usize) -> Option<f32> {
    let inverse = planes.at[cell].dot(&view.ray_of_cell(cell));
    (view.hole[cell] && planes.cost[cell] <= LARGEST_COST && inverse > 0.0).then_some(inverse)
}

fn verdict_of_view(view: &Cells, planes: &Planes, point: &Point3<f64>) -> Word {
    let seen = view.world_from_camera.inverse_transform_point(point);
    let Some(cell) = view.camera.pixel_of(&seen) else { return Word::Nothing };
    if view.off_object[cell] {
        return Word::Through;
    }
    let depth_m = seen.z as f32;
    match view.side_of_depth(cell, depth_m) {
        Side::Before => Word::Through,
        Side::On => Word::Same((depth_m - view.depth_m[cell]) / depth_m),
        Side::Behind => Word::Nothing,
        Side::Unknown => {
            let difference = borne_out(view, planes, cell).map(|inverse| 1.0 - 1.0 / (inverse * depth_m));
            difference.filter(|d| d.abs() < SAME).map_or(Word::Nothing, Word::Same)
        }
    }
}
