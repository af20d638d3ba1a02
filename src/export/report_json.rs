//! The results of a run and their evidence, as a machine-readable report.

use std::collections::BTreeMap;

use nalgebra::Unit;
use serde::{Deserialize, Serialize};

use super::{
    camera_poses::{CameraPosesReport, CameraTrackingReport, DepthSensorReport, WorldFrameReport},
    difference_report::StateDifference,
    limit_report::LimitReport,
    link_report::LinkReport,
    number::round_significant,
    overall::Overall,
    package::ExportFile,
    part_count::PartCountReport,
    start::InitialMotion,
};
use common::note::Note;
use geometry::{Intrinsics, Pose};
use model::{ArticulatedModel, Deviations, Joint, JointKind, ParentScore};

/// Version of the layout of `report.json`.
pub(crate) const REPORT_FORMAT: &str = "artitwin-report/2";
/// Significant digits of numbers in the report.
const DIGITS: usize = 10;

/// The contents of `report.json`. Meters, radians, seconds and kilograms unless the key says otherwise.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// `REPORT_FORMAT`.
    pub format: String,
    /// Name of the object.
    pub name: String,
    /// Verdict on the uses of the twin.
    pub overall: Overall,
    /// Joint positions of the observed states.
    pub states: Vec<StateReport>,
    /// Joints, in the order of the URDF.
    pub joints: Vec<JointReport>,
    /// Links, in the order of the URDF.
    pub links: Vec<LinkReport>,
    /// Facts about the run itself.
    #[serde(flatten)]
    pub run: RunFacts,
}

/// One observed state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StateReport {
    /// Position of every joint by name, radians or meters; a screw also has that of its slide.
    pub joints: BTreeMap<String, f64>,
}

/// A joint with its evidence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JointReport {
    /// Name.
    pub name: String,
    /// `revolute`, `prismatic`, `screw`, or `free` where no type explains the motion.
    #[serde(rename = "type")]
    pub kind: String,
    /// Advance along the axis per radian for a screw or free motion; none for other joints.
    pub pitch_m_per_rad: Option<f64>,
    /// Standard deviation of the pitch.
    pub pitch_std_m_per_rad: Option<f64>,
    /// Parent link.
    pub parent: String,
    /// Child link.
    pub child: String,
    /// Direction of the axis in the world in state 0.
    pub axis: [f64; 3],
    /// A point on the axis in the world in state 0, meters.
    pub origin: [f64; 3],
    /// Position in state 1 minus position in state 0; with more states, in the state farthest from state 0.
    pub motion: Quantity,
    /// Position in every state with its standard deviation, in the unit of the motion.
    pub positions: Vec<PositionReport>,
    /// Position interval.
    pub limit: LimitReport,
    /// Friction and damping.
    pub dynamics: DynamicsReport,
    /// Root mean square angle between estimated and true axis from the covariance, degrees; null: not
    /// determined.
    pub axis_std_deg: Option<f64>,
    /// Root mean square distance between estimated and true axis from the covariance, perpendicular to the
    /// axis, millimeters; meaningless for a prismatic joint; null: not determined.
    pub origin_std_mm: Option<f64>,
    /// Standard deviation of the motion.
    pub motion_std: SpreadReport,
    /// Covariance of (axis direction 3, point on the axis 3, motion 1), world, radians and meters, row by
    /// row.
    pub covariance: Vec<[f64; 7]>,
    /// Number of points and matches that support the motion.
    pub inliers: usize,
    /// Number of points and matches tried.
    pub tried: usize,
    /// Root mean square distance of the supporting points after the motion, millimeters.
    pub residual_rms_mm: f64,
    /// Cost of every joint type (Bayesian information criterion); lower is better.
    pub type_scores: BTreeMap<String, f64>,
    /// Ratio of the squared error of the parameters to that of independent observations; included in the
    /// covariance.
    pub dispersion: f64,
    /// How well each link fits as the child's parent, by name.
    pub parents: BTreeMap<String, ParentReport>,
    /// The axis from the motion alone, if the object's other axes and flat faces influenced the final one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis_alone: Option<AxisAloneReport>,
    /// Reasons not to trust this joint.
    pub cautions: Vec<Note>,
    /// Properties that the states cannot show.
    pub not_observable: Vec<Note>,
}

