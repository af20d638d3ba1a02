//! Advice in one line on the next recording, and the failures of the twin.

use super::words::{decimal_places, escaped_words, fixed_text, position_text, variable_name, with_unit};
use gap::{
    judge::{
        finding::Finding,
        law::{Point, Way},
        locate::{Dependence, Variable},
        report::JointReport,
        verdict::Verdict,
    },
    twin_tree::TwinJoint,
};
use model::escape_xml;

/// Significance level at which a dependence is named. derived: the level of the report (`gap::judge::report`)
const LEVEL: f64 = 0.05;
/// Largest number of dependences listed.
const MAX_PLACES: usize = 3;
/// Share of the largest effort from which a bin belongs to the same place. chosen: a little less than half
const ALIKE: f64 = 0.4;
/// Largest share of the range that is still a place. chosen: most of the range is no place
const LOCAL: f64 = 0.7;
/// Share of a joint's range from which the runs cover it. chosen: most of it
const COVERED: f64 = 0.8;

/// A sentence on the next experiment; `range` is the interval of all recorded positions.
pub(super) fn next_experiment(joint: &JointReport, spec: Option<&TwinJoint>, range: (f64, f64)) -> String {
    let d = &joint.diagnosis;
    match d.verdict {
        Verdict::Ambiguous => {
            let Some(f) = d.findings.iter().find(|f| !f.alternatives.is_empty()) else {
                return String::new();
            };
            let others: Vec<String> = f.alternatives.iter().map(|(name, _)| escaped_words(name)).collect();
            format!(
                "To decide between {} and {}: {}.",
                escaped_words(&f.effect),
                others.join(", "),
                escape_xml(&f.experiment)
            )
        }
        Verdict::Named => {
            let loosest =
                d.findings.iter().max_by(|a, b| relative_half_width(a).total_cmp(&relative_half_width(b)));
            loosest.map_or(String::new(), |f| {
                let known = 100.0 * relative_half_width(f);
                let share = if known.is_finite() && known < 1000.0 {
                    format!(" (known to \u{b1}\u{a0}{}\u{a0}%)", fixed_text(known, i32::from(known < 3.0)))
                } else {
                    String::new()
                };
                format!("To know {}{share} better: {}.", escaped_words(&f.effect), escape_xml(&f.experiment))
            })
        }
        Verdict::Unknown if joint.doubt.is_some() => joint
            .doubt
            .as_ref()
            .map_or(String::new(), |d| escape_xml(&d.remedy_text()) + ", and diagnose again."),
        Verdict::Unknown => match (place_advice(joint), d.before.first()) {
            (Some(text), _) => text,
            (None, Some(w)) => wanted(w, joint.turns),
            (None, None) => String::new(),
        },
        Verdict::None => further(joint, spec, range),
        Verdict::Insufficient => d.lacks.iter().map(|l| escape_xml(l)).collect::<Vec<_>>().join("; ") + ".",
    }
}

/// Half width of the widest interval of an effect's amplitudes, relative to its value.
fn relative_half_width(f: &Finding) -> f64 {
    f.parameters.first().map_or(0.0, |p| 0.5 * (p.interval.1 - p.interval.0) / p.value.abs().max(1e-300))
}

/// A sentence on the next recording if something unknown acts at a place: where the twin lacks most effort.
fn place_advice(joint: &JointReport) -> Option<String> {
    let law = joint.laws.iter().find(|l| l.variable == Variable::Position && l.effects.is_empty())?;
    let [rising, falling]: [Vec<&Point>; 2] = [Way::Rising, Way::Falling]
        .map(|way| law.points.iter().filter(|p| p.way == way && !p.is_held_out).collect());
    let all = rising.iter().chain(&falling);
    let peak: &Point = all.max_by(|a, b| least_effort(a).total_cmp(&least_effort(b)))?;
    if !(least_effort(peak) > 0.0) {
        return None;
    }
    let own = if peak.way == Way::Rising { rising } else { falling };
    let at = own.iter().position(|p| *p == peak)?;
    let is_alike: Vec<bool> =
        own.iter().map(|p| p.effort * peak.effort.signum() > ALIKE * peak.effort.abs()).collect();
    let first = own[(0..=at).rev().take_while(|i| is_alike[*i]).last()?];
    let last = own[(at..own.len()).take_while(|i| is_alike[*i]).last()?];
    let range = own.last()?.x - own.first()?.x;
    if last.x - first.x > LOCAL * range {
        return None;
    }
    let way = if peak.way == Way::Rising { "rising" } else { "falling" };
    let turns = joint.turns;
    Some(format!(
        "The twin lacks most with the position {way}, about {} to {}: cross this range slowly, both ways, \
         three times at each of two speeds.",
        position_text(first.x, turns),
        position_text(last.x, turns)
    ))
}

