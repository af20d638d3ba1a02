//! Gap before and after on frames unseen by any fit. See docs/method.md (15.11).

use nalgebra::Point3;

use crate::camera::{
    fit::{
        patches::patch_means,
        problem::FrameProblem,
        residual::compared_pixels,
        sample::{PixelSample, Sample},
    },
    model::{hypothesis::Hypothesis, missing::Missing, posed::PosedTwin, twin::SeenTwin},
};

/// The gap on held-out frames.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameGap {
    /// Root mean square residual of the twin's patches, a conflict counting as the gate, meters.
    pub before: f64,
    /// The same for the updated twin, meters.
    pub after: f64,
    /// Root mean square residual expected from the camera's noise alone, meters.
    pub noise_floor: f64,
    /// Share of the seen area in conflict with the twin.
    pub conflict_before: f64,
    /// The same for the updated twin.
    pub conflict_after: f64,
    /// For each run: name, `before`, `after`.
    pub runs: Vec<(String, f64, f64)>,
}

/// Residuals of a part.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartResidual {
    /// Root mean square residual of its patches, meters.
    pub rms_m: f64,
    /// Root mean square residual expected from the camera's noise alone, meters.
    pub floor_m: f64,
    /// Share of its area in conflict.
    pub conflict: f64,
    /// Box of the conflicting points, part frame, meters.
    pub bounds: Option<[[f64; 3]; 2]>,
}

#[derive(Default)]
struct Sums {
    square: f64,
    floor: f64,
    area: f64,
    conflict: f64,
}

impl Sums {
    /// Root mean square residual; a conflict counts as the gate.
    fn rms_m(&self, gate_m: f64) -> f64 {
        // (15.11)
        ((self.square + self.conflict * gate_m * gate_m) / (self.area + self.conflict).max(1e-12)).sqrt()
    }

    /// Share of the area in conflict.
    fn conflict_share(&self) -> f64 {
        self.conflict / (self.area + self.conflict).max(1e-12)
    }

    fn sum_of(all: &[Self]) -> Self {
        all.iter().fold(Self::default(), |t, s| Self {
            square: t.square + s.square,
            floor: t.floor + s.floor,
            area: t.area + s.area,
            conflict: t.conflict + s.conflict,
        })
    }
}

/// Gap of a twin and its hypothesis before and after; `missing` is part of the updated twin.
pub fn frame_gap(
    problem: &FrameProblem,
    before: (&SeenTwin, &Hypothesis),
    after: &Hypothesis,
    missing: &[Missing],
) -> FrameGap {
    let gate_m = problem.gate_m();
    let sums_before = sums_by_run(problem, before.0, before.1, &[]);
    let sums_after = sums_by_run(problem, problem.twin, after, missing);
    let total_before = Sums::sum_of(&sums_before);
    let total_after = Sums::sum_of(&sums_after);
    FrameGap {
        before: total_before.rms_m(gate_m),
        after: total_after.rms_m(gate_m),
        noise_floor: (total_after.floor / total_after.area.max(1e-12)).sqrt(),
        conflict_before: total_before.conflict_share(),
        conflict_after: total_after.conflict_share(),
        runs: problem
            .runs
            .iter()
            .zip(sums_before.iter().zip(&sums_after))
            .map(|(r, (b, a))| (r.name.clone(), b.rms_m(gate_m), a.rms_m(gate_m)))
            .collect(),
    }
}

