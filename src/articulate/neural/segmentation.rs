//! The soft part segmentation field of one state (docs/method.md 12.7): the features of a dense grid and the
//! position go through layers `23 -> 64 -> 64 -> parts` with ReLU; softmax is applied outside. Forward and
//! backward passes are written by hand.

use rand_core::Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::neural::{
    dense_kernel::{multiply, multiply_transposed},
    feature_grid::{Cell, FEATURES},
};
use numeric::random::{STREAM_STEP, split_mix};

/// Width of the network's input: grid features, x, y, z, and one zero to fill a vector register.
const INPUTS: usize = 24;
/// Width of both hidden layers.
const HIDDEN: usize = 64;
/// Points per work item. Fixed, so sums have the same order for every number of threads.
const CHUNK: usize = 256;

/// A dense layer, weights input-major: `y[o] = biases[o] + sum_i x[i] weights[i * outputs + o]`. The output
/// width is a multiple of 8.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Dense {
    /// Input width.
    pub inputs: usize,
    /// Output width.
    pub outputs: usize,
    /// `inputs * outputs` weights.
    pub weights: Vec<f32>,
    /// `outputs` biases.
    pub biases: Vec<f32>,
}

impl Dense {
    /// A layer with weights and biases uniform in `+-1/sqrt(fan_in)`; rows of unused inputs and columns of
    /// unused outputs are zero.
    fn random_layer(
        inputs: usize,
        outputs: usize,
        used_inputs: usize,
        used_outputs: usize,
        rng: &mut impl Rng,
    ) -> Self {
        let bound = 1.0 / (used_inputs as f32).sqrt();
        // Drawn for used values only, so padding does not change the initial values.
        let mut draw = || ((rng.next_u32() >> 8) as f32 / (1u32 << 23) as f32 - 1.0) * bound;
        let mut layer = Self::zeros(inputs, outputs);
        for i in 0..used_inputs {
            for o in 0..used_outputs {
                layer.weights[i * outputs + o] = draw();
            }
        }
        for b in &mut layer.biases[..used_outputs] {
            *b = draw();
        }
        layer
    }

    fn zeros(inputs: usize, outputs: usize) -> Self {
        Self { inputs, outputs, weights: vec![0.0; inputs * outputs], biases: vec![0.0; outputs] }
    }

    fn forward(&self, x: &[f32], y: &mut [f32], relu: bool) {
        // The product is added to existing values, so the biases are written first.
        for row in y.chunks_exact_mut(self.outputs) {
            row.copy_from_slice(&self.biases);
        }
        multiply(x, self.inputs, &self.weights, self.outputs, y);
        if relu {
            y.iter_mut().for_each(|v| *v = v.max(0.0));
        }
    }

    /// Adds the gradients of a chunk by the weights and biases.
    fn add_gradient(&mut self, x: &[f32], by_y: &[f32]) {
        multiply_transposed(x, self.inputs, by_y, self.outputs, &mut self.weights);
        for row in by_y.chunks_exact(self.outputs) {
            self.biases.iter_mut().zip(row).for_each(|(b, g)| *b += g);
        }
    }

    fn transposed_weights(&self) -> Vec<f32> {
        let mut t = vec![0.0; self.weights.len()];
        for i in 0..self.inputs {
            for o in 0..self.outputs {
                t[o * self.inputs + i] = self.weights[i * self.outputs + o];
            }
        }
        t
    }
}

/// Parameters of the segmentation field of one state, over the normalised cube `[-1, 1]^3`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SegmentationField {
    /// Number of parts; part 0 is the static one.
    pub parts: usize,
    /// Grid nodes along each side of the cube.
    pub nodes: usize,
    /// Grid features, x fastest: 20 floats a node.
    pub grid: Vec<f32>,
    /// The three layers; the last one's output width is the number of parts rounded up to a multiple of 8.
    pub layers: [Dense; 3],
}

