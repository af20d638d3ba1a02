//! What is hidden in a made object, in its twin or in the recordings of it.

use std::{fs, ops::Range, path::Path};

use gap::camera::model::small_motion::twist_motion;
use geometry::{AxisMotion, Pose};
use nalgebra::{Point3, UnitQuaternion, Vector3, Vector6};
use numeric::random::stage_rng;
use rand_core::Rng as _;
use synth::{Object, SynthState};

use crate::cut::cut;

/// Recordings of a case.
pub const RECORDINGS: usize = 3;
/// The part that moves; the made objects have two.
pub const PART: usize = 1;
/// How far a second way of the part goes in each recording: unrelated to the joint's position.
const SECOND_WAY: [f64; RECORDINGS] = [1.0, -0.7, 0.4];

/// What is hidden. Shares are of the moving part's radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hidden {
    /// Nothing.
    Nothing,
    /// Nothing, in recordings that have joint positions.
    NothingWithPositions,
    /// Depth readings too long by a share.
    DepthScale(f64),
    /// Depth readings too long, meters.
    DepthBias(f64),
    /// The camera stands off its reported poses, meters and radians.
    Extrinsic(f64),
    /// Images are stamped late, seconds.
    Delay(f64),
    /// The twin's axis is turned, radians.
    AxisTurn(f64),
    /// The twin's axis is shifted, its part is not, meters.
    AxisShift(f64),
    /// The twin's axis and part are shifted, meters.
    FrameShift(f64),
    /// The twin slides where the object turns, or the other way.
    OtherType,
    /// The twin is revolute where the object is a screw.
    NoThread,
    /// The twin's pitch is off by a share of the object's.
    Pitch(f64),
    /// The part stands off its motion, in every recording otherwise, by a share.
    Play(f64),
    /// The part slides across its motion, too, by a share at most.
    SecondSlide(f64),
    /// The part turns across its motion, too, radians at most.
    SecondTurn(f64),
    /// Recorded joint positions are off: radians, or a share for a slide.
    EncoderBias(f64),
    /// Recorded joint positions are too large by a share.
    EncoderScale(f64),
    /// The twin lacks a third of a part.
    Cut(usize),
}

impl Hidden {
    /// Whether the object must be a screw.
    pub fn needs_screw(self) -> bool {
        matches!(self, Self::NoThread | Self::Pitch(_))
    }

    /// Whether the object must turn: the axis of a slide has no place.
    pub fn needs_turn(self) -> bool {
        matches!(self, Self::AxisShift(_))
    }

    /// Whether the recordings have joint positions.
    pub fn has_positions(self) -> bool {
        matches!(self, Self::NothingWithPositions | Self::EncoderBias(_) | Self::EncoderScale(_))
    }
}

/// An offset of the camera's mount by a length and an angle of a size.
pub fn mount(size: f64) -> Pose {
    Pose::new(Vector3::new(0.7, -0.5, 0.5) * size, Vector3::new(0.6, 1.0, -0.4) * size)
}

/// Middle of the moving part's bounds at position 0, in the object's rest frame, and half their diagonal,
/// meters.
fn middle_and_radius(object: &Object) -> (Point3<f64>, f64) {
    let (low, high) = object.mesh_of_part(PART).bounds().unwrap();
    let (low, high): (Point3<f64>, Point3<f64>) = (low.cast(), high.cast());
    (nalgebra::center(&low, &high), 0.5 * (high - low).norm())
}

/// What is added to a joint position in the recordings, rad or m.
pub fn encoder_bias(object: &Object, size: f64) -> f64 {
    match object.parts[PART].joint.unwrap().kind {
        AxisMotion::Prismatic => size * middle_and_radius(object).1,
        _ => size,
    }
}

/// The joint position that a recording of an object in its state 1 has.
pub fn recorded_position(hidden: Hidden, object: &Object) -> f64 {
    let position = object.parts[PART].joint.unwrap().positions[1];
    match hidden {
        Hidden::EncoderBias(size) => position + encoder_bias(object, size),
        Hidden::EncoderScale(share) => position * (1.0 + share),
        _ => position,
    }
}

/// The direction of the joint's frame along which the part slides in a second way, or about which it turns.
fn second_direction(hidden: Hidden, object: &Object) -> Vector3<f64> {
    let joint = object.parts[PART].joint.unwrap();
    let along = joint.axis.iamax();
    // What turns may slide along its axis.
    let is_axis = matches!(hidden, Hidden::SecondSlide(_)) && joint.kind != AxisMotion::Prismatic;
    let chosen = if is_axis { along } else { (along + 1) % 3 };
    Vector3::from_fn(|i, _| if i == chosen { 1.0 } else { 0.0 })
}

