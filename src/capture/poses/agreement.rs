//! Whether image features that frames share lie where the reported poses say.
//!
//! Features are matched by what they look like, so that they know of no pose. Poses that are off by more than
//! surfaces can be compared over leave them apart. Poses of another time bring them together at that time.
//! See docs/method.md 2.13.

use serde::{Deserialize, Serialize};

use super::{pairs::Matches, pose_noise::PoseNoise, surfels::Surfels, trajectory::Trajectory};
use common::stop::{Stop, Stopped};

/// Fewest matches of a state that say anything.
const LEAST_MATCHES: usize = 200;
/// Poses contradict the images where fewer matches than this share agree with them: most say so. (0.9 and
/// more agree with poses as a hand-held camera reports them.) chosen: a majority
const LEAST_SHARE: f64 = 0.5;
/// Delays that are tried, seconds: up to the first, in steps of the second, in which a hand at 0.3 m/s moves
/// a camera by less than matches may be apart. chosen: beyond the delay of any driver
const MOST_DELAY_S: f64 = 1.0;
const DELAY_STEP_S: f64 = 0.025;
/// Poses are of another time where that lets this many times as many matches agree. Poses between those of
/// kept frames are inexact, so that few may agree with them, too.
/// chosen: far beyond chance among hundreds of matches
const EXPLAINED: f64 = 2.0;

/// How far poses and images agree.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseAgreement {
    /// Share of the matched features that lie where the poses say.
    pub share: f64,
    /// By how much the poses seem to be older than the images, seconds, and the share that agrees then; where
    /// too few agree otherwise.
    pub delay: Option<[f64; 2]>,
}

impl PoseAgreement {
    /// Of a state's frames; `None` where too few features match.
    pub(super) fn of(
        trajectory: &Trajectory,
        surfels: &[Surfels],
        matches: &Matches,
        stop: &Stop,
    ) -> Result<Option<Self>, Stopped> {
        let share = |delay_s: f64| {
            let poses = trajectory.delayed(delay_s);
            let mut agreeing = 0;
            let mut all = 0;
            for (&[i, j], matches) in matches.iter().filter(|([i, j], _)| i < j) {
                let other_from_this = poses[j].inverse() * poses[i];
                let agrees = |m: &&[u32; 2]| {
                    surfels[i]
                        .across(**m, &surfels[j], &other_from_this, &PoseNoise::EXPECTED)
                        .iter()
                        .all(Option::is_some)
                };
                all += matches.len();
                agreeing += matches.iter().filter(agrees).count();
            }
            (all >= LEAST_MATCHES).then(|| agreeing as f64 / all as f64)
        };
        let Some(reported) = share(0.0) else { return Ok(None) };
        let steps = (MOST_DELAY_S / DELAY_STEP_S).round() as i32;
        let mut delay: Option<[f64; 2]> = None;
        for delay_s in (-steps..=steps).map(|k| f64::from(k) * DELAY_STEP_S) {
            if reported >= LEAST_SHARE {
                break;
            }
            stop.check()?;
            let Some(share) = share(delay_s) else { continue };
            if delay.is_none_or(|best| share > best[1]) {
                delay = Some([delay_s, share]);
            }
        }
        Ok(Some(Self { share: reported, delay: delay.filter(|d| d[1] > EXPLAINED * reported) }))
    }

    /// Whether poses and images contradict each other.
    #[must_use]
    pub fn contradicts(&self) -> bool {
        self.share < LEAST_SHARE
    }

    /// The delay by which most matches agree.
    #[must_use]
    pub fn certain_delay_s(&self) -> Option<f64> {
        self.delay.filter(|d| d[1] > LEAST_SHARE).map(|d| d[0])
    }
}
