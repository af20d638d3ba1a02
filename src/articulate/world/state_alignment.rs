//! Decides whether both states were recorded in one world frame, and finds the motion between their frames if
//! not. See docs/method.md 5.
//!
//! Some of the object and all of its surroundings should stand still. If one motion explains all such surface
//! as well, the frames drifted apart or the object was moved as a whole: the motion of the surroundings, or
//! without them of the largest part, is then the motion of the world.

use rand_core::Rng;

use crate::{
    observations::LiftedMatch,
    propose::ransac::{CHANCE, CellCounter, Gate, cell_side_m, common_motions},
    world::standing::StandingShares,
};
use geometry::Pose;

/// Least number of cells of matches for a motion to count.
///
/// derived: three fix a motion, beside the cells of wrong matches by chance
const LEAST_CELLS: f64 = CHANCE + 3.0;
/// The motion of the world must have this many times the supporting cells of the next one.
///
/// tuned: shared/bags
const CLEAR: f64 = 2.0;
/// The world did not move if at least this share of the object's surface stands still.
///
/// tuned: random objects (eval/random_objects.md)
const STANDING: f64 = 0.25;
/// Number of motions looked for.
const MOTIONS: usize = 4;

/// What shows that the world frames differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlignedBy {
    /// The surroundings of the object.
    Surroundings,
    /// The part of the object with the most matches.
    LargestPart,
}

/// A correction of state 1's world frame.
#[derive(Clone, Debug)]
pub struct StateAlignment {
    /// Motion of static surface from state 0's frame to state 1's.
    pub state1_from_state0: Pose,
    /// What shows it.
    pub by: AlignedBy,
    /// Number of supporting cells of matches.
    pub cells: f64,
}

/// Why the states cannot be aligned.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum AlignmentError {
    /// Two motions could be the world's.
    #[error(
        "nothing stands still between the two states, and what should is not known: {first:.0} \
         cells of matches follow one motion and {second:.0} another; record both states in one world frame, \
         or with textured surroundings in view"
    )]
    Ambiguous {
        /// Support of the strongest motion, cells.
        first: f64,
        /// Support of the second, cells.
        second: f64,
    },
}

/// The motion between the world frames of both states; `None` if they are one, or too few matches show it.
/// `surroundings` gives matches beside the object, used if those on the object do not stand still. `standing`
/// gives the shares of the surface that a motion leaves in place: a plain static part has no matches.
/// `extent_m` is the longest side of the object, meters.
///
/// # Errors
/// [`AlignmentError`] where two motions could be the world's.
pub fn align_states(
    object: &[LiftedMatch],
    surroundings: impl FnOnce() -> Vec<LiftedMatch>,
    standing: impl Fn(&Pose) -> StandingShares,
    extent_m: f64,
    rng: &mut impl Rng,
) -> Result<Option<StateAlignment>, AlignmentError> {
    let on_object = Support::new(object, extent_m);
    let motions = common_motions(object, MOTIONS, extent_m, rng);
    let still = Pose::identity();
    // A motion with matches that stand still is no motion.
    let mut moving = motions.clone();
    moving.retain(|m| on_object.of_its_own(m, &[still]) > 0.5 * on_object.of_its_own(m, &[]));
    // The cases of docs/method.md 5. 1. No match moved, or enough stand still.
    if moving.is_empty() || on_object.of_its_own(&still, &moving) >= LEAST_CELLS {
        return Ok(None);
    }
    // 2. The surroundings of the object; they are matched only here, as matching takes long.
    let around = surroundings();
    let found = common_motions(&around, MOTIONS, extent_m, rng);
    if let Some((motion, cells)) = Support::new(&around, extent_m).clear(&found)? {
        let still = on_object.of_its_own(&motion, &[]) >= LEAST_CELLS;
        if still {
            let drifted = on_object.of_its_own(&motion, &[Pose::identity()]) >= LEAST_CELLS;
            let alignment = StateAlignment { state1_from_state0: motion, by: AlignedBy::Surroundings, cells };
            return Ok(drifted.then_some(alignment));
        }
        // The object was moved as a whole relative to its surroundings.
    }
    // 3. The object's strongest motion. A plain static part has no matches: 4. where two motions compete, or
    // more of all that is seen stands still than follows the motion, the surface that stands still decides.
    let clear = match on_object.clear(&motions) {
        Err(_) if is_standing(&motions, None, &standing) => None,
        Ok(Some((motion, _))) if is_standing(&motions, Some(&motion), &standing) => None,
        clear => clear?,
    };
    Ok(clear.map(|(motion, cells)| StateAlignment {
        state1_from_state0: motion,
        by: AlignedBy::LargestPart,
        cells,
    }))
}