/// An axis estimated from the motion of its part alone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AxisAloneReport {
    /// Unit direction in the world.
    pub axis: [f64; 3],
    /// Its standard deviation, degrees; null: not determined.
    pub std_deg: Option<f64>,
}

/// How well a link fits as the parent of a part.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParentReport {
    /// Score of the best joint with one degree of freedom, less that of the free motion; lower is simpler.
    pub excess: f64,
    /// Distance between both, the largest over the states, millimeters.
    pub gap_mm: f64,
}

/// Position of a joint in a state.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PositionReport {
    /// Index of the state.
    pub state: usize,
    /// Position, radians or meters.
    pub value: f64,
    /// Standard deviation; none if unknown. Positions count from state 0.
    pub std: Option<f64>,
}

/// A number with its unit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Quantity {
    /// The number.
    pub value: f64,
    /// `rad` or `m`.
    pub unit: String,
}

/// A standard deviation with its unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpreadReport {
    /// The number; null: not determined.
    pub value: Option<f64>,
    /// `rad` or `m`.
    #[serde(default)]
    pub unit: String,
}

/// Resistance to a joint's motion; N m or N, per radian or meter.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DynamicsReport {
    /// Coulomb friction.
    pub friction: f64,
    /// Viscous damping.
    pub damping: f64,
    /// What both are based on.
    pub assumption: String,
}

/// Facts about a run, beside its model.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RunFacts {
    /// The input.
    pub input: InputFacts,
    /// Where the motions started, and how far refinement changed them.
    pub initialization: Vec<InitialMotion>,
    /// How closely the rendered twin resembles photos.
    pub renderings: Vec<Rendering>,
    /// Differences between the camera readings and the twin, by state; a state whose object pixels are
    /// unknown is left out.
    pub differences: Vec<StateDifference>,
    /// How the number of parts was found.
    pub part_count: Option<PartCountReport>,
    /// Bounding box of the isolated object over all states, lower and upper corner in the world, meters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub object_box_m: Option<[[f64; 3]; 2]>,
    /// How the camera was tracked through each state; empty where its poses were recorded.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub camera_tracking: Vec<CameraTrackingReport>,
    /// Corrections of the camera poses of each state.
    pub camera_poses: Vec<CameraPosesReport>,
    /// How far the twin's frame may be off as a whole, if poses were corrected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub world_frame: Option<WorldFrameReport>,
    /// Corrections of the depth sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_sensor: Option<DepthSensorReport>,
    /// Stages in order with their wall times.
    pub stages: Vec<StageTime>,
    /// Versions of the program and its libraries, by name.
    pub versions: BTreeMap<String, String>,
    /// Seed of all random streams.
    pub seed: u64,
    /// Name of the settings' preset, and its cost in accuracy.
    pub preset: String,
    /// Digest of the effective configuration.
    pub config_digest: String,
    /// Digest of recordings, settings, seed and version: runs with equal digests compute the same.
    pub fingerprint: String,
    /// Device that computed: processor or graphics adapter, threads.
    pub device: String,
    /// Findings and choices.
    pub notes: Vec<Note>,
    /// Warnings about degraded results.
    pub warnings: Vec<Note>,
}

/// How closely the rendered twin resembles a photo.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Rendering {
    /// State of the object.
    pub state: usize,
    /// Name of the view.
    pub view: String,
    /// Peak signal-to-noise ratio over the object's pixels, dB.
    pub psnr_db: f64,
    /// Path of a PNG of the object's pixels, with all others transparent, relative to the run folder.
    pub photo: String,
    /// Camera of the photo.
    pub camera: Option<RecordedCamera>,
}

/// A camera of the recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RecordedCamera {
    /// Pinhole model, pixels.
    pub intrinsics: Intrinsics,
    /// Homogeneous matrix, row-major, meters; the optical frame has x right, y down, z forward.
    pub world_from_camera: [[f64; 4]; 4],
}

