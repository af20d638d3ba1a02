//! One joint of one or several openings of a mechanism.

use geometry::AxisMotion;
use nalgebra::Vector3;

use crate::track::{
    opening::{DECISIVE, Opening, OpeningJoint},
    repeats::{SharedAxis, shared_axis},
    trace::PointTrack,
};
use common::note::{Note, NoteCode};

/// Odds below which a type is not named.
/// chosen: not worth more than a bare mention, by Kass and Raftery (1995), section 3.2.
const NAMED_ODDS: f64 = 3.0;
/// Deviation between openings that is noted, in the deviations of the joint.
/// chosen: three standard deviations.
const APART: f64 = 3.0;

/// Why a track shows no joint.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TraceFault {
    /// It has too few samples.
    #[error("`{name}` has {count} samples; a joint needs {least} or more")]
    Short {
        /// Name of the track.
        name: String,
        /// Its samples.
        count: usize,
        /// Fewest samples.
        least: usize,
    },
    /// There is no track.
    #[error("there is no track")]
    None,
}

/// What tracks say of the type of their joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TracedType {
    /// A hinge or a slide.
    Known(AxisMotion),
    /// It moved, and both types explain it.
    Undecided,
    /// Nothing moved.
    Fixed,
}

impl TracedType {
    /// Whether it is known to turn.
    #[must_use]
    pub fn is_turning(&self) -> bool {
        matches!(self, Self::Known(motion) if motion.is_turning())
    }

    /// Name in files and reports.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Known(motion) => motion.name(),
            Self::Undecided => "undecided",
            Self::Fixed => "fixed",
        }
    }
}

/// The joint behind one or several tracks.
#[derive(Clone, Debug)]
pub struct TracedJoint {
    /// Its type.
    pub kind: TracedType,
    /// Logarithm of the odds of a revolute joint against a prismatic one, from all tracks.
    pub log_odds: f64,
    /// Its axis; `None` where the type is not known.
    pub axis: Option<SharedAxis>,
    /// Least and largest position, radians or meters: the joint reaches at least so far.
    pub limits: [f64; 2],
    /// Their standard deviations.
    pub limit_deviations: [f64; 2],
    /// Each track's name, its own odds and its own joint, `None` where the type is not known or it stood
    /// still.
    pub openings: Vec<(String, f64, Option<OpeningJoint>)>,
    /// Doubts.
    pub notes: Vec<Note>,
}

/// The joint behind tracks of one mechanism, each with a point of its own on the part.
///
/// # Errors
/// [`TraceFault`] where a track has too few samples.
pub fn joint_of_traces(traces: &[PointTrack]) -> Result<TracedJoint, TraceFault> {
    if traces.is_empty() {
        return Err(TraceFault::None);
    }
    let all: Vec<Opening> = traces.iter().map(Opening::of_trace).collect::<Result<_, _>>()?;
    let log_odds: f64 = all.iter().map(|o| o.log_odds).sum();
    let mut notes: Vec<Note> = all.iter().flat_map(|o| o.notes.clone()).collect();
    let kind = if !all.iter().any(Opening::moved) {
        TracedType::Fixed
    } else if log_odds.abs() < NAMED_ODDS.ln() {
        TracedType::Undecided
    } else if log_odds > 0.0 {
        TracedType::Known(AxisMotion::Revolute)
    } else {
        TracedType::Known(AxisMotion::Prismatic)
    };
    notes.extend(doubt_of_type(kind, log_odds, &all));
    let openings: Vec<(String, f64, Option<OpeningJoint>)> = all
        .iter()
        .map(|o| {
            let joint = match kind {
                TracedType::Known(AxisMotion::Revolute) => o.hinge(),
                TracedType::Known(_) => o.slide(),
                _ => None,
            };
            (o.whole.name.clone(), o.log_odds, joint)
        })
        .collect();
    let moved: Vec<OpeningJoint> = openings.iter().filter_map(|(_, _, joint)| joint.clone()).collect();
    let axis = shared_axis(&moved, kind.is_turning());
    notes.extend(axis.iter().filter_map(|a| doubt_of_frames(a, moved.len())));
    let [lower, upper] = limits(&moved, axis.as_ref());
    Ok(TracedJoint {
        kind,
        log_odds,
        axis,
        limits: [lower.0, upper.0],
        limit_deviations: [lower.1, upper.1],
        openings,
        notes,
    })
}

/// Least and largest position of all openings, each with its deviation.
fn limits(openings: &[OpeningJoint], axis: Option<&SharedAxis>) -> [(f64, f64); 2] {
    let shared = axis.map_or_else(Vector3::zeros, |a| a.axis);
    let all: Vec<(f64, f64)> = openings
        .iter()
        .flat_map(|o| {
            let sign = o.sign_along(&shared);
            o.positions.iter().map(move |q| sign * q).zip(o.deviations.iter().copied())
        })
        .collect();
    let least = all.iter().copied().fold((0.0, 0.0), |m, q| if q.0 < m.0 { q } else { m });
    let largest = all.iter().copied().fold((0.0, 0.0), |m, q| if q.0 > m.0 { q } else { m });
    [least, largest]
}

/// Why no type is named, or why the named one may be wrong.
fn doubt_of_type(kind: TracedType, log_odds: f64, all: &[Opening]) -> Option<Note> {
    let (likelier, times) =
        if log_odds > 0.0 { ("revolute", log_odds.exp()) } else { ("prismatic", (-log_odds).exp()) };
    let extent_mm = 1e3 * all.iter().map(Opening::extent_m).fold(0.0, f64::max);
    match kind {
        TracedType::Fixed => Some(Note::new(
            NoteCode::JointAtRest,
            format!("nothing moved: the samples lie {extent_mm:.1} mm about their middle, without a way"),
        )),
        TracedType::Undecided => Some(Note::new(
            NoteCode::JointTypeUndecided,
            format!(
                "a line and a circle explain the tracks about equally well ({likelier} is {times:.1} times \
                 as likely): open the part farther, record rotations, or give more openings"
            ),
        )),
        TracedType::Known(_) if log_odds.abs() < DECISIVE => Some(Note::new(
            NoteCode::JointTypeUndecided,
            format!("{likelier} is only {times:.0} times as likely as the other type"),
        )),
        TracedType::Known(_) => None,
    }
}

/// A note where openings differ by more than their own deviations.
fn doubt_of_frames(axis: &SharedAxis, count: usize) -> Option<Note> {
    // The deviations of the mean contain what differs; an opening's own are without it.
    let root = (count as f64).sqrt();
    let is_apart = axis.between_m > 0.0 && APART * axis.between_m > root * axis.origin_std_m();
    let turned = axis.between_rad > 0.0 && APART * axis.between_rad > root * axis.axis_std_rad();
    (count > 1 && (is_apart || turned)).then(|| {
        Note::new(
            NoteCode::JointContradicted,
            format!(
                "the openings' axes differ by {:.1} deg and {:.0} mm more than each of them says: were \
                 they recorded in one frame, and was the mechanism in its place?",
                axis.between_rad.to_degrees(),
                1e3 * axis.between_m
            ),
        )
    })
}
