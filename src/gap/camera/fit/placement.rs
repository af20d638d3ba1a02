//! Finds the joint positions of a run by a search over the joints' ranges on coarse frames.
//! See docs/method.md 15.2.

use std::f64::consts::PI;

use rayon::prelude::*;

use crate::camera::{
    fit::predict::{rendered_twin, true_camera},
    model::{hypothesis::Hypothesis, scales::Scales, twin::SeenTwin},
    record::frames::{FrameRun, coarse_frame},
};
use geometry::Pose;

/// Number of compared frames.
const FRAMES: usize = 6;
/// Approximate width of the coarse images, pixels.
const WIDTH: usize = 80;
/// Fewest and most steps of the first scan over a joint's range.
const STEPS: [usize; 2] = [12, 72];
/// Number of the scan's minima refined.
const MINIMA: usize = 4;
/// Number of halvings of the step.
const HALVINGS: usize = 5;
/// Most rounds over all joints.
const ROUNDS: usize = 3;
/// Least gain in the mean cost of a pixel for another round.
///
/// chosen: far below the cost of one joint in a wrong place
const LEAST_GAIN: f64 = 1e-4;
/// A range is searched beyond its limits by at least this share of the possible range.
///
/// chosen: the twin may describe a moving joint as fixed
const LEAST_BEYOND: f64 = 0.1;
/// First step of later rounds, in steps of the first round.
///
/// chosen: later rounds only follow changes of the other joints
const LATER_STEP: f64 = 0.25;

/// Coarse frames of a run.
pub struct CoarseRun {
    run: FrameRun,
    /// A depth off by more than this, meters, counts as wrong.
    wrong_m: f64,
}

impl CoarseRun {
    /// Some frames of a run, spread over it, at a coarse resolution.
    pub fn of_run(run: &FrameRun, scales: &Scales) -> Self {
        let n = run.frames.len();
        let chosen: Vec<usize> = (0..FRAMES.min(n)).map(|i| i * n / FRAMES.min(n)).collect();
        let mut frames = Vec::with_capacity(chosen.len());
        for frame in chosen.iter().map(|&i| &run.frames[i]) {
            frames.push(coarse_frame(frame, (frame.intrinsics.width / WIDTH).max(1)));
        }
        let velocities = chosen.iter().filter_map(|&i| run.velocities.get(i).copied()).collect();
        Self {
            run: FrameRun {
                name: run.name.clone(),
                frames,
                velocities,
                positions: run.positions.clone(),
                noise: run.noise,
            },
            // One standard deviation of the displacement due to effects.
            wrong_m: 0.5 * scales.gate_m(),
        }
    }

