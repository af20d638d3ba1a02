//! ROS messages of a twin: joint states, transforms, markers.

use nalgebra::{Point3, UnitQuaternion, Vector3};

use geometry::Pose;
use io::{
    RunSummary, SummaryJoint,
    ros2msg::{
        Header, JointState, TfMessage, Time, Transform, TransformStamped,
        markers::{Color, Marker, MarkerArray, action, kind},
    },
};
use model::JointKind;

/// Marker namespace of the joints.
const NAMESPACE: &str = "joint_axes";
/// Marker namespace of the object.
const OBJECT: &str = "object";
/// Markers per joint: axis, range, uncertainty cone, text.
const MARKERS_PER_JOINT: i32 = 4;
/// Length of a drawn axis, meters. chosen: easy to see
const AXIS_LENGTH_M: f64 = 0.2;
/// Number of points of an arc or circle.
const ARC_POINTS: usize = 33;
/// Number of standard deviations drawn. chosen: 99.7 % of a normal distribution
const SIGMAS: f64 = 3.0;

/// Joint positions in an observed state.
#[must_use]
pub(crate) fn joint_state(twin: &RunSummary, state: usize, stamp: Time) -> JointState {
    JointState {
        // JointState has no frame.
        header: Header { stamp, frame_id: String::new() },
        name: twin.joints.iter().map(|j| j.name.clone()).collect(),
        position: twin.positions(state),
        ..JointState::default()
    }
}

/// Transforms of the moving links in their parents' frames; with `fixed`, also of the root in the world
/// frame.
#[must_use]
pub(crate) fn link_transforms(twin: &RunSummary, state: usize, stamp: Time, prefix: &str) -> TfMessage {
    let mut transforms = Vec::with_capacity(twin.joints.len());
    for (joint, position) in twin.joints.iter().zip(twin.positions(state)) {
        transforms.push(TransformStamped {
            header: Header { stamp, frame_id: format!("{prefix}{}", joint.parent) },
            child_frame_id: format!("{prefix}{}", joint.child),
            transform: Transform::from_pose(&joint.parent_from_child(position)),
        });
    }
    TfMessage { transforms }
}

/// Transform of the root link's frame, which equals the recording's world frame. `None` if both have one
/// name.
#[must_use]
pub(crate) fn root_transform(
    twin: &RunSummary,
    world_frame: &str,
    stamp: Time,
    prefix: &str,
) -> Option<TransformStamped> {
    let child_frame_id = format!("{prefix}{}", twin.root);
    (child_frame_id != world_frame).then(|| TransformStamped {
        header: Header { stamp, frame_id: world_frame.to_owned() },
        child_frame_id,
        transform: Transform::default(),
    })
}

/// Markers of axes, ranges and uncertainty of all joints in the world frame in an observed state, and of the
/// box around the object. Earlier markers are deleted.
#[must_use]
pub(crate) fn joint_markers(twin: &RunSummary, state: usize, world_frame: &str, stamp: Time) -> MarkerArray {
    let header = Header { stamp, frame_id: world_frame.to_owned() };
    // RViz keeps markers until they are deleted, also those of an earlier twin with more joints.
    let clear = Marker {
        header: header.clone(),
        ns: NAMESPACE.into(),
        action: action::DELETE_ALL,
        ..Marker::default()
    };
    let positions = twin.positions(state);
    let poses = twin.link_poses(&positions);
    let mut markers = vec![clear];
    for (k, joint) in twin.joints.iter().enumerate() {
        let parent = poses
            .iter()
            .find(|(name, _)| *name == joint.parent)
            .map_or_else(Pose::identity, |(_, pose)| *pose);
        let world_from_joint = parent * joint.parent_from_joint;
        let drawn =
            Drawn { joint, position: positions.get(k).copied().unwrap_or_default(), world_from_joint };
        let first = MARKERS_PER_JOINT * k as i32;
        markers.extend(drawn.joint_markers().into_iter().zip(first..).map(|(m, id)| Marker {
            header: header.clone(),
            ns: NAMESPACE.into(),
            id,
            ..m
        }));
    }
    markers.extend(twin.object_box_m.map(|corners| Marker {
        header,
        ns: OBJECT.into(),
        ..box_edges(corners)
    }));
    MarkerArray { markers }
}

/// Marker with the edges of a box.
fn box_edges(corners: [[f64; 3]; 2]) -> Marker {
    let corner = |k: usize| [0, 1, 2].map(|axis| corners[k >> axis & 1][axis]).into();
    let edges = (0..8usize).flat_map(|k| (0..3).map(move |axis| (k, k | 1 << axis))).filter(|(a, b)| a != b);
    Marker {
        kind: kind::LINE_LIST,
        scale: [0.002, 0.0, 0.0].into(),
        color: Color { r: 1.0, g: 0.9, b: 0.1, a: 0.9 },
        points: edges.flat_map(|(a, b)| [corner(a), corner(b)]).collect(),
        ..Marker::default()
    }
}

