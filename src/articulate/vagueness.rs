//! What is said of a joint that its motion tells coarsely, or not at all.

use super::JointEstimate;
use crate::model::Deviations;

/// Standard deviation of an axis direction, radians, and of an axis position, metres, from which it is said.
const COARSE_DIRECTION_RAD: f64 = 0.02;
const COARSE_POSITION_M: f64 = 0.01;

/// Sentences about the deviations of a joint of an object whose longest side is `extent_m`; none where all are small.
pub(super) fn vagueness(joint: &JointEstimate, extent_m: f64) -> Vec<String> {
    let turns = joint.kind.turns();
    let motion = joint.motion().abs();
    let amount = if turns { format!("{:.1} deg", motion.to_degrees()) } else { format!("{:.1} mm", 1e3 * motion) };
    let deviations = Deviations::of(&joint.evidence.covariance, &joint.axis, turns, extent_m);
    let undetermined = |what: &str| Some(format!("a motion of {amount} leaves the {what} not determined"));
    let direction = match deviations.axis_rad {
        None => undetermined("axis direction"),
        Some(std) if std > COARSE_DIRECTION_RAD => {
            Some(format!("a motion of {amount} tells the axis direction to +-{:.1} deg only", std.to_degrees()))
        }
        Some(_) => None,
    };
    let position = match deviations.origin_m {
        _ if !turns => None,
        None => undetermined("axis position"),
        Some(std) if std > COARSE_POSITION_M => Some(format!("a motion of {amount} tells the axis position to +-{:.0} mm only", 1e3 * std)),
        Some(_) => None,
    };
    let size = if deviations.motion.is_none() { Some("how far the joint moved is not determined".to_owned()) } else { None };
    [direction, position, size].into_iter().flatten().collect()
}
