//! Names moving parts by their kind, if shape and motion decide it.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::{ArticulatedModel, JointKind};

/// An axis is level, or upright, within this sine or cosine. chosen: about 17 deg.
const SQUARE: f64 = 0.3;
/// Least ratio of a panel's length along its hinge to its reach from it.
/// chosen: a narrower part is an arm.
const PANEL_SHARE: f64 = 0.45;
/// Least distance of a hung part's center from its axis, as a share of its reach.
/// chosen: nearer parts turn about themselves.
const OFF_AXIS: f64 = 0.25;
/// Largest size of a knob, as a share of the object.
/// chosen: larger parts are hardly held by fingers.
const KNOB_SHARE: f64 = 0.25;
/// A part thinner than this share of its height and of its travel is a panel that slides in its own plane.
/// chosen: thicker parts are drawers.
const SLIDING_PANEL: f64 = 0.25;
/// Upper share of the base in which the hinge of a lid lies. chosen: a quarter is the top.
const TOP_SHARE: f64 = 0.25;

/// How moving parts are named.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PartNames {
    /// `part_1`, `joint_1`, ...: the same for all objects.
    #[default]
    Numbered,
    /// `drawer`, `door_1`, `lid`, `knob`, ... if shape and motion decide, else `part_K`.
    Semantic,
}

/// The model with its links and joints renamed; `prefix` precedes all names.
pub fn renamed_model(mut model: ArticulatedModel, names: PartNames, prefix: &str) -> ArticulatedModel {
    let (links, joints) = match names {
        PartNames::Numbered => (
            model.links.iter().map(|l| l.name.clone()).collect(),
            model.joints.iter().map(|j| j.name.clone()).collect(),
        ),
        PartNames::Semantic => semantic_names(&model),
    };
    model.links.iter_mut().zip(links).for_each(|(link, name)| link.name = format!("{prefix}{name}"));
    model.joints.iter_mut().zip(joints).for_each(|(joint, name)| joint.name = format!("{prefix}{name}"));
    model
}

/// Names of links and of joints: the root keeps its own; equal ones are numbered.
fn semantic_names(model: &ArticulatedModel) -> (Vec<String>, Vec<String>) {
    let kinds: Vec<Option<&str>> = (0..model.joints.len()).map(|j| kind_of_part(model, j)).collect();
    let mut links: Vec<String> = model.links.iter().map(|l| l.name.clone()).collect();
    let mut joints: Vec<String> = model.joints.iter().map(|j| j.name.clone()).collect();
    let mut count: BTreeMap<&str, usize> = BTreeMap::new();
    for (j, kind) in kinds.iter().enumerate() {
        let Some(kind) = *kind else { continue };
        let so_far = count.entry(kind).or_default();
        *so_far += 1;
        let several = kinds.iter().filter(|k| **k == Some(kind)).count() > 1;
        let name = if several { format!("{kind}_{so_far}") } else { kind.to_owned() };
        let motion = match model.joints[j].kind {
            JointKind::Prismatic => "slide",
            JointKind::Revolute => "hinge",
            JointKind::Screw { .. } | JointKind::Free { .. } => "screw",
        };
        joints[j] = format!("{name}_{motion}");
        links[model.joints[j].child] = name;
    }
    (links, joints)
}

