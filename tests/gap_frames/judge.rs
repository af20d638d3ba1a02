//! What a report should say of a case, and whether it does.

use nalgebra::Vector3;
use serde_json::Value;
use synth::Object;

use crate::hidden::{Hidden, PART, encoder_bias, mount, play, second_way};
use geometry::AxisMotion;

/// The gap of a right name falls to this share, or to [`CLOSED_M`] above the noise.
const CLOSED_SHARE: f64 = 0.2;
/// Meters.
const CLOSED_M: f64 = 0.001;

/// A parameter of the first finding.
pub struct Truth {
    /// Its name.
    pub name: String,
    /// Its true value.
    pub value: f64,
    /// Its value where nothing is hidden.
    pub neutral: f64,
}

impl Truth {
    fn of(name: &str, value: f64) -> Self {
        Self { name: name.to_owned(), value, neutral: 0.0 }
    }
}

/// The first finding that a report should have.
pub struct Expected {
    /// Name of the effect.
    pub effect: &'static str,
    /// The joint or link, or the camera.
    pub subject: String,
    /// The joint's true type, where the twin has another.
    pub to_type: Option<&'static str>,
    /// What is known of its parameters.
    pub truth: Vec<Truth>,
}

/// What a report says of a case, held against what it should say.
pub struct Judged {
    /// What is wrong with it, if anything.
    pub wrong: Option<String>,
    /// Intervals that hold the truth, and of how many.
    pub held: [usize; 2],
    /// Error of the values as a share of what was hidden; root mean square over the parameters.
    pub error_share: Option<f64>,
    /// Names of findings behind the first.
    pub further: Vec<String>,
}

/// What a report of a case should say first; nothing where nothing is hidden. `states` are what was meant to
/// be filmed.
pub fn expected(hidden: Hidden, object: &Object, states: &[Object], seed: u64) -> Option<Expected> {
    let part = &object.parts[PART];
    let kind = part.joint.unwrap().kind;
    let of_joint = |effect| Expected {
        effect,
        subject: format!("{}_joint", part.name),
        to_type: None,
        truth: truth(hidden, object, states, seed),
    };
    let of_camera = |effect| Expected { subject: "camera".to_owned(), ..of_joint(effect) };
    Some(match hidden {
        Hidden::Nothing | Hidden::NothingWithPositions => return None,
        Hidden::DepthScale(_) => of_camera("depth_scale"),
        Hidden::DepthBias(_) => of_camera("depth_bias"),
        Hidden::Extrinsic(_) => of_camera("camera_extrinsic_offset"),
        Hidden::Delay(_) => of_camera("camera_time_offset"),
        Hidden::AxisTurn(_) | Hidden::AxisShift(_) | Hidden::FrameShift(_) => of_joint("axis_offset"),
        Hidden::OtherType | Hidden::NoThread | Hidden::Pitch(_) => {
            Expected { to_type: Some(kind.name()), ..of_joint("wrong_joint_type") }
        }
        Hidden::Play(_) => of_joint("axis_play"),
        Hidden::SecondSlide(_) | Hidden::SecondTurn(_) => of_joint("second_dof"),
        Hidden::EncoderBias(_) => of_joint("encoder_bias"),
        Hidden::EncoderScale(_) => of_joint("encoder_scale"),
        Hidden::Cut(0) => Expected { subject: object.parts[0].name.clone(), ..of_joint("missing_geometry") },
        Hidden::Cut(_) => of_joint("missing_geometry"),
    })
}

