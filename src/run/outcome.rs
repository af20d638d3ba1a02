//! Requests for runs and their results.

use std::{path::PathBuf, sync::Arc};

use super::{Cancelled, CheckpointError};
use capture::CaptureError;
use common::{ahead::Ahead, note::Note, stop::Stopped};
use config::{Config, ConfigError, Origins};
use io::Place;
use model::{ArticulatedModel, JointKind};

/// Stage name in errors from writing the run folder.
pub(super) const OUTPUT_STAGE: &str = "output";
/// The stage that checks whether simulators load the twin as intended.
pub(super) const CHECK_STAGE: &str = "check";

/// Request for a reconstruction.
#[derive(Clone, Debug)]
pub struct ReconstructRequest {
    /// One recording, or one per state.
    pub sources: Vec<PathBuf>,
    /// Parent of the run folder.
    pub out: PathBuf,
    /// Name of the twin, `[A-Za-z][A-Za-z0-9_]*`; default: from the recording.
    pub name: Option<String>,
    /// Settings.
    pub config: Config,
    /// Where the settings came from.
    pub origins: Origins,
    /// Whether an interrupted run is continued.
    pub resume: bool,
    /// Whether finished stages are kept when the run is stopped.
    pub keep: bool,
    /// Folder for the results of every stage, also for runs of the same recordings with other settings.
    pub stages: Option<PathBuf>,
    /// Results computed from the recordings while they grew.
    pub ahead: Arc<Ahead>,
    /// Whether a folder that may not be replaced is moved to `NAME.bak`.
    pub force: bool,
    /// File for views and findings as a rerun recording; needs the feature `rerun`.
    pub rerun: Option<PathBuf>,
    /// Files and folders beside the sources that the result must not replace.
    pub beside: Vec<PathBuf>,
}

impl ReconstructRequest {
    /// The default settings: one recording, or one for each state, to a run folder in `out`.
    pub fn new(sources: impl IntoIterator<Item = impl Into<PathBuf>>, out: impl Into<PathBuf>) -> Self {
        Self {
            sources: sources.into_iter().map(Into::into).collect(),
            out: out.into(),
            name: None,
            config: Config::default(),
            origins: Origins::default(),
            resume: false,
            keep: false,
            stages: None,
            ahead: Arc::default(),
            force: false,
            rerun: None,
            beside: Vec::new(),
        }
    }

    /// Where the result goes.
    pub(super) fn place(&self, name: &str) -> Place {
        let matcher = self.config.matching.onnx.iter();
        // The matcher is an input like a recording: a result must not take its place either.
        let inputs =
            self.sources.iter().chain(&self.beside).chain(matcher).chain(&self.stages).cloned().collect();
        Place { force: self.force, inputs, ..Place::named(&self.out, name) }
    }

    /// Where a result goes if the check rejects it.
    pub(super) fn rejected_place(&self, name: &str) -> Place {
        Place { out: self.out.join(format!("{name}_rejected")), name: None, ..self.place(name) }
    }
}

/// The result of a finished run.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The run folder.
    pub folder: PathBuf,
    /// The joints found.
    pub joints: Vec<JointSummary>,
    /// Warnings about losses and uncertainties.
    pub warnings: Vec<Note>,
    /// Whether something was lost: data, or confidence in a joint.
    pub degraded: bool,
    /// Whether the folder is that of an earlier run with the same facts; then nothing was done, and nothing
    /// else is reported about it.
    pub stood: bool,
}

/// A joint as it is in state 0, in the world frame of the recording.
#[derive(Clone, Debug, PartialEq)]
pub struct JointSummary {
    /// Name.
    pub name: String,
    /// The kind of motion that it allows.
    pub kind: JointKind,
    /// Unit direction of the axis.
    pub axis_in_world: [f64; 3],
    /// Origin of the joint frame, a point of the axis, meters.
    pub point_in_world_m: [f64; 3],
    /// Position in state 1 minus position in state 0, radians or meters; with more states, in the one
    /// farthest from state 0.
    pub motion: f64,
    /// Position in every state.
    pub positions: Vec<f64>,
}

/// Why a run ended without a result. Nothing exists under the final name then.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The settings cannot be used.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// Stopped on request.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The checkpoint cannot be used or written.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// There is nothing to continue, and the name belongs to another run's result.
    #[error(
        "{} is the result of other inputs, settings or another version, and no run is there to continue; \
         give another --name, or start anew without --resume",
        folder.display()
    )]
    OtherResult {
        /// The run folder.
        folder: PathBuf,
    },
    /// A stage failed.
    #[error("{stage}")]
    Stage {
        /// Name of the stage, e.g. `field/state0`.
        stage: String,
        /// Why.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

impl RunError {
    /// The failure of a stage.
    pub fn stage(
        stage: impl Into<String>,
        source: impl Into<Box<dyn std::error::Error + Send + Sync>>,
    ) -> Self {
        Self::Stage { stage: stage.into(), source: source.into() }
    }

    /// The failure of a stage that reads, or its stop.
    pub(super) fn reading(stage: &str, error: CaptureError) -> Self {
        match error {
            CaptureError::Stopped(stopped) => stopped.into(),
            other => Self::stage(stage, other),
        }
    }

    /// Whether the run could continue from its checkpoint: it was stopped, or only its files could not be
    /// written. After any other failure it would fail again.
    pub fn can_continue(&self) -> bool {
        match self {
            Self::Cancelled(_) | Self::Checkpoint(_) => true,
            Self::Config(_) | Self::OtherResult { .. } => false,
            // A full disk can be emptied; recordings and settings do not change.
            Self::Stage { stage, .. } => stage == OUTPUT_STAGE,
        }
    }
}

impl From<Stopped> for RunError {
    fn from(stopped: Stopped) -> Self {
        Self::Cancelled(stopped.into())
    }
}

/// An error and its causes on one line. A cause at the end of a message is not repeated.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let reason = error.to_string();
        // Transparent errors repeat the sentence of their cause.
        if !text.ends_with(&reason) {
            text = format!("{text}: {reason}");
        }
        cause = error.source();
    }
    text
}

