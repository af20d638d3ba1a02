//! The box to pass to `--workspace`.

use nalgebra::{Point3, Vector3};

use super::Object;
use geometry::bounding_box;

/// Margin around the object, meters. chosen: more than depth errors
const MARGIN_M: f64 = 0.03;
/// Height of the box's lower side above the floor, meters.
/// chosen: more than the noise of the floor
const ABOVE_FLOOR_M: f64 = 0.006;

/// Lower and upper corner of a box in the true world around the objects in both of their states, without the
/// space next to the floor.
pub fn workspace(objects: &[&Object]) -> [Point3<f64>; 2] {
    let mut points: Vec<Point3<f64>> = Vec::new();
    for (object, state) in objects.iter().flat_map(|o| [(o, 0), (o, 1)]) {
        for (k, pose) in object.world_from_parts(state).iter().enumerate() {
            points.extend(object.mesh_of_part(k).vertices.iter().map(|v| pose * v.cast::<f64>()));
        }
    }
    let (lower, upper) = bounding_box(points.iter().copied()).unwrap_or_default();
    let margin = Vector3::repeat(MARGIN_M);
    let floor_z_m = objects.first().map_or(0.0, |o| o.world_from_rest.translation.vector.z);
    let lower = lower - margin;
    [Point3::new(lower.x, lower.y, floor_z_m + ABOVE_FLOOR_M), upper + margin]
}

/// The box around an object in any state: with all joints at either limit or half way.
pub(super) fn whole_way(object: &Object) -> [Point3<f64>; 2] {
    // An arc may extend furthest between its limits.
    let [low, half, high] = [0.0, 0.5, 1.0].map(|share| at_share_of_limits(object, share));
    workspace(&[&low, &half, &high])
}

/// An object with all joints at the same share of the way between their limits.
fn at_share_of_limits(object: &Object, share: f64) -> Object {
    let mut moved = object.clone();
    for joint in moved.parts.iter_mut().filter_map(|p| p.joint.as_mut()) {
        let [low, high] = joint.limits;
        joint.positions = [low + share * (high - low); 2];
    }
    moved
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SynthConfig, generate};

    #[test]
    fn the_box_holds_both_states_and_not_the_floor() {
        for seed in 0..5 {
            let object = generate(&SynthConfig { seed, ..SynthConfig::default() }).unwrap();
            let [lower, upper] = workspace(&[&object]);
            assert!(lower.z > 0.0 && lower.z < 0.01);
            for state in 0..2 {
                for (k, pose) in object.world_from_parts(state).iter().enumerate() {
                    let inside =
                        |p: Point3<f64>| (0..3).all(|a| (a == 2 || p[a] > lower[a]) && p[a] < upper[a]);
                    assert!(object.mesh_of_part(k).vertices.iter().all(|v| inside(pose * v.cast::<f64>())));
                }
            }
        }
    }
}