impl RecordedCamera {
    /// A camera at a pose.
    pub fn new(intrinsics: Intrinsics, world_from_camera: &Pose) -> Self {
        let matrix = world_from_camera.to_homogeneous();
        Self {
            intrinsics,
            world_from_camera: std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)])),
        }
    }
}

/// The recordings used.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct InputFacts {
    /// Files and folders as the user named them.
    pub paths: Vec<String>,
    /// Number of frames used of each state.
    pub frames: Vec<usize>,
}

/// Wall time of a stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageTime {
    /// Name, e.g. `field/state0`.
    pub name: String,
    /// Seconds.
    pub seconds: f64,
}

impl Report {
    /// The report of a model, its `files` and its run. The model must have no findings ([`model::validate`]).
    pub fn new(model: &ArticulatedModel, files: &[ExportFile], run: RunFacts) -> Self {
        Self {
            format: REPORT_FORMAT.to_owned(),
            name: model.name.clone(),
            overall: Overall::of_run(model.joints.len(), &run.warnings, &run.differences),
            states: model.states.iter().map(|positions| state_report(model, positions)).collect(),
            joints: model.joints.iter().enumerate().map(|(i, j)| joint_report(model, i, j)).collect(),
            links: model.links.iter().map(|l| LinkReport::of_link(l, files)).collect(),
            run,
        }
    }