/// A joint to draw.
struct Drawn<'a> {
    joint: &'a SummaryJoint,
    position: f64,
    world_from_joint: Pose,
}

impl Drawn<'_> {
    fn joint_markers(&self) -> [Marker; MARKERS_PER_JOINT as usize] {
        let axis = self.joint.axis.into_inner();
        let half = 0.5 * AXIS_LENGTH_M * axis;
        let arrow = Marker {
            kind: kind::ARROW,
            // Shaft, head, head length.
            scale: [0.006, 0.014, 0.03].into(),
            color: Color { r: 0.1, g: 0.4, b: 1.0, a: 1.0 },
            points: self.points_in_world(&[-half, half]),
            ..Marker::default()
        };
        let at = self.world_from_joint * Point3::from(1.2 * half);
        let label = Marker {
            kind: kind::TEXT,
            scale: [0.0, 0.0, 0.03].into(),
            color: Color { r: 1.0, g: 1.0, b: 1.0, a: 1.0 },
            pose: Transform { translation: <[f64; 3]>::from(at.coords).into(), ..Transform::default() },
            text: self.label_text(),
            ..Marker::default()
        };
        let range = self.line_marker(&self.range_points(), Color { r: 0.1, g: 0.8, b: 0.2, a: 1.0 });
        let uncertain =
            self.line_marker(&self.uncertainty_circle(), Color { r: 1.0, g: 0.5, b: 0.0, a: 0.8 });
        [arrow, range, uncertain, label]
    }

    fn line_marker(&self, in_joint: &[Vector3<f64>], color: Color) -> Marker {
        Marker {
            kind: kind::LINE_STRIP,
            scale: [0.003, 0.0, 0.0].into(),
            color,
            points: self.points_in_world(in_joint),
            ..Marker::default()
        }
    }

    fn points_in_world(&self, in_joint: &[Vector3<f64>]) -> Vec<io::ros2msg::Vector3> {
        in_joint
            .iter()
            .map(|p| <[f64; 3]>::from((self.world_from_joint * Point3::from(*p)).coords).into())
            .collect()
    }

    /// Points from the lowest to the highest position: an arc about the axis, or a segment of it.
    fn range_points(&self) -> Vec<Vector3<f64>> {
        let [low, high] = self.joint.limits;
        let axis = self.joint.axis.into_inner();
        match self.joint.kind {
            JointKind::Prismatic => vec![axis * low, axis * high],
            JointKind::Revolute | JointKind::Screw { .. } | JointKind::Free { .. } => {
                let pitch_m_per_rad = self.joint.kind.pitch_m_per_rad().unwrap_or(0.0);
                let radius = 0.4 * AXIS_LENGTH_M * unit_across(&axis);
                let turns = (0..ARC_POINTS).map(|k| low + (high - low) * k as f64 / (ARC_POINTS - 1) as f64);
                turns
                    .map(|turn| {
                        UnitQuaternion::from_scaled_axis(axis * turn) * radius
                            + axis * (pitch_m_per_rad * turn)
                    })
                    .collect()
            }
        }
    }

    /// A circle around the tip of the axis with the combined uncertainty of direction and position.
    fn uncertainty_circle(&self) -> Vec<Vector3<f64>> {
        let axis = self.joint.axis.into_inner();
        let reach = 0.5 * AXIS_LENGTH_M;
        // NaN is an undetermined deviation; the label shows it, a circle cannot.
        let known = |v: f64| if v.is_finite() { v } else { 0.0 };
        // At the tip, the direction error acts over the arrow's length; both errors are independent.
        let radius = SIGMAS * (known(self.joint.axis_std_rad) * reach).hypot(known(self.joint.origin_std_m));
        let turns = (0..ARC_POINTS).map(|k| std::f64::consts::TAU * k as f64 / (ARC_POINTS - 1) as f64);
        turns
            .map(|turn| {
                axis * reach + UnitQuaternion::from_scaled_axis(axis * turn) * (radius * unit_across(&axis))
            })
            .collect()
    }

    fn label_text(&self) -> String {
        let j = self.joint;
        let [low, high] = j.limits;
        let axis = if j.axis_std_rad.is_finite() {
            format!("axis +-{:.2} deg", j.axis_std_rad.to_degrees())
        } else {
            "axis not determined".to_owned()
        };
        match j.kind {
            JointKind::Revolute | JointKind::Screw { .. } | JointKind::Free { .. } => {
                format!(
                    "{}: {:.1} deg in [{:.1}, {:.1}], {axis}",
                    j.name,
                    self.position.to_degrees(),
                    low.to_degrees(),
                    high.to_degrees()
                )
            }
            JointKind::Prismatic => format!(
                "{}: {:.0} mm in [{:.0}, {:.0}], {axis}",
                j.name,
                1e3 * self.position,
                1e3 * low,
                1e3 * high
            ),
        }
    }
}

/// A unit vector perpendicular to an axis.
fn unit_across(axis: &Vector3<f64>) -> Vector3<f64> {
    // Far from the axis, as the product of nearly parallel vectors is mostly rounding error.
    let helper = if axis.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    axis.cross(&helper).normalize()
}

