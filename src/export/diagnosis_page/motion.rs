//! Charts of positions over time: all runs, and the held-out ones as measured, by the twin and by the updated
//! twin.

use std::fmt::Write as _;

use super::{
    chart::{Axis, Chart, finite_extent, keys_of},
    words::effort_unit,
};
use gap::judge::{
    proof::{ResidualSeries, RunGap, RunSeries},
    report::{JointReport, Track},
};
use model::escape_xml;

/// Largest number of runs in the chart of all runs.
const MAX_RUNS: usize = 12;
/// Largest number of held-out runs with charts.
const MAX_HELD_OUT: usize = 3;
/// Largest number of windows shaded one by one.
const MAX_WINDOWS: usize = 120;
/// Space between runs, as a share of all of them. chosen: for the eye
const SPACE: f64 = 0.012;
/// Width of the charts. chosen: for the eye
const WIDTH: f64 = 1180.0;

/// Names of the compared motions.
#[derive(Clone, Copy)]
pub(super) struct Names {
    /// Name of the updated twin; `None` if it equals the twin.
    pub updated: Option<&'static str>,
}

/// The sections of the page on a joint's motion.
pub(super) fn motion_sections(joint: &JointReport, names: &Names) -> String {
    let mut out = all_runs(joint);
    let Some(gap) = &joint.gap else { return out };
    let drawn = joint.series.iter().zip(&gap.runs).take(MAX_HELD_OUT);
    for (series, run) in drawn {
        out.push_str(&held_out(joint, series, run, gap.noise_floor, names));
    }
    if joint.series.len() > MAX_HELD_OUT {
        let more = gap.runs.len() - MAX_HELD_OUT;
        writeln!(out, "<p class=\"soft\">{more} more held-out runs are not drawn.</p>").ok();
    }
    out
}

fn position_unit(joint: &JointReport) -> &'static str {
    if joint.turns { "rad" } else { "m" }
}

/// A chart of all runs one after the other, with the held-out ones shaded.
fn all_runs(joint: &JointReport) -> String {
    let tracks: Vec<_> = joint.tracks.iter().filter(|t| t.time_s.len() > 1).collect();
    // If there are too many, held-out runs come first: the proof rests on them.
    let mut shown: Vec<usize> = (0..tracks.len()).collect();
    shown.sort_by_key(|i| !tracks[*i].is_held_out);
    shown.truncate(MAX_RUNS);
    shown.sort_unstable();
    let tracks: Vec<_> = shown.iter().map(|i| tracks[*i]).collect();
    let total: f64 = tracks.iter().map(|t| duration_s(t)).sum();
    if tracks.is_empty() || total <= 0.0 {
        return String::new();
    }
    let space = SPACE * total;
    let end = total + space * (tracks.len() - 1) as f64;
    let y = Axis::over_values(
        format!("position, {}", position_unit(joint)),
        tracks.iter().flat_map(|t| t.position.iter()),
    );
    let x = Axis { label: "time of all runs, s".into(), range: (0.0, end) };
    let mut chart = Chart::new("measured position of all runs", (WIDTH, 150.0), x, y);
    let mut from = 0.0;
    for track in &tracks {
        let to = from + duration_s(track);
        if track.is_held_out {
            chart.push_band(from, to, "held");
        }
        let time: Vec<f64> = track.time_s.iter().map(|t| from + t - track.time_s[0]).collect();
        chart.push_curve(&time, &track.position, &[0], "measured");
        let word = if track.is_held_out { "held out: " } else { "" };
        // As many letters as fit the length of the run.
        let room = (WIDTH * 0.9 * (to - from) / end / 6.5) as usize;
        let text: String = format!("{word}{}", track.run).chars().take(room.max(1)).collect();
        chart.push_note(from, &escape_xml(&text), "over");
        from = to + space;
    }
    format!(
        "<section>\n<h3>Measured position, all runs</h3>\n{}\n{}</section>\n",
        chart.svg_text(),
        keys_of(&[("key held", "held out: no fit has read it")])
    )
}

fn duration_s(track: &Track) -> f64 {
    track.time_s[track.time_s.len() - 1] - track.time_s[0]
}