    /// The report as indented JSON with a line break at the end. NaN and infinities become `null`.
    pub fn to_json(&self) -> String {
        // Maps with text keys always serialize.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }

    /// Seconds of all stages together.
    pub fn total_seconds(&self) -> f64 {
        self.run.stages.iter().map(|s| s.seconds).sum()
    }
}

fn joint_report(model: &ArticulatedModel, index: usize, joint: &Joint) -> JointReport {
    let none = vec![0.0; model.joints.len()];
    let first = model.states.first().unwrap_or(&none);
    // Axis and origin in the world, as they are in state 0.
    let world_from_joint = model.world_from_link(joint.parent, first) * joint.parent_from_joint;
    let axis = world_from_joint.rotation * joint.axis.into_inner();
    let unit = unit(joint.kind);
    let quantity = |value: f64| Quantity { value: round_significant(value, DIGITS), unit: unit.to_owned() };
    let e = &joint.evidence;
    let extent_m = model.extent_m();
    let direction = Unit::new_normalize(axis);
    let deviation = Deviations::of_covariance(&e.covariance, &direction, joint.kind.turns(), extent_m);
    let link_name = |link: usize| model.links[link].name.clone();
    // Standard deviations are known to a few digits only.
    let spread = |value: Option<f64>, factor: f64| value.map(|v| round_significant(factor * v, 4));
    JointReport {
        name: joint.name.clone(),
        kind: joint.kind.name().into(),
        pitch_m_per_rad: joint.kind.pitch_m_per_rad().map(|p| round_significant(p, DIGITS)),
        pitch_std_m_per_rad: joint
            .kind
            .pitch_m_per_rad()
            .map(|_| round_significant(e.pitch_std_m_per_rad, 4)),
        parent: model.links[joint.parent].name.clone(),
        child: model.links[joint.child].name.clone(),
        axis: round3(axis.into()),
        origin: round3(world_from_joint.translation.vector.into()),
        motion: quantity(model.motion_of_joint(index)),
        positions: positions(model, index),
        limit: LimitReport::of_joint(model, index),
        dynamics: DynamicsReport {
            friction: round_significant(joint.dynamics.friction, DIGITS),
            damping: round_significant(joint.dynamics.damping, DIGITS),
            assumption: joint.dynamics.assumption.clone(),
        },
        axis_std_deg: spread(deviation.axis_rad, 1f64.to_degrees()),
        origin_std_mm: spread(deviation.origin_m, 1e3),
        motion_std: SpreadReport { value: spread(deviation.motion, 1.0), unit: unit.to_owned() },
        covariance: e
            .covariance
            .row_iter()
            .map(|r| std::array::from_fn(|k| round_significant(r[k], DIGITS)))
            .collect(),
        inliers: e.inliers,
        tried: e.tried,
        residual_rms_mm: round_significant(1000.0 * e.residual_rms_m, 4),
        type_scores: e
            .type_scores
            .iter()
            .map(|(k, v)| (k.name().to_owned(), round_significant(v, DIGITS)))
            .collect(),
        dispersion: round_significant(e.dispersion, 4),
        parents: e.parents.iter().map(|(link, p)| (link_name(*link), parent_report(p))).collect(),
        axis_alone: e.axis_alone.map(|a| AxisAloneReport {
            axis: std::array::from_fn(|k| round_significant(a.axis[k], DIGITS)),
            std_deg: spread(a.deviation_rad(), 1f64.to_degrees()),
        }),
        cautions: e.cautions.iter().map(|remark| remark.note(link_name)).collect(),
        not_observable: e.not_observable.iter().map(|remark| remark.note(link_name)).collect(),
    }
}

fn state_report(model: &ArticulatedModel, positions: &[f64]) -> StateReport {
    let joints = model.joints.iter().zip(positions).flat_map(|(j, &q)| {
        let turn = (j.name.clone(), round_significant(q, 12));
        // In the URDF the slide of a screw leads.
        let pitch = j.kind.thread_m_per_rad();
        let advance = pitch.map(|p| (j.advance_name(), round_significant(p * q, 12)));
        advance.into_iter().chain([turn])
    });
    StateReport { joints: joints.collect() }
}

/// Standard deviation of a position; `None` where it is unknown.
fn position_std(joint: &Joint, state: usize) -> Option<f64> {
    // Positions count from state 0, which therefore has no deviation; the evidence begins with state 1.
    let Some(k) = state.checked_sub(1) else { return Some(0.0) };
    let std = joint.evidence.position_std.get(k).copied().filter(|s| s.is_finite());
    std.map(|s| round_significant(s, 4))
}

/// Position in every state.
fn positions(model: &ArticulatedModel, joint: usize) -> Vec<PositionReport> {
    let states = model.states.iter().enumerate();
    states
        .map(|(state, q)| PositionReport {
            state,
            value: round_significant(q[joint], 12),
            std: position_std(&model.joints[joint], state),
        })
        .collect()
}

fn parent_report(score: &ParentScore) -> ParentReport {
    ParentReport {
        excess: round_significant(score.excess, 4),
        gap_mm: round_significant(1e3 * score.gap_m, 4),
    }
}

/// Unit of a joint's positions.
fn unit(kind: JointKind) -> &'static str {
    if kind.turns() { "rad" } else { "m" }
}

