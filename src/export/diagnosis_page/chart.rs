//! Curves, bands and points over two axes, as SVG.

use std::fmt::Write as _;

use super::ticks::{round_ticks, tick_labels};

/// Largest number of points of a curve: more than a printed page resolves.
const MAX_POINTS: usize = 1000;
/// Space for the numbers of the vertical axis. chosen: for the eye
const LEFT: f64 = 62.0;
/// Space beside the last tick. chosen: for the eye
const RIGHT: f64 = 10.0;
/// Space above, for labels of bands. chosen: for the eye
const TOP: f64 = 18.0;
/// Space for the numbers and the name of the horizontal axis. chosen: for the eye
const BOTTOM: f64 = 38.0;

/// An axis with the range of a quantity; its label is escaped.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    /// The quantity, with its unit.
    pub label: String,
    /// Its ends.
    pub range: (f64, f64),
}

impl Axis {
    /// An axis over all finite values, extended by a twentieth on either side.
    pub(super) fn over_values<'a>(label: impl Into<String>, values: impl Iterator<Item = &'a f64>) -> Self {
        let (low, high) = finite_extent(values);
        let pad = 0.05 * (high - low);
        Self { label: label.into(), range: (low - pad, high + pad) }
    }
}

/// Least and largest finite value; a range around zero if there is none.
pub(super) fn finite_extent<'a>(values: impl Iterator<Item = &'a f64>) -> (f64, f64) {
    let (low, high) = values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    match () {
        () if high > low => (low, high),
        () if high == low => (low - 1e-3 - 0.1 * low.abs(), low + 1e-3 + 0.1 * low.abs()),
        () => (-1.0, 1.0),
    }
}

/// The legend of a chart: the class of each mark, and its escaped text.
pub(super) fn keys_of(keys: &[(&str, &str)]) -> String {
    let mut marks = String::new();
    for (class, text) in keys {
        write!(marks, "<span><i class=\"{class}\"></i>{text}</span>").ok();
    }
    format!("<p class=\"legend\">{marks}</p>")
}

/// A chart; later elements cover earlier ones.
pub(super) struct Chart {
    title: String,
    size: (f64, f64),
    x: Axis,
    y: Axis,
    body: String,
    /// Texts drawn over the plot.
    over: String,
}

// Writing to a string cannot fail: the results below are dropped.

impl Chart {
    /// An empty chart; `title` is escaped, and read out in place of the picture.
    pub(super) fn new(title: impl Into<String>, size: (f64, f64), x: Axis, y: Axis) -> Self {
        Self { title: title.into(), size, x, y, body: String::new(), over: String::new() }
    }

    fn pixel_x(&self, x: f64) -> f64 {
        let (low, high) = self.x.range;
        LEFT + (self.size.0 - LEFT - RIGHT) * (x - low) / (high - low)
    }

    fn pixel_y(&self, y: f64) -> f64 {
        let (low, high) = self.y.range;
        let height = self.size.1 - TOP - BOTTOM;
        // Clamped far outside the plot, so a diverging motion keeps short numbers.
        TOP + (height * (high - y) / (high - low)).clamp(-height, 2.0 * height)
    }

    /// A shaded part of the horizontal axis.
    pub(super) fn push_band(&mut self, from: f64, to: f64, class: &str) {
        let left = self.pixel_x(from);
        let right = self.pixel_x(to);
        let height = self.size.1 - TOP - BOTTOM;
        writeln!(
            self.body,
            "<rect class=\"{class}\" x=\"{left:.1}\" y=\"{TOP}\" width=\"{:.1}\" height=\"{height}\"/>",
            (right - left).max(0.0)
        )
        .ok();
    }

    /// A shaded part of the vertical axis.
    pub(super) fn push_level(&mut self, from: f64, to: f64, class: &str) {
        let top = self.pixel_y(to);
        let bottom = self.pixel_y(from);
        writeln!(
            self.body,
            "<rect class=\"{class}\" x=\"{LEFT}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>",
            self.size.0 - LEFT - RIGHT,
            bottom - top
        )
        .ok();
    }

