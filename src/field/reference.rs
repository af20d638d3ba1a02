//! The field and its losses once more in double precision, point by point, as the equations read; for tests.

use super::block::sdf_loss;
use super::{
    FieldConfig, FieldEngine, FieldParams, GEOMETRY_OUTPUTS, Layer, LevelLayout, SampleBatch, SdfTarget,
    view_coefficients,
};
use numeric::random::stage_rng;
use rand_core::Rng;

/// A field whose table is large enough to matter.
pub(super) fn field(config: &FieldConfig, seed: u64) -> FieldParams {
    let mut params = FieldParams::random_params(config, &mut stage_rng(seed, "test/field", 0));
    let mut rng = stage_rng(seed, "test/table", 0);
    for t in &mut params.table {
        *t = uniform(&mut rng) - 0.5;
    }
    params
}

/// Uniform in `[0, 1)`.
pub(super) fn uniform(rng: &mut impl Rng) -> f32 {
    (rng.next_u32() >> 8) as f32 / (1u32 << 24) as f32
}

/// A small field: two dense and two hashed levels.
pub(super) fn small_config() -> FieldConfig {
    FieldConfig { levels: 4, base_resolution: 4, finest_resolution: 24, log2_table_size: 10, hidden: 64 }
}

/// A batch with every kind of target, zero and non-zero color weights, and samples without any loss.
pub(super) fn batch(rays: usize, samples_per_ray: usize, seed: u64) -> SampleBatch {
    let mut rng = stage_rng(seed, "test/batch", 0);
    let n = rays * samples_per_ray;
    let mut b = SampleBatch { rays, samples_per_ray, ..SampleBatch::default() };
    for i in 0..n {
        b.points.push(std::array::from_fn(|_| uniform(&mut rng)));
        let weight = 0.5 + uniform(&mut rng);
        b.targets.push(match i % 5 {
            0 => SdfTarget::Ignore,
            1 => SdfTarget::Empty { value: 1.5 - uniform(&mut rng), weight },
            2 => SdfTarget::Background { value: uniform(&mut rng) - 0.5, weight: 100.0 * weight },
            _ => SdfTarget::Surface { value: uniform(&mut rng) * 2.0 - 1.0, weight: 6.0 * weight },
        });
        let with_color = i / samples_per_ray % 3 != 0 && i % 2 == 0;
        b.color_weights.push(if with_color { 2.0 * uniform(&mut rng) / samples_per_ray as f32 } else { 0.0 });
    }
    for _ in 0..rays {
        let v: nalgebra::Vector3<f32> =
            nalgebra::Vector3::from_fn(|_, _| uniform(&mut rng) - 0.5).normalize();
        b.directions.push([v.x, v.y, v.z]);
        b.colors.push(std::array::from_fn(|_| uniform(&mut rng)));
        b.ray_weights.push(10.0 * uniform(&mut rng));
    }
    b
}

/// A field in double precision.
pub(super) struct Reference<'a> {
    params: &'a FieldParams,
    /// All parameters in the order of [`FieldParams::flatten`].
    pub flat: Vec<f64>,
}

impl<'a> Reference<'a> {
    pub fn new(params: &'a FieldParams) -> Self {
        Self { params, flat: params.flatten().into_iter().map(f64::from).collect() }
    }

    /// Features of all levels at a point of the unit cube.
    pub fn encode(&self, unit: [f64; 3]) -> Vec<f64> {
        let mut out = Vec::new();
        for level in &self.params.levels {
            let position = unit.map(|u| u * f64::from(level.scale) + 0.5);
            let base = position.map(|p| p.floor() as usize);
            for feature in 0..2 {
                let mut sum = 0.0;
                for corner in 0..8usize {
                    let mut weight = 1.0;
                    let mut node = base;
                    for k in 0..3 {
                        let frac = position[k] - base[k] as f64;
                        let upper = corner >> k & 1 == 1;
                        weight *= if upper { frac } else { 1.0 - frac };
                        node[k] += usize::from(upper);
                    }
                    sum += weight * self.flat[level.offset + 2 * entry(level, node) + feature];
                }
                out.push(sum);
            }
        }
        out
    }

