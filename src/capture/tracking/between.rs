//! Motion between the maps of two states, from static surfaces.
//!
//! Matching landmarks of both states propose motions: of the static surroundings, and of moved parts. The
//! static surfaces contradict most motions of parts. Of the remaining motions, the one with landmarks in the
//! most places is taken.

use std::collections::BTreeSet;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::{
    keyframes::view_distance_rad,
    landmark_motion::{LandmarkPair, landmark_motion},
    locate::{mean_depth_m, overlap_both_ways},
    track::Track,
};
use crate::{
    poses::{
        pairs::Matches,
        pose_noise::PoseNoise,
        surfels::{Overlap, Surfels},
        world::corrected_world,
    },
    select::spread_views,
};
use common::stop::{Stop, Stopped};
use geometry::Pose;
use numeric::random::stage_rng;

/// Keyframes compared per state.
/// derived: 144 pairs take a second
const KEYFRAMES: usize = 12;
/// Most proposed motions: the static surroundings and three parts.
/// derived: recordings have few moving parts, and large ones are found first
const MOTIONS: usize = 4;
/// Largest difference of views that are compared, radians.
/// derived: twice the reach of features (`closure`), as surfaces are compared here
const REACH_RAD: f64 = 1.0;
/// Least agreement of surfaces after a motion, relative to the best motion.
/// tuned: shared/bags: motions of parts contradicted by a floor have at most 0.83, motions of halves of
/// scissors flat on a floor 1.0
const POSSIBLE: f64 = 0.9;
/// Least ratio of landmark cells between the best motion and the next possible one.
/// derived: as between states with poses (docs/method.md 5)
const CLEAR: f64 = 2.0;
/// Side of the cells in which landmarks are counted, share of the depth.
/// derived: as between states with poses, for an object as large as its depth
const CELL_SHARE: f64 = 0.05;
/// Two motions count as one if they place the observed surface at most this share of its depth apart, and
/// rotate it by at most as many radians from each other.
/// measured: motions of one floor from different landmarks of shared/bags/drawer were 0.012 apart
const SAME_SHARE: f64 = 0.03;

/// Why two states have no common map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unaligned {
    /// No landmarks of the two states match.
    NothingAlike,
    /// Two motions explain the landmarks about equally well.
    Ambiguous {
        /// Number of landmark cells of each motion.
        cells: [usize; 2],
    },
}

/// The motion from the second state's map to the first one's, and the agreeing share of the surfels that both
/// can judge.
///
/// # Errors
/// [`Stopped`]; [`Unaligned`] is part of the result.
pub fn align_tracks(
    first: &Track,
    second: &Track,
    seed: u64,
    stop: &Stop,
) -> Result<Result<(Pose, f64), Unaligned>, Stopped> {
    let sides = [first, second].map(TrackSide::of_track);
    let pairs: Vec<[usize; 2]> =
        (0..sides[0].poses.len()).flat_map(|i| (0..sides[1].poses.len()).map(move |j| [i, j])).collect();
    let matches: Vec<Vec<[u32; 2]>> = pairs
        .par_iter()
        .map(|&[i, j]| {
            stop.check()?;
            let observations =
                [&first.observations[sides[0].keyframes[i]], &second.observations[sides[1].keyframes[j]]];
            Ok(observations[0].matches_with(observations[1]))
        })
        .collect::<Result<_, Stopped>>()?;
    let Some(surfels) = sides[0].surfels.first() else { return Ok(Err(Unaligned::NothingAlike)) };
    let depth_m = mean_depth_m(surfels);
    let mut found: Vec<Proposal> = proposed_motions(&sides, &pairs, &matches, depth_m, seed, stop)?;
    let best = found.iter().map(|p| p.overlap.agreement()).fold(0.0, f64::max);
    found.retain(|p| p.overlap.agreement() >= POSSIBLE * best);
    // By number of cells; the first of equals.
    found.sort_by_key(|p| std::cmp::Reverse(p.cells));
    let Some(&Proposal { motion: coarse, cells, overlap }) = found.first() else {
        return Ok(Err(Unaligned::NothingAlike));
    };
    let mut rivals = found[1..].iter().filter(|p| (cells as f64) < CLEAR * p.cells as f64);
    if let Some(next) = rivals.find(|p| !is_same(&p.motion, &coarse, &sides[0].poses[0], depth_m)) {
        return Ok(Err(Unaligned::Ambiguous { cells: [cells, next.cells] }));
    }
    let fine = refined_motion(&sides, &pairs, &matches, &coarse, stop)?.unwrap_or(coarse);
    Ok(Ok((fine.inverse(), overlap.agreement())))
}