/// Whether enough of the object's surface stands still and no motion explains clearly more. More of all
/// surface, of the object and around it, must stand still than follows the `strongest` motion.
fn is_standing(
    motions: &[Pose],
    strongest: Option<&Pose>,
    standing: impl Fn(&Pose) -> StandingShares,
) -> bool {
    let still = standing(&Pose::identity());
    still.object >= STANDING
        && motions.iter().all(|motion| {
            let moved = standing(motion);
            moved.object <= CLEAR * still.object
                && (strongest != Some(motion) || still.everything > moved.everything)
        })
}

/// Counts the cells of matches that support motions.
struct Support<'a> {
    matches: &'a [LiftedMatch],
    gate: Gate,
    cell_m: f64,
}

impl<'a> Support<'a> {
    fn new(matches: &'a [LiftedMatch], extent_m: f64) -> Self {
        Self { matches, gate: Gate::new(extent_m), cell_m: cell_side_m(extent_m) }
    }

    /// Number of cells of the matches that follow a motion and none of the others.
    fn of_its_own(&self, motion: &Pose, others: &[Pose]) -> f64 {
        let mut own = self.matches.to_vec();
        own.retain(|m| self.gate.supports(m, motion) && !others.iter().any(|o| self.gate.supports(m, o)));
        CellCounter::new(&own, self.gate, self.cell_m).support(&own, motion)
    }

