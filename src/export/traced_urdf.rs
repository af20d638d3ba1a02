//! URDF text of a joint that was found from tracks: two links without shapes.

use std::fmt::Write as _;

use super::number::decimal;
use gap::track::joint::{TracedJoint, TracedType};
use model::{escape_xml as escape, identifier};

/// Decimals of lengths, angles and axes.
const PLACES: usize = 9;

/// URDF text; `None` where the type is not known. The base is the frame of the tracks.
#[must_use]
pub fn traced_urdf(name: &str, joint: &TracedJoint) -> Option<String> {
    let TracedType::Known(motion) = joint.kind else { return None };
    let axis = joint.axis.as_ref()?;
    let numbers =
        |v: &nalgebra::Vector3<f64>| v.iter().map(|x| decimal(*x, PLACES)).collect::<Vec<_>>().join(" ");
    let [lower, upper] = joint.limits.map(|q| decimal(q, PLACES));
    let mut text = format!("<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n", escape(&identifier(name)));
    // Writing to a string cannot fail.
    write!(
        text,
        "  <!-- No track shows a mass: that of the part is a stand-in. -->\n  <link name=\"base\"/>\n  \
         <link name=\"part\">\n    <inertial>\n      <mass value=\"{MASS}\"/>\n      <inertia \
         ixx=\"{INERTIA}\" ixy=\"0\" ixz=\"0\" iyy=\"{INERTIA}\" iyz=\"0\" izz=\"{INERTIA}\"/>\n    \
         </inertial>\n  </link>\n  <joint name=\"joint\" type=\"{}\">\n    \
         <parent link=\"base\"/>\n    <child link=\"part\"/>\n    <origin xyz=\"{}\" rpy=\"0 0 0\"/>\n    \
         <axis xyz=\"{}\"/>\n    <limit lower=\"{lower}\" upper=\"{upper}\" effort=\"{EFFORT}\" \
         velocity=\"{VELOCITY}\"/>\n  </joint>\n</robot>\n",
        motion.name(),
        numbers(&axis.origin),
        numbers(&axis.axis),
    )
    .ok();
    Some(text)
}

/// Effort and velocity of the limits, which URDF demands and no track shows; N or N m, m/s or rad/s.
/// chosen: more than any hand gives a door.
const EFFORT: &str = "1000";
const VELOCITY: &str = "10";
/// Mass and inertia of the part, without which simulators drop it; kg and kg m^2.
/// chosen: a kilogram, as PyBullet takes it, with a radius of gyration of 10 cm.
const MASS: &str = "1";
const INERTIA: &str = "0.01";