/// Values of a forward pass that the backward pass needs.
#[derive(Default)]
pub(crate) struct Activations {
    inputs: Vec<f32>,
    hidden: [Vec<f32>; 2],
    /// `stride` logits a point; the first `parts` count.
    pub logits: Vec<f32>,
    /// Width of a row of `logits`.
    pub stride: usize,
}

/// Gradients by the parameters of one field. The grid's gradient accumulates; see
/// [`SegmentationField::backward`].
pub(crate) struct SegmentationGradient {
    /// Gradient by the grid features.
    pub grid: Vec<f32>,
    /// Nodes that have had a gradient at any time.
    pub touched: Vec<bool>,
    /// Gradient by the layers.
    pub layers: [Dense; 3],
    /// Buffers of an earlier forward pass, for reuse.
    pub spare: Activations,
}

impl SegmentationField {
    /// A new field: grid features zero, layers uniform in `+-1/sqrt(inputs)`.
    pub(crate) fn random_field(parts: usize, nodes: usize, rng: &mut impl Rng) -> Self {
        // Rounded up to whole vector registers; the unused outputs stay zero.
        let outputs = parts.next_multiple_of(8);
        let layers = [
            Dense::random_layer(INPUTS, HIDDEN, INPUTS - 1, HIDDEN, rng),
            Dense::random_layer(HIDDEN, HIDDEN, HIDDEN, HIDDEN, rng),
            Dense::random_layer(HIDDEN, outputs, HIDDEN, parts, rng),
        ];
        Self { parts, nodes, grid: vec![0.0; nodes * nodes * nodes * FEATURES], layers }
    }

    /// Whether another field has the same number of parts, nodes and units.
    pub(crate) fn same_shape(&self, other: &Self) -> bool {
        let mut layers = self.layers.iter().zip(&other.layers);
        (self.parts, self.nodes, self.grid.len()) == (other.parts, other.nodes, other.grid.len())
            && layers.all(|(a, b)| a.weights.len() == b.weights.len() && a.biases.len() == b.biases.len())
    }

    /// A gradient of this field's shape, all zero.
    pub(crate) fn zero_gradient(&self) -> SegmentationGradient {
        SegmentationGradient {
            grid: vec![0.0; self.grid.len()],
            touched: vec![false; self.grid.len() / FEATURES],
            layers: self.zero_layers(),
            spare: Activations::default(),
        }
    }

    fn zero_layers(&self) -> [Dense; 3] {
        std::array::from_fn(|k| Dense::zeros(self.layers[k].inputs, self.layers[k].outputs))
    }

    /// Logits at normalised points, with all values for the backward pass; the buffers of `spare` are reused.
    pub(crate) fn forward(&self, points: &[[f32; 3]], spare: Activations) -> Activations {
        let n = points.len();
        let stride = self.layers[2].outputs;
        let Activations { mut inputs, mut hidden, mut logits, .. } = spare;
        for (buffer, width) in [(&mut inputs, INPUTS), (&mut logits, stride)]
            .into_iter()
            .chain(hidden.iter_mut().map(|h| (h, HIDDEN)))
        {
            buffer.resize(n * width, 0.0);
        }
        let [first, second] = &mut hidden;
        (
            points.par_chunks(CHUNK),
            inputs.par_chunks_mut(CHUNK * INPUTS),
            first.par_chunks_mut(CHUNK * HIDDEN),
        )
            .into_par_iter()
            .zip(
                (second.par_chunks_mut(CHUNK * HIDDEN), logits.par_chunks_mut(CHUNK * stride))
                    .into_par_iter(),
            )
            .for_each(|((points, x, h1), (h2, y))| {
                for (p, row) in points.iter().zip(x.chunks_exact_mut(INPUTS)) {
                    Cell::cell_of(self.nodes, *p).gather(&self.grid, row);
                    row[FEATURES..FEATURES + 3].copy_from_slice(p);
                    // The buffer may hold values of an earlier pass.
                    row[FEATURES + 3..].fill(0.0);
                }
                self.layers[0].forward(x, h1, true);
                self.layers[1].forward(h1, h2, true);
                self.layers[2].forward(h2, y, false);
            });
        Activations { inputs, hidden, logits, stride }
    }