/// Sums over the held-out frames of each run, or over all frames if none are held out. Readings of the
/// missing geometry `known` are left out.
fn sums_by_run(
    problem: &FrameProblem,
    twin: &SeenTwin,
    hypothesis: &Hypothesis,
    known: &[Missing],
) -> Vec<Sums> {
    let is_counted = |f: usize| problem.options.held_out_every == 0 || problem.is_held_out(f);
    let mut samples = compared_pixels(twin, problem.runs, &problem.pixels, hypothesis, problem.gate_m());
    let posed = PosedTwin::new(twin, problem.runs, hypothesis);
    samples.retain(|s| !known.iter().any(|m| m.covers(&posed.parts[s.run], &s.sample.measured_point())));
    let mut all: Vec<Sums> = problem.runs.iter().map(|_| Sums::default()).collect();
    for c in patch_means(twin, &posed.parts, &samples, |_, f| is_counted(f)).0 {
        let area = c.pixels as f64
            * (c.seen.depth_m / problem.runs[c.seen.run].frames[c.seen.frame].intrinsics.fx).powi(2);
        let sum = &mut all[c.seen.run];
        sum.square += area * c.residual_m.powi(2);
        sum.floor += area * c.variance_m2;
        sum.area += area;
    }
    for s in samples.iter().filter(|s| is_counted(s.frame)) {
        if matches!(s.sample, Sample::Conflict { .. }) {
            all[s.run].conflict += s.area_m2 / stride_squared(problem, s);
        }
    }
    all
}

/// Pixels represented by one sample: a square of the sampling stride.
fn stride_squared(problem: &FrameProblem, s: &PixelSample) -> f64 {
    let k = &problem.runs[s.run].frames[s.frame].intrinsics;
    let depth = match &s.sample {
        Sample::Match { seen, .. } => seen.depth_m,
        Sample::Conflict { .. } => return problem.pixels.stride_of(s.run, s.frame).pow(2) as f64,
    };
    s.area_m2 / (depth / k.fx).powi(2)
}

/// Residuals of every part over all frames.
pub fn by_part(problem: &FrameProblem, hypothesis: &Hypothesis) -> Vec<PartResidual> {
    let samples = compared_pixels(problem.twin, problem.runs, &problem.pixels, hypothesis, problem.gate_m());
    let posed = PosedTwin::new(problem.twin, problem.runs, hypothesis);
    let mut sums: Vec<(f64, f64, f64)> = vec![(0.0, 0.0, 0.0); problem.twin.parts.len()];
    for c in patch_means(problem.twin, &posed.parts, &samples, |_, _| true).0 {
        let s = &mut sums[c.seen.part];
        *s = (s.0 + c.residual_m.powi(2), s.1 + c.variance_m2, s.2 + 1.0);
    }
    let mut seen = vec![(0usize, 0usize); problem.twin.parts.len()];
    let mut points: Vec<Vec<Point3<f64>>> = vec![Vec::new(); problem.twin.parts.len()];
    for s in &samples {
        match &s.sample {
            Sample::Match { seen: at, .. } => seen[at.part].0 += 1,
            Sample::Conflict { part: Some(p), point, .. } => {
                seen[*p].1 += 1;
                points[*p].push(posed.parts[s.run][*p].inverse_transform_point(point));
            }
            Sample::Conflict { .. } => {}
        }
    }
    (0..sums.len())
        .map(|p| {
            let (square, floor, n) = sums[p];
            let all = (seen[p].0 + seen[p].1).max(1) as f64;
            PartResidual {
                rms_m: (square / n.max(1.0)).sqrt(),
                floor_m: (floor / n.max(1.0)).sqrt(),
                conflict: seen[p].1 as f64 / all,
                bounds: middle_box(&points[p]),
            }
        })
        .collect()
}

/// Box of the middle 90 % of the points along each axis.
pub fn middle_box(points: &[Point3<f64>]) -> Option<[[f64; 3]; 2]> {
    (!points.is_empty()).then(|| {
        let mut sides = [[0.0; 3]; 2];
        for k in 0..3 {
            let mut values: Vec<f64> = points.iter().map(|p| p[k]).collect();
            values.sort_unstable_by(f64::total_cmp);
            // Single stray readings would enlarge the box.
            let cut = values.len() / 20;
            sides[0][k] = values[cut];
            sides[1][k] = values[values.len() - 1 - cut];
        }
        sides
    })
}
