//! Every number of a URDF: its form and its range.

use nalgebra::Vector3;
use roxmltree::Node;

use super::{description::INERTIA, rule::Rule};

/// Larger numbers stand for no length, mass or inertia of a model, and computations with them overflow: with
/// this bound the tenth power of a number is finite, and no computation takes a higher one.
/// derived: its tenth power is 1e300
pub(super) const LARGEST: f64 = 1e30;
/// Places and scales beyond this, meters, are of no model: meshes have single precision, and up to here the
/// sixth power of a coordinate is finite in it. derived: the sixth power is 1e36
const FARTHEST: f64 = 1e6;
/// Shorter axes are no direction. chosen: above the rounding of a double
const SHORTEST_AXIS: f64 = 1e-9;

/// Whether a number can be one of a model.
pub(super) fn is_number(x: f64) -> bool {
    x.abs() <= LARGEST
}

/// Range of the numbers of an attribute.
#[derive(Clone, Copy, PartialEq)]
enum Range {
    Any,
    /// Not beyond [`FARTHEST`].
    Place,
    /// Not zero, none of them, and not beyond [`FARTHEST`].
    Scale,
    NotNegative,
    Positive,
    /// Not negative, and as large as a number can be: it bounds, and nothing is computed from it.
    Bound,
    /// Not all zero, where the joint moves, and not beyond [`FARTHEST`].
    Direction,
}

use Range::{Any, Bound, Direction, NotNegative, Place, Positive, Scale};

/// Elements with numbers: tag, attributes, count of numbers in each, their range, the rule of their findings.
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

/// A number that is none or cannot be.
#[derive(Clone, Debug)]
pub(super) struct BadNumber {
    pub rule: Rule,
    /// Link, joint or material.
    pub subject: String,
    pub message: String,
}

/// All of them below `<robot>`, in the order of the text.
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
            // Nothing reads the axis of a joint without motion, and writers put zeros there.
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

/// The fault of a text of `count` numbers, if any.
fn number_fault(text: &str, count: usize, range: Range) -> Option<String> {
    // `nan` and `inf` are read as numbers here; the test of finite ones refuses them.
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
