//! Check of the reported poses against image features seen in several frames.
//!
//! Features are matched by appearance, without poses. If poses are too wrong for a comparison of surfaces,
//! the matched features do not agree. If they were reported late, the features agree once the delay is
//! removed. See docs/method.md 2.13.

use serde::{Deserialize, Serialize};

use super::{pairs::Matches, pose_noise::PoseNoise, surfels::Surfels, trajectory::Trajectory};
use common::stop::{Stop, Stopped};

/// Fewest matches of a state for a check.
const LEAST_MATCHES: usize = 200;
/// Poses contradict the images if a smaller share of the matches agrees with them. (With poses of a handheld
/// camera, 0.9 and more agree.) chosen: a majority
const LEAST_SHARE: f64 = 0.5;
/// Largest tried delay and its step, seconds. Within a step, a hand at 0.3 m/s moves the camera by less than
/// the gate of matches. chosen: beyond the delay of any driver
const MOST_DELAY_S: f64 = 1.0;
const DELAY_STEP_S: f64 = 0.025;
/// Poses are late if this many times as many matches agree at another delay. Few matches may agree even then,
/// since poses interpolated between kept frames are inexact.
/// chosen: far beyond chance among hundreds of matches
const EXPLAINED: f64 = 2.0;

/// How far the poses agree with the images.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseAgreement {
    /// Share of the matched features that agree with the poses.
    pub share: f64,
    /// Apparent delay of the poses against the images, seconds, and the share that agrees then; only where
    /// too few agree without it.
    pub delay: Option<[f64; 2]>,
}

impl PoseAgreement {
    /// Checks the frames of a state; `None` where too few features match.
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

    /// The delay, if a majority of the matches agrees at it, seconds.
    #[must_use]
    pub fn certain_delay_s(&self) -> Option<f64> {
        self.delay.filter(|d| d[1] > LEAST_SHARE).map(|d| d[0])
    }
}

/// Share of the matches that agree with the poses read `delay_s` later; `None` where too few features match.
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
