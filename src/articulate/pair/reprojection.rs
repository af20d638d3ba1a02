//! Where a surface sample goes in the other state, and at what cost: a robust negative log-likelihood in
//! units of 3 nats, which is the loss of a correspondence at the edge of the reach. See docs/method.md (6.5).

pub(crate) use crate::samples::place_costs::{ALL_FREE, HIDDEN};

/// Additional cost of a surface labelled with another motion; also the evidence for a motion with a
/// correspondence, compared with a motion that hides the sample.
/// tuned: shared/bags
pub(crate) const TAKEN: f32 = 0.4;
/// Cost of a place in space seen to be empty.
/// tuned: shared/bags
pub(crate) const FREE: f32 = 1.6;
/// Squared mismatch, in standard deviations, at which the cost is half that of a missing surface: half of it
/// are the 3 nats of a unit of cost.
/// derived: 2 * 3 nats, so small deviations cost `z^2 / 2` nats (Geman-McClure)
pub(crate) const HALF_COST: f64 = 6.0;
/// A motion explains a sample if its cost is lower: the mismatch is then below [`HALF_COST`].
/// derived: `HALF_COST / (HALF_COST + HALF_COST)`
pub(crate) const EXPLAINED: f32 = 0.5;
/// Evidence of a sample for its motion against one that takes it into space seen empty, in addition to the
/// cost of its own: one in fifty true points is there.
/// derived: `-ln ASTRAY / 3`, 3 nats being the unit of cost
pub(crate) const MISSED: f64 = 1.3;
/// Cost of a sample moved into space seen empty, in samples moved onto planes: a sixth of those counts.
/// tuned: shared/bags
pub(crate) const CONTRADICTED: f64 = 2.0;
/// Share of true points that errors of depth and pose move into space seen empty.
/// tuned: shared/bags
pub(crate) const ASTRAY: f64 = 0.02;

/// How a reprojection is rated.
#[derive(Clone, Copy)]
pub(crate) struct Look<'a> {
    /// Label of the motion.
    pub label: u8,
    /// Labels of the other state's samples, where known, and the additional cost of a partner with another
    /// label.
    pub other_labels: Option<(&'a [u8], f32)>,
    /// Whether colors count.
    pub colored: bool,
}

/// Where a sample goes in the other state.
#[derive(Clone, Copy)]
pub(crate) struct Reprojection {
    /// The nearest sample there, with the squared deviations of shape and of color.
    pub partner: Option<(u32, f64, f64)>,
    /// Whether its place was seen empty, where known.
    pub free: Option<bool>,
}

impl Reprojection {
    /// Cost by agreement with the surface: 0 for a perfect partner, towards 1 for none; [`HIDDEN`] or
    /// [`FREE`] where there is no surface and free space is known. A partner that `other_labels` give to
    /// another motion counts at best as hiding the sample.
    pub(crate) fn reprojection_cost(&self, look: Look<'_>) -> f32 {
        let Look { label, other_labels, colored } = look;
        let partner = self.partner.map(|(j, shape, color)| {
            let squared = if colored { shape + color } else { shape };
            let cost = (squared / (squared + HALF_COST)) as f32;
            let taken = other_labels.filter(|(labels, _)| labels[j as usize] != label);
            taken.map_or(cost, |(_, more)| cost.max((cost + more).min(HIDDEN)))
        });
        match (partner, self.free) {
            // If free space is not known, a missing surface costs a whole unit, more than any partner.
            (partner, None) => partner.unwrap_or(1.0),
            (Some(cost), _) if cost < EXPLAINED => cost,
            // A poor partner is not better than none.
            (_, Some(true)) => FREE,
            _ => HIDDEN,
        }
    }
}

/// Log-likelihood ratio of the first of two motions, from one sample with these costs: the first reaches a
/// surface; the other takes the sample into space seen empty, or reaches a surface less well. A sample hidden
/// under either motion is no evidence for it. See docs/method.md (7.2).
pub(crate) fn log_ratio(own: f32, rival: f32) -> f64 {
    match (own, rival) {
        // The arms are in the order of docs/method.md (7.2): first its own motion hides the sample, then the
        // cases of the rival.
        (own, rival) if own >= HIDDEN => {
            if rival < HIDDEN {
                -f64::from(TAKEN)
            } else {
                0.0
            }
        }
        (own, rival) if rival >= FREE => MISSED - f64::from(own),
        (_, rival) if rival >= HIDDEN => 0.0,
        (own, rival) => f64::from(rival - own),
    }
}