    /// A text at the top of the plot; it is escaped.
    pub(super) fn push_note(&mut self, x: f64, text: &str, class: &str) {
        let x = self.pixel_x(x);
        let y = TOP - 5.0;
        writeln!(self.over, "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y}\">{text}</text>").ok();
    }

    /// Draws a curve in pieces that begin at the indices `starts`.
    pub(super) fn push_curve(&mut self, x: &[f64], y: &[f64], starts: &[usize], class: &str) {
        let mut path = String::new();
        let ends = starts.iter().skip(1).copied().chain([x.len()]);
        let share = (MAX_POINTS as f64 / x.len().max(1) as f64).min(1.0);
        for (start, end) in starts.iter().copied().zip(ends) {
            let thin = thinned_indices(&y[start..end], ((end - start) as f64 * share) as usize);
            let points = thin.into_iter().map(|i| (self.pixel_x(x[start + i]), self.pixel_y(y[start + i])));
            push_path(&mut path, points);
        }
        if !path.is_empty() {
            writeln!(self.body, "<path class=\"{class}\" d=\"{path}\"/>").ok();
        }
    }

    /// The space between two curves.
    pub(super) fn push_area(&mut self, x: &[f64], low: &[f64], high: &[f64], class: &str) {
        let up = x.iter().zip(low).map(|(x, y)| (self.pixel_x(*x), self.pixel_y(*y)));
        let back = x.iter().zip(high).rev().map(|(x, y)| (self.pixel_x(*x), self.pixel_y(*y)));
        let mut path = String::new();
        push_path(&mut path, up.chain(back));
        writeln!(self.body, "<path class=\"{class}\" d=\"{path}Z\"/>").ok();
    }

    /// Draws a point with its interval of half width `half`; a square if `is_square`.
    pub(super) fn push_point(&mut self, x: f64, y: f64, half: f64, class: &str, is_square: bool) {
        let px = self.pixel_x(x);
        let py = self.pixel_y(y);
        let top = self.pixel_y(y + half);
        let bottom = self.pixel_y(y - half);
        if half > 0.0 {
            writeln!(self.body, "<path class=\"{class} bar-of\" d=\"M{px:.1} {top:.1}V{bottom:.1}\"/>").ok();
        }
        if is_square {
            let left = px - 2.8;
            let top = py - 2.8;
            writeln!(
                self.body,
                "<rect class=\"{class} open\" x=\"{left:.1}\" y=\"{top:.1}\" width=\"5.6\" height=\"5.6\"/>"
            )
            .ok();
        } else {
            writeln!(self.body, "<circle class=\"{class}\" cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"3\"/>").ok();
        }
    }

    /// The chart as SVG text.
    pub(super) fn svg_text(self) -> String {
        let (width, height) = self.size;
        let right = width - RIGHT;
        let bottom = height - BOTTOM;
        let mut svg = format!(
            "<svg class=\"chart\" viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{}\">\n{}",
            self.title, self.body
        );
        // Curves beyond the plot are covered; the axes come on top.
        for (x, y, w, h) in [
            (0.0, 0.0, width, TOP),
            (0.0, bottom, width, BOTTOM),
            (0.0, 0.0, LEFT, height),
            (right, 0.0, RIGHT, height),
        ] {
            writeln!(svg, "<rect class=\"card\" x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\"/>").ok();
        }
        let across = round_ticks(self.x.range.0, self.x.range.1, ((right - LEFT) / 80.0) as usize);
        for (tick, label) in across.iter().zip(tick_labels(&across)) {
            let x = self.pixel_x(*tick);
            let end = bottom + 4.0;
            writeln!(svg, "<path class=\"tick\" d=\"M{x:.1} {bottom}V{end}\"/>").ok();
            writeln!(svg, "<text class=\"mid\" x=\"{x:.1}\" y=\"{}\">{label}</text>", bottom + 16.0).ok();
        }
        let up = round_ticks(self.y.range.0, self.y.range.1, (((bottom - TOP) / 34.0) as usize).max(2));
        for (tick, label) in up.iter().zip(tick_labels(&up)) {
            let y = self.pixel_y(*tick);
            let class = if *tick == 0.0 { "zero" } else { "grid" };
            writeln!(svg, "<path class=\"{class}\" d=\"M{LEFT} {y:.1}H{right}\"/>").ok();
            writeln!(svg, "<text class=\"end\" x=\"{}\" y=\"{:.1}\">{label}</text>", LEFT - 6.0, y + 4.0)
                .ok();
        }
        writeln!(
            svg,
            "<path class=\"frame-of\" d=\"M{LEFT} {TOP}V{bottom}H{right}\"/>\n{}<text class=\"mid name\" \
             x=\"{:.1}\" y=\"{}\">{}</text>\n<text class=\"mid name\" transform=\"translate(13 {:.1}) \
             rotate(-90)\">{}</text>\n</svg>",
            self.over,
            0.5 * (LEFT + right),
            height - 5.0,
            self.x.label,
            0.5 * (TOP + bottom),
            self.y.label
        )
        .ok();
        svg
    }
}

