//! Localization of a frame relative to keyframes with known poses.

use nalgebra::Matrix6;
use rand_core::Rng;
use rayon::prelude::*;

use super::{
    adjust::{Adjusted, Adjustment, landmark_information, least_known_m},
    landmark_motion::{LandmarkPair, landmark_motion},
    lost::Lost,
    observation::Observation,
};
use crate::poses::{
    observed::Observed,
    pairs::Matches,
    pose_noise::PoseNoise,
    surfels::{Overlap, Surfels},
};
use common::stop::Stop;
use geometry::Pose;

/// One in this many surfels is checked in the other frame.
const CHECKED_EVERY: usize = 4;
/// Least agreeing share of the judged surfels.
/// tuned: shared/bags and synth --sensor handheld; right poses reach 0.95, wrong ones less than 0.8
const LEAST_AGREEMENT: f64 = 0.88;
/// Least share of a frame's surfels seen by the known frames.
/// tuned: shared/bags: consecutive views share at least half
const LEAST_SHARE: f64 = 0.2;

/// Least information about a direction that counts as observed, relative to the best: less may come from the
/// noise of normals.
/// derived: the square of 4 deg, the largest error of a surfel's normal
const LEAST_OBSERVED: f64 = 0.005;

/// A frame with a known pose.
#[derive(Clone)]
pub(super) struct Known<'a> {
    pub observation: &'a Observation,
    pub pose: Pose,
    /// Its landmark matches with the new frame, if already found.
    pub matches: Option<Vec<[u32; 2]>>,
}

/// A located frame.
pub(super) struct Located {
    pub pose: Pose,
    /// By known frame: its information about the new pose, in the new camera's frame.
    pub by_known: Vec<Matrix6<f64>>,
    /// By known frame: agreement of the surfels of both.
    pub overlaps: Vec<Overlap>,
    /// By known frame: matching landmarks.
    pub matches: Vec<Vec<[u32; 2]>>,
    /// Standard deviation in the least determined direction at the frame's mean depth, meters.
    pub least_known_m: f64,
    /// Agreeing share of the judged surfels.
    pub agreement: f64,
}

/// An approximate pose of the new frame and its error.
#[derive(Clone, Copy)]
pub(super) struct Guess {
    pub pose: Pose,
    pub noise: PoseNoise,
}

/// Error of an approximate pose from landmarks, as a factor on the error of unrefined poses.
/// chosen: landmarks are a few times less accurate than surfaces
const BY_LANDMARKS: f64 = 3.0;