/// Charts of a held-out run.
fn held_out(joint: &JointReport, series: &RunSeries, run: &RunGap, noise: f64, names: &Names) -> String {
    let windows = &series.windows;
    let updated = names.updated.map(|name| ("key updated", name));
    let is_updated = updated.is_some();
    let mut out = format!("<section class=\"tall\">\n<h3>Held-out run {}</h3>\n", escape_xml(&run.run));
    let measured = ("key measured", "measured");
    let window = ("key window", "held-out windows: each begins in the state that fits it best");
    let title = "measured, twin and updated position over time";
    let mut chart = position_chart(title, position_unit(joint), windows);
    shade(&mut chart, windows);
    curves(&mut chart, windows, is_updated);
    out.push_str(&chart.svg_text());
    out.push_str(&motion_legend(&[measured], updated, &[window]));
    let [before, after] =
        [&windows.before, &windows.after].map(|values| values.iter().map(|r| 1e3 * r).collect::<Vec<f64>>());
    let small = if joint.turns { "mrad" } else { "mm" };
    let y = Axis::over_values(format!("residual, {small}"), before.iter().chain(&after));
    let mut chart = Chart::new("residual over time", (WIDTH, 180.0), time_axis(windows), y);
    shade(&mut chart, windows);
    chart.push_level(-1e3 * noise, 1e3 * noise, "noise");
    chart.push_curve(&windows.time_s, &before, &windows.starts, "twin");
    if is_updated {
        chart.push_curve(&windows.time_s, &after, &windows.starts, "updated");
    }
    out.push_str("<h3>Residual: measured less predicted</h3>\n");
    out.push_str(&chart.svg_text());
    out.push_str(&motion_legend(&[], updated, &[("key noise", "\u{b1} noise floor")]));
    if !series.whole.time_s.is_empty() {
        let mut chart =
            position_chart("the whole run from its first state", position_unit(joint), &series.whole);
        curves(&mut chart, &series.whole, is_updated);
        writeln!(
            out,
            "<h3>The same run predicted as a whole, from its first state by the recorded efforts ({}) alone\
             </h3>\n{}\n{}",
            effort_unit(joint.turns),
            chart.svg_text(),
            motion_legend(&[measured], updated, &[])
        )
        .ok();
    }
    out.push_str("</section>\n");
    out
}

/// A legend with the twins between other marks, given by class and text of each.
fn motion_legend(first: &[(&str, &str)], updated: Option<(&str, &str)>, last: &[(&str, &str)]) -> String {
    let mut marks = first.to_vec();
    marks.push(("key twin", "twin"));
    marks.extend(updated);
    marks.extend(last);
    keys_of(&marks)
}

fn time_axis(s: &ResidualSeries) -> Axis {
    Axis { label: "time, s".into(), range: finite_extent(s.time_s.iter()) }
}

/// An empty chart for positions over time.
fn position_chart(title: &str, unit: &str, s: &ResidualSeries) -> Chart {
    Chart::new(title, (WIDTH, 230.0), time_axis(s), position_axis(unit, s))
}

fn predicted(s: &ResidualSeries, residual: &[f64]) -> Vec<f64> {
    s.position.iter().zip(residual).map(|(y, r)| y - r).collect()
}

fn curves(chart: &mut Chart, s: &ResidualSeries, is_updated: bool) {
    chart.push_curve(&s.time_s, &s.position, &s.starts, "measured");
    chart.push_curve(&s.time_s, &predicted(s, &s.before), &s.starts, "twin");
    if is_updated {
        chart.push_curve(&s.time_s, &predicted(s, &s.after), &s.starts, "updated");
    }
}

/// The range of the measured positions, extended for a twin that diverges.
fn position_axis(unit: &str, s: &ResidualSeries) -> Axis {
    let (low, high) = finite_extent(s.position.iter());
    let all = [predicted(s, &s.before), predicted(s, &s.after)].concat();
    let (least, most) = finite_extent(all.iter());
    let room = 0.6 * (high - low);
    let pad = 0.05 * (high - low);
    let range = (least.clamp(low - room, low) - pad, most.clamp(high, high + room) + pad);
    Axis { label: format!("position, {unit}"), range }
}

/// Shades the windows.
fn shade(chart: &mut Chart, s: &ResidualSeries) {
    let ends = s.starts.iter().skip(1).copied().chain([s.time_s.len()]);
    let spans = s.starts.iter().copied().zip(ends).filter(|(a, b)| b > a);
    let spans: Vec<(f64, f64)> = spans.map(|(a, b)| (s.time_s[a], s.time_s[b - 1])).collect();
    if spans.len() > MAX_WINDOWS {
        // Too many to be seen one by one: shaded from the first to the last.
        chart.push_band(spans[0].0, spans[spans.len() - 1].1, "window");
    } else {
        spans.iter().for_each(|(a, b)| chart.push_band(*a, *b, "window"));
    }
}
