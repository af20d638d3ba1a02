//! Camera tracking from frame to frame by keyframes. See docs/method.md 2.14.

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

/// Keyframes used to locate a frame: the last one, and those with the nearest views.
/// tuned: shared/bags; more cost time and changed no pose by its deviation
const NEIGHBORS: usize = 4;
/// Least difference of a new keyframe's view from all others, radians ...
/// chosen: about a quarter of the 0.5 rad over which features match (Mikolajczyk and Schmid 2005)
const KEY_DISTANCE_RAD: f64 = 0.12;
/// ... or largest share of its surface seen by keyframes.
/// chosen: half is needed to locate a frame; this leaves a margin
const KEY_SHARE: f64 = 0.65;
/// Most keyframes compared with a lost frame.
/// derived: a comparison by appearance takes 10 ms; a lost frame should take no longer than two others
const LOOKED_AT: usize = 16;
/// Share of a hand's motion that may change from frame to frame, beside jitter.
/// chosen: a hand may stop or turn back
const UNSTEADY: f64 = 0.5;
const JITTER: PoseNoise = PoseNoise { translation_m: 0.01, rotation_rad: 0.02 };
/// Longest time between frames over which motion is extrapolated, seconds.
/// chosen: a hand changes its motion within this time
const STEADY_S: f64 = 0.5;

/// Pose of a located view.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub keyframe: usize,
    pub keyframe_from_camera: Pose,
}

/// A view located by keyframes.
pub(super) struct Found {
    pub piece: usize,
    /// Indices of these keyframes.
    pub known: Vec<usize>,
    pub located: Located,
}

/// Tracks the camera of one state.
pub struct Tracker {
    seed: u64,
    pub(super) keyframes: Keyframes,
    /// Place of each view, in order of time; `None` if it was lost.
    pub(super) views: Vec<Option<Place>>,
    pub(super) stamps_nanos: Vec<i64>,
    pieces: usize,
    /// The last located view: its index, stamp and piece.
    pub(super) last: Option<Last>,
    /// Standard deviation of each keyframe's position relative to earlier ones, meters.
    pub(super) least_known_m: Vec<f64>,
}

#[derive(Clone, Copy)]
pub(super) struct Last {
    stamp_nanos: i64,
    piece: usize,
    pub keyframe: usize,
    pub pose: Pose,
    /// Camera velocity in its own frame, m/s and rad/s.
    velocity: Option<nalgebra::Vector6<f64>>,
}

impl Tracker {
    /// A tracker without frames that draws random numbers from the seed.
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

    /// Index of the piece with the most views.
    pub(super) fn largest_piece(&self) -> usize {
        let mut counts = vec![0usize; self.pieces.max(1)];
        for place in self.views.iter().flatten() {
            counts[self.keyframes.all[place.keyframe].piece] += 1;
        }
        // The first of equals; `max_by_key` alone would return the last.
        (0..counts.len()).max_by_key(|&p| (counts[p], usize::MAX - p)).unwrap_or(0)
    }

    /// Adds the next frame in order of time.
    ///
    /// # Errors
    /// [`Lost`] if it cannot be located relative to earlier frames.
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
                // It may start a new piece, to be joined by later frames.
                let first = self.views.is_empty();
                let place = self.begin_piece(view, observation);
                self.views.push(Some(place));
                if first { Ok(()) } else { Err(why) }
            }
        }
    }

    /// Locates a frame by the current keyframes; `view` selects its random numbers.
    pub(super) fn place_of_frame(&self, view: usize, new: &Observation) -> Result<Found, Lost> {
        let placed = self.place_by_following(view, new).or_else(|why| self.find_again(view, new).ok_or(why));
        placed.map_err(|why| new.reason_unplaceable().unwrap_or(why))
    }

    /// By the keyframes near the expected pose.
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

    /// By appearance, wherever the camera is.
    fn find_again(&self, view: usize, new: &Observation) -> Option<Found> {
        let count = self.keyframes.all.len();
        // The latest ones, and a sample of the earlier ones.
        let latest = LOOKED_AT / 2;
        let before = count.saturating_sub(latest);
        let step = before.div_ceil(LOOKED_AT - latest).max(1);
        let looked_at: Vec<usize> = (0..before).step_by(step).chain(before..count).collect();
        let alike = self.keyframes.most_alike(&looked_at, new, NEIGHBORS, &Stop::never()).ok()?;
        let (numbers, known): (Vec<usize>, Vec<Known<'_>>) = alike.into_iter().unzip();
        let mut rng = stage_rng(self.seed, "track/again", view as u64);
        let located = locate_frame(&known, new, None, &mut rng).ok()?;
        let piece = self.keyframes.all[numbers[0]].piece;
        // Similar keyframes need not be nearest.
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

    /// Adds a located view. If `may` is set and it shows new surface, it becomes a keyframe.
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

    /// Starts a new piece with a view.
    pub(super) fn begin_piece(&mut self, view: usize, new: Observation) -> Place {
        let piece = self.pieces;
        self.pieces += 1;
        let stamp_nanos = new.stamp_nanos;
        let keyframe = self.keyframes.all.len();
        // The first camera of a piece defines its frame.
        self.keyframes.all.push(Keyframe::new(view, new, piece, Pose::identity()));
        self.last = Some(Last { stamp_nanos, piece, keyframe, pose: Pose::identity(), velocity: None });
        Place { keyframe, keyframe_from_camera: Pose::identity() }
    }
}

impl Last {
    /// The expected pose at a stamp if the motion continues.
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