    /// The motion with the most support and its cells; `None` where no motion has enough.
    fn clear(&self, motions: &[Pose]) -> Result<Option<(Pose, f64)>, AlignmentError> {
        let mut scored: Vec<(f64, usize)> =
            motions.iter().enumerate().map(|(i, m)| (self.of_its_own(m, &[]), i)).collect();
        scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let Some(&(first, i)) = scored.first().filter(|s| s.0 >= LEAST_CELLS) else { return Ok(None) };
        let second = scored.get(1).map_or(0.0, |s| s.0);
        if first < CLEAR * second {
            return Err(AlignmentError::Ambiguous { first, second });
        }
        Ok(Some((motions[i], first)))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use numeric::random::stage_rng;

    fn uniform(rng: &mut impl Rng) -> f64 {
        (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Matches of `counts` points in boxes side by side, each box with its motion, and some wrong ones.
    fn matches(counts: &[(usize, Pose)], seed: u64) -> Vec<LiftedMatch> {
        let mut rng = stage_rng(seed, "matches", 0);
        let mut all = Vec::new();
        let mut vector = |s: f64, x: f64| {
            Vector3::new(x, 0.0, 0.0) + Vector3::from_fn(|_, _| s * (uniform(&mut rng) - 0.5))
        };
        for (k, (count, motion)) in counts.iter().enumerate() {
            for i in 0..*count {
                let point0 = Point3::from(vector(0.3, 0.4 * k as f64));
                let point1 = if i % 5 == 0 {
                    Point3::from(vector(1.2, 0.3))
                } else {
                    motion * point0 + vector(0.003, 0.0)
                };
                all.push(LiftedMatch {
                    point0,
                    point1,
                    sigma_m: 0.002,
                    frames: [0, 0],
                    pixels: [[0.0; 2]; 2],
                });
            }
        }
        all
    }

    fn drift() -> Pose {
        Pose::new(Vector3::new(0.03, -0.03, 0.026), Vector3::new(0.05, 0.06, -0.04))
    }

    fn door() -> Pose {
        Pose::new(Vector3::new(0.1, 0.2, 0.0), Vector3::new(0.0, 0.0, 0.7))
    }

    fn aligned(
        object: &[(usize, Pose)],
        around: &[(usize, Pose)],
    ) -> Result<Option<StateAlignment>, AlignmentError> {
        align_states(
            &matches(object, 1),
            || matches(around, 2),
            |_| StandingShares::default(),
            0.8,
            &mut stage_rng(0, "align", 0),
        )
    }

    fn check_drift(found: Option<StateAlignment>, by: AlignedBy) {
        let found = found.unwrap();
        assert_eq!(found.by, by);
        let apart = found.state1_from_state0.inverse() * drift();
        assert!(apart.rotation.angle() < 0.01, "{}", apart.rotation.angle());
        assert!((apart * Point3::new(0.2, 0.0, 0.0) - Point3::new(0.2, 0.0, 0.0)).norm() < 0.002);
    }

    #[test]
    fn one_world_is_left_alone_however_large_the_moving_part() {
        assert!(aligned(&[(100, Pose::identity()), (400, door())], &[]).unwrap().is_none());
        assert!(aligned(&[], &[]).unwrap().is_none());
    }

    #[test]
    fn a_drift_is_found_by_the_surroundings_even_where_a_moving_part_is_larger() {
        let found = aligned(&[(150, drift()), (400, drift() * door())], &[(200, drift())]).unwrap();
        check_drift(found, AlignedBy::Surroundings);
    }

    #[test]
    fn without_surroundings_the_largest_part_decides_or_nothing_does() {
        check_drift(
            aligned(&[(400, drift()), (100, drift() * door())], &[]).unwrap(),
            AlignedBy::LargestPart,
        );
        let unclear = aligned(&[(300, drift()), (280, drift() * door())], &[]);
        assert!(matches!(unclear, Err(AlignmentError::Ambiguous { .. })), "{unclear:?}");
    }

    #[test]
    fn where_matches_cannot_tell_surfaces_that_stand_still_do() {
        let object = matches(&[(300, drift()), (280, drift() * door())], 1);
        let still = |share: f64| {
            move |m: &Pose| {
                let object = if *m == Pose::identity() { share } else { 0.6 };
                StandingShares { object, everything: object }
            }
        };
        let aligned =
            |share: f64| align_states(&object, Vec::new, still(share), 0.8, &mut stage_rng(0, "align", 0));
        assert!(aligned(0.5).unwrap().is_none());
        assert!(matches!(aligned(0.2), Err(AlignmentError::Ambiguous { .. })), "little stands still");
        assert!(
            matches!(aligned(0.28), Err(AlignmentError::Ambiguous { .. })),
            "another motion explains clearly more"
        );
    }

    #[test]
    fn a_textured_part_does_not_move_a_plain_object_and_its_room() {
        let object = matches(&[(300, door())], 1);
        let aligned = |object_share: f64, room_share: f64| {
            let standing = |m: &Pose| {
                let is_still = *m == Pose::identity();
                StandingShares {
                    object: if is_still { object_share } else { 0.5 },
                    everything: if is_still { room_share } else { 0.4 },
                }
            };
            let rng = &mut stage_rng(0, "align", 0);
            align_states(&object, Vec::new, standing, 0.8, rng).unwrap().is_none()
        };
        assert!(aligned(0.4, 0.8));
        assert!(!aligned(0.1, 0.8), "the object was moved as a whole");
        assert!(!aligned(0.4, 0.3), "the worlds differ");
    }

    #[test]
    fn an_object_moved_as_a_whole_is_followed() {
        let found = aligned(&[(400, drift()), (100, drift() * door())], &[(300, Pose::identity())]).unwrap();
        check_drift(found, AlignedBy::LargestPart);
    }
}