/// Kind of a joint's child; `None` if shape and motion do not decide.
fn kind_of_part(model: &ArticulatedModel, j: usize) -> Option<&'static str> {
    let joint = &model.joints[j];
    let closed = vec![0.0; model.joints.len()];
    let world_from_joint = model.world_from_link(joint.parent, &closed) * joint.parent_from_joint;
    let axis = world_from_joint.rotation * joint.axis.into_inner();
    let level = axis.z.abs() < SQUARE;
    let upright = axis.xy().norm() < SQUARE;
    let shape = PartShape::of_link(model, joint.child, &world_from_joint.translation.vector, &axis, &closed)?;
    let size_m = object_size_m(model, &closed)?;
    match joint.kind {
        JointKind::Free { .. } => None,
        JointKind::Prismatic if level && !shape.slides_in_its_plane(&axis) => Some("drawer"),
        JointKind::Prismatic => None,
        JointKind::Screw { .. } => {
            (shape.extent.norm() < KNOB_SHARE * size_m).then_some("knob").or_else(|| {
                // It turns about an upright thread, on top of its parent.
                (upright && shape.middle_m < OFF_AXIS * shape.reach_m).then_some("cap")
            })
        }
        JointKind::Revolute if shape.middle_m < OFF_AXIS * shape.reach_m => {
            (shape.extent.norm() < KNOB_SHARE * size_m).then_some("knob")
        }
        JointKind::Revolute if shape.along_m < PANEL_SHARE * shape.reach_m => None,
        JointKind::Revolute if upright => Some("door"),
        // Only on the static part: the head of a lamp is no lid.
        JointKind::Revolute if level && joint.parent == 0 => {
            let (lower, upper) = link_bounds(model, joint.parent, &closed)?;
            let top = upper.z - TOP_SHARE * (upper.z - lower.z);
            Some(if world_from_joint.translation.z >= top { "lid" } else { "flap" })
        }
        JointKind::Revolute => None,
    }
}

/// Size of a part relative to its axis.
struct PartShape {
    /// Extent along the world's axes, meters.
    extent: Vector3<f64>,
    /// Extent along the axis, meters.
    along_m: f64,
    /// Largest distance from the axis, meters.
    reach_m: f64,
    /// Distance of the center of its box from the axis, meters.
    middle_m: f64,
}

impl PartShape {
    fn of_link(
        model: &ArticulatedModel,
        link: usize,
        point: &Vector3<f64>,
        axis: &Vector3<f64>,
        positions: &[f64],
    ) -> Option<Self> {
        let (lower, upper) = link_bounds(model, link, positions)?;
        let off = |p: &Point3<f64>| (p.coords - point).cross(axis).norm();
        let world_from_link = model.world_from_link(link, positions);
        let places = || model.links[link].visual.vertices.iter().map(|v| world_from_link * v.cast::<f64>());
        let along = places().map(|p| p.coords.dot(axis));
        let [low, high] =
            along.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], a| [lo.min(a), hi.max(a)]);
        Some(Self {
            extent: upper - lower,
            along_m: high - low,
            reach_m: places().map(|p| off(&p)).fold(0.0, f64::max),
            middle_m: off(&nalgebra::center(&lower, &upper)),
        })
    }

    /// Whether it is thin in a horizontal direction perpendicular to its travel: a sliding door, not a
    /// drawer.
    fn slides_in_its_plane(&self, axis: &Vector3<f64>) -> bool {
        // The horizontal axis of the world perpendicular to its travel.
        let (along, across) = if axis.x.abs() > axis.y.abs() { (0, 1) } else { (1, 0) };
        self.extent[across] < SLIDING_PANEL * self.extent[along].min(self.extent.z)
    }
}

/// The box of a link in the world.
fn link_bounds(
    model: &ArticulatedModel,
    link: usize,
    positions: &[f64],
) -> Option<(Point3<f64>, Point3<f64>)> {
    let (lower, upper) =
        model.links[link].visual.transformed(&model.world_from_link(link, positions)).bounds()?;
    Some((lower.cast(), upper.cast()))
}

