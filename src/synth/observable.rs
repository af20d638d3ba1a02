//! Test whether both recordings can show each part's motion.

use nalgebra::Point3;
use rand_core::Rng;

use super::{Object, Scene, SynthConfig, recording, truth};
use surface::sample_surface;

/// Views tested per state.
const VIEWS: usize = 15;
/// Points sampled per part.
const POINTS: usize = 300;
/// Least share of a part's surface seen in both states. chosen: a smaller share does not show the part
const MIN_SHARE: f64 = 0.1;

/// Whether every part has surface seen in both states: a part that shows different sides cannot be found from
/// the recordings.
pub(super) fn is_observable(object: &Object, config: &SynthConfig, rng: &mut impl Rng) -> bool {
    let k = recording::camera_intrinsics(config);
    let (floor, _) = recording::drawn_surroundings(config.seed);
    let poses = [0, 1].map(|state| object.world_from_parts(state));
    // The floor has radius 0: it hides nothing of the objects on it.
    let scenes = [0, 1].map(|state| Scene::new(object, state, &floor, 0.0));
    let cameras = [0, 1].map(|state| {
        let path = recording::camera_path(object, state, config);
        (0..VIEWS).map(|i| path.pose_at((i as f64 + 0.5) / VIEWS as f64)).collect::<Vec<_>>()
    });
    (0..object.parts.len()).all(|part| {
        let samples = sample_surface(&object.mesh_of_part(part), POINTS, rng);
        let common = samples.points.iter().zip(&samples.normals).filter(|(p, n)| {
            (0..2).all(|state| {
                let point: Point3<f64> = poses[state][part] * p.cast::<f64>();
                let normal = poses[state][part] * n.cast::<f64>();
                cameras[state]
                    .iter()
                    .any(|camera| truth::sees_point(&scenes[state], &k, camera, &point, &normal))
            })
        });
        common.count() as f64 >= MIN_SHARE * POINTS as f64
    })
}
