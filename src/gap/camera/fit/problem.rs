//! A twin and its frames, prepared for a fit: usable pixels, effects, nuisance parameters.

use std::sync::Arc;

use crate::camera::{
    effects,
    fit::{residual::compared_pixels, sample::PixelSample},
    model::{
        hypothesis::Hypothesis,
        missing::Missing,
        parameter::HypothesisParameter,
        scales::Scales,
        trial::{Column, Trial, free_joints, prior_column, twin_column},
        twin::SeenTwin,
    },
    record::{frames::FrameRun, options::FrameOptions, pixels::Pixels},
};

/// A twin to diagnose, and its frames.
pub struct FrameProblem<'a> {
    /// Twin.
    pub twin: &'a SeenTwin,
    /// Recordings.
    pub runs: &'a [FrameRun],
    /// The compared pixels of the recordings.
    pub pixels: Arc<Pixels>,
    /// All trials of effects.
    pub trials: Vec<Trial>,
    /// Nuisance parameters, always free: placements and positions.
    pub nuisance: Vec<Column>,
    /// Assumptions of the diagnosis.
    pub options: FrameOptions,
    /// Lengths from which all gates and priors are derived.
    pub scales: Scales,
    /// Known missing geometry of the twin: its readings are left out.
    pub lacks: Vec<Missing>,
}

impl<'a> FrameProblem<'a> {
    /// Prepares a diagnosis.
    pub fn new(twin: &'a SeenTwin, runs: &'a [FrameRun], options: &FrameOptions) -> Self {
        let scales = Scales::of_twin(twin, runs, options.accuracy_m);
        Self {
            twin,
            runs,
            pixels: Arc::new(Pixels::chosen_of(runs)),
            trials: effects::all_trials(twin, runs, &scales),
            nuisance: nuisance_columns(twin, runs, &scales),
            options: *options,
            scales,
            lacks: Vec::new(),
        }
    }

    /// The same problem for another twin.
    pub fn for_twin<'b>(&'b self, twin: &'b SeenTwin) -> FrameProblem<'b> {
        FrameProblem {
            twin,
            runs: self.runs,
            pixels: Arc::clone(&self.pixels),
            trials: effects::all_trials(twin, self.runs, &self.scales),
            nuisance: nuisance_columns(twin, self.runs, &self.scales),
            options: self.options,
            scales: self.scales,
            lacks: self.lacks.clone(),
        }
    }

    /// Residuals beyond this are conflicts, meters.
    pub fn gate_m(&self) -> f64 {
        self.scales.gate_m()
    }

    /// Compares all runs with a hypothesis, without readings of known missing geometry.
    pub fn pixel_samples(&self, hypothesis: &Hypothesis, gate_m: f64) -> Vec<PixelSample> {
        let mut samples = compared_pixels(self.twin, self.runs, &self.pixels, hypothesis, gate_m);
        if !self.lacks.is_empty() {
            let poses: Vec<_> =
                (0..self.runs.len()).map(|r| hypothesis.part_and_joint_poses(self.twin, r).0).collect();
            samples
                .retain(|s| !self.lacks.iter().any(|m| m.covers(&poses[s.run], &s.sample.measured_point())));
        }
        samples
    }

    /// Whether a frame is held out for the proof.
    pub fn is_held_out(&self, frame: usize) -> bool {
        let every = self.options.held_out_every;
        every > 0 && frame % every == every - 1
    }
}

/// The nuisance parameters: the object's placement in each run, joint positions, and the twin's own errors.
fn nuisance_columns(twin: &SeenTwin, runs: &[FrameRun], scales: &Scales) -> Vec<Column> {
    let mut all = Vec::new();
    let gate_m = scales.gate_m();
    // Readings beyond the gate would be conflicts, so a step need not reach farther.
    let [shift, turn] = [0.5 * gate_m, 0.5 * gate_m / scales.radius_m];
    for (r, run) in runs.iter().enumerate() {
        all.extend(
            (0..6).map(|k| prior_column(HypothesisParameter::Root(r, k), if k < 3 { shift } else { turn })),
        );
        for j in free_joints(twin) {
            let lever = if twin.joints[j].kind.is_turning() { scales.child_lever_m(twin, j) } else { 1.0 };
            all.push(if run.positions.contains_key(&twin.joints[j].name) {
                twin_column(HypothesisParameter::Position(r, j), 1.0 / lever)
            } else {
                prior_column(HypothesisParameter::Position(r, j), gate_m / lever)
            });
        }
    }
    // The root's placement is already free in every recording.
    for p in 1..twin.parts.len() {
        let turn = scales.lever_m(twin, p).recip();
        all.extend(
            (0..6).map(|k| twin_column(HypothesisParameter::Mesh(p, k), if k < 3 { 1.0 } else { turn })),
        );
    }
    for j in free_joints(twin) {
        let turn = scales.child_lever_m(twin, j).recip();
        all.extend((0..2).map(|k| twin_column(HypothesisParameter::AxisTurn(j, k), turn)));
        // The axis of a slide has a direction but no position.
        if twin.joints[j].kind.is_turning() {
            all.extend((0..2).map(|k| twin_column(HypothesisParameter::AxisShift(j, k), 1.0)));
        }
    }
    all
}
