//! True surface points that the cameras see.

use nalgebra::{Point3, Vector3};
use rand_core::Rng;
use rayon::prelude::*;

use super::{Object, Scene};
use geometry::{Intrinsics, Pose};
use surface::sample_surface;

/// A true surface point that was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenSample {
    /// Position in the world, meters.
    pub point: Point3<f64>,
    /// Index of its part.
    pub part: usize,
}

/// Fewest views that must see a point.
const MIN_VIEWS: usize = 3;
/// Least cosine between ray and normal for a view to count. chosen: 78 degrees
const MIN_COSINE: f64 = 0.2;
/// Gap left at the point for rounding of its position, meters. chosen: above rounding, below any gap
const MARGIN_M: f64 = 1e-4;

/// Whether a camera sees a true surface point at an angle that is not grazing.
pub(super) fn sees_point(
    scene: &Scene,
    k: &Intrinsics,
    camera: &Pose,
    point: &Point3<f64>,
    normal: &Vector3<f64>,
) -> bool {
    let eye = Point3::from(camera.translation.vector);
    let to_eye = eye - point;
    let facing = to_eye.dot(normal) > MIN_COSINE * to_eye.norm();
    facing
        && k.pixel_of(&(camera.inverse() * point)).is_some()
        && scene.is_clear(&(point + normal * MARGIN_M), &eye, 0.0)
}

/// Points that at least three cameras, each with its scene, see at angles that are not grazing; `count`
/// points are drawn uniformly from the surface of all parts in a state.
pub fn seen_points(
    object: &Object,
    state: usize,
    k: &Intrinsics,
    cameras: &[(&Scene, Pose)],
    count: usize,
    rng: &mut impl Rng,
) -> Vec<SeenSample> {
    let poses = object.world_from_parts(state);
    let meshes: Vec<_> = (0..object.parts.len()).map(|p| object.mesh_of_part(p)).collect();
    let area_m2: f64 = meshes.iter().map(|m| m.area_m2()).sum();
    let mut seen = Vec::new();
    for (part, mesh) in meshes.iter().enumerate() {
        let share = (count as f64 * mesh.area_m2() / area_m2).round() as usize;
        let samples = sample_surface(mesh, share, rng);
        let found = samples.points.par_iter().zip(&samples.normals).with_min_len(256).filter_map(|(p, n)| {
            let point = poses[part] * p.cast::<f64>();
            let normal = poses[part] * n.cast::<f64>();
            // Stops at enough views, since each costs a ray.
            let seeing =
                cameras.iter().filter(|(scene, camera)| sees_point(scene, k, camera, &point, &normal));
            (seeing.take(MIN_VIEWS).count() == MIN_VIEWS).then_some(SeenSample { point, part })
        });
        seen.extend(found.collect::<Vec<_>>());
    }
    seen
}
