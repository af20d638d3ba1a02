//! Checks the form and range of every number in a URDF.

use nalgebra::Vector3;
use roxmltree::Node;

use super::{description::INERTIA, rule::Rule};

/// Larger numbers are no length, mass or inertia of a model, and computations with them overflow: up to this
/// bound the tenth power of a number is finite, and no computation takes a higher one.
/// derived: its tenth power is 1e300
pub(super) const LARGEST: f64 = 1e30;
/// Positions and scales beyond this, meters, belong to no model: meshes have single precision, in which the
/// sixth power of a coordinate is finite up to here. derived: the sixth power is 1e36
const FARTHEST: f64 = 1e6;
/// Axes shorter than this have no direction. chosen: above the rounding of a double
const SHORTEST_AXIS: f64 = 1e-9;

/// Whether a number is possible in a model.
pub(super) fn is_number(x: f64) -> bool {
    x.abs() <= LARGEST
}

/// Allowed range of an attribute's numbers.
#[derive(Clone, Copy, PartialEq)]
enum Range {
    Any,
    /// At most [`FARTHEST`] in size.
    Place,
    /// Each not zero, and at most [`FARTHEST`] in size.
    Scale,
    NotNegative,
    Positive,
    /// Not negative, of any size: it is a bound from which nothing is computed.
    Bound,
    /// At most [`FARTHEST`] in size, and not all zero if the joint moves.
    Direction,
}

use Range::{Any, Bound, Direction, NotNegative, Place, Positive, Scale};

/// Elements with numbers: tag, attributes, numbers in each attribute, their range, and the rule of a finding.
const ATTRIBUTES: [(&str, &[&str], usize, Range, Rule); 16] = [
    ("origin", &["xyz", "rpy"], 3, Place, Rule::Origin),
    ("mass", &["value"], 1, NotNegative, Rule::Inertia),
    ("inertia", &INERTIA, 1, Any, Rule::Inertia),
    ("box", &["size"], 3, Positive, Rule::Geometry),
    ("cylinder", &["radius", "length"], 1, Positive, Rule::Geometry),
    ("capsule", &["radius", "length"], 1, Positive, Rule::Geometry),
    ("sphere", &["radius"], 1, Positive, Rule::Geometry),
    ("mesh", &["scale"], 3, Scale, Rule::Geometry),
    ("color", &["rgba"], 4, NotNegative, Rule::Color),
    ("axis", &["xyz"], 3, Direction, Rule::Joint),
    ("limit", &["lower", "upper"], 1, Any, Rule::Limit),
    ("limit", &["effort", "velocity"], 1, Bound, Rule::Limit),
    ("dynamics", &["damping", "friction"], 1, NotNegative, Rule::Joint),
    ("mimic", &["multiplier", "offset"], 1, Any, Rule::Joint),
    (
        "safety_controller",
        &["soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"],
        1,
        Any,
        Rule::Joint,
    ),
    ("thread", &["pitch_m_per_rad"], 1, Any, Rule::Joint),
];

/// A malformed or impossible number.
#[derive(Clone, Debug)]
pub(super) struct BadNumber {
    pub rule: Rule,
    /// The link, joint or material it belongs to.
    pub subject: String,
    pub message: String,
}

/// All bad numbers below `<robot>`, in the order of the text.
pub(super) fn bad_numbers(robot: Node) -> Vec<BadNumber> {
    robot
        .children()
        .filter(|n| ["link", "joint", "material"].contains(&n.tag_name().name()))
        .flat_map(|owner| owner.descendants().flat_map(move |node| of_element(owner, node)))
        .collect()
}

fn of_element(owner: Node, node: Node) -> Vec<BadNumber> {
    let tag = node.tag_name().name();
    let mut bad = Vec::new();
    for (_, attributes, count, range, rule) in ATTRIBUTES.iter().filter(|a| a.0 == tag) {
        for attribute in *attributes {
            let Some(text) = node.attribute(*attribute) else { continue };
            // Nothing reads the axis of a joint that does not move, and writers put zeros there.
            let still = ["fixed", "floating"].contains(&owner.attribute("type").unwrap_or_default());
            let range = if *range == Direction && still { Place } else { *range };
            if let Some(why) = number_fault(text, *count, range) {
                // A finding stays one short line, whatever the file holds.
                let shown: String = text.chars().take(60).collect();
                let message = format!("the {attribute} of <{tag}> is '{}'; {why}", shown.escape_debug());
                bad.push(BadNumber {
                    rule: *rule,
                    subject: owner.attribute("name").unwrap_or_default().to_owned(),
                    message,
                });
            }
        }
    }
    bad
}

/// What is wrong with a text of `count` numbers, if anything.
fn number_fault(text: &str, count: usize, range: Range) -> Option<String> {
    // `nan` and `inf` parse as numbers; the test for finite ones refuses them.
    let numbers: Vec<f64> = text.split_whitespace().map_while(|w| w.parse().ok()).collect();
    let all = |test: fn(f64) -> bool| numbers.iter().all(|x| test(*x));
    if numbers.len() != count || text.split_whitespace().count() != count || !all(f64::is_finite) {
        return Some(if count == 1 {
            "it must be a finite number".to_owned()
        } else {
            format!("it must be {count} finite numbers")
        });
    }
    let why = match range {
        Bound | NotNegative if !all(|x| x >= 0.0) => "it must not be negative",
        Positive if !all(|x| x > 0.0) => "it must be positive",
        Scale if !all(|x| x != 0.0) => "it must not be zero",
        Direction if Vector3::from_iterator(numbers.iter().copied()).norm() < SHORTEST_AXIS => {
            "it must be a direction"
        }
        Place | Scale | Direction if !all(|x| x.abs() <= FARTHEST) => {
            return Some(format!("what follows from coordinates beyond {FARTHEST:e} overflows"));
        }
        Any | NotNegative | Positive if !all(is_number) => {
            return Some(format!("what follows from numbers beyond {LARGEST:e} overflows"));
        }
        _ => return None,
    };
    Some(why.to_owned())
}
