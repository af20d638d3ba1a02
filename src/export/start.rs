//! How far refinement moved a part's motion from its start.

use serde::{Deserialize, Serialize};

use geometry::Pose;
use geometry::rotation_angle_rad;
use model::ArticulatedModel;

/// An actual or possible start of a part's refinement, and its distance from the final motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InitialMotion {
    /// Name of the joint.
    pub joint: String,
    /// Source of the start: `registration` or `identity`.
    pub source: String,
    /// Whether the refinement started from it; if not, it is the motion that this source alone gives.
    pub used: bool,
    /// Angle of the start's rotation, degrees.
    pub start_rotation_deg: f64,
    /// Mean displacement of the part's vertices by the start, millimeters.
    pub start_displacement_mm: f64,
    /// Angle of the rotation between start and end, degrees.
    pub rotation_deg: f64,
    /// Mean displacement of the part's vertices between start and end, millimeters.
    pub displacement_mm: f64,
}

/// Compares motions (`state1_from_state0` in the world, in the order of the joints) with those of the model.
pub fn compare_starts(
    model: &ArticulatedModel,
    source: &str,
    used: bool,
    starts: &[Pose],
) -> Vec<InitialMotion> {
    let mut motions = Vec::new();
    for (j, (joint, start)) in model.joints.iter().zip(starts).enumerate() {
        let part = MovingPart::of_joint(model, j);
        let end_from_start = part.state1_from_state0 * start.inverse();
        motions.push(InitialMotion {
            joint: joint.name.clone(),
            source: source.to_owned(),
            used,
            start_rotation_deg: rotation_angle_rad(&start.rotation).to_degrees(),
            start_displacement_mm: 1000.0 * part.displacement_m(&Pose::identity(), start),
            rotation_deg: rotation_angle_rad(&end_from_start.rotation).to_degrees(),
            displacement_mm: 1000.0 * part.displacement_m(start, &part.state1_from_state0),
        });
    }
    motions
}

/// Motions assigned to the joints, in their order: the closest pair of joint and motion first, each used
/// once. For motions in the order of another search for parts.
pub fn nearest_starts(model: &ArticulatedModel, motions: &[Pose]) -> Vec<Pose> {
    let parts: Vec<MovingPart> = (0..model.joints.len()).map(|j| MovingPart::of_joint(model, j)).collect();
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (j, part) in parts.iter().enumerate() {
        for (m, motion) in motions.iter().enumerate() {
            pairs.push((part.displacement_m(motion, &part.state1_from_state0), j, m));
        }
    }
    // Equal distances are ordered by index, so the result is the same on every run.
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut of_joint: Vec<Option<usize>> = vec![None; parts.len()];
    for (_, j, m) in pairs {
        if of_joint[j].is_none() && !of_joint.contains(&Some(m)) {
            of_joint[j] = Some(m);
        }
    }
    of_joint.into_iter().flatten().map(|m| motions[m]).collect()
}

/// The part moved by a joint.
struct MovingPart<'a> {
    vertices: &'a [nalgebra::Point3<f32>],
    world_from_link: Pose,
    state1_from_state0: Pose,
}

impl<'a> MovingPart<'a> {
    fn of_joint(model: &'a ArticulatedModel, joint: usize) -> Self {
        let none = vec![0.0; model.joints.len()];
        let first = model.states.first().unwrap_or(&none);
        let last = model.states.last().unwrap_or(&none);
        let child = model.joints[joint].child;
        let world_from_link = model.world_from_link(child, first);
        let state1_from_state0 = model.world_from_link(child, last) * world_from_link.inverse();
        Self { vertices: &model.links[child].visual.vertices, world_from_link, state1_from_state0 }
    }

    /// Mean distance between the part's vertices after one motion and after the other, meters.
    fn displacement_m(&self, a: &Pose, b: &Pose) -> f64 {
        let in_world = self.vertices.iter().map(|p| self.world_from_link * p.cast::<f64>());
        in_world.map(|p| (b * p - a * p).norm()).sum::<f64>() / self.vertices.len().max(1) as f64
    }
}