#[cfg(test)]
mod tests {
    use nalgebra::Unit;

    use super::*;

    fn twin() -> RunSummary {
        let joint = |name: &str, parent: &str, child: &str, kind, x: f64, axis| SummaryJoint {
            name: name.into(),
            parent: parent.into(),
            child: child.into(),
            kind,
            parent_from_joint: Pose::translation(x, 0.0, 0.0),
            axis: Unit::new_normalize(axis),
            limits: [0.0, 1.0],
            states: vec![0.0, std::f64::consts::FRAC_PI_2],
            axis_std_rad: 0.01,
            origin_std_m: f64::NAN,
            motion_std: 0.1,
            residual_rms_m: f64::NAN,
        };
        RunSummary {
            folder: "/nowhere".into(),
            name: "box".into(),
            urdf: "<mesh filename=\"meshes/visual/base.obj\"/>".into(),
            root: "base".into(),
            joints: vec![
                joint("hinge", "base", "lid", JointKind::Revolute, 1.0, Vector3::z()),
                joint("slide", "lid", "tray", JointKind::Prismatic, 0.5, Vector3::x()),
            ],
            object_box_m: None,
        }
    }

    #[test]
    fn names_and_positions_go_together() {
        let message = joint_state(&twin(), 1, Time { sec: 3, nanosec: 4 });
        assert_eq!(message.name, ["hinge", "slide"]);
        assert_eq!(message.position, [std::f64::consts::FRAC_PI_2; 2]);
        assert_eq!(message.header.stamp.sec, 3);
    }

    #[test]
    fn transforms_compose_to_the_poses_of_the_links() {
        let twin = twin();
        let message = link_transforms(&twin, 1, Time::default(), "p/");
        assert_eq!(message.transforms[1].header.frame_id, "p/lid");
        let chain =
            message.transforms.iter().fold(Pose::identity(), |pose, t| pose * t.transform.checked().unwrap());
        let (name, pose) = twin.link_poses(&twin.positions(1)).pop().unwrap();
        assert_eq!(name, "tray");
        assert!((chain.translation.vector - pose.translation.vector).norm() < 1e-12);
        // The lid stands at a right angle, so the tray slides along y.
        assert!(
            (pose.translation.vector - Vector3::new(1.0, 0.5 + std::f64::consts::FRAC_PI_2, 0.0)).norm()
                < 1e-12
        );
        assert_eq!(root_transform(&twin, "map", Time::default(), "").unwrap().child_frame_id, "base");
        assert_eq!(root_transform(&twin, "base", Time::default(), ""), None);
    }

    #[test]
    fn markers_have_stable_numbers_and_finite_points() {
        let array = joint_markers(&twin(), 0, "map", Time::default());
        assert_eq!(array.markers[0].action, action::DELETE_ALL);
        assert_eq!(array.markers[1..].iter().map(|m| m.id).collect::<Vec<_>>(), (0..8).collect::<Vec<_>>());
        let arrow = &array.markers[1];
        assert_eq!((arrow.points.len(), arrow.kind, arrow.header.frame_id.as_str()), (2, kind::ARROW, "map"));
        assert!((arrow.points[1].z - 0.1).abs() < 1e-12 && (arrow.points[1].x - 1.0).abs() < 1e-12);
        let finite = |p: &io::ros2msg::Vector3| p.x.is_finite() && p.y.is_finite() && p.z.is_finite();
        assert!(array.markers.iter().flat_map(|m| &m.points).all(finite));
        // Three standard deviations of 0.01 rad at 0.1 m.
        let tip = array.markers[3].points[0];
        assert!(((tip.x - 1.0).hypot(tip.y) - 0.003).abs() < 1e-9, "{tip:?}");
    }

    #[test]
    fn the_object_is_shown_as_a_box() {
        let twin = RunSummary { object_box_m: Some([[0.0, 0.1, 0.2], [1.0, 1.2, 1.4]]), ..twin() };
        let array = joint_markers(&twin, 0, "map", Time::default());
        let marker = array.markers.last().unwrap();
        assert_eq!((array.markers.len(), marker.ns.as_str(), marker.points.len()), (10, "object", 24));
        assert_eq!((marker.header.frame_id.as_str(), marker.kind), ("map", kind::LINE_LIST));
        let length = |p: &[io::ros2msg::Vector3]| {
            (p[0].x - p[1].x).abs() + (p[0].y - p[1].y).abs() + (p[0].z - p[1].z).abs()
        };
        let sum: f64 = marker.points.chunks(2).map(length).sum();
        assert!((sum - 4.0 * (1.0 + 1.1 + 1.2)).abs() < 1e-9, "{sum}");
    }

    #[test]
    fn meshes_are_named_so_that_others_find_them() {
        assert!(twin().urdf_with_uris(false).contains("\"file:///nowhere/meshes/visual/base.obj\""));
        assert!(twin().urdf_with_uris(true).contains("\"package://box/meshes/visual/base.obj\""));
    }
}
