//! The engine against the equations, and known answers of rendering.

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::engine::{RadianceEngine, RadianceGradient};
use super::half_motion::COORDINATES;
use super::motion_adam::MotionState;
use super::ray_batch::{Ray, RayBatch};
use super::reference::{loss, two_part_loss};
use super::{HalfMotion, RadianceConfig};
use crate::reference::{Reference, field, small_config, uniform};
use crate::{EngineState, FieldParams};
use geometry::Pose;
use numeric::random::stage_rng;

/// All terms on, the color network everywhere.
fn config(parts: usize) -> RadianceConfig {
    RadianceConfig {
        field: small_config(),
        parts,
        half_side: 1.2,
        depth_weight: 0.3,
        part_entropy_weight: 0.2,
        color_threshold: 0.0,
        steps: 100,
        ..RadianceConfig::default()
    }
}

/// Fields whose densities are about what lets half of the light through.
fn fields(parts: usize) -> Vec<FieldParams> {
    let made = |k: usize| {
        let mut f = field(&small_config(), 40 + k as u64);
        f.geometry[1].biases[0] += 0.7;
        f
    };
    (0..parts).map(made).collect()
}

fn motions(parts: usize) -> Vec<HalfMotion> {
    let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.2, -0.3, 0.4));
    let all = [
        HalfMotion::Free { pose: Pose::from_parts(Vector3::new(0.05, 0.1, -0.07).into(), rotation) },
        HalfMotion::Revolute { pivot: Point3::new(0.3, -0.2, 0.1), rotation },
        HalfMotion::prismatic_start(),
    ];
    all[..parts - 1].to_vec()
}

/// Rays through the cube from all sides, with and without mask and reading, one of them empty.
fn batch(rays: usize, samples: usize, seed: u64) -> RayBatch {
    let mut rng = stage_rng(seed, "test/rays", 0);
    let mut next = move || f64::from(uniform(&mut rng));
    let mut made = Vec::new();
    let mut distances = Vec::new();
    for i in 0..rays {
        let origin = Vector3::from_fn(|_, _| next() - 0.5).normalize() * 2.5;
        let target = Vector3::from_fn(|_, _| 0.8 * (next() - 0.5));
        let step = if i == 3 { 0.0 } else { 2.0 / samples as f64 };
        made.push(Ray {
            state: i * 2 / rays,
            origin: origin.into(),
            direction: (target - origin).normalize(),
            step,
            color: [next(), next(), next()],
            object: i % 3 != 0,
            distance: (i % 3 == 1).then(|| 2.0 + next()),
        });
        distances.extend((0..samples).map(|k| 1.5 + (k as f64 + next()) * step));
    }
    RayBatch { rays: made, samples, distances }
}

fn engine(fields: &[FieldParams]) -> RadianceEngine {
    RadianceEngine::new(fields.iter().cloned().map(EngineState::untrained).collect())
}

/// Central difference of a loss; `None` at a kink, where the two one-sided differences disagree.
fn numeric(value: impl Fn(f64) -> f64, h: f64) -> Option<f64> {
    let up = value(h);
    let down = value(-h);
    let zero = value(0.0);
    let right = (up - zero) / h;
    let left = (zero - down) / h;
    ((right - left).abs() <= 1e-3 * (1e-4 + right.abs().max(left.abs()))).then_some((up - down) / (2.0 * h))
}

