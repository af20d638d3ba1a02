//! Positions over time: all runs, and the held-out ones as measured, as the twin and as the updated twin.

use std::fmt::Write as _;

use super::{
    chart::{Axis, Chart, extent},
    words::effort_unit,
};
use crate::{
    gap::judge::{
        proof::{ResidualSeries, RunGap, RunSeries},
        report::JointReport,
    },
    model::escape_xml,
};

/// Most runs in the picture of all runs.
const MAX_RUNS: usize = 12;
/// Most held-out runs that are drawn.
const MAX_HELD_OUT: usize = 3;
/// Most windows that are shaded one by one.
const MAX_WINDOWS: usize = 120;
/// Space between runs, as a share of all of them.
const SPACE: f64 = 0.012;
/// Width of the charts.
const WIDTH: f64 = 1180.0;

/// Names of the three motions.
pub struct Names {
    /// That of the updated twin.
    pub updated: &'static str,
}

/// The sections of a joint.
#[must_use]
pub fn motion(joint: &JointReport, names: &Names) -> String {
    let mut out = all_runs(joint);
    let Some(gap) = &joint.gap else { return out };
    let drawn = joint.series.iter().zip(&gap.runs).take(MAX_HELD_OUT);
    for (series, run) in drawn {
        out.push_str(&held_out(joint, series, run, gap.noise_floor, names));
    }
    if gap.runs.len() > MAX_HELD_OUT {
        let more = gap.runs.len() - MAX_HELD_OUT;
        writeln!(out, "<p class=\"soft\">{more} more held-out runs are not drawn.</p>").ok();
    }
    out
}

fn unit(joint: &JointReport) -> &'static str {
    if joint.turns { "rad" } else { "m" }
}

/// All runs one after the other, the held-out ones shaded.
fn all_runs(joint: &JointReport) -> String {
    let tracks: Vec<_> = joint.tracks.iter().filter(|t| t.time_s.len() > 1).collect();
    // Held-out runs first where there are too many: the proof rests on them.
    let mut shown: Vec<usize> = (0..tracks.len()).collect();
    shown.sort_by_key(|i| !tracks[*i].is_held_out);
    shown.truncate(MAX_RUNS);
    shown.sort_unstable();
    let tracks: Vec<_> = shown.iter().map(|i| tracks[*i]).collect();
    let length = |t: &&crate::gap::judge::report::Track| t.time_s[t.time_s.len() - 1] - t.time_s[0];
    let total: f64 = tracks.iter().map(length).sum();
    if tracks.is_empty() || total <= 0.0 {
        return String::new();
    }
    let space = SPACE * total;
    let end = total + space * (tracks.len() - 1) as f64;
    let y = Axis::over(format!("position, {}", unit(joint)), tracks.iter().flat_map(|t| t.position.iter()));
    let x = Axis { label: "time of all runs, s".into(), range: (0.0, end) };
    let mut chart = Chart::new("measured position of all runs", (WIDTH, 150.0), x, y);
    let mut from = 0.0;
    for track in &tracks {
        let to = from + length(track);
        if track.is_held_out {
            chart.band(from, to, "held");
        }
        let time: Vec<f64> = track.time_s.iter().map(|t| from + t - track.time_s[0]).collect();
        chart.curve(&time, &track.position, &[0], "measured");
        let word = if track.is_held_out { "held out: " } else { "" };
        // As many letters as the run is long.
        let room = (WIDTH * 0.9 * (to - from) / end / 6.5) as usize;
        let text: String = format!("{word}{}", track.run).chars().take(room.max(1)).collect();
        chart.note(from, &escape_xml(&text), "over");
        from = to + space;
    }
    format!(
        "<section>\n<h3>Measured position, all runs</h3>\n{}\n<p class=\"legend\"><i class=\"key \
         held\"></i>held out: no fit has read it</p>\n</section>\n",
        chart.svg()
    )
}

