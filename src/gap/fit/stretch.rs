//! Short stretches of measured motion, independent of the twin: velocities and accelerations of all joints,
//! from the positions alone, and the mean effort over each stretch.

use crate::record::{
    drive::{Hold, Signal},
    log::JointLog,
    motion::SmoothMotion,
};

/// Least length of a stretch, seconds.
/// chosen: a sixteenth of the longest window: four stretches for each of its four independent measurements.
const WIDTH_S: f64 = 1.0 / 16.0;
/// Share of the top speed below which friction may hold the joint.
/// chosen: a smoothed motion is never exactly at rest.
pub(crate) const SLOW: f64 = 0.03;

/// Motion of one joint in a run.
#[derive(Clone, Debug)]
pub struct Moved {
    /// Stamps and efforts; `None` if no effort was recorded.
    pub log: Option<JointLog>,
    /// Smoothed motion from the positions.
    pub motion: SmoothMotion,
}

/// Joints of a run, in the twin's order; `None` if not recorded.
pub type RunMotion = Vec<Option<Moved>>;

/// Means over a stretch of time.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// Run, and index of the stretch: stretches of all joints of a run are cut at the same times.
    pub key: (usize, usize),
    /// First and last time, seconds.
    pub time_s: (f64, f64),
    /// Positions of all joints, rad or m.
    pub position: Vec<f64>,
    /// Velocities of all joints, rad/s or m/s.
    pub velocity: Vec<f64>,
    /// Accelerations of all joints, rad/s^2 or m/s^2.
    pub acceleration: Vec<f64>,
}

/// Length of the stretches of a run, seconds: at least two samples.
fn width_s(run: &RunMotion) -> f64 {
    let logs = run.iter().flatten().filter_map(|m| m.log.as_ref()?.interval_s());
    logs.fold(WIDTH_S, |width, interval| width.max(2.0 * interval))
}

/// Stretches in which the joint moves in one direction and the stamps have no gap.
pub fn one_way_stretches(runs: &[RunMotion], joint: usize) -> Vec<Stretch> {
    let of = |run: usize| runs[run][joint].as_ref().and_then(|m| Some((m, m.log.as_ref()?)));
    let speeds = (0..runs.len()).filter_map(of).flat_map(|(m, _)| m.motion.state.iter().map(|s| s[1].abs()));
    let top = speeds.fold(0.0, f64::max);
    let mut found = Vec::new();
    for run in 0..runs.len() {
        let Some((moved, log)) = of(run) else { continue };
        let width = width_s(&runs[run]);
        for span in log.gapless_segments(run) {
            let first = log.time_s[span.start];
            let last = log.time_s[span.start + span.len - 1];
            let from = (first / width).ceil().max(0.0) as usize;
            for index in from..(last / width).floor().max(0.0) as usize {
                let time_s = (width * index as f64, width * (index + 1) as f64);
                let ends = [time_s.0, time_s.1].map(|t| moved.motion.state_at(t)[1]);
                // At a reversal friction has both signs, and at rest any value.
                if ends[0] * ends[1] > 0.0 && 0.5 * (ends[0] + ends[1]).abs() >= SLOW * top {
                    found.push(stretch_means(&runs[run], (run, index), time_s));
                }
            }
        }
    }
    found
}

/// Means over a stretch for all joints; unrecorded joints are at 0.
fn stretch_means(run: &RunMotion, key: (usize, usize), time_s: (f64, f64)) -> Stretch {
    let mut stretch =
        Stretch { key, time_s, position: Vec::new(), velocity: Vec::new(), acceleration: Vec::new() };
    for moved in run {
        let at =
            |t: f64| moved.as_ref().map_or([0.0; 2], |m| [m.motion.state_at(t)[0], m.motion.state_at(t)[1]]);
        let [q0, v0] = at(time_s.0);
        let [q1, v1] = at(time_s.1);
        let width = time_s.1 - time_s.0;
        stretch.position.push(0.5 * (q0 + q1));
        stretch.velocity.push((q1 - q0) / width);
        stretch.acceleration.push((v1 - v0) / width);
    }
    stretch
}

/// Mean of a log's signal over each stretch, `delay_s` late; `None` where the stamps have a gap.
pub fn mean_signal(
    log: &JointLog,
    values: &[f64],
    stretches: &[&Stretch],
    hold: Hold,
    delay_s: f64,
) -> Vec<Option<f64>> {
    let spans = log.gapless_segments(0);
    let mut signal = Signal::new(&log.time_s, values, hold.into());
    let mut means = Vec::with_capacity(stretches.len());
    for s in stretches {
        let (from, to) = s.time_s;
        let has_no_gap = spans
            .iter()
            .any(|p| log.time_s[p.start] <= from + 1e-9 && to <= log.time_s[p.start + p.len - 1] + 1e-9);
        means.push(has_no_gap.then(|| {
            let before = signal.value_and_integral(from - delay_s).1;
            (signal.value_and_integral(to - delay_s).1 - before) / (to - from)
        }));
    }
    means
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::reading_noise::ReadingNoise;

    #[test]
    fn stretches_hold_the_means_of_a_motion_and_of_its_effort() {
        let time_s: Vec<f64> = (0..2000).map(|k| 0.005 * f64::from(k)).collect();
        let position: Vec<f64> = time_s.iter().map(|t| 0.5 * (3.0 * t).sin()).collect();
        let effort: Vec<f64> = time_s.iter().map(|t| -4.5 * (3.0 * t).sin()).collect();
        let motion = SmoothMotion::of_positions(&time_s, &position, &ReadingNoise::at_rest(1e-6), &[]);
        let log = JointLog { time_s, position, effort: effort.clone(), ..JointLog::default() };
        let runs = vec![vec![Some(Moved { log: Some(log.clone()), motion }), None]];
        let found = one_way_stretches(&runs, 0);
        assert!(found.len() > 100);
        let all: Vec<&Stretch> = found.iter().collect();
        let efforts = mean_signal(&log, &effort, &all, Hold::Sampled, 0.0);
        // The smoother begins without a velocity.
        for (s, u) in found.iter().zip(efforts).skip(2) {
            assert!((s.acceleration[0] - u.unwrap()).abs() < 0.05, "{s:?} {u:?}");
            assert_eq!(s.position[1], 0.0);
        }
    }
}