    /// Layer `index`: geometry 0 and 1, color 2 to 4.
    fn layer(&self, index: usize, x: &[f64], relu: bool) -> Vec<f64> {
        let layers: Vec<&Layer> = self.params.geometry.iter().chain(&self.params.color).collect();
        let before: usize = layers[..index].iter().map(|l| l.weights.len() + l.biases.len()).sum();
        let (w, b) = self.flat[self.params.table.len() + before..].split_at(layers[index].weights.len());
        let rows = w.chunks_exact(layers[index].inputs).zip(b);
        let value = |(w, b): (&[f64], &f64)| b + w.iter().zip(x).map(|(w, x)| w * x).sum::<f64>();
        rows.map(value).map(|y| if relu { y.max(0.0) } else { y }).collect()
    }

    /// TSDF in truncation distances and 15 features.
    pub fn geometry(&self, unit: [f64; 3]) -> Vec<f64> {
        let out = self.layer(1, &self.layer(0, &self.encode(unit), true), false);
        assert_eq!(out.len(), GEOMETRY_OUTPUTS);
        out
    }

    /// Color after the logistic function.
    pub fn color(&self, unit: [f64; 3], direction: [f64; 3]) -> Vec<f64> {
        let mut x = view_coefficients(direction).to_vec();
        x.extend_from_slice(&self.geometry(unit)[1..]);
        let hidden = self.layer(3, &self.layer(2, &x, true), true);
        self.layer(4, &hidden, false).into_iter().map(|y| 1.0 / (1.0 + (-y).exp())).collect()
    }
}

/// Table entry of a node: docs/method.md (12.2).
fn entry(level: &LevelLayout, [x, y, z]: [usize; 3]) -> usize {
    if level.hashed {
        let h = (x as u32) ^ (y as u32).wrapping_mul(2_654_435_761) ^ (z as u32).wrapping_mul(805_459_861);
        h as usize % level.entries
    } else {
        x + level.resolution * (y + level.resolution * z)
    }
}

/// TSDF and color loss of a batch.
pub(super) fn losses(field: &Reference<'_>, batch: &SampleBatch) -> (f64, f64) {
    let mut sdf = 0.0;
    let mut color_sum = 0.0;
    for ray in 0..batch.rays {
        let mut seen = [0.0; 3];
        for i in ray * batch.samples_per_ray..(ray + 1) * batch.samples_per_ray {
            let unit = batch.points[i].map(f64::from);
            let s = field.geometry(unit)[0];
            sdf += match batch.targets[i] {
                SdfTarget::Ignore => 0.0,
                SdfTarget::Empty { value, weight } => f64::from(weight) * (f64::from(value) - s).max(0.0),
                SdfTarget::Surface { value, weight } => f64::from(weight) * (s - f64::from(value)).powi(2),
                SdfTarget::Background { value, weight } => {
                    f64::from(weight) * (s - f64::from(value)).min(0.0).powi(2)
                }
            };
            if batch.color_weights[i] != 0.0 {
                for (c, v) in seen.iter_mut().zip(field.color(unit, batch.directions[ray].map(f64::from))) {
                    *c += f64::from(batch.color_weights[i]) * v;
                }
            }
        }
        if (0..batch.samples_per_ray).any(|k| batch.color_weights[ray * batch.samples_per_ray + k] != 0.0) {
            for (c, observed) in seen.iter().zip(batch.colors[ray]) {
                color_sum += f64::from(batch.ray_weights[ray]) * (c - f64::from(observed)).powi(2);
            }
        }
    }
    (sdf / (batch.rays * batch.samples_per_ray) as f64, color_sum / (3 * batch.rays) as f64)
}

/// The batch with the kept targets only, and without color unless `color`.
pub(super) fn with_losses(batch: &SampleBatch, keep: fn(&SdfTarget) -> bool, color: bool) -> SampleBatch {
    let mut batch = batch.clone();
    for (target, weight) in batch.targets.iter_mut().zip(&mut batch.color_weights) {
        if !keep(target) {
            *target = SdfTarget::Ignore;
        }
        if !color {
            *weight = 0.0;
        }
    }
    batch
}