/// Locates a frame relative to known ones: from matching landmarks, else from a given guess.
pub(super) fn locate_frame(
    known: &[Known<'_>],
    new: &Observation,
    guess: Option<Guess>,
    rng: &mut impl Rng,
) -> Result<Located, Lost> {
    let matched: Vec<Vec<[u32; 2]>> = known
        .par_iter()
        .map(|k| k.matches.clone().unwrap_or_else(|| k.observation.matches_with(new)))
        .collect();
    // The new camera defines its own map.
    let own = Pose::identity();
    let own = &own;
    let pairs: Vec<LandmarkPair> = known
        .iter()
        .zip(&matched)
        .flat_map(|(k, matched)| {
            let frames = [&k.observation.surfels, &new.surfels];
            matched.iter().map(move |m| LandmarkPair::new([&k.pose, own], frames, *m))
        })
        .collect();
    let by_landmarks = landmark_motion(&pairs, rng).map(|(camera_from_map, _)| {
        let noise = PoseNoise::EXPECTED.scaled_by(BY_LANDMARKS);
        Guess { pose: camera_from_map.inverse(), noise }
    });
    let guesses = by_landmarks.into_iter().chain(guess);
    let mut lost = Lost::NoGuess;
    for guess in guesses {
        match settled_place(known, new, &matched, guess) {
            Ok(located) => return Ok(located),
            Err(why) => lost = why,
        }
        // Another guess would leave the same directions undetermined.
        if lost == Lost::Undetermined {
            break;
        }
    }
    Err(lost)
}

/// The pose near a guess at which surfaces and landmarks agree, if they determine it.
fn settled_place(
    known: &[Known<'_>],
    new: &Observation,
    matched: &[Vec<[u32; 2]>],
    guess: Guess,
) -> Result<Located, Lost> {
    let last = known.len();
    let pairs: Vec<[usize; 2]> = (0..last).map(|k| [k, last]).collect();
    let matches: Matches = pairs.iter().copied().zip(matched.iter().cloned()).collect();
    let mut surfels: Vec<Surfels> = known.iter().map(|k| k.observation.surfels.clone()).collect();
    surfels.push(new.surfels.clone());
    let start: Vec<Pose> = known.iter().map(|k| k.pose).chain([guess.pose]).collect();
    let adjustment = Adjustment {
        surfels: &surfels,
        fixed: last,
        pairs: &pairs,
        matches: &matches,
        start: guess.noise,
        // Too short to be stopped.
        stop: &Stop::never(),
    };
    let Ok(Some(adjusted)) = adjustment.solve_near(&start) else { return Err(Lost::Undetermined) };
    let pose = adjusted.poses[last];
    let overlaps: Vec<Overlap> = known
        .iter()
        .map(|k| overlap_both_ways([&k.observation.surfels, &new.surfels], &(pose.inverse() * k.pose)))
        .collect();
    let both = overlaps.iter().copied().fold(Overlap::default(), Overlap::added_to);
    if overlaps.iter().map(Overlap::share).fold(0.0, f64::max) < LEAST_SHARE {
        return Err(Lost::LittleShared);
    }
    let agreement = both.agreement();
    if agreement < LEAST_AGREEMENT {
        return Err(Lost::Contradicted);
    }
    let depth_m = mean_depth_m(&new.surfels);
    let least_known_m = least_known_m(&observed_information(known, new, matched, &adjusted), depth_m);
    // The true pose must lie within the assumed error of the joint adjustment.
    if !(least_known_m <= PoseNoise::EXPECTED.displacement_m(depth_m)) {
        return Err(Lost::Undetermined);
    }
    let by_known = (0..last).map(|k| adjusted.information_with(last, k)).collect();
    Ok(Located { pose, by_known, overlaps, matches: matched.to_vec(), least_known_m, agreement })
}

/// Information about the new pose, without directions known only by the noise of normals.
fn observed_information(
    known: &[Known<'_>],
    new: &Observation,
    matched: &[Vec<[u32; 2]>],
    adjusted: &Adjusted,
) -> Matrix6<f64> {
    let last = known.len();
    let pose = adjusted.poses[last];
    let by_landmarks: Matrix6<f64> = known
        .iter()
        .zip(matched)
        .map(|(k, m)| {
            let frames = [&k.observation.surfels, &new.surfels];
            landmark_information(frames, m, &(pose.inverse() * k.pose), &PoseNoise::EXPECTED)
        })
        .sum::<Matrix6<f64>>()
        // A landmark matched in several known frames counts once.
        / (last.max(1) as f64 * adjusted.scale.powi(2));
    let all = adjusted.pose_information(last);
    Observed::above_share(&all, LEAST_OBSERVED).information + by_landmarks
}

/// Counts how each of two frames sees the other's surfels.
pub(super) fn overlap_both_ways(frames: [&Surfels; 2], second_from_first: &Pose) -> Overlap {
    let [first, second] = frames;
    let noise = PoseNoise::EXPECTED;
    let there = first.overlap_with(second, second_from_first, &noise, CHECKED_EVERY);
    there.added_to(second.overlap_with(first, &second_from_first.inverse(), &noise, CHECKED_EVERY))
}

/// Mean depth of a frame's surfels, meters; 1 without any.
pub(super) fn mean_depth_m(surfels: &Surfels) -> f64 {
    let (sum, count) = surfels.sum_of_points();
    if count > 0.0 { sum.z / count } else { 1.0 }
}
