//! Limits of a joint in the report, and where they come from.

use serde::Serialize;

use super::number::round_significant;
use model::{ArticulatedModel, LimitSource};

/// Significant digits of swept and closed positions.
const DIGITS: usize = 10;

/// An interval of joint positions.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LimitReport {
    /// Lowest position, radians or meters.
    pub lower: f64,
    /// Highest position.
    pub upper: f64,
    /// Largest effort, N m or N.
    pub effort: f64,
    /// Largest speed, rad/s or m/s.
    pub velocity: f64,
    /// What both bounds are based on: `seated`, the interval of the states with a margin, at the closed end
    /// up to the seat; `observed`, the interval of the states, which the joint reaches at least; or `swept`,
    /// as far as the collision solids let it go.
    pub source: String,
    /// Inner bound: lowest and highest observed position.
    pub observed: [f64; 2],
    /// Index of the states in which these two were observed.
    pub observed_in: [usize; 2],
    /// Outer bound: the collision-free interval; none if it was not computed.
    pub swept: Option<[f64; 2]>,
    /// Where a face of the part meets its seat; none if neither end shows it.
    pub closed: Option<SeatReport>,
}

/// The closed end of a joint.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SeatReport {
    /// Position, radians or meters.
    pub position: f64,
    /// Root mean square deviation of the surface cells in contact there, radians or meters.
    pub std: f64,
    /// Share of the part's leading surface in contact.
    pub contact_share: f64,
}

impl LimitReport {
    /// The limits of a joint of a model.
    pub fn of_joint(model: &ArticulatedModel, joint: usize) -> Self {
        let l = &model.joints[joint].limit;
        Self {
            lower: round_significant(l.lower, 12),
            upper: round_significant(l.upper, 12),
            effort: l.effort,
            velocity: l.velocity,
            source: match l.source {
                LimitSource::Seated => "seated".into(),
                LimitSource::Observed => "observed".into(),
                LimitSource::Swept => "swept".into(),
            },
            observed: model.observed_interval(joint).map(|q| round_significant(q, 12)),
            observed_in: observed_in(model, joint),
            swept: l.swept.map(|s| s.map(|q| round_significant(q, DIGITS))),
            closed: l.closed.map(|s| SeatReport {
                position: round_significant(s.position, DIGITS),
                std: round_significant(s.std, 4),
                contact_share: round_significant(s.contact_share, 4),
            }),
        }
    }
}

/// Indices of the first states at the lowest and at the highest position.
fn observed_in(model: &ArticulatedModel, joint: usize) -> [usize; 2] {
    // Equal bit for bit: the ends of the interval are positions of states.
    model.observed_interval(joint).map(|q| model.states.iter().position(|s| s[joint] == q).unwrap_or(0))
}