/// Charts of a held-out run.
fn held_out(joint: &JointReport, series: &RunSeries, run: &RunGap, noise: f64, names: &Names) -> String {
    let unit = unit(joint);
    let updated = names.updated;
    let legend = |first: &str| {
        format!(
            "<p class=\"legend\">{first}<i class=\"key twin\"></i>twin<i class=\"key updated\"></i>{updated}"
        )
    };
    let measured = "<i class=\"key measured\"></i>measured";
    let mut out = format!("<section>\n<h3>Held-out run {}</h3>\n", escape_xml(&run.run));
    let windows = &series.windows;
    let time = || Axis { label: "time, s".into(), range: extent(windows.time_s.iter()) };
    let mut chart = Chart::new(
        "measured, twin and updated position over time",
        (WIDTH, 230.0),
        time(),
        Axis::over(format!("position, {unit}"), windows.position.iter()),
    );
    shade(&mut chart, windows);
    curves(&mut chart, windows);
    writeln!(
        out,
        "{}\n{}<i class=\"key window\"></i>held-out windows: each begins in the state that fits it best\
         </p>",
        chart.svg(),
        legend(measured)
    )
    .ok();
    let residuals = windows.before.iter().chain(&windows.after).map(|r| 1e3 * r).collect::<Vec<_>>();
    let small = if joint.turns { "mrad" } else { "mm" };
    let mut chart = Chart::new(
        "residual over time",
        (WIDTH, 170.0),
        time(),
        Axis::over(format!("measured \u{2212} predicted, {small}"), residuals.iter()),
    );
    shade(&mut chart, windows);
    chart.level(-1e3 * noise, 1e3 * noise, "noise");
    let milli = |values: &[f64]| values.iter().map(|r| 1e3 * r).collect::<Vec<_>>();
    chart.curve(&windows.time_s, &milli(&windows.before), &windows.starts, "twin");
    chart.curve(&windows.time_s, &milli(&windows.after), &windows.starts, "updated");
    writeln!(out, "{}\n{}<i class=\"key noise\"></i>\u{b1} noise floor</p>", chart.svg(), legend("")).ok();
    let whole = &series.whole;
    if !whole.time_s.is_empty() {
        let mut chart = Chart::new(
            "the whole run from its first state",
            (WIDTH, 230.0),
            Axis { label: "time, s".into(), range: extent(whole.time_s.iter()) },
            whole_axis(unit, whole),
        );
        curves(&mut chart, whole);
        writeln!(
            out,
            "<h3>The same run from its first state to its end, by the recorded efforts ({}) alone</h3>\n{}\n\
             {}</p>",
            effort_unit(joint.turns),
            chart.svg(),
            legend(measured)
        )
        .ok();
    }
    out.push_str("</section>\n");
    out
}

fn curves(chart: &mut Chart, s: &ResidualSeries) {
    let predicted = |r: &[f64]| s.position.iter().zip(r).map(|(y, r)| y - r).collect::<Vec<f64>>();
    chart.curve(&s.time_s, &s.position, &s.starts, "measured");
    chart.curve(&s.time_s, &predicted(&s.before), &s.starts, "twin");
    chart.curve(&s.time_s, &predicted(&s.after), &s.starts, "updated");
}

/// The range of what was measured, with room for a twin that runs away.
fn whole_axis(unit: &str, whole: &ResidualSeries) -> Axis {
    let (low, high) = extent(whole.position.iter());
    let all: Vec<f64> = whole
        .position
        .iter()
        .zip(&whole.before)
        .zip(&whole.after)
        .flat_map(|((y, b), a)| [y - b, y - a])
        .collect();
    let (least, most) = extent(all.iter());
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
        // Too many to be seen one by one: from the first to the last.
        chart.band(spans[0].0, spans[spans.len() - 1].1, "window");
    } else {
        spans.iter().for_each(|(a, b)| chart.band(*a, *b, "window"));
    }
}