impl JointSummary {
    /// Summaries of all joints of a model; none of a model of fewer than two states.
    pub fn of(model: &ArticulatedModel) -> Vec<Self> {
        // One state shows no motion.
        let [state0, _, ..] = model.states.as_slice() else { return Vec::new() };
        (0..model.joints.len()).map(|j| Self::of_joint(model, j, state0)).collect()
    }

    /// Summary of joint number `j`, with its axis as in state 0.
    fn of_joint(model: &ArticulatedModel, j: usize, state0: &[f64]) -> Self {
        let joint = &model.joints[j];
        let world_from_joint = model.world_from_link(joint.child, state0);
        Self {
            name: joint.name.clone(),
            kind: joint.kind,
            axis_in_world: (world_from_joint.rotation * joint.axis).into_inner().into(),
            point_in_world_m: world_from_joint.translation.vector.into(),
            motion: model.motion_of_joint(j),
            positions: model.states.iter().map(|s| s[j]).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use geometry::Pose;
    use nalgebra::{Matrix3, Point3, SMatrix, Vector3};

    #[test]
    fn everything_that_a_run_reads_is_kept_from_its_result() {
        let mut config = Config::default();
        config.matching.onnx = Some("matcher.onnx".into());
        let request = ReconstructRequest {
            config,
            force: true,
            beside: vec!["mine.yaml".into()],
            ..ReconstructRequest::new(["state0", "state1"], "runs")
        };
        let place = request.place("box");
        let rejected = request.rejected_place("box");
        assert_eq!(place.inputs, ["state0", "state1", "mine.yaml", "matcher.onnx"].map(PathBuf::from));
        assert_eq!(
            (place.target().unwrap(), rejected.target().unwrap()),
            ("runs/box".into(), "runs/box_rejected".into())
        );
        assert!(place.force && rejected.force && rejected.inputs == place.inputs);
    }

    fn link(name: &str) -> model::Link {
        let inertial = model::Inertial {
            mass_kg: 1.0,
            center_of_mass: Point3::origin(),
            inertia: Matrix3::identity(),
            assumption: String::new(),
            mass_range_kg: [1.0; 2],
        };
        model::Link {
            name: name.to_owned(),
            visual: surface::TriangleMesh::default(),
            assumed_m2: 0.0,
            assumed: surface::TriangleMesh::default(),
            collision: vec![],
            inertial,
            grasps: vec![],
        }
    }

    #[test]
    fn the_axis_is_given_in_the_world_as_it_stands_in_state_0() {
        let quarter = std::f64::consts::FRAC_PI_2;
        let evidence = model::JointEvidence {
            covariance: SMatrix::zeros(),
            state1_from_state0: Pose::identity(),
            inliers: 0,
            tried: 0,
            residual_rms_m: 0.0,
            position_std: Vec::new(),
            pitch_std_m_per_rad: 0.0,
            dispersion: 1.0,
            type_scores: model::TypeScores::default(),
            parents: std::collections::BTreeMap::new(),
            axis_alone: None,
            cautions: Vec::new(),
            not_observable: Vec::new(),
        };
        let limit = model::Limit {
            lower: 0.0,
            upper: 1.0,
            effort: 1.0,
            velocity: 1.0,
            source: model::LimitSource::Observed,
            swept: None,
            closed: None,
        };
        let joint = |name: &str, kind, parent, child, at: [f64; 3], axis| model::Joint {
            name: name.to_owned(),
            kind,
            parent,
            child,
            parent_from_joint: Pose::translation(at[0], at[1], at[2]),
            axis,
            limit,
            dynamics: model::JointDynamics::default(),
            evidence: evidence.clone(),
        };
        // A door turned by 90 degrees carries a drawer that slides along its x axis.
        let model = ArticulatedModel {
            name: "box".to_owned(),
            links: ["body", "door", "drawer"].map(link).into(),
            joints: vec![
                joint("hinge", JointKind::Revolute, 0, 1, [1.0, 0.0, 0.0], Vector3::z_axis()),
                joint("slide", JointKind::Prismatic, 1, 2, [0.5, 0.0, 0.0], Vector3::x_axis()),
            ],
            states: vec![vec![quarter, 0.0], vec![0.0, 0.2]],
        };
        let joints = JointSummary::of(&model);
        assert_eq!(joints[0].name, "hinge");
        assert_relative_eq!(joints[0].motion, -quarter);
        assert_relative_eq!(joints[1].motion, 0.2);
        let check = |got: [f64; 3], expected: [f64; 3]| {
            assert_relative_eq!(Vector3::from(got), Vector3::from(expected), epsilon = 1e-12)
        };
        check(joints[0].axis_in_world, [0.0, 0.0, 1.0]);
        check(joints[0].point_in_world_m, [1.0, 0.0, 0.0]);
        check(joints[1].axis_in_world, [0.0, 1.0, 0.0]);
        check(joints[1].point_in_world_m, [1.0, 0.5, 0.0]);
    }
}