    /// Back-propagates `by_logits` (row width `activations.stride`, zero beyond the parts): adds to
    /// `gradient` and returns the gradient by every normalised point. Consumes the activations.
    pub(crate) fn backward(
        &self,
        points: &[[f32; 3]],
        activations: Activations,
        by_logits: &[f32],
        gradient: &mut SegmentationGradient,
    ) -> Vec<[f32; 3]> {
        let Activations { inputs: mut both, hidden, logits, stride } = activations;
        let back = [
            self.layers[0].transposed_weights(),
            self.layers[1].transposed_weights(),
            self.layers[2].transposed_weights(),
        ];
        let mut by_points = vec![[0.0; 3]; points.len()];
        let sums: Vec<[Dense; 3]> =
            (points.par_chunks(CHUNK), by_points.par_chunks_mut(CHUNK), both.par_chunks_mut(CHUNK * INPUTS))
                .into_par_iter()
                .enumerate()
                .map(|(chunk, (points, by_points, x))| {
                    let first = chunk * CHUNK;
                    let end = first + points.len();
                    let h1 = &hidden[0][first * HIDDEN..end * HIDDEN];
                    let h2 = &hidden[1][first * HIDDEN..end * HIDDEN];
                    let by_y = &by_logits[first * stride..end * stride];
                    let mut layers = self.zero_layers();
                    layers[2].add_gradient(h2, by_y);
                    let by_h2 = through_relu(by_y, stride, &back[2], h2);
                    layers[1].add_gradient(h1, &by_h2);
                    let by_h1 = through_relu(&by_h2, HIDDEN, &back[1], h1);
                    layers[0].add_gradient(x, &by_h1);
                    // From here on, `x` holds the gradient by the inputs.
                    x.fill(0.0);
                    multiply(&by_h1, HIDDEN, &back[0], INPUTS, x);
                    for ((p, g), row) in points.iter().zip(by_points).zip(x.chunks_exact(INPUTS)) {
                        *g = Cell::cell_of(self.nodes, *p).by_position(&self.grid, &row[..FEATURES]);
                        g.iter_mut().zip(&row[FEATURES..FEATURES + 3]).for_each(|(g, direct)| *g += direct);
                    }
                    layers
                })
                .collect();
        // Summed in the order of the chunks, independent of the number of threads.
        for layers in &sums {
            for (total, part) in gradient.layers.iter_mut().zip(layers) {
                total.weights.iter_mut().zip(&part.weights).for_each(|(t, p)| *t += p);
                total.biases.iter_mut().zip(&part.biases).for_each(|(t, p)| *t += p);
            }
        }
        // Several points may share a node, so this runs on one thread.
        for (p, row) in points.iter().zip(both.chunks_exact(INPUTS)) {
            Cell::cell_of(self.nodes, *p).scatter(
                &row[..FEATURES],
                &mut gradient.grid,
                &mut gradient.touched,
            );
        }
        gradient.spare = Activations { inputs: both, hidden, logits, stride };
        by_points
    }

    /// Part probabilities without noise at normalised points, `parts` values a point.
    pub(crate) fn probabilities(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let mut all = Vec::with_capacity(points.len() * self.parts);
        // Blocks keep the activations of a large query small.
        let mut spare = Activations::default();
        for block in points.chunks(64 * CHUNK) {
            spare = self.forward(block, spare);
            all.extend(softmax(&spare, self.parts, None));
        }
        all
    }
}

/// `by_x = by_y * transposed weights`, zero where the ReLU was off.
fn through_relu(by_y: &[f32], outputs: usize, transposed: &[f32], x: &[f32]) -> Vec<f32> {
    let mut by_x = vec![0.0; x.len()];
    multiply(by_y, outputs, transposed, HIDDEN, &mut by_x);
    by_x.iter_mut().zip(x).for_each(|(g, x)| *g = if *x > 0.0 { *g } else { 0.0 });
    by_x
}

