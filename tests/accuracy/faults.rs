//! Faults in the files of a twin, as a fault of the program would put them there.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use serde_json::Value;

use super::{measure::evaluation, runs::Finished, twin_files::TwinFiles};

/// The moving parts of the truth, each with the twin's joint.
pub fn joints(done: &Finished) -> Vec<(String, String)> {
    let rows = evaluation(done.twin.as_ref().unwrap(), &done.truth).joints;
    rows.into_iter().filter_map(|row| Some((row.part, row.joint?))).collect()
}

/// Turns the axis of a joint by an angle about a direction across it.
pub fn turn_axis(twin: &mut TwinFiles, joint: &str, angle_deg: f64) {
    let element = twin.joint(joint);
    let head = "<axis xyz=\"";
    let start = element.start + twin.urdf[element.clone()].find(head).unwrap() + head.len();
    let end = start + twin.urdf[start..element.end].find('"').unwrap();
    let numbers: Vec<f64> = twin.urdf[start..end].split(' ').map(|n| n.parse().unwrap()).collect();
    let axis = Vector3::from_column_slice(&numbers);
    let across = Unit::new_normalize(axis.cross(&Vector3::ith(axis.iamin(), 1.0)));
    let turned = UnitQuaternion::from_axis_angle(&across, angle_deg.to_radians()) * axis;
    twin.urdf.replace_range(start..end, &format!("{} {} {}", turned.x, turned.y, turned.z));
}

/// Scales the positions of all joints.
pub fn scale_motions(twin: &mut TwinFiles, factor: f64) {
    for state in twin.report["states"].as_array_mut().unwrap() {
        state["joints"].as_object_mut().unwrap().values_mut().for_each(|position| scale(position, factor));
    }
}

/// Takes away a joint and the link that it moves.
pub fn lose_part(twin: &mut TwinFiles, joint: &str) {
    let element = twin.joint(joint);
    let head = "<child link=\"";
    let text = &twin.urdf[element.clone()];
    let start = text.find(head).unwrap() + head.len();
    let link = text[start..].split('"').next().unwrap().to_owned();
    twin.urdf.replace_range(element, "");
    let start = twin.urdf.find(&format!("<link name=\"{link}\"")).unwrap();
    let end = start + twin.urdf[start..].find("</link>").unwrap() + "</link>".len();
    twin.urdf.replace_range(start..end, "");
}

/// Scales all standard deviations that the report states.
pub fn scale_deviations(twin: &mut TwinFiles, factor: f64) {
    for joint in twin.report["joints"].as_array_mut().unwrap() {
        scale(&mut joint["axis_std_deg"], factor);
        scale(&mut joint["origin_std_mm"], factor);
        scale(&mut joint["motion_std"]["value"], factor);
    }
}

/// Scales a number; `null` stays.
fn scale(value: &mut Value, factor: f64) {
    if let Some(number) = value.as_f64() {
        *value = (factor * number).into();
    }
}
