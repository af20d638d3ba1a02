//! A camera followed from frame to frame by keyframes. See docs/method.md 2.14.

use nalgebra::Vector3;

use super::{
    keyframes::{Keyframe, Keyframes, view_distance_rad},
    locate::{Guess, Known, Located, locate_frame},
    lost::Lost,
    observation::Observation,
};
use crate::poses::pose_noise::PoseNoise;
use common::stop::Stop;
use geometry::{Pose, shift_and_turn};
use numeric::random::stage_rng;

/// Keyframes for the placement of a frame: the last one, and those seen from nearest by.
/// tuned: shared/bags; more cost time and change no pose by its deviation
const NEIGHBORS: usize = 4;
/// Difference from all keyframes of a new one, radians.
/// chosen: about a quarter of the 0.5 rad of matching features (Mikolajczyk and Schmid 2005)
const KEY_DISTANCE_RAD: f64 = 0.12;
/// ... or the share of its surface shown by the keyframes, at most.
/// chosen: most of it, with a margin: half is the least for a known surface
const KEY_SHARE: f64 = 0.65;
/// Most keyframes compared with a lost frame.
/// derived: a comparison of looks takes 10 ms; a lost frame takes no more than the time of two
const LOOKED_AT: usize = 16;
/// A hand's motion goes on as it was, but for this share and the jitter of a hand.
/// chosen: a hand may stop or turn back
const UNSTEADY: f64 = 0.5;
const JITTER: PoseNoise = PoseNoise { translation_m: 0.01, rotation_rad: 0.02 };
/// Motions from frames further apart than this say nothing of the next one, seconds.
/// chosen: hands change their motion within this time
const STEADY_S: f64 = 0.5;

/// Where a view was placed.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub keyframe: usize,
    pub keyframe_from_camera: Pose,
}

/// A view placed by keyframes.
pub(super) struct Found {
    pub piece: usize,
    /// The keyframes.
    pub known: Vec<usize>,
    pub located: Located,
}

/// Follows the camera of one state.
pub struct Tracker {
    seed: u64,
    pub(super) keyframes: Keyframes,
    /// Of every view, in the order of time.
    pub(super) views: Vec<Option<Place>>,
    pub(super) stamps_nanos: Vec<i64>,
    pieces: usize,
    /// Of the last placed view: its number, stamp and piece.
    pub(super) last: Option<Last>,
    /// Standard deviations of the places of keyframes against those before, meters.
    pub(super) least_known_m: Vec<f64>,
}

#[derive(Clone, Copy)]
pub(super) struct Last {
    stamp_nanos: i64,
    piece: usize,
    pub keyframe: usize,
    pub pose: Pose,
    /// Motion to it from the one before, in its own frame, a second.
    velocity: Option<nalgebra::Vector6<f64>>,
}

