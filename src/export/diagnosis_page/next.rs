//! What to record next, in one line, and where the twin fails.

use super::words::{fixed, places, position, variable, with_unit, words};
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

/// Level at which a dependence is named. derived: that of the report (`gap::judge::report`)
const LEVEL: f64 = 0.05;
/// Most dependences that are listed.
const MAX_PLACES: usize = 3;
/// Share of the largest effort from which a bin belongs to it. chosen: a little less than half
const ALIKE: f64 = 0.4;
/// Largest share of the range that is a place. chosen: what is wider is no place
const LOCAL: f64 = 0.7;
/// Share of a joint's range from which the runs cover it. chosen: most of it
const COVERED: f64 = 0.8;

/// The next experiment; `range` is that of all runs.
#[must_use]
pub(super) fn next(joint: &JointReport, spec: Option<&TwinJoint>, range: (f64, f64)) -> String {
    let d = &joint.diagnosis;
    let of = |f: &Finding| escape_xml(&f.experiment);
    match d.verdict {
        Verdict::Ambiguous => {
            let Some(f) = d.findings.iter().find(|f| !f.alternatives.is_empty()) else {
                return String::new();
            };
            let others: Vec<String> = f.alternatives.iter().map(|(name, _)| words(name)).collect();
            format!("To decide between {} and {}: {}.", words(&f.effect), others.join(", "), of(f))
        }
        Verdict::Named => {
            let loosest = d.findings.iter().max_by(|a, b| looseness(a).total_cmp(&looseness(b)));
            loosest.map_or(String::new(), |f| {
                let known = 100.0 * looseness(f);
                let share = if known.is_finite() && known < 1000.0 {
                    format!(" (known to \u{b1}\u{a0}{}\u{a0}%)", fixed(known, i32::from(known < 3.0)))
                } else {
                    String::new()
                };
                format!("To know {}{share} better: {}.", words(&f.effect), of(f))
            })
        }
        Verdict::Unknown if joint.doubt.is_some() => {
            joint.doubt.as_ref().map_or(String::new(), |d| escape_xml(&d.remedy()) + ", and diagnose again.")
        }
        Verdict::Unknown => match (place(joint), d.before.first()) {
            (Some(text), _) => text,
            (None, Some(w)) => wanted(w, joint.turns),
            (None, None) => String::new(),
        },
        Verdict::None => further(joint, spec, range),
        Verdict::Insufficient => d.lacks.iter().map(|l| escape_xml(l)).collect::<Vec<_>>().join("; ") + ".",
    }
}

/// Half width of the widest interval of an effect's amplitudes, relative to its value.
fn looseness(f: &Finding) -> f64 {
    f.parameters.first().map_or(0.0, |p| 0.5 * (p.interval.1 - p.interval.0) / p.value.abs().max(1e-300))
}

/// What to record where something unknown acts at a place: where the twin lacks most, either way.
fn place(joint: &JointReport) -> Option<String> {
    let law = joint.laws.iter().find(|l| l.variable == Variable::Position && l.effects.is_empty())?;
    let fitted = |way: Way| law.points.iter().filter(move |p| p.way == way && !p.is_held_out);
    let sure = |p: &&Point| p.effort.abs() - p.half;
    let all = [Way::Rising, Way::Falling].into_iter().flat_map(fitted);
    let peak = all.max_by(|a, b| sure(a).total_cmp(&sure(b))).filter(|p| sure(p) > 0.0)?;
    let own: Vec<&Point> = fitted(peak.way).collect();
    let at = own.iter().position(|p| *p == peak)?;
    let alike = |p: &&&Point| p.effort * peak.effort.signum() > ALIKE * peak.effort.abs();
    let first = own[..=at].iter().rev().take_while(alike).last()?;
    let last = own[at..].iter().take_while(alike).last()?;
    let range = own.last()?.x - own.first()?.x;
    if last.x - first.x > LOCAL * range {
        return None;
    }
    let way = if peak.way == Way::Rising { "rising" } else { "falling" };
    let turns = joint.turns;
    Some(format!(
        "The twin lacks most with the position {way}, about {} to {}: cross this range slowly, both ways, \
         three times at each of two speeds.",
        position(first.x, turns),
        position(last.x, turns)
    ))
}

/// What to record where something unknown depends on a variable.
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
    let places = places((high - low).abs(), 0.0);
    with_unit(&format!("{} to {}", fixed(low, places), fixed(high, places)), w.variable.unit(turns))
}

/// Where nothing is missing: what these runs say nothing about.
fn further(joint: &JointReport, spec: Option<&TwinJoint>, (low, high): (f64, f64)) -> String {
    let speed = format!("{}\u{a0}{}", fixed(joint.coverage.speed.1, 2), Variable::Velocity.unit(joint.turns));
    let limit = spec.and_then(|s| s.limit).filter(|(l, h)| h - l < 1e3);
    match limit {
        Some((l, h)) if high - low < COVERED * (h - l) => format!(
            "These runs say nothing beyond {} to {}, nor above {speed}: go through the rest of the range, {} \
             to {}.",
            position(low, joint.turns),
            position(high, joint.turns),
            position(l, joint.turns),
            position(h, joint.turns)
        ),
        _ => format!(
            "These runs say nothing above {speed}, nor of efforts and loads that did not occur: go faster, \
             reverse slowly, and repeat with another load."
        ),
    }
}

/// Where twin and recording disagree.
#[must_use]
pub(super) fn disagreement(joint: &JointReport) -> String {
    let listed = joint
        .diagnosis
        .before
        .iter()
        .filter(|w| w.q <= LEVEL && w.gain > 2.0 * w.bins.len() as f64 + 10.0)
        .take(MAX_PLACES)
        .map(|w| format!("{}, {} (p\u{a0}{})", variable(w.variable), region(w, joint.turns), fixed(w.p, 3)))
        .collect::<Vec<_>>();
    if listed.is_empty() { String::new() } else { format!("The residual depends on {}.", listed.join("; ")) }
}