/// Diagonal of the box of the whole object, meters.
fn object_size_m(model: &ArticulatedModel, positions: &[f64]) -> Option<f64> {
    let boxes = (0..model.links.len()).filter_map(|l| link_bounds(model, l, positions));
    let (lower, upper) = boxes.reduce(|(a, b), (c, d)| (a.inf(&c), b.sup(&d)))?;
    Some((upper - lower).norm())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        JointRemark,
        example::{box_mesh, cabinet},
        validate,
    };
    use common::note::NoteCode;
    use geometry::Pose;

    /// The cabinet with names as reconstruction gives them.
    fn numbered() -> ArticulatedModel {
        let mut model = cabinet();
        for (k, (link, joint)) in model.links.iter_mut().skip(1).zip(&mut model.joints).enumerate() {
            (link.name, joint.name) = (format!("part_{}", k + 1), format!("joint_{}", k + 1));
        }
        model
    }

    /// Names of a box in place of the cabinet's door: about its joint, which stands at a place in the world.
    fn part(kind: JointKind, axis: Vector3<f64>, at: [f64; 3], lower: [f32; 3], upper: [f32; 3]) -> String {
        let mut model = numbered();
        model.joints[0].kind = kind;
        model.joints[0].axis = nalgebra::Unit::new_normalize(axis);
        model.joints[0].parent_from_joint = Pose::translation(at[0], at[1], at[2]);
        model.links[1].visual = box_mesh(lower, upper, [9; 3]);
        let named = renamed_model(model, PartNames::Semantic, "");
        assert_eq!(validate(&named), []);
        format!("{} {}", named.links[1].name, named.joints[0].name)
    }

    #[test]
    fn shape_and_motion_name_a_part_where_they_decide() {
        let x = Vector3::x();
        let y = Vector3::y();
        let z = Vector3::z();
        let turn = JointKind::Revolute;
        let thread = JointKind::Screw { pitch_m_per_rad: 0.01 };
        let unclear = "part_1 joint_1";
        assert_eq!(part(turn, z, [0.2, -0.25, 0.3], [0.0, 0.0, -0.2], [0.02, 0.3, 0.2]), "door door_hinge");
        // The body is 0.6 m high.
        assert_eq!(part(turn, y, [0.2, 0.0, 0.6], [-0.3, -0.2, 0.0], [0.0, 0.2, 0.02]), "lid lid_hinge");
        assert_eq!(part(turn, y, [0.2, 0.0, 0.1], [0.0, -0.2, 0.0], [0.02, 0.2, 0.3]), "flap flap_hinge");
        // An arm is narrow along its hinge.
        assert_eq!(part(turn, y, [0.2, 0.0, 0.6], [0.0, -0.02, 0.0], [0.3, 0.02, 0.02]), unclear);
        let small = ([0.0, -0.02, -0.02], [0.02, 0.02, 0.02]);
        assert_eq!(part(turn, x, [0.2, 0.0, 0.3], small.0, small.1), "knob knob_hinge");
        assert_eq!(part(thread, x, [0.2, 0.0, 0.3], small.0, small.1), "knob knob_screw");
        let cover = ([-0.2, -0.2, 0.0], [0.2, 0.2, 0.1]);
        assert_eq!(part(thread, z, [0.0, 0.0, 0.6], cover.0, cover.1), "cap cap_screw");
        // Nor is a lid what hangs on another part.
        let mut model = numbered();
        model.joints[1].kind = turn;
        model.joints[1].axis = Vector3::y_axis();
        model.joints[1].parent = 1;
        model.joints[1].parent_from_joint = Pose::translation(0.0, 0.0, 0.2);
        assert_eq!(renamed_model(model, PartNames::Semantic, "").links[2].name, "part_2");
        // What slides in its own plane, and what rises, is no drawer.
        let sliding = ([0.0, -0.1, -0.2], [0.02, 0.1, 0.2]);
        assert_eq!(part(JointKind::Prismatic, y, [0.2, 0.0, 0.3], sliding.0, sliding.1), unclear);
        assert_eq!(part(JointKind::Prismatic, z, [0.2, 0.0, 0.3], sliding.0, sliding.1), unclear);
    }

    #[test]
    fn equal_names_are_numbered_and_all_have_the_prefix() {
        let mut model = numbered();
        model.joints[0] = crate::Joint { child: 1, name: "joint_1".into(), ..model.joints[1].clone() };
        model.links[1].visual = model.links[2].visual.clone();
        let remark = JointRemark::OtherParents { others: vec![2], parent: 0 };
        model.joints[0].evidence.not_observable.push(remark);
        let named = renamed_model(model, PartNames::Semantic, "left_");
        let links: Vec<&str> = named.links.iter().map(|l| l.name.as_str()).collect();
        assert_eq!(links, ["left_body", "left_drawer_1", "left_drawer_2"]);
        let joints: Vec<&str> = named.joints.iter().map(|j| j.name.as_str()).collect();
        assert_eq!(joints, ["left_drawer_1_slide", "left_drawer_2_slide"]);
        let note = named.joints[0].evidence.not_observable[0].note(|link| named.links[link].name.clone());
        let expected =
            "the parent: left_drawer_2 would do as well as left_body, which the shortest chain makes it";
        assert_eq!((note.code, note.text.as_str()), (NoteCode::ParentNotDecided, expected));
    }
}