impl Tracker {
    /// Before the first frame. Draws come from a stream of the seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self {
            seed,
            keyframes: Keyframes::default(),
            views: Vec::new(),
            stamps_nanos: Vec::new(),
            pieces: 0,
            last: None,
            least_known_m: Vec::new(),
        }
    }

    pub(super) fn seed(&self) -> u64 {
        self.seed
    }

    /// The piece with the most views.
    pub(super) fn largest_piece(&self) -> usize {
        let mut counts = vec![0usize; self.pieces.max(1)];
        for place in self.views.iter().flatten() {
            counts[self.keyframes.all[place.keyframe].piece] += 1;
        }
        // Of equals the first: `max_by_key` alone would give the last.
        (0..counts.len()).max_by_key(|&p| (counts[p], usize::MAX - p)).unwrap_or(0)
    }

    /// Takes the next frame, in the order of time; says whether it could be placed against an earlier one.
    pub fn add(&mut self, observation: Observation) -> Result<(), Lost> {
        let view = self.views.len();
        self.stamps_nanos.push(observation.stamp_nanos);
        match self.place_of_frame(view, &observation) {
            Ok(found) => {
                let place = self.take_placed(view, observation, &found, true);
                self.views.push(Some(place));
                Ok(())
            }
            Err(why) => {
                // It may be the first frame of a piece; later frames may join it.
                let first = self.views.is_empty();
                let place = self.begin_piece(view, observation);
                self.views.push(Some(place));
                if first { Ok(()) } else { Err(why) }
            }
        }
    }

    /// Place of a frame, by the present keyframes; `view` numbers its draws.
    pub(super) fn place_of_frame(&self, view: usize, new: &Observation) -> Result<Found, Lost> {
        let placed = self.place_by_following(view, new).or_else(|why| self.find_again(view, new).ok_or(why));
        placed.map_err(|why| new.reason_unplaceable().unwrap_or(why))
    }

    /// By the keyframes about where the camera should be.
    fn place_by_following(&self, view: usize, new: &Observation) -> Result<Found, Lost> {
        let last = self.last.ok_or(Lost::NoGuess)?;
        let guess = last.extrapolated_guess(new.stamp_nanos);
        let mut near = vec![last.keyframe];
        let nearest = self.keyframes.nearest(last.piece, &guess.pose);
        near.extend(nearest.into_iter().filter(|k| *k != last.keyframe).take(NEIGHBORS - 1));
        let located = locate_frame(
            &self.known_frames(&near),
            new,
            Some(guess),
            &mut stage_rng(self.seed, "track", view as u64),
        )?;
        Ok(Found { piece: last.piece, known: near, located })
    }

    /// By looks, wherever the camera is.
    fn find_again(&self, view: usize, new: &Observation) -> Option<Found> {
        let count = self.keyframes.all.len();
        // The latest ones, and some of all before.
        let latest = LOOKED_AT / 2;
        let before = count.saturating_sub(latest);
        let step = before.div_ceil(LOOKED_AT - latest).max(1);
        let looked_at: Vec<usize> = (0..before).step_by(step).chain(before..count).collect();
        let alike = self.keyframes.most_alike(&looked_at, new, NEIGHBORS, &Stop::never()).ok()?;
        let (numbers, known): (Vec<usize>, Vec<Known<'_>>) = alike.into_iter().unzip();
        let mut rng = stage_rng(self.seed, "track/again", view as u64);
        let located = locate_frame(&known, new, None, &mut rng).ok()?;
        let piece = self.keyframes.all[numbers[0]].piece;
        // Similar ones need not be the nearest.
        let near: Vec<usize> =
            self.keyframes.nearest(piece, &located.pose).into_iter().take(NEIGHBORS).collect();
        let guess = Guess { pose: located.pose, noise: PoseNoise::EXPECTED };
        match locate_frame(&self.known_frames(&near), new, Some(guess), &mut rng) {
            Ok(better) if better.least_known_m < located.least_known_m => {
                Some(Found { piece, known: near, located: better })
            }
            _ => Some(Found { piece, known: numbers, located }),
        }
    }

    fn known_frames(&self, keyframes: &[usize]) -> Vec<Known<'_>> {
        keyframes.iter().map(|&k| self.keyframes.all[k].known()).collect()
    }

    /// Takes a view at its place. One with new surface becomes a keyframe, if it `may`.
    pub(super) fn take_placed(&mut self, view: usize, new: Observation, found: &Found, may: bool) -> Place {
        let &Found { piece, ref located, .. } = found;
        let pose = located.pose;
        let stamp_nanos = new.stamp_nanos;
        let nearest = self.keyframes.nearest(piece, &pose)[0];
        let keyframe = &self.keyframes.all[nearest];
        let apart = view_distance_rad(&keyframe.pose, &pose, keyframe.depth_m);
        let share = located.overlaps.iter().map(|o| o.share()).fold(0.0, f64::max);
        let is_key = may && (apart > KEY_DISTANCE_RAD || share < KEY_SHARE);
        let keyframe = if is_key { self.add_keyframe(view, new, found) } else { nearest };
        let keyframe_from_camera = self.keyframes.all[keyframe].pose.inverse() * pose;
        let before = self.last.filter(|l| l.piece == piece);
        let velocity = before.and_then(|l| l.velocity_to(stamp_nanos, &pose));
        self.last = Some(Last { stamp_nanos, piece, keyframe, pose, velocity });
        Place { keyframe, keyframe_from_camera }
    }

    fn add_keyframe(&mut self, view: usize, new: Observation, found: &Found) -> usize {
        let Found { piece, known, located } = found;
        let number = self.keyframes.all.len();
        self.keyframes.all.push(Keyframe::new(view, new, *piece, located.pose));
        self.least_known_m.push(located.least_known_m);
        self.keyframes.add_edges(known, number, located, false);
        number
    }

    /// Takes a view unconnected to those before.
    pub(super) fn begin_piece(&mut self, view: usize, new: Observation) -> Place {
        let piece = self.pieces;
        self.pieces += 1;
        let stamp_nanos = new.stamp_nanos;
        let keyframe = self.keyframes.all.len();
        // The first camera of a piece is its frame.
        self.keyframes.all.push(Keyframe::new(view, new, piece, Pose::identity()));
        self.last = Some(Last { stamp_nanos, piece, keyframe, pose: Pose::identity(), velocity: None });
        Place { keyframe, keyframe_from_camera: Pose::identity() }
    }
}

impl Last {
    /// Where the camera should be at a stamp, if it goes on as it did.
    fn extrapolated_guess(&self, stamp_nanos: i64) -> Guess {
        let seconds = (stamp_nanos - self.stamp_nanos) as f64 * 1e-9;
        let Some(velocity) = self.velocity.filter(|_| seconds <= STEADY_S) else {
            return Guess { pose: self.pose, noise: JITTER };
        };
        let step = velocity * seconds;
        let [shift, turn] = [0, 3].map(|k| Vector3::new(step[k], step[k + 1], step[k + 2]));
        let noise =
            PoseNoise { translation_m: UNSTEADY * shift.norm(), rotation_rad: UNSTEADY * turn.norm() };
        Guess { pose: self.pose * Pose::new(shift, turn), noise: noise.of_difference(&JITTER) }
    }

    fn velocity_to(&self, stamp_nanos: i64, pose: &Pose) -> Option<nalgebra::Vector6<f64>> {
        let seconds = (stamp_nanos - self.stamp_nanos) as f64 * 1e-9;
        (seconds > 0.0 && seconds <= STEADY_S)
            .then(|| shift_and_turn(&(self.pose.inverse() * pose)) / seconds)
    }
}
