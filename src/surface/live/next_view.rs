//! The view with the most gain (Connolly 1985): of many placed around the focus of the views, the one that
//! sees the most unseen surface.

use nalgebra::{Point3, Vector3};

use super::{
    region::{Cell, Region},
    sight_map::SightMap,
};
use geometry::{Pose, lattice_directions};

/// Number of places tried, all around.
const PLACES: usize = 200;
/// Rays along a side of the image of the region from each place.
const RAYS: usize = 32;
/// Least useful gain of a view, as a share of all surface.
/// chosen: a hundred such views would be as much as all there is
const LEAST_SHARE: f64 = 0.01;

/// A place to look from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NextView {
    /// Pose of the optical frame there.
    pub world_from_camera: Pose,
    /// Newly seen surface, as area perpendicular to its rays, square meters.
    pub gain_m2: f64,
}

/// The best view of a region with `all_m2` of surface, square meters; `None` where no view has a useful gain.
pub(super) fn next_view(region: &Region, sight: &SightMap, all_m2: f64) -> Option<NextView> {
    let focus = &region.focus;
    let mut best: Option<NextView> = None;
    for direction in lattice_directions(PLACES) {
        // No lower than the lowest camera, less half the distance between two places: there may be a floor.
        let is_low = direction.dot(&focus.up) < focus.lowest - (std::f64::consts::PI / PLACES as f64).sqrt();
        let eye = focus.point + direction * focus.distance_m;
        if is_low || !can_stand(&eye, region, sight) {
            continue;
        }
        let world_from_camera = looking_at(&eye, &focus.point, &focus.up);
        let gain_m2 = gain_m2(region, &world_from_camera);
        if best.is_none_or(|b| gain_m2 > b.gain_m2) {
            best = Some(NextView { world_from_camera, gain_m2 });
        }
    }
    best.filter(|b| b.gain_m2 > 0.0 && b.gain_m2 >= LEAST_SHARE * all_m2)
}

/// Surface a camera would newly see, as area perpendicular to its rays, square meters. Unknown space outside
/// the region hides nothing.
pub(super) fn gain_m2(region: &Region, world_from_camera: &Pose) -> f64 {
    let eye = Point3::from(world_from_camera.translation.vector);
    let distance_m = (region.focus.point - eye).norm();
    // An image of the whole ball, with suitable intrinsics.
    let half = (region.radius_m / distance_m).min(0.9).asin().tan();
    let pixel = 2.0 * half / RAYS as f64;
    let mut area_m2 = 0.0;
    for v in 0..RAYS {
        for u in 0..RAYS {
            let [x, y] = [u, v].map(|i| (i as f64 + 0.5) * pixel - half);
            let ray = world_from_camera * Vector3::new(x, y, 1.0);
            if let Some((Cell::Unknown, depth_m)) = region.first_met(&eye, &ray) {
                area_m2 += (pixel * depth_m).powi(2);
            }
        }
    }
    area_m2
}

/// Whether no seen surface is at the camera's place or between it and the region.
fn can_stand(eye: &Point3<f64>, region: &Region, sight: &SightMap) -> bool {
    let to = region.focus.point - eye;
    let free_m = to.norm() - region.radius_m;
    let steps = (free_m / sight.cell_m()).ceil().clamp(1.0, 1e4);
    (0..=steps as usize).all(|i| {
        let seen = sight.count_at_point(&(eye + to.normalize() * (free_m * i as f64 / steps)));
        seen.filled == 0 || seen.empty >= 2
    })
}

/// Pose of a camera towards a point, held upright.
fn looking_at(eye: &Point3<f64>, target: &Point3<f64>, up: &Vector3<f64>) -> Pose {
    // Seen from straight above, any side is up.
    let along = (target - eye).normalize();
    let up = if along.cross(up).norm() < 1e-3 { Vector3::ith(along.iamin(), 1.0) } else { *up };
    Pose::face_towards(eye, target, &-up)
}