/// Lower end of the interval of a point's absolute effort.
fn least_effort(p: &Point) -> f64 {
    p.effort.abs() - p.half
}

/// A sentence on the next recording if something unknown depends on a variable.
fn wanted(w: &Dependence, turns: bool) -> String {
    let region = region(w, turns);
    match w.variable {
        Variable::Position => format!("Cross {region} slowly, both ways, three times."),
        Variable::PositionRising => format!("Cross {region} upwards three times, slowly and fast."),
        Variable::PositionFalling => format!("Cross {region} downwards three times, slowly and fast."),
        Variable::Velocity => format!("Move at steady speeds of {region}, both ways, over the whole range."),
        Variable::Direction => "Reverse slowly six times or more, at two speeds.".into(),
        Variable::Effort => format!("Repeat one motion under efforts of {region} with two loads."),
        Variable::Acceleration => "Shake it fast with a known effort, with two inertias.".into(),
        Variable::Time => format!(
            "Record the same motion again, with what happens at {region} noted: whether it comes back."
        ),
    }
}

fn region(w: &Dependence, turns: bool) -> String {
    let (low, high) = w.region;
    if w.variable == Variable::Direction {
        return match (low < 0.0, high > 0.0) {
            (true, true) => "both ways".into(),
            (true, false) => "position falling".into(),
            _ => "position rising".into(),
        };
    }
    let places = decimal_places((high - low).abs(), 0.0);
    with_unit(&format!("{} to {}", fixed_text(low, places), fixed_text(high, places)), w.variable.unit(turns))
}

/// A sentence on ranges and efforts not covered by these runs, if nothing is missing.
fn further(joint: &JointReport, spec: Option<&TwinJoint>, range: (f64, f64)) -> String {
    let (low, high) = range;
    let speed =
        format!("{}\u{a0}{}", fixed_text(joint.coverage.speed.1, 2), Variable::Velocity.unit(joint.turns));
    let limit = spec.and_then(|s| s.limit).filter(|(l, h)| h - l < 1e3);
    match limit {
        Some((l, h)) if high - low < COVERED * (h - l) => format!(
            "These runs say nothing beyond {} to {}, nor above {speed}: go through the rest of the range, {} \
             to {}.",
            position_text(low, joint.turns),
            position_text(high, joint.turns),
            position_text(l, joint.turns),
            position_text(h, joint.turns)
        ),
        _ => format!(
            "These runs say nothing above {speed}, nor of efforts and loads that did not occur: go faster, \
             reverse slowly, and repeat with another load."
        ),
    }
}

/// Where twin and recording disagree.
pub(super) fn disagreement(joint: &JointReport) -> String {
    let listed = joint
        .diagnosis
        .before
        .iter()
        .filter(|w| w.q <= LEVEL && w.gain > 2.0 * w.bins.len() as f64 + 10.0)
        .take(MAX_PLACES)
        .map(|w| {
            format!(
                "{}, {} (p\u{a0}{})",
                variable_name(w.variable),
                region(w, joint.turns),
                fixed_text(w.p, 3)
            )
        })
        .collect::<Vec<_>>();
    if listed.is_empty() { String::new() } else { format!("The residual depends on {}.", listed.join("; ")) }
}
