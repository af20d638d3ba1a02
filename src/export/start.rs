//! Where a motion started and where it ended.

use serde::{Deserialize, Serialize};

use crate::{geometry::Pose, geometry::rotation_angle_rad, model::ArticulatedModel};

/// How far the final motion of a part is from the one that its refinement started with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InitialMotion {
    /// Name of the joint.
    pub joint: String,
    /// What the start came from: `registration` or `identity`.
    pub source: String,
    /// Angle of the rotation between start and end, degrees.
    pub rotation_deg: f64,
    /// Mean displacement of the part's vertices between start and end, millimetres.
    pub displacement_mm: f64,
}

/// Compares the motions that the refinement of a model started with (`state1_from_state0` in the world, in the order of
/// the joints) with those of the model.
#[must_use]
pub fn compare_start(model: &ArticulatedModel, source: &str, starts: &[Pose]) -> Vec<InitialMotion> {
    let none = vec![0.0; model.joints.len()];
    let (first, last) = (model.states.first().unwrap_or(&none), model.states.last().unwrap_or(&none));
    let compare = |(joint, start): (&crate::model::Joint, &Pose)| {
        let world_from_link = model.world_from_link(joint.child, first);
        let end = model.world_from_link(joint.child, last) * world_from_link.inverse();
        let vertices = &model.links[joint.child].visual.vertices;
        let moved = |p: &nalgebra::Point3<f32>| {
            let p = world_from_link * p.cast::<f64>();
            (end * p - start * p).norm()
        };
        let mean_m = vertices.iter().map(moved).sum::<f64>() / vertices.len().max(1) as f64;
        InitialMotion {
            joint: joint.name.clone(),
            source: source.to_owned(),
            rotation_deg: rotation_angle_rad(&(end.rotation * start.rotation.inverse())).to_degrees(),
            displacement_mm: 1000.0 * mean_m,
        }
    };
    model.joints.iter().zip(starts).map(compare).collect()
}