    /// Mean cost of the pixels covered by the object or the twin, 0 to 1: docs/method.md (15.2).
    pub fn mean_cost(&self, twin: &SeenTwin, hypothesis: &Hypothesis, run: usize) -> f64 {
        let poses = hypothesis.part_and_joint_poses(twin, run).0;
        let (sum, count) = (0..self.run.frames.len())
            .into_par_iter()
            .map(|f| self.frame_cost(twin, hypothesis, &poses, f))
            .reduce(|| (0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        sum / count.max(1) as f64
    }

    /// Sum of the costs of a frame's pixels and their number; `poses` are world poses of the parts.
    fn frame_cost(
        &self,
        twin: &SeenTwin,
        hypothesis: &Hypothesis,
        poses: &[Pose],
        frame_index: usize,
    ) -> (f64, usize) {
        let wrong_m = self.wrong_m;
        let frame = &self.run.frames[frame_index];
        let camera = true_camera(&self.run, frame_index, &hypothesis.camera);
        let image = rendered_twin(twin, poses, &frame.intrinsics, &camera, false);
        let mut sum = 0.0;
        let mut count = 0;
        for i in 0..image.depth_m.len() {
            let reading = f64::from(frame.depth_m[i]);
            let predicted = f64::from(image.depth_m[i]);
            let measured = (reading - hypothesis.camera.bias_m) / hypothesis.camera.scale;
            let object = frame.is_object(i);
            let cost = match (object && (frame.mask.is_some() || predicted > 0.0), predicted > 0.0) {
                (true, true) if reading > 0.0 => ((measured - predicted).abs() / wrong_m).min(1.0),
                // A missing reading on the object says nothing of its depth.
                (true, true) => continue,
                (true, false) => 1.0,
                // A nearer reading may belong to an occluder; a farther one, or none, contradicts the twin.
                (false, true) if reading == 0.0 || measured > predicted + wrong_m => 1.0,
                _ => continue,
            };
            sum += cost;
            count += 1;
        }
        (sum, count)
    }

    /// Sets the position of a joint and returns the cost of the run.
    fn cost_at(
        &self,
        twin: &SeenTwin,
        hypothesis: &mut Hypothesis,
        run: usize,
        joint: usize,
        position: f64,
    ) -> f64 {
        hypothesis.positions[run][joint] = position;
        self.mean_cost(twin, hypothesis, run)
    }
}

/// Finds the positions of the joints in a run, one joint at a time from the root outward, in several rounds;
/// recorded positions are kept.
pub fn find_positions(twin: &SeenTwin, coarse: &CoarseRun, hypothesis: &mut Hypothesis, run: usize) {
    let mut best = coarse.mean_cost(twin, hypothesis, run);
    for round in 0..ROUNDS {
        let before = best;
        for joint in 0..twin.joints.len() {
            let spec = &twin.joints[joint];
            if spec.mimic.is_some() || coarse.run.positions.contains_key(&spec.name) {
                continue;
            }
            best = search_joint(twin, coarse, hypothesis, run, joint, best, round == 0);
        }
        if before - best < LEAST_GAIN {
            break;
        }
    }
}

/// Finds the position of one joint in a run, the others fixed; returns the cost.
pub fn find_position(
    twin: &SeenTwin,
    coarse: &CoarseRun,
    hypothesis: &mut Hypothesis,
    run: usize,
    joint: usize,
) -> f64 {
    let best = coarse.mean_cost(twin, hypothesis, run);
    search_joint(twin, coarse, hypothesis, run, joint, best, true)
}

/// Searches one joint's range; returns the cost at the position found, `best` or less.
fn search_joint(
    twin: &SeenTwin,
    coarse: &CoarseRun,
    hypothesis: &mut Hypothesis,
    run: usize,
    joint: usize,
    mut best: f64,
    first: bool,
) -> f64 {
    let spec = &twin.joints[joint];
    let turns = hypothesis.laws[joint].kind.is_turning();
    // A slide moves its part by its own length at most.
    let wide = if turns { PI } else { 2.0 * twin.parts[spec.child].radius_m };
    let (low, high) = spec.limit.map_or((-wide, wide), |(l, h)| {
        // A twin's limits are those observed: the search extends past them by the range's own width.
        let more = (h - l).max(LEAST_BEYOND * wide);
        ((l - more).max(-wide + l.min(0.0)), (h + more).min(wide + h.max(0.0)))
    });
    let start = hypothesis.positions[run][joint];
    let reach_m = if turns { (high - low) * twin.radius_m() } else { high - low };
    // Steps no longer than `wrong_m` skip no minimum.
    let count = ((reach_m / coarse.wrong_m).ceil() as usize).clamp(STEPS[0], STEPS[1]);
    let mut step = (high - low) / count as f64;
    // The present position is one of the starts, so the cost never rises.
    let mut minima = vec![(best, start)];
    if first {
        let mut scan = Vec::with_capacity(count + 1);
        for i in 0..=count {
            let q = low + step * i as f64;
            scan.push((coarse.cost_at(twin, hypothesis, run, joint, q), q));
        }
        minima.extend(local_minima(&scan));
        minima.sort_by(|a, b| a.0.total_cmp(&b.0));
        minima.truncate(MINIMA);
    } else {
        step *= LATER_STEP;
    }
    for _ in 0..HALVINGS {
        step *= 0.5;
        for m in &mut minima {
            let middle = m.1;
            for q in [middle - step, middle + step] {
                let cost = coarse.cost_at(twin, hypothesis, run, joint, q);
                if cost < m.0 {
                    *m = (cost, q);
                }
            }
        }
    }
    let found = minima.into_iter().fold((best, start), |a, b| if b.0 < a.0 { b } else { a });
    best = found.0;
    hypothesis.positions[run][joint] = found.1;
    best
}

/// The pairs (cost, position) with no lower cost on either side.
fn local_minima(scan: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut minima = Vec::new();
    for (i, at) in scan.iter().enumerate() {
        if (i == 0 || at.0 <= scan[i - 1].0) && (i + 1 == scan.len() || at.0 <= scan[i + 1].0) {
            minima.push(*at);
        }
    }
    minima
}