type Loss = dyn Fn(&[Reference<'_>], &[HalfMotion], &RayBatch, &RadianceConfig) -> f64;

/// Compares loss and gradients of the engine with a loss and its differences.
fn check(parts: usize, expected: &Loss) {
    let config = config(parts);
    let fields = fields(parts);
    let motions = motions(parts);
    let batch = batch(12, 16, 7);
    let (RadianceGradient { losses, by_pose, .. }, gradients) =
        engine(&fields).gradient(&batch, &motions, &config);
    let references = || fields.iter().map(Reference::new).collect::<Vec<_>>();
    let whole = expected(&references(), &motions, &batch, &config);
    assert!((losses.total_loss() - whole).abs() < 1e-5 * whole, "{losses:?} {whole}");
    assert!([losses.color, losses.mask, losses.depth, losses.part_entropy].iter().all(|&l| l > 1e-3));

    for (k, gradient) in gradients.iter().enumerate() {
        let mut sizes: Vec<usize> = fields[k].levels.iter().map(|l| l.entries * 2).collect();
        let layers = fields[k].geometry.iter().chain(&fields[k].color);
        sizes.extend(layers.flat_map(|l| [l.weights.len(), l.biases.len()]));
        let mut offset = 0;
        for (tensor, size) in sizes.into_iter().enumerate() {
            let here = &gradient[offset..offset + size];
            let norm = here.iter().fold(0.0f32, |a, g| a.max(g.abs()));
            assert!(norm > 0.0, "part {k}: tensor {tensor} has no gradient");
            // The largest and some others.
            let largest = here.iter().position(|g| g.abs() == norm).unwrap();
            let mut compared = 0;
            for index in [largest, 13 % size, size / 2, size - 1] {
                let value = |h: f64| {
                    let mut references = references();
                    references[k].flat[offset + index] += h;
                    expected(&references, &motions, &batch, &config)
                };
                let Some(slope) = numeric(value, 1e-6) else { continue };
                let error = (f64::from(here[index]) - slope).abs();
                assert!(
                    error < 1e-3 * slope.abs() + 1e-4 * f64::from(norm) + 1e-9,
                    "part {k} tensor {tensor} entry {index}: {} but {slope}",
                    here[index]
                );
                compared += 1;
            }
            assert!(compared > 0, "part {k} tensor {tensor}: nothing compared");
            offset += size;
        }
        assert_eq!(offset, gradient.len());
    }
    check_motions(&motions, &by_pose, |moved| expected(&references(), moved, &batch, &config));
}

/// Compares the motions' gradients with differences of a loss.
fn check_motions(
    motions: &[HalfMotion],
    by_pose: &[super::half_motion::PoseGradient],
    value: impl Fn(&[HalfMotion]) -> f64,
) {
    for (m, motion) in motions.iter().enumerate() {
        let gradient = motion.coordinate_gradient(&by_pose[m]);
        let norm = gradient.iter().fold(0.0f64, |a, g| a.max(g.abs()));
        let mut compared = 0;
        for (c, analytic) in gradient.into_iter().enumerate() {
            let nudged = |h: f64| {
                let mut change = [0.0; COORDINATES];
                change[c] = h;
                let mut moved = motions.to_vec();
                moved[m] = motion.stepped_by(&change);
                value(&moved)
            };
            // Small: hundreds of samples must not cross a cell of the grid.
            let Some(slope) = numeric(nudged, 1e-7) else { continue };
            let error = (analytic - slope).abs();
            assert!(error < 2e-3 * norm, "motion {m} coordinate {c}: {analytic} but {slope}");
            compared += usize::from(slope.abs() > 0.01 * norm);
        }
        assert!(compared > 1, "motion {m}: {compared} compared of {gradient:?}");
    }
}

#[test]
fn two_parts_have_the_loss_and_gradients_of_the_two_part_composite() {
    check(2, &|f, m, b, c| two_part_loss([&f[0], &f[1]], &m[0], b, c));
}

#[test]
fn three_parts_have_the_loss_and_gradients_of_the_equations() {
    check(3, &loss);
}

#[test]
fn four_parts_have_the_loss_and_gradients_of_the_equations() {
    check(4, &loss);
}

#[test]
fn the_two_forms_of_the_reference_agree() {
    let config = config(2);
    let fields = fields(2);
    let motions = motions(2);
    let batch = batch(12, 16, 7);
    let references: Vec<_> = fields.iter().map(Reference::new).collect();
    let many = loss(&references, &motions, &batch, &config);
    let two = two_part_loss([&references[0], &references[1]], &motions[0], &batch, &config);
    assert!((many - two).abs() < 1e-14 * many);
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let config = config(3);
    let train = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut engine = engine(&fields(3));
            let mut state = MotionState::new(motions(3));
            let step = |k: usize| engine.train_step(&batch(100, 48, 100 + k as u64), &mut state, &config, k);
            let losses: Vec<_> = (0..4).map(step).collect();
            (losses, engine.field_states(), state)
        })
    };
    let one = train(1);
    let two = train(2);
    assert!(one == two && train(3) == two);
}

/// A field of one density and one color everywhere.
fn even(exponent: f32, color: f32) -> FieldParams {
    let mut f = field(&small_config(), 1);
    let zeros = vec![0.0; f.parameter_count()];
    f.assign_values(&zeros);
    f.geometry[1].biases[0] = exponent + 1.0;
    f.color[2].biases.fill((color / (1.0 - color)).ln());
    f
}

/// Losses of one ray a state against what it is asked to show.
fn shown(fields: &[FieldParams], color: [f64; 3], object: bool, distance: Option<f64>) -> [f64; 3] {
    let config = RadianceConfig { part_entropy_weight: 0.0, half_side: 0.5, ..config(2) };
    let step = 4.0 / 512.0;
    let ray = |state: usize| Ray {
        state,
        origin: Point3::new(0.0, 0.0, -2.0),
        direction: Vector3::z(),
        step,
        color,
        object,
        distance,
    };
    let distances = (0..2).flat_map(|_| (0..512).map(|i| (f64::from(i) + 0.5) * step)).collect();
    let batch = RayBatch { rays: vec![ray(0), ray(1)], samples: 512, distances };
    let still = [HalfMotion::Free { pose: Pose::identity() }];
    let losses = engine(fields).gradient(&batch, &still, &config).0.losses;
    [losses.color, losses.mask, losses.depth]
}

#[test]
fn what_is_empty_is_white_and_a_slab_has_its_color_distance_and_opacity() {
    // Nothing: white, opacity 0 and so no loss of the mask but its margin.
    let [color, mask, depth] = shown(&[even(-60.0, 0.5), even(-60.0, 0.5)], [1.0; 3], false, None);
    assert!(color < 1e-12 && depth == 0.0);
    assert!((mask - 0.1 * -(1.0f64 - 1e-3).ln()).abs() < 1e-9);
    // The cube of half side 0.5 is dense: seen from 2 away its face is at 1.5. One sample is 1/128 long.
    for fields in [[even(9.0, 0.3), even(-60.0, 0.9)], [even(-60.0, 0.9), even(9.0, 0.3)]] {
        let [color, mask, depth] = shown(&fields, [0.3; 3], true, Some(1.5));
        assert!(color < 1e-10, "{color}");
        assert!(mask <= 0.1 * -(1.0f64 - 1e-3).ln() + 1e-9, "{mask}");
        assert!((depth / 0.3).sqrt() < 4.0 / 512.0, "{depth}");
    }
    // A slab of half the light: color and opacity between.
    let thickness = (2f64.ln()).ln() as f32;
    let [color, mask, _] = shown(&[even(thickness, 0.3), even(-60.0, 0.5)], [0.65; 3], true, None);
    assert!(color < 1e-8, "{color}");
    assert!((mask - 0.1 * 2f64.ln()).abs() < 1e-4, "{mask}");
}