/// The parameters that the first finding should have.
fn truth(hidden: Hidden, object: &Object, states: &[Object], seed: u64) -> Vec<Truth> {
    let root_mean_square =
        |all: &[Vector3<f64>]| (all.iter().map(Vector3::norm_squared).sum::<f64>() / all.len() as f64).sqrt();
    match hidden {
        Hidden::DepthScale(share) => {
            vec![Truth { name: "scale".to_owned(), value: 1.0 + share, neutral: 1.0 }]
        }
        Hidden::DepthBias(m) => vec![Truth::of("bias", m)],
        Hidden::Delay(seconds) => vec![Truth::of("offset", -seconds)],
        Hidden::Extrinsic(size) => {
            let back = mount(size).inverse();
            let (shift, turn) = (back.translation.vector, back.rotation.scaled_axis());
            let names = ["x", "y", "z", "roll", "pitch", "yaw"];
            let values = shift.iter().chain(turn.iter());
            names.iter().zip(values).map(|(name, value)| Truth::of(name, *value)).collect()
        }
        Hidden::AxisTurn(rad) => vec![Truth::of("axis_angle", rad)],
        Hidden::AxisShift(m) | Hidden::FrameShift(m) => vec![Truth::of("axis_position", m)],
        Hidden::NoThread | Hidden::Pitch(_) => match object.parts[PART].joint.unwrap().kind {
            AxisMotion::Screw { pitch_m_per_rad } => vec![Truth::of("pitch", pitch_m_per_rad)],
            _ => Vec::new(),
        },
        Hidden::Play(share) => {
            let all = play(states, share, seed);
            let shifts: Vec<Vector3<f64>> = all.iter().map(|motion| motion[0]).collect();
            let turns: Vec<Vector3<f64>> = all.iter().map(|motion| motion[1]).collect();
            vec![
                Truth::of("play_angle_rms", root_mean_square(&turns)),
                Truth::of("play_shift_rms", root_mean_square(&shifts)),
            ]
        }
        Hidden::SecondSlide(_) | Hidden::SecondTurn(_) => {
            let way = if matches!(hidden, Hidden::SecondTurn(_)) { "turn" } else { "slide" };
            let values = second_way(hidden, object);
            values.iter().enumerate().map(|(k, x)| Truth::of(&format!("{way}_{k}"), *x)).collect()
        }
        Hidden::EncoderBias(size) => vec![Truth::of("bias", encoder_bias(object, size))],
        Hidden::EncoderScale(share) => {
            vec![Truth { name: "scale".to_owned(), value: 1.0 + share, neutral: 1.0 }]
        }
        Hidden::Nothing | Hidden::NothingWithPositions | Hidden::OtherType | Hidden::Cut(_) => Vec::new(),
    }
}

/// Gap before and after, and what the noise makes, meters.
pub fn gap_m(report: &Value) -> [f64; 3] {
    ["before", "after", "noise_floor"].map(|key| report["gap"][key].as_f64().unwrap())
}

/// Holds a report against what it should say.
pub fn judge(report: &Value, expected: Option<&Expected>) -> Judged {
    let names = |finding: &Value| finding["effect"].as_str().unwrap().to_owned();
    let findings = report["findings"].as_array().unwrap();
    let further = findings.iter().skip(1).map(names).collect();
    let Some(expected) = expected else {
        let is_none = findings.is_empty() && report["verdict"] == "none";
        let wrong = (!is_none).then(|| told(report));
        return Judged { wrong, held: [0, 0], error_share: None, further };
    };
    let first = &report["findings"][0];
    let is_right = first["effect"] == expected.effect
        && first["joint"] == expected.subject.as_str()
        && expected.to_type.is_none_or(|to| first["type"]["to"] == to);
    if !is_right {
        return Judged { wrong: Some(told(report)), held: [0, 0], error_share: None, further };
    }
    let [before, after, floor] = gap_m(report);
    let is_closed = after - floor < (CLOSED_SHARE * (before - floor)).max(CLOSED_M);
    let left = format!("gap {:.1} of {:.1} mm left", 1e3 * after, 1e3 * before);
    let (held, error_share) = values(first, &expected.truth);
    Judged { wrong: (!is_closed).then_some(left), held, error_share, further }
}

/// What a report says, in a few words.
fn told(report: &Value) -> String {
    let word = |value: &Value| value.as_str().unwrap_or("-").to_owned();
    let first = &report["findings"][0];
    let to_type = first["type"]["to"].as_str().map_or(String::new(), |to| format!(" to {to}"));
    let of = format!("{} of {}{to_type}", word(&first["effect"]), word(&first["joint"]));
    format!("{}: {}", word(&report["verdict"]), if first.is_null() { "no name" } else { &of })
}

/// Intervals of a finding that hold the truth, of how many, and the error of its values as a share of what is
/// hidden. A parameter that the finding lacks holds nothing.
fn values(finding: &Value, truth: &[Truth]) -> ([usize; 2], Option<f64>) {
    let parameters = finding["parameters"].as_array().unwrap();
    let (mut held, mut error_squares, mut hidden_squares) = (0, 0.0, 0.0);
    for t in truth {
        let told = parameters.iter().find(|p| p["name"] == t.name.as_str());
        let number = |p: &Value| p.as_f64().unwrap();
        let value = told.map_or(t.neutral, |p| number(&p["value"]));
        let holds = |p: &Value| (number(&p["interval"][0])..=number(&p["interval"][1])).contains(&t.value);
        held += usize::from(told.is_some_and(holds));
        error_squares += (value - t.value).powi(2);
        hidden_squares += (t.value - t.neutral).powi(2);
    }
    ([held, truth.len()], (!truth.is_empty()).then(|| f64::sqrt(error_squares / hidden_squares)))
}
