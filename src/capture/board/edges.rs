//! Where the edges of a tag run in an image, to hundredths of a pixel.

use nalgebra::{Point2, Vector2};

use super::{detection::SeenTag, gray::Gray, tag::CELLS};
use numeric::statistics::median;

/// Share of an edge at each corner that is not measured, since the other edge blurs it.
/// derived: one cell
const CORNER_SHARE: f64 = 1.0 / CELLS as f64;
/// Step of samples across an edge, pixels. chosen: a fifth of the blur, so that no edge falls between samples
const STEP_PX: f64 = 0.25;
/// Half the width of the blur of an edge, pixels.
/// chosen: half of a sensor pixel, and linear interpolation over one to either side, less its tail
const BLUR_PX: f64 = 1.25;
/// Reach of the samples to either side of an edge, pixels: a shorter one cuts the blur off, a longer one only
/// adds noise. The border is one cell wide and its other side is blurred too: where a cell is narrower than
/// twice the blur, the position of the edge is uncertain by the excess of the reach.
/// chosen: 3 pixels, more than twice the blur
const REACH_PX: [f64; 2] = [BLUR_PX, 3.0];
/// Least difference of brightness between the sides of an edge.
/// chosen: five times the noise of a camera, of 255
const LEAST_STEP: f64 = 10.0 / 255.0;
/// Fewest measured points of an edge.
const LEAST_PLACES: usize = 5;
/// Share of independent points: points a pixel apart share half of their samples.
/// chosen: linear interpolation over two pixels along and across
const INDEPENDENT: f64 = 0.5;
/// Least standard deviation of an edge, pixels: lens models leave such errors.
/// chosen: a fifth of the reprojection error of good calibrations
const FLOOR_PX: f64 = 0.03;
/// Points further than this many robust standard deviations from the line are outliers.
/// chosen: 0.3 % of a normal distribution lie beyond
const GATE: f64 = 3.0;
/// Rounds of the line fit, each with the outliers of the previous one removed.
const ROUNDS: usize = 3;

/// A point on an edge of a tag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EdgePoint {
    pub tag: u16,
    /// Index of the corner where the edge begins.
    pub edge: usize,
    pub at: Point2<f64>,
    /// Standard deviation across the edge, pixels.
    pub sigma_px: f64,
}

/// Two points with independent errors on each edge of a tag, both on its least squares line.
pub(super) fn edge_points(gray: &Gray, seen: &SeenTag) -> Vec<EdgePoint> {
    let mut all = Vec::new();
    for edge in 0..4 {
        let [from, to] = [seen.corners[edge], seen.corners[(edge + 1) % 4]];
        let across_px = area_px(&seen.corners) / (to - from).norm().max(1.0);
        let free_px = across_px / CELLS as f64 - BLUR_PX;
        let reach_px = free_px.clamp(REACH_PX[0], REACH_PX[1]);
        if let Some((places, sigma_px)) = brightness_line(gray, from, to, reach_px) {
            let sigma_px = sigma_px.hypot((reach_px - free_px).max(0.0));
            all.extend(places.map(|at| EdgePoint { tag: seen.tag, edge, at, sigma_px }));
        }
    }
    all
}

/// Area of a quadrilateral.
fn area_px(corners: &[Point2<f64>; 4]) -> f64 {
    let [a, b, c, d] = corners;
    0.5 * (c - a).perp(&(d - b)).abs()
}

/// Fits a line to the edge between two corners: two of its points, and their standard deviation, pixels.
fn brightness_line(
    gray: &Gray,
    from: Point2<f64>,
    to: Point2<f64>,
    reach_px: f64,
) -> Option<([Point2<f64>; 2], f64)> {
    let way = to - from;
    let length = way.norm();
    let along = way / length.max(1e-9);
    // Corners run clockwise as seen: the outside lies left of the way.
    let outward = Vector2::new(along.y, -along.x);
    let first = CORNER_SHARE * length;
    let count = (length - 2.0 * first).floor().max(0.0) as usize + 1;
    // Offset along the outward normal at a point of the edge: a + b (s - middle).
    let middle = 0.5 * length;
    let mut a = 0.0;
    let mut b = 0.0;
    let mut spread = 0.0;
    let mut sigma_px = 0.0;
    for round in 0..ROUNDS {
        // In the first round the line is known to about a pixel.
        let reach_px = if round == 0 { reach_px + 1.0 } else { reach_px };
        let mut places: Vec<[f64; 2]> = (0..count)
            .filter_map(|k| {
                let s = first + (k as f64 + 0.5) * (length - 2.0 * first) / count as f64 - middle;
                let about = a + b * s;
                let at = from + along * (s + middle) + outward * about;
                Some([s, about + brightness_step(gray, &at, &outward, reach_px)?])
            })
            .collect();
        let off = |[s, d]: &[f64; 2]| (d - a - b * s).abs();
        if round > 0 {
            let gate = GATE * 1.5 * median(places.iter().map(off).collect())?.max(FLOOR_PX);
            places.retain(|p| off(p) <= gate);
        }
        if places.len() < LEAST_PLACES {
            return None;
        }
        let n = places.len() as f64;
        let [mean_s, mean_d] = [0, 1].map(|k| places.iter().map(|p| p[k]).sum::<f64>() / n);
        let squares: f64 = places.iter().map(|p| (p[0] - mean_s).powi(2)).sum();
        let product: f64 = places.iter().map(|p| (p[0] - mean_s) * (p[1] - mean_d)).sum();
        b = product / squares.max(1e-9);
        a = mean_d - b * mean_s;
        let left: f64 = places.iter().map(|p| (p[1] - a - b * p[0]).powi(2)).sum();
        // One standard deviation of the points to either side of their middle, the errors of the line are
        // independent.
        spread = (squares / n).sqrt();
        sigma_px = (2.0 * left / (n - 2.0) / (INDEPENDENT * n)).sqrt().hypot(FLOOR_PX);
    }
    let place = |s: f64| from + along * (s + middle) + outward * (a + b * s);
    Some(([place(-spread), place(spread)], sigma_px))
}

/// Offset of the edge along the outward direction, pixels.
fn brightness_step(gray: &Gray, at: &Point2<f64>, outward: &Vector2<f64>, reach_px: f64) -> Option<f64> {
    let steps = (reach_px / STEP_PX).round() as i32;
    let value = |t: f64| gray.value_at(at.x + outward.x * t, at.y + outward.y * t);
    let mut sum = 0.0;
    let mut moment = 0.0;
    let mut before = value(-(f64::from(steps) + 0.5) * STEP_PX)?;
    for k in -steps..=steps {
        let here = value((f64::from(k) + 0.5) * STEP_PX)?;
        sum += here - before;
        moment += f64::from(k) * STEP_PX * (here - before);
        before = here;
    }
    let offset = moment / sum;
    (sum >= LEAST_STEP && offset.abs() <= reach_px).then_some(offset)
}