/// Name of a loss, a batch with it alone, and whether it has color.
pub(super) type LossCase = (&'static str, SampleBatch, bool);

/// The loss terms of a batch one by one, and together.
pub(super) fn loss_cases(all: &SampleBatch) -> [LossCase; 5] {
    [
        ("empty", with_losses(all, |t| matches!(t, SdfTarget::Empty { .. }), false), false),
        ("surface", with_losses(all, |t| matches!(t, SdfTarget::Surface { .. }), false), false),
        ("background", with_losses(all, |t| matches!(t, SdfTarget::Background { .. }), false), false),
        ("color", with_losses(all, |_| false, true), true),
        ("all", all.clone(), true),
    ]
}

/// Central difference of the total loss; `None` at a kink, where the one-sided differences disagree.
fn numeric(reference: &mut Reference<'_>, batch: &SampleBatch, index: usize) -> Option<f64> {
    let value = reference.flat[index];
    let [up, down, zero] = [H, -H, 0.0].map(|delta| {
        reference.flat[index] = value + delta;
        let (sdf, color) = losses(reference, batch);
        sdf + color
    });
    let right = (up - zero) / H;
    let left = (zero - down) / H;
    ((right - left).abs() <= 1e-4 * (1e-3 + right.abs().max(left.abs()))).then_some((up - down) / (2.0 * H))
}

/// Step of central differences. chosen: balances rounding and curvature
const H: f64 = 1e-6;

/// Compares an engine's losses and gradients with the reference; gradients may be off by a share of the
/// largest of their tensor.
pub(super) fn check_gradients(
    engine: &mut dyn FieldEngine,
    params: &FieldParams,
    cases: &[LossCase],
    share: f64,
) {
    let mut sizes: Vec<usize> = params.levels.iter().map(|l| l.entries * 2).collect();
    for l in params.geometry.iter().chain(&params.color) {
        sizes.extend([l.weights.len(), l.biases.len()]);
    }
    for (name, batch, has_color) in cases {
        let (loss, gradient) = engine.loss_gradient(batch);
        let mut reference = Reference::new(params);
        let (sdf, color) = losses(&reference, batch);
        assert!(
            (loss.sdf - sdf).abs() < 1e-5 * (1.0 + sdf) && (loss.color - color).abs() < 1e-5 * (1.0 + color),
            "{name}: {loss:?} {sdf} {color}"
        );
        assert_eq!(gradient.len(), reference.flat.len());
        let mut offset = 0;
        let mut moved = 0;
        for (tensor, &size) in sizes.iter().enumerate() {
            let largest = gradient[offset..offset + size].iter().fold(0.0f32, |a, g| a.max(g.abs()));
            let mut compared = 0;
            let mut kinks = 0;
            for k in 0..size.min(24) {
                let index = offset + (k * 7919 + 13) % size;
                let Some(expected) = numeric(&mut reference, batch, index) else {
                    kinks += 1;
                    continue;
                };
                let error = (f64::from(gradient[index]) - expected).abs();
                let tolerance = 1e-4 * expected.abs() + share * f64::from(largest) + 1e-9;
                let found = gradient[index];
                assert!(error < tolerance, "{name}: tensor {tensor} at {index}: {found} but {expected}");
                compared += usize::from(expected != 0.0);
            }
            // The only entry with a gradient may be at a kink.
            let is_compared = (largest > 0.0) == (compared > 0);
            assert!(is_compared || kinks > 0, "{name}: tensor {tensor}: {compared} compared");
            moved += usize::from(largest > 0.0);
            offset += size;
        }
        // Levels and the layers of the geometry; color reaches all.
        let expected = params.levels.len() + if *has_color { 10 } else { 4 };
        assert_eq!(moved, expected, "{name}");
    }
}

#[test]
fn the_slope_of_a_loss_is_its_derivative() {
    for target in [
        SdfTarget::Ignore,
        SdfTarget::Empty { value: 1.0, weight: 2.0 },
        SdfTarget::Surface { value: 0.3, weight: 5.0 },
        SdfTarget::Background { value: 0.001, weight: 100.0 },
    ] {
        for s in [-0.7f32, -0.1, 0.2, 0.9, 1.3] {
            let h = 1e-3;
            let numeric = (sdf_loss(s + h, target).0 - sdf_loss(s - h, target).0) / (2.0 * h);
            assert!(
                (numeric - sdf_loss(s, target).1).abs() < 2e-2,
                "{target:?} at {s}: {numeric} and {}",
                sdf_loss(s, target).1
            );
        }
    }
}