/// Adds a line through points; points without finite coordinates break it.
fn push_path(path: &mut String, points: impl Iterator<Item = (f64, f64)>) {
    let mut is_down = false;
    for (x, y) in points {
        if x.is_finite() && y.is_finite() {
            write!(path, "{}{x:.1} {y:.1}", if is_down { 'L' } else { 'M' }).ok();
        }
        is_down = x.is_finite() && y.is_finite();
    }
}

/// Indices of about `most` samples: the least and the largest in each of equal parts, so peaks stay.
fn thinned_indices(y: &[f64], most: usize) -> Vec<usize> {
    let parts = (most / 2).max(2);
    if y.len() <= 2 * parts {
        return (0..y.len()).collect();
    }
    let mut kept = vec![0];
    for part in 0..parts {
        let range = y.len() * part / parts..y.len() * (part + 1) / parts;
        let low = range.clone().min_by(|a, b| y[*a].total_cmp(&y[*b]));
        let high = range.max_by(|a, b| y[*a].total_cmp(&y[*b]));
        kept.extend(low.into_iter().chain(high));
    }
    kept.push(y.len() - 1);
    kept.sort_unstable();
    kept.dedup();
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(low: f64, high: f64) -> Axis {
        Axis { label: "a".into(), range: (low, high) }
    }

    #[test]
    fn a_curve_runs_where_its_axes_say() {
        let mut chart = Chart::new("t", (172.0, 156.0), axis(0.0, 10.0), axis(0.0, 10.0));
        chart.push_curve(&[0.0, 5.0, 10.0], &[0.0, 10.0, f64::INFINITY], &[0], "twin");
        chart.push_band(2.0, 4.0, "window");
        let svg = chart.svg_text();
        assert!(svg.contains("d=\"M62.0 118.0L112.0 18.0L162.0 -82.0\""), "{svg}");
        assert!(svg.contains("class=\"window\" x=\"82.0\" y=\"18\" width=\"20.0\" height=\"100\""), "{svg}");
    }

    #[test]
    fn a_long_curve_keeps_its_peaks_and_few_points() {
        let mut y: Vec<f64> = (0..100_000).map(|i| (f64::from(i) * 1e-3).sin()).collect();
        (y[40_321], y[70_123]) = (5.0, -7.0);
        let kept = thinned_indices(&y, MAX_POINTS);
        assert!(kept.len() <= MAX_POINTS + 2, "{}", kept.len());
        assert!(kept.contains(&40_321) && kept.contains(&70_123) && kept.contains(&99_999));
    }

    #[test]
    fn axes_without_values_are_still_axes() {
        assert_eq!(finite_extent([f64::NAN].iter()), (-1.0, 1.0));
        let (low, high) = finite_extent([2.0, 2.0].iter());
        assert!(low < 2.0 && high > 2.0);
    }
}
