//! Joints of a chain recorded together, prepared, and their models' predictions.

use crate::{
    fit::{
        multibody::dynamics::{Dynamics, Inputs},
        problem::{Problem, window_length_s},
        rollout::Start,
    },
    model::{effect::run_time_s, joint_model::JointModel},
    record::{drive::Drive, log::shooting_windows},
    twin_tree::TwinTree,
};

/// Joints of a chain recorded together, with common windows.
pub struct Joints<'t, 'c> {
    tree: &'t TwinTree,
    /// Index of each in the tree.
    joints: Vec<usize>,
    /// Runs of each joint, for predictions of whole windows.
    pub problems: Vec<Problem<'c>>,
}

impl<'t, 'c> Joints<'t, 'c> {
    /// Prepares joints by their index in the tree, each with its runs; `None` if their stamps differ from
    /// those of the first.
    pub fn new(tree: &'t TwinTree, joints: Vec<usize>, runs: &[&Problem<'c>]) -> Option<Self> {
        let length_s = runs.iter().map(|p| window_length_s(&p.plant)).fold(0.0, f64::max);
        let mut problems: Vec<Problem> = runs.iter().map(|p| p.predicting_over(length_s)).collect();
        let stamps = |p: &Problem| p.logs.iter().map(|l| l.time_s.clone()).collect::<Vec<_>>();
        let first = stamps(problems.first()?);
        if problems.iter().any(|p| stamps(p) != first) {
            return None;
        }
        problems.iter_mut().for_each(|p| p.windows = shooting_windows(&p.logs, length_s));
        Some(Self { tree, joints, problems })
    }

    /// Number of windows.
    pub fn window_count(&self) -> usize {
        self.problems[0].windows.len()
    }

    /// Start states from the smoothed motion: by window, by joint.
    pub fn smoothed_starts(&self, models: &[JointModel]) -> Vec<Vec<Start>> {
        let own: Vec<Vec<Start>> =
            self.problems.iter().zip(models).map(|(p, m)| p.smoothed_starts(m)).collect();
        (0..self.window_count()).map(|w| own.iter().map(|s| s[w]).collect()).collect()
    }

    /// Drive of each joint: by joint, by log.
    pub fn joint_drives(&self, models: &[JointModel]) -> Vec<Vec<Drive>> {
        self.problems.iter().zip(models).map(|(p, m)| p.model_drives(m)).collect()
    }

    /// Residuals of a window, rad or m: sample by sample, each joint.
    pub fn window_residuals(
        &self,
        models: &[JointModel],
        drives: &[Vec<Drive>],
        window: usize,
        starts: &[Start],
    ) -> Vec<f64> {
        let first = &self.problems[0];
        let span = first.windows[window];
        let time_s = &first.logs[span.log].time_s;
        let dynamics = Dynamics::of_models(self.tree, &self.joints, models, first.catalogue);
        let mut q: Vec<f64> = starts.iter().map(|s| s.position).collect();
        let mut v: Vec<f64> = starts.iter().map(|s| s.velocity).collect();
        let mut gauge: Vec<f64> = dynamics
            .sensors()
            .zip(starts)
            .map(|(s, start)| start.position + start.play * s.half_gap)
            .collect();
        let steps = drives.iter().map(|d| d[span.log].steps).max().unwrap_or(1);
        let mut residuals = Vec::with_capacity(span.len * q.len());
        let mut signal = vec![0.0; q.len()];
        for k in span.start..span.start + span.len {
            for (i, sensor) in dynamics.sensors().enumerate() {
                // The gauge follows the joint at either end of its play.
                // No `clamp`: it panics on NaN from a diverged rollout.
                gauge[i] = gauge[i].max(q[i] - sensor.half_gap).min(q[i] + sensor.half_gap);
                let predicted = sensor.scale * gauge[i] + sensor.bias;
                residuals.push(self.problems[i].logs[span.log].position[k] - predicted);
            }
            if k + 1 == span.start + span.len {
                break;
            }
            let step = (time_s[k + 1] - time_s[k]) / steps as f64;
            let others: Vec<[f64; 8]> =
                self.problems.iter().map(|p| p.logs[span.log].others_after(k)).collect();
            for s in 0..steps {
                for (signal, drives) in signal.iter_mut().zip(drives) {
                    let drive = &drives[span.log];
                    *signal = drive.signal[k * drive.steps + s * drive.steps / steps];
                }
                let middle_s = run_time_s(span.log, &first.logs[span.log], k) + (s as f64 + 0.5) * step;
                dynamics.step_by(
                    &mut q,
                    &mut v,
                    step,
                    &Inputs { signal: &signal, time_s: middle_s, others: &others },
                );
            }
        }
        residuals
    }
}
