//! Whether image features shared by frames lie where the reported poses put them.
//!
//! Features are matched by their looks, without poses. Poses with errors too large for a comparison of
//! surfaces leave them apart. Poses of another time bring them together at that time. See docs/method.md
//! 2.13.

use serde::{Deserialize, Serialize};

use super::{pairs::Matches, pose_noise::PoseNoise, surfels::Surfels, trajectory::Trajectory};
use common::stop::{Stop, Stopped};

/// Fewest matches of a state.
const LEAST_MATCHES: usize = 200;
/// Poses contradict the images where fewer matches than this share agree with them: most say so. (0.9 and
/// more agree with poses as a hand-held camera reports them.) chosen: a majority
const LEAST_SHARE: f64 = 0.5;
/// Tried delays, seconds: up to the first, in steps of the second. Within a step a hand at 0.3 m/s moves a
/// camera by less than the gate of matches. chosen: beyond the delay of any driver
const MOST_DELAY_S: f64 = 1.0;
const DELAY_STEP_S: f64 = 0.025;
/// Poses are of another time if this many times as many matches agree then. Poses between those of kept
/// frames are inexact: few may agree with them, too.
/// chosen: far beyond chance among hundreds of matches
const EXPLAINED: f64 = 2.0;

/// How far poses and images agree.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseAgreement {
    /// Share of the matched features in agreement with the poses.
    pub share: f64,
    /// Apparent age of the poses against the images, seconds, and the agreeing share with it; where too few
    /// agree otherwise.
    pub delay: Option<[f64; 2]>,
}

impl PoseAgreement {
    /// Of a state's frames; `None` where too few features match.
    pub(super) fn of_state(
        trajectory: &Trajectory,
        surfels: &[Surfels],
        matches: &Matches,
        stop: &Stop,
    ) -> Result<Option<Self>, Stopped> {
        let Some(reported) = agreeing_share(trajectory, surfels, matches, 0.0) else { return Ok(None) };
        let mut delay: Option<[f64; 2]> = None;
        if reported < LEAST_SHARE {
            let steps = (MOST_DELAY_S / DELAY_STEP_S).round() as i32;
            for delay_s in (-steps..=steps).map(|k| f64::from(k) * DELAY_STEP_S) {
                stop.check()?;
                let Some(share) = agreeing_share(trajectory, surfels, matches, delay_s) else { continue };
                if delay.is_none_or(|best| share > best[1]) {
                    delay = Some([delay_s, share]);
                }
            }
        }
        Ok(Some(Self { share: reported, delay: delay.filter(|d| d[1] > EXPLAINED * reported) }))
    }

    /// Whether poses and images contradict each other.
    #[must_use]
    pub fn contradicts(&self) -> bool {
        self.share < LEAST_SHARE
    }

    /// The delay of most agreeing matches.
    #[must_use]
    pub fn certain_delay_s(&self) -> Option<f64> {
        self.delay.filter(|d| d[1] > LEAST_SHARE).map(|d| d[0])
    }
}

/// Share of the matches in agreement with poses later by `delay_s`; `None` where too few features match.
fn agreeing_share(
    trajectory: &Trajectory,
    surfels: &[Surfels],
    matches: &Matches,
    delay_s: f64,
) -> Option<f64> {
    let poses = trajectory.delayed_poses(delay_s);
    let mut agreeing = 0;
    let mut all = 0;
    for (&[i, j], matches) in matches.iter().filter(|([i, j], _)| i < j) {
        let other_from_this = poses[j].inverse() * poses[i];
        for landmarks in matches {
            let found = surfels[i].landmark_residuals(
                *landmarks,
                &surfels[j],
                &other_from_this,
                &PoseNoise::EXPECTED,
            );
            all += 1;
            agreeing += usize::from(found.iter().all(Option::is_some));
        }
    }
    (all >= LEAST_MATCHES).then(|| agreeing as f64 / all as f64)
}
