//! Loop closure: pairs of keyframes with surface in common that tracking did not compare; also joins pieces
//! of the track.

use rayon::prelude::*;

use super::{
    keyframes::{KeyframeEdge, Keyframes, view_distance_rad},
    locate::{Guess, Known, Located, locate_frame},
};
use crate::poses::pose_noise::PoseNoise;
use common::stop::{Stop, Stopped};
use geometry::Pose;
use numeric::random::stage_rng;

/// Most keyframes compared with each one, nearest views first.
/// tuned: shared/bags; more changed no trajectory by a tenth of its error
const NEIGHBORS: usize = 6;
/// Largest difference of views with common features, radians.
/// chosen: as for keyframes (Mikolajczyk and Schmid 2005)
const REACH_RAD: f64 = 0.5;
/// Adds pairs of keyframes of one piece with surface in common; returns their number.
pub(super) fn close_loops(keyframes: &mut Keyframes, seed: u64, stop: &Stop) -> Result<usize, Stopped> {
    let count = keyframes.all.len();
    let mut pairs: Vec<[usize; 2]> = Vec::new();
    for j in 0..count {
        let own = &keyframes.all[j];
        let near = keyframes.nearest(own.piece, &own.pose).into_iter().filter(|&i| {
            let other = &keyframes.all[i];
            let depth_m = own.depth_m.min(other.depth_m);
            i != j && view_distance_rad(&own.pose, &other.pose, depth_m) < REACH_RAD
        });
        pairs.extend(near.take(NEIGHBORS).map(|i| [i.min(j), i.max(j)]));
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs.retain(|pair| !keyframes.has_edge(*pair));
    let found: Vec<Option<KeyframeEdge>> = pairs
        .par_iter()
        .map(|&[i, j]| {
            stop.check()?;
            let pose = keyframes.all[i].pose.inverse() * keyframes.all[j].pose;
            let noise = PoseNoise::EXPECTED.scaled_by(CLOSE);
            Ok(edge_between(keyframes, [i, j], Some(Guess { pose, noise }), seed))
        })
        .collect::<Result<_, Stopped>>()?;
    let before = keyframes.edges.len();
    keyframes.edges.extend(found.into_iter().flatten());
    Ok(keyframes.edges.len() - before)
}

/// Expected drift between two keyframes, as a factor on the error of unrefined poses; landmarks may correct
/// more.
/// chosen: landmarks are a few times less accurate than surfaces
const CLOSE: f64 = 4.0;

/// Joins pieces with surface in common, largest first.
pub(super) fn join_pieces(keyframes: &mut Keyframes, seed: u64, stop: &Stop) -> Result<(), Stopped> {
    let mut sizes: Vec<(usize, usize)> = Vec::new();
    for k in &keyframes.all {
        match sizes.iter_mut().find(|(_, piece)| *piece == k.piece) {
            Some((size, _)) => *size += 1,
            None => sizes.push((1, k.piece)),
        }
    }
    sizes.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut pieces: Vec<usize> = sizes.into_iter().map(|(_, piece)| piece).collect();
    let mut at = 0;
    while at < pieces.len() {
        // A joined piece may reach others that the largest did not.
        let mut joined = None;
        for k in at + 1..pieces.len() {
            if join_two_pieces(keyframes, [pieces[at], pieces[k]], seed, stop)? {
                joined = Some(k);
                break;
            }
        }
        match joined {
            Some(k) => _ = pieces.remove(k),
            None => at += 1,
        }
    }
    Ok(())
}

/// Joins the second piece to the first, if a keyframe of it shows surface of the first.
fn join_two_pieces(
    keyframes: &mut Keyframes,
    pieces: [usize; 2],
    seed: u64,
    stop: &Stop,
) -> Result<bool, Stopped> {
    let [into, from] = pieces;
    let [of_into, of_from] = pieces.map(|piece| keyframes.of_piece(piece));
    for &j in of_from.iter().step_by(of_from.len().div_ceil(TRIED)) {
        // Keyframes near in time are more likely to see the same surface.
        let mut candidates = of_into.clone();
        candidates.sort_by_key(|&i| (keyframes.all[i].view.abs_diff(keyframes.all[j].view), i));
        candidates.truncate(LOOKED_AT);
        let alike = keyframes.most_alike(&candidates, &keyframes.all[j].observation, JOINED_BY, stop)?;
        let (numbers, known): (Vec<usize>, Vec<Known<'_>>) = alike.into_iter().unzip();
        let mut rng = stage_rng(seed, "track/join", (into * keyframes.all.len() + j) as u64);
        if let Ok(located) = locate_frame(&known, &keyframes.all[j].observation, None, &mut rng) {
            let into_from_piece = located.pose * keyframes.all[j].pose.inverse();
            keyframes.merge_piece(from, into, &into_from_piece);
            keyframes.add_edges(&numbers, j, &located, true);
            return Ok(true);
        }
    }
    Ok(false)
}

/// Most keyframes of a piece tried in joining it ...
/// derived: both ends and two between
const TRIED: usize = 4;
/// ... most keyframes of the other piece compared with each by appearance ...
/// derived: a second of looking at pairs
const LOOKED_AT: usize = 100;
/// ... and most of them used to place it.
/// derived: as in tracking
const JOINED_BY: usize = 4;

/// The edge between two keyframes; `None` if they share too little surface or contradict each other.
fn edge_between(
    keyframes: &Keyframes,
    [i, j]: [usize; 2],
    guess: Option<Guess>,
    seed: u64,
) -> Option<KeyframeEdge> {
    let mut rng = stage_rng(seed, "track/close", (i * keyframes.all.len() + j) as u64);
    let known = Known { observation: &keyframes.all[i].observation, pose: Pose::identity(), matches: None };
    let new = &keyframes.all[j].observation;
    let Located { pose, by_known, mut matches, .. } = locate_frame(&[known], new, guess, &mut rng).ok()?;
    Some(KeyframeEdge {
        frames: [i, j],
        first_from_second: pose,
        information: by_known[0],
        matches: matches.pop()?,
        closure: true,
    })
}