fn round3(v: [f64; 3]) -> [f64; 3] {
    // Positions and directions: noise below a picometer has no meaning.
    v.map(|x| (x * 1e12).round() * 1e-12 + 0.0).map(|x| round_significant(x, DIGITS))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Vector3};

    use super::*;
    use crate::ReadReport;
    use crate::start::{compare_starts, nearest_starts};
    use geometry::Pose;
    use model::example::cabinet;

    fn facts() -> RunFacts {
        RunFacts {
            input: InputFacts { paths: vec!["bags/cabinet".into()], frames: vec![30, 28] },
            stages: vec![
                StageTime { name: "field/state0".into(), seconds: 12.5 },
                StageTime { name: "articulate".into(), seconds: 7.5 },
            ],
            seed: 7,
            warnings: vec![Note::new(common::note::NoteCode::PosesMissing, "2 frames had no pose")],
            ..RunFacts::default()
        }
    }

    #[test]
    fn json_holds_what_an_evaluation_reads() {
        let report = Report::new(&cabinet(), &[], facts());
        let json: serde_json::Value = serde_json::from_str(&report.to_json()).unwrap();
        assert_eq!(json["states"][1]["joints"]["door_hinge"], 1.25);
        assert_eq!(json["states"][0]["joints"]["drawer_slide"], 0.18);
        assert_eq!((&json["seed"], &json["input"]["frames"][1]), (&7.into(), &28.into()));
        assert_eq!(json["joints"][0]["covariance"].as_array().map(Vec::len), Some(7));
        let read: ReadReport = serde_json::from_value(json).unwrap();
        assert_eq!((&read.name, &read.states, read.links.len()), (&report.name, &report.states, 3));
        assert_eq!(read.joints[0].motion_std.as_ref(), Some(&report.joints[0].motion_std));
        assert!((report.total_seconds() - 20.0).abs() < 1e-12);
    }

    #[test]
    fn joints_are_given_in_the_world_with_units() {
        let mut model = cabinet();
        let hinge = &mut model.joints[0];
        hinge.evidence.covariance.fill(0.0);
        let axis = hinge.parent_from_joint.rotation * Vector3::z();
        // Noise along the axis must not count.
        let block = Matrix3::identity() * 1e-6 + axis * axis.transpose() * 1e-2;
        hinge.evidence.covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&block);
        hinge.evidence.covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&block);
        hinge.evidence.covariance[(6, 6)] = 4e-6;
        let report = Report::new(&model, &[], facts());
        let door = &report.joints[0];
        assert!(
            (door.axis_std_deg.unwrap() - (2e-6f64).sqrt().to_degrees()).abs() < 1e-4,
            "{:?}",
            door.axis_std_deg
        );
        assert!((door.origin_std_mm.unwrap() - 1.414).abs() < 1e-3);
        assert_eq!(
            (door.motion.value, door.motion.unit.as_str(), door.motion_std.value),
            (1.25, "rad", Some(0.002))
        );
        assert_eq!((report.joints[1].motion.value, report.joints[1].motion.unit.as_str()), (-0.18, "m"));
        assert_eq!(
            (door.parent.as_str(), door.child.as_str(), door.kind.as_str()),
            ("body", "door", "revolute")
        );
        assert!((Vector3::from(door.axis) - axis).norm() < 1e-9 && door.origin == [0.2, -0.25, 0.3]);
    }

    #[test]
    fn a_chain_has_its_axes_where_they_stand_in_state_0() {
        let mut model = cabinet();
        model.joints[1].parent = 1;
        model.states[0][0] = 0.5;
        let report = Report::new(&model, &[], facts());
        let world_from_door = model.world_from_link(1, &model.states[0]);
        let expected = world_from_door * model.joints[1].parent_from_joint * nalgebra::Point3::origin();
        assert!((Vector3::from(report.joints[1].origin) - expected.coords).norm() < 1e-9);
    }

    #[test]
    fn the_start_is_compared_with_the_end() {
        let model = cabinet();
        let end = |i: usize| {
            model.world_from_link(i, &model.states[1]) * model.world_from_link(i, &model.states[0]).inverse()
        };
        let same = compare_starts(&model, "registration", true, &[end(1), end(2)]);
        assert!(same.iter().all(|m| m.rotation_deg < 1e-6 && m.displacement_mm < 1e-6), "{same:?}");
        let off = compare_starts(&model, "identity", false, &[Pose::identity(), Pose::identity()]);
        assert!((off[0].rotation_deg - 1.25f64.to_degrees()).abs() < 1e-9 && off[0].joint == "door_hinge");
        assert!((off[1].displacement_mm - 180.0).abs() < 1e-9 && off[1].source == "identity" && !off[1].used);
        assert_eq!((off[1].start_displacement_mm, off[1].start_rotation_deg), (0.0, 0.0));
        assert!((same[1].start_displacement_mm - 180.0).abs() < 1e-9 && same[1].used);
    }

    #[test]
    fn motions_of_another_order_are_matched_with_the_joints() {
        let model = cabinet();
        let end = |i: usize| {
            model.world_from_link(i, &model.states[1]) * model.world_from_link(i, &model.states[0]).inverse()
        };
        let near = |i: usize| Pose::translation(0.001, 0.0, 0.0) * end(i);
        assert_eq!(nearest_starts(&model, &[near(2), near(1)]), [near(1), near(2)]);
    }
}