/// Sampled keyframes of a state.
struct TrackSide<'a> {
    keyframes: Vec<usize>,
    poses: Vec<Pose>,
    surfels: Vec<&'a Surfels>,
}

impl<'a> TrackSide<'a> {
    fn of_track(track: &'a Track) -> Self {
        let keyframes = spread_views(&track.key_poses, KEYFRAMES);
        Self {
            poses: keyframes.iter().map(|&k| track.key_poses[k]).collect(),
            surfels: keyframes.iter().map(|&k| &track.observations[k].surfels).collect(),
            keyframes,
        }
    }
}

/// A possible motion from the first map to the second.
struct Proposal {
    motion: Pose,
    /// Number of cells with landmarks that follow it.
    cells: usize,
    /// Agreement of both states' surfels after it.
    overlap: Overlap,
}

/// Motions that landmarks follow, those with the most landmarks first.
fn proposed_motions(
    sides: &[TrackSide<'_>; 2],
    pairs: &[[usize; 2]],
    matches: &[Vec<[u32; 2]>],
    depth_m: f64,
    seed: u64,
    stop: &Stop,
) -> Result<Vec<Proposal>, Stopped> {
    let mut left: Vec<LandmarkPair> = Vec::new();
    for (&[i, j], matched) in pairs.iter().zip(matches) {
        let cameras = [&sides[0].poses[i], &sides[1].poses[j]];
        let frames = [sides[0].surfels[i], sides[1].surfels[j]];
        left.extend(matched.iter().map(|m| LandmarkPair::new(cameras, frames, *m)));
    }
    let mut motions = Vec::new();
    for attempt in 0..MOTIONS {
        stop.check()?;
        let mut rng = stage_rng(seed, "track/states", attempt as u64);
        let Some((motion, _)) = landmark_motion(&left, &mut rng) else { break };
        let cells: BTreeSet<[i64; 3]> = left
            .iter()
            .filter(|p| p.follows(&motion))
            .map(|p| p.cell_of_space(CELL_SHARE * depth_m))
            .collect();
        left.retain(|p| !p.is_near(&motion));
        motions.push(Proposal {
            motion,
            cells: cells.len(),
            overlap: overlap_after_motion(sides, pairs, &motion),
        });
    }
    Ok(motions)
}

/// Agreement of both states' surfels after a motion.
fn overlap_after_motion(sides: &[TrackSide<'_>; 2], pairs: &[[usize; 2]], motion: &Pose) -> Overlap {
    let overlaps = pairs.par_iter().map(|&[i, j]| {
        let moved = motion * sides[0].poses[i];
        let a = sides[0].surfels[i];
        let b = sides[1].surfels[j];
        let near = view_distance_rad(&moved, &sides[1].poses[j], mean_depth_m(a)) < REACH_RAD;
        if near {
            overlap_both_ways([a, b], &(sides[1].poses[j].inverse() * moved))
        } else {
            Overlap::default()
        }
    });
    overlaps.collect::<Vec<Overlap>>().into_iter().fold(Overlap::default(), Overlap::added_to)
}

/// Whether two motions of the first map move what its camera sees to about the same place.
fn is_same(a: &Pose, b: &Pose, camera: &Pose, depth_m: f64) -> bool {
    let seen = camera * nalgebra::Point3::from(Vector3::z() * depth_m);
    (a * seen - b * seen).norm() < SAME_SHARE * depth_m && (a.rotation.angle_to(&b.rotation)) < SAME_SHARE
}

/// The motion refined by surfaces and landmarks, if held-out ones then agree better.
fn refined_motion(
    sides: &[TrackSide<'_>; 2],
    pairs: &[[usize; 2]],
    matches: &[Vec<[u32; 2]>],
    motion: &Pose,
    stop: &Stop,
) -> Result<Option<Pose>, Stopped> {
    let back = motion.inverse();
    let behind = sides[0].poses.len();
    let moved: Vec<Pose> = sides[1].poses.iter().map(|p| back * p).collect();
    let owned: [Vec<Surfels>; 2] = sides.each_ref().map(|s| s.surfels.iter().map(|s| (*s).clone()).collect());
    let mut all = Matches::new();
    for (&[i, j], matched) in pairs.iter().zip(matches) {
        all.insert([behind + j, i], matched.iter().map(|[a, b]| [*b, *a]).collect());
        all.insert([i, behind + j], matched.clone());
    }
    let poses = [&sides[0].poses[..], &moved];
    let surfels = owned.each_ref().map(Vec::as_slice);
    let found = corrected_world(poses, surfels, all, &PoseNoise::EXPECTED, stop)?;
    Ok(found.map(|(world, _)| (world.corrected_from_reported * back).inverse()))
}