/// Softmax of the logits, plus noise (`parts` values a point) if given; returns `parts` probabilities a
/// point.
pub(crate) fn softmax(activations: &Activations, parts: usize, noise: Option<&[f32]>) -> Vec<f32> {
    let mut p = Vec::with_capacity(activations.logits.len() / activations.stride * parts);
    for (i, row) in activations.logits.chunks_exact(activations.stride).enumerate() {
        let start = p.len();
        p.extend_from_slice(&row[..parts]);
        let row = &mut p[start..];
        if let Some(noise) = noise {
            row.iter_mut().zip(&noise[i * parts..]).for_each(|(v, g)| *v += g);
        }
        // With the largest logit subtracted, no exponential overflows.
        let top = row.iter().fold(f32::NEG_INFINITY, |a, b| a.max(*b));
        row.iter_mut().for_each(|v| *v = (*v - top).exp());
        let sum: f32 = row.iter().sum();
        row.iter_mut().for_each(|v| *v /= sum);
    }
    p
}

/// Turns a gradient by probabilities (`parts` values a point) into one by logits (`stride` values a point,
/// zero beyond the parts).
pub(crate) fn softmax_backward(
    probabilities: &[f32],
    by_probabilities: &[f32],
    parts: usize,
    stride: usize,
) -> Vec<f32> {
    let mut by_logits = vec![0.0; probabilities.len() / parts * stride];
    let rows = probabilities.chunks_exact(parts).zip(by_probabilities.chunks_exact(parts));
    for ((p, g), out) in rows.zip(by_logits.chunks_exact_mut(stride)) {
        let mean: f32 = p.iter().zip(g).map(|(p, g)| p * g).sum();
        for k in 0..parts {
            out[k] = p[k] * (g[k] - mean);
        }
    }
    by_logits
}

/// Gumbel(0, 1) noise that depends only on the index of its logit, not on other queries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct GumbelNoise {
    /// Key of the noise; `None` means no noise.
    pub key: Option<u64>,
}