/// How far a second way goes in each recording, meters or radians.
pub fn second_way(hidden: Hidden, object: &Object) -> [f64; RECORDINGS] {
    match hidden {
        Hidden::SecondSlide(share) => SECOND_WAY.map(|x| x * share * middle_and_radius(object).1),
        Hidden::SecondTurn(rad) => SECOND_WAY.map(|x| x * rad),
        _ => [0.0; RECORDINGS],
    }
}

/// Shift of the part's middle (meters) and turn about it (radians) by which the part stands off its motion in
/// each recording: drawn, without what the joint's own motion would make up for, and zero in the mean, which
/// would be an axis that is off.
pub fn play(states: &[Object], share: f64, seed: u64) -> Vec<[Vector3<f64>; 2]> {
    let joint = states[0].parts[PART].joint.unwrap();
    let (middle, radius_m) = middle_and_radius(&states[0]);
    let axis = joint.axis.into_inner();
    let mut drawn: Vec<Vector6<f64>> = Vec::new();
    for (recording, state) in states.iter().enumerate() {
        let mut rng = stage_rng(seed, "gap_frames/play", recording as u64);
        // Turns count with the radius, so that all six numbers are lengths.
        let mut motion = Vector6::from_fn(|_, _| 2.0 * (rng.next_u64() as f64 / u64::MAX as f64) - 1.0);
        let middle = joint.motion_at(state.parts[PART].joint.unwrap().positions[1]) * middle;
        let own = match joint.kind {
            AxisMotion::Prismatic => [axis, Vector3::zeros()],
            AxisMotion::Revolute => [axis.cross(&(middle - joint.origin)), axis * radius_m],
            AxisMotion::Screw { pitch_m_per_rad } => {
                [axis.cross(&(middle - joint.origin)) + axis * pitch_m_per_rad, axis * radius_m]
            }
        };
        let own = Vector6::new(own[0].x, own[0].y, own[0].z, own[1].x, own[1].y, own[1].z).normalize();
        motion -= own * own.dot(&motion);
        drawn.push(motion);
    }
    let mean = drawn.iter().sum::<Vector6<f64>>() / drawn.len() as f64;
    drawn.iter_mut().for_each(|motion| *motion -= mean);
    let rms = (drawn.iter().map(Vector6::norm_squared).sum::<f64>() / drawn.len() as f64).sqrt();
    drawn
        .iter()
        .map(|motion| motion * (share * radius_m / rms))
        .map(|m| [Vector3::new(m[0], m[1], m[2]), Vector3::new(m[3], m[4], m[5]) / radius_m])
        .collect()
}

/// Hides it in the objects that are filmed, each in its state 1.
pub fn hide_in_states(hidden: Hidden, states: &mut [Object], seed: u64) {
    let offs: Vec<[Vector3<f64>; 2]> = match hidden {
        Hidden::Play(share) => play(states, share, seed),
        Hidden::SecondSlide(_) | Hidden::SecondTurn(_) => {
            let direction = second_direction(hidden, &states[0]);
            let turns = matches!(hidden, Hidden::SecondTurn(_));
            let off = |x: f64| {
                let by = direction * x;
                if turns { [Vector3::zeros(), by] } else { [by, Vector3::zeros()] }
            };
            second_way(hidden, &states[0]).map(off).to_vec()
        }
        _ => return,
    };
    let (middle, _) = middle_and_radius(&states[0]);
    for (state, [shift, turn]) in states.iter_mut().zip(offs) {
        let joint = state.parts[PART].joint.unwrap();
        let motion = joint.motion_at(joint.positions[1]);
        let middle = (motion * middle).coords;
        let turn = UnitQuaternion::from_scaled_axis(turn);
        let off = Pose::from_parts((middle + shift - turn * middle).into(), turn);
        // The part stands at `off * motion`, and its joint moves it by `motion`.
        let in_part = motion.inverse() * off * motion;
        for solid in &mut state.parts[PART].solids {
            solid.part_from_solid = in_part * solid.part_from_solid;
        }
    }
}

