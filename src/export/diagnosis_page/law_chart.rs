//! Draws the found law through the effort that the twin lacks.

use super::{
    chart::{Axis, Chart, keys_of},
    words::{effort_unit, escaped_words, unit_text, variable_name},
};
use gap::judge::{
    law::{Law, Way},
    report::JointReport,
};

/// Largest share of the points' range by which intervals widen the axis. chosen: for the eye
const ROOM: f64 = 0.25;
/// Least half range of the effort axis, as a share of the recorded efforts. chosen: for the eye
const LEAST: f64 = 0.05;

/// The chart of a law of a joint; the law is dashed unless `is_named`.
pub(super) fn law_chart(joint: &JointReport, law: &Law, is_named: bool) -> String {
    let unit = law.variable.unit(joint.turns);
    let name = if law.effects.is_empty() {
        "What the twin lacks".to_owned()
    } else {
        law.effects.iter().map(|e| escaped_words(e)).collect::<Vec<_>>().join(" + ")
    };
    let x = Axis {
        label: format!("{}, {}", variable_name(law.variable), unit_text(unit)),
        ..Axis::over_values("", law.points.iter().map(|p| &p.x).chain(law.curves.iter().flat_map(|c| &c.x)))
    };
    let title = format!("{name}: effort against {}", variable_name(law.variable));
    let mut chart = Chart::new(title.clone(), (620.0, 400.0), x, effort_axis(joint, law));
    let dashed = if is_named { "" } else { " dashed" };
    for curve in &law.curves {
        let [low, high] = [-1.0, 1.0].map(|sign| {
            curve.effort.iter().zip(&curve.half).map(|(y, h)| y + sign * h).collect::<Vec<f64>>()
        });
        chart.push_area(&curve.x, &low, &high, &format!("interval {}", way_class(curve.way)));
    }
    // At rest, friction can be anything between its two sides.
    if let [a, b] = &law.curves[..]
        && a.way == Way::Both
    {
        chart.push_curve(&[0.0, 0.0], &[a.effort[0], b.effort[0]], &[0], &format!("law{dashed}"));
    }
    for curve in &law.curves {
        chart.push_curve(&curve.x, &curve.effort, &[0], &format!("law {}{dashed}", way_class(curve.way)));
    }
    for p in &law.points {
        chart.push_point(p.x, p.effort, p.half, &format!("seen {}", way_class(p.way)), p.is_held_out);
    }
    format!("<section>\n<h3>{title}</h3>\n{}\n{}\n</section>\n", chart.svg_text(), law_legend(law, is_named))
}

fn way_class(way: Way) -> &'static str {
    match way {
        Way::Both => "both",
        Way::Rising => "rising",
        Way::Falling => "falling",
    }
}

/// The range of the points and the law; a much wider interval is cut off.
fn effort_axis(joint: &JointReport, law: &Law) -> Axis {
    let middle: Vec<f64> = law
        .points
        .iter()
        .map(|p| p.effort)
        .chain(law.curves.iter().flat_map(|c| c.effort.iter().copied()))
        .chain([0.0])
        .collect();
    let (low, high) = super::chart::finite_extent(middle.iter());
    let room = ROOM * (high - low);
    let bound = |x: f64| x.clamp(low - room, high + room);
    let ends = law
        .points
        .iter()
        .map(|p| (p.effort, p.half))
        .chain(law.curves.iter().flat_map(|c| c.effort.iter().copied().zip(c.half.iter().copied())));
    // Efforts that are tiny relative to the recorded ones should look tiny.
    let least = LEAST * joint.coverage.effort_rms;
    let all: Vec<f64> =
        ends.flat_map(|(y, h)| [bound(y - h), bound(y + h)]).chain([low, high, -least, least]).collect();
    Axis::over_values(format!("effort that the twin lacks, {}", effort_unit(joint.turns)), all.iter())
}

fn law_legend(law: &Law, is_named: bool) -> String {
    let mut keys: Vec<(&str, &str)> = Vec::new();
    if !law.curves.is_empty() {
        keys.push(if is_named {
            ("key law", "law found, 95\u{a0}% interval shaded")
        } else {
            ("key law dashed", "what comes nearest; no name")
        });
    }
    keys.push(("dot-key", "motion of the fitted runs"));
    if law.points.iter().any(|p| p.is_held_out) {
        keys.push(("square-key", "of the held-out runs"));
    }
    if law.points.iter().any(|p| p.way != Way::Both) {
        keys.extend([("dot-key rising", "position rising"), ("dot-key falling", "falling")]);
    }
    format!(
        "{}<p class=\"soft\">Points: means, with 95\u{a0}% by the scatter of windows.</p>",
        keys_of(&keys)
    )
}