impl GumbelNoise {
    /// Noise of a logit, identified by a group of points and an index in it.
    pub(crate) fn noise_at(self, group: u64, index: u64) -> f32 {
        let Some(key) = self.key else { return 0.0 };
        // SplitMix64 at position `index` of the stream of the group.
        let x = split_mix(key.wrapping_add((group << 48 | index).wrapping_mul(STREAM_STEP)));
        // 23 bits: adding one half is exact, and the result is never 0 or 1.
        let uniform = ((x >> 41) as f32 + 0.5) / (1u32 << 23) as f32;
        // docs/method.md (12.11).
        -(-uniform.ln()).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    /// The definition of the field in f64: probabilities at one point, with `grid[g]` changed by a step.
    fn reference(
        f: &SegmentationField,
        point: [f64; 3],
        (layer, weight, bias, node): (usize, usize, usize, usize),
        step: f64,
    ) -> Vec<f64> {
        let scale = 0.5 * (f.nodes - 1) as f64;
        let mut x = vec![0.0; INPUTS];
        let g = point.map(|p| (p + 1.0) * scale);
        let corner = g.map(|g| (g as usize).min(f.nodes - 2));
        for k in 0..8 {
            let mut w = 1.0;
            let mut index = 0;
            for axis in (0..3).rev() {
                let t = g[axis] - corner[axis] as f64;
                w *= if k >> axis & 1 == 1 { t } else { 1.0 - t };
                index = index * f.nodes + corner[axis] + (k >> axis & 1);
            }
            for (j, x) in x[..FEATURES].iter_mut().enumerate() {
                let i = index * FEATURES + j;
                *x += w * (f64::from(f.grid[i]) + if i == node { step } else { 0.0 });
            }
        }
        x[FEATURES..FEATURES + 3].copy_from_slice(&point);
        for (k, l) in f.layers.iter().enumerate() {
            let mut y = Vec::new();
            for o in 0..l.outputs {
                let mut sum = f64::from(l.biases[o]) + if k == layer && o == bias { step } else { 0.0 };
                for (i, x) in x.iter().enumerate() {
                    let w = i * l.outputs + o;
                    sum += x * (f64::from(l.weights[w]) + if k == layer && w == weight { step } else { 0.0 });
                }
                y.push(if k < 2 { sum.max(0.0) } else { sum });
            }
            x = y;
        }
        let e: Vec<f64> = x[..f.parts].iter().map(|v| v.exp()).collect();
        let sum: f64 = e.iter().sum();
        e.iter().map(|v| v / sum).collect()
    }

    /// A scalar of the probabilities at some points, and its gradient by everything.
    #[test]
    fn gradients_agree_with_central_differences() {
        const NONE: usize = usize::MAX;
        let mut rng = stage_rng(3, "test", 0);
        let mut field = SegmentationField::random_field(3, 9, &mut rng);
        let mut draw = || (rng.next_u32() >> 8) as f32 / (1u32 << 23) as f32 - 1.0;
        field.grid.iter_mut().for_each(|g| *g = 0.5 * draw());
        let points: Vec<[f32; 3]> = (0..300).map(|_| [draw(), draw(), draw()]).collect();
        let weights: Vec<f32> = (0..points.len() * 3).map(|_| draw()).collect();
        let activations = field.forward(&points, Activations::default());
        let p = softmax(&activations, 3, None);
        let by_logits = softmax_backward(&p, &weights, 3, activations.stride);
        let mut gradient = field.zero_gradient();
        let by_points = field.backward(&points, activations, &by_logits, &mut gradient);

        let one = |i: usize, point: [f64; 3], what, step| -> f64 {
            reference(&field, point, what, step)
                .iter()
                .zip(&weights[i * 3..])
                .map(|(p, w)| p * f64::from(*w))
                .sum()
        };
        let check = |analytic: f32, what: (usize, usize, usize, usize)| {
            let value = |step| -> f64 {
                points.iter().enumerate().map(|(i, p)| one(i, p.map(f64::from), what, step)).sum()
            };
            let numeric = (value(1e-6) - value(-1e-6)) / 2e-6;
            assert!(
                (numeric - f64::from(analytic)).abs() < 1e-4 + 1e-4 * numeric.abs(),
                "{what:?}: {analytic} against {numeric}"
            );
        };
        for (layer, l) in gradient.layers.iter().enumerate() {
            (0..l.weights.len()).step_by(97).for_each(|i| check(l.weights[i], (layer, i, NONE, NONE)));
            let used = if layer == 2 { 3 } else { HIDDEN };
            (0..used).step_by(7).for_each(|i| check(l.biases[i], (layer, NONE, i, NONE)));
        }
        (0..field.grid.len()).step_by(487).for_each(|i| check(gradient.grid[i], (NONE, NONE, NONE, i)));
        for i in (0..points.len()).step_by(7) {
            for k in 0..3 {
                let at = |step: f64| {
                    let mut moved = points[i].map(f64::from);
                    moved[k] += step;
                    one(i, moved, (NONE, NONE, NONE, NONE), 0.0)
                };
                let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
                assert!(
                    (numeric - f64::from(by_points[i][k])).abs() < 1e-4 + 1e-4 * numeric.abs(),
                    "{} {numeric}",
                    by_points[i][k]
                );
            }
        }
    }

    #[test]
    fn noise_has_the_gumbel_mean() {
        let noise = GumbelNoise { key: Some(5) };
        let mean = (0..100_000).map(|i| f64::from(noise.noise_at(1, i))).sum::<f64>() / 1e5;
        assert!((mean - 0.5772).abs() < 0.02, "{mean}");
        assert!((0..100_000).all(|i| noise.noise_at(0, i).is_finite()));
        assert_eq!(GumbelNoise { key: None }.noise_at(1, 2), 0.0);
    }
}