/// Hides it in what the camera recorded.
pub fn hide_in_recording(hidden: Hidden, recording: &mut SynthState) {
    for frame in &mut recording.frames {
        let readings = frame.depth_mm.iter_mut().filter(|d| **d > 0);
        match hidden {
            Hidden::DepthScale(share) => {
                readings.for_each(|d| *d = (f64::from(*d) * (1.0 + share)).round() as u16);
            }
            Hidden::DepthBias(m) => readings.for_each(|d| *d = (f64::from(*d) + 1000.0 * m).round() as u16),
            Hidden::Extrinsic(size) => frame.reported.iter_mut().for_each(|pose| *pose *= mount(size)),
            Hidden::Delay(seconds) => {
                let off = twist_motion(&frame.velocity, seconds);
                frame.reported.iter_mut().for_each(|pose| *pose *= off);
            }
            _ => {}
        }
    }
}

/// Hides it in the true twin of an object.
pub fn hide_in_twin(hidden: Hidden, object: &Object, urdf: &Path) {
    let text = fs::read_to_string(urdf).unwrap();
    let line = text.lines().find(|l| l.contains("<joint ")).unwrap();
    let mut text = text.replace(line, &joint_line(hidden, object, line));
    if let Hidden::AxisShift(m) = hidden {
        // The part stays where it was.
        let mesh = text.find(&format!("meshes/part_{PART}.obj")).unwrap();
        let visual = text[..mesh].rfind("<visual>").unwrap();
        let back = -across(object) * m;
        text = format!("{}{}", &text[..visual], with_numbers(&text[visual..], "origin", &back));
    }
    fs::write(urdf, text).unwrap();
    if let Hidden::Cut(part) = hidden {
        let mesh = urdf.with_file_name("meshes").join(format!("part_{part}.obj"));
        cut(&mesh, &mesh);
    }
}

/// The line of a twin that has its joint, with what is hidden in it.
fn joint_line(hidden: Hidden, object: &Object, line: &str) -> String {
    let joint = object.parts[PART].joint.unwrap();
    match hidden {
        Hidden::AxisTurn(rad) => turned(line, &across(object), rad),
        Hidden::AxisShift(m) | Hidden::FrameShift(m) => {
            // The joint hangs on the static part, whose frame is the world's.
            let shift = object.world_from_rest.rotation * across(object) * m;
            with_numbers(line, "origin", &(numbers(line, "origin") + shift))
        }
        Hidden::OtherType if joint.kind == AxisMotion::Prismatic => {
            line.replace("type=\"prismatic\"", "type=\"revolute\"")
        }
        Hidden::OtherType => line.replace("type=\"revolute\"", "type=\"prismatic\""),
        Hidden::NoThread => format!("{}</joint>", &line[..line.find("<artitwin:thread").unwrap()]),
        Hidden::Pitch(share) => {
            let AxisMotion::Screw { pitch_m_per_rad } = joint.kind else { panic!("no screw: {line}") };
            let pitch = |m: f64| format!("pitch_m_per_rad=\"{m}\"");
            line.replace(&pitch(pitch_m_per_rad), &pitch((1.0 + share) * pitch_m_per_rad))
        }
        _ => line.to_owned(),
    }
}

/// A direction across the joint's axis that is none of the object's own.
fn across(object: &Object) -> Vector3<f64> {
    across_axis(&object.parts[PART].joint.unwrap().axis)
}

fn across_axis(axis: &Vector3<f64>) -> Vector3<f64> {
    axis.cross(&Vector3::new(0.3, 0.5, 0.8)).normalize()
}

/// A description whose first axis is turned by an angle.
pub fn with_turned_axis(text: &str, rad: f64) -> String {
    let across = across_axis(&numbers(text, "axis"));
    turned(text, &across, rad)
}

fn turned(text: &str, about: &Vector3<f64>, rad: f64) -> String {
    with_numbers(text, "axis", &(UnitQuaternion::from_scaled_axis(about * rad) * numbers(text, "axis")))
}

/// Where the first element `tag` whose `xyz` comes first has its numbers.
fn place_of_numbers(text: &str, tag: &str) -> Range<usize> {
    let element = format!("<{tag} xyz=\"");
    let start = text.find(&element).unwrap() + element.len();
    start..start + text[start..].find('"').unwrap()
}

fn numbers(text: &str, tag: &str) -> Vector3<f64> {
    let all: Vec<f64> = text[place_of_numbers(text, tag)].split(' ').map(|n| n.parse().unwrap()).collect();
    Vector3::new(all[0], all[1], all[2])
}

fn with_numbers(text: &str, tag: &str, v: &Vector3<f64>) -> String {
    let place = place_of_numbers(text, tag);
    format!("{}{} {} {}{}", &text[..place.start], v.x, v.y, v.z, &text[place.end..])
}
