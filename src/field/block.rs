//! Forward pass, losses and backward pass of one block of whole rays, all within the cache.

use super::matrix::{BackwardNetwork, Network, NetworkGradient};
use super::passes::{ColorPass, GeometryPass};
use super::plan::{Block, Plan};
use super::simd::{Columns, InstructionSet};
use super::{FieldLosses, GEOMETRY_OUTPUTS, SampleBatch, SdfTarget};

/// Loss of one sample and its derivative by the network's TSDF `s`.
pub(super) fn sdf_loss(s: f32, target: SdfTarget) -> (f32, f32) {
    match target {
        SdfTarget::Ignore => (0.0, 0.0),
        // docs/method.md (12.4), here and below with the derivatives of (12.10).
        SdfTarget::Empty { value, weight } => {
            if s < value {
                (weight * (value - s), -weight)
            } else {
                (0.0, 0.0)
            }
        }
        // docs/method.md (12.5).
        SdfTarget::Surface { value, weight } => {
            (weight * (s - value) * (s - value), 2.0 * weight * (s - value))
        }
        // docs/method.md (12.6).
        SdfTarget::Background { value, weight } => {
            let below = s - value;
            if below < 0.0 { (weight * below * below, 2.0 * weight * below) } else { (0.0, 0.0) }
        }
    }
}

/// Buffers for blocks of at most a number of columns.
pub(super) struct Scratch {
    geometry: GeometryPass,
    color: ColorPass,
    /// Columns with color weight, by index in the block.
    columns: Vec<usize>,
}

impl Scratch {
    pub(crate) fn new(network: &Network, widest: usize) -> Self {
        Self {
            geometry: GeometryPass::new(network, widest),
            color: ColorPass::new(network, widest),
            columns: Vec::with_capacity(widest),
        }
    }
}

/// Input shared by all blocks of a step.
pub(super) struct StepContext<'a> {
    pub isa: InstructionSet,
    pub batch: &'a SampleBatch,
    pub plan: &'a Plan,
    pub network: &'a Network,
    pub backward: &'a BackwardNetwork,
}

/// Trains on one block: reads its columns of `features` (all columns of all levels) and writes the gradient
/// by them to `d_features` (`padded(2 levels)` rows of the block's columns). Adds to the layers' gradient and
/// returns the losses.
pub(super) fn train_block(
    context: &StepContext<'_>,
    block: &Block,
    features: Columns<'_>,
    scratch: &mut Scratch,
    gradient: &mut NetworkGradient,
    d_features: &mut [f32],
) -> FieldLosses {
    let StepContext { isa, network, backward, .. } = *context;
    let cols = block.cols;
    scratch.geometry.forward(isa, network, features, cols);
    // Losses, and their derivatives by the outputs; padding columns keep a derivative of 0.
    let geometry = &mut scratch.geometry;
    geometry.d_outputs[..GEOMETRY_OUTPUTS * cols].fill(0.0);
    let sdf = sdf_losses(context, block, &geometry.outputs[..cols], &mut geometry.d_outputs[..cols]);
    let color = color_losses(context, block, scratch, gradient);
    scratch.geometry.backward(isa, backward, features, cols, gradient, d_features);
    FieldLosses { sdf, color }
}

/// TSDF terms of a block and their derivatives.
fn sdf_losses(context: &StepContext<'_>, block: &Block, tsdf: &[f32], d_tsdf: &mut [f32]) -> f64 {
    let batch = context.batch;
    // Relative to all samples: omitted ones count as zero, so that all batches have the same weight.
    let share = 1.0 / (batch.rays * batch.samples_per_ray) as f32;
    let samples = &context.plan.sample[block.start..block.start + block.len];
    let mut sum = 0.0;
    for ((&sample, &s), d) in samples.iter().zip(tsdf).zip(d_tsdf) {
        let (loss, slope) = sdf_loss(s, batch.targets[sample as usize]);
        sum += f64::from(loss);
        *d = slope * share;
    }
    sum * f64::from(share)
}

/// Color term of a block: forward and backward pass of the color network where it has weight; adds to the
/// features' gradient in rows 1 to 15 of `d_outputs`.
fn color_losses(
    context: &StepContext<'_>,
    block: &Block,
    scratch: &mut Scratch,
    gradient: &mut NetworkGradient,
) -> f64 {
    let StepContext { isa, network, backward, .. } = *context;
    // Samples in free space have no color weight and are skipped.
    let batch = context.batch;
    let samples = &context.plan.sample[block.start..block.start + block.len];
    let Scratch { geometry, color, columns } = scratch;
    columns.clear();
    columns.extend((0..block.len).filter(|&c| batch.color_weights[samples[c] as usize] != 0.0));
    if columns.is_empty() {
        return 0.0;
    }
    let cols = color.gather_inputs(
        &geometry.outputs,
        block.cols,
        columns,
        |column| samples[column] as usize / batch.samples_per_ray,
        |ray| batch.directions[ray],
    );
    color.forward(isa, network, cols);
    color.d_rgb[..network.color[2].outputs * cols].fill(0.0);
    let loss = ray_colors(context, block, columns, &color.rgb, &mut color.d_rgb, cols);
    color.backward(isa, backward, cols, gradient);
    // Columns without color weight keep a zero gradient.
    color.return_features(0, columns, cols, &mut geometry.d_outputs, block.cols);
    loss
}

/// Loss of the rays' colors `sum_i w_i rgb_i` and its derivative by the network outputs before the logistic
/// function.
fn ray_colors(
    context: &StepContext<'_>,
    block: &Block,
    columns: &[usize],
    rgb: &[f32],
    d_rgb: &mut [f32],
    cols: usize,
) -> f64 {
    let StepContext { batch, plan, .. } = *context;
    let share = 1.0 / (3 * batch.rays) as f32;
    let sample = |i: usize| plan.sample[block.start + columns[i]] as usize;
    let mut sum = 0.0;
    let mut first = 0;
    while first < columns.len() {
        let ray = sample(first) / batch.samples_per_ray;
        let end = (first..columns.len())
            .find(|&i| sample(i) / batch.samples_per_ray != ray)
            .unwrap_or(columns.len());
        for channel in 0..3 {
            let values = &rgb[channel * cols..][..cols];
            let color: f32 = (first..end).map(|i| batch.color_weights[sample(i)] * values[i]).sum();
            // docs/method.md (12.8); the factor below is the slope of the logistic function, c (1 - c).
            let excess = color - batch.colors[ray][channel];
            let weight = batch.ray_weights[ray] * share;
            sum += f64::from(weight * excess * excess);
            for i in first..end {
                d_rgb[channel * cols + i] =
                    2.0 * weight * excess * batch.color_weights[sample(i)] * values[i] * (1.0 - values[i]);
            }
        }
        first = end;
    }
    sum
}
