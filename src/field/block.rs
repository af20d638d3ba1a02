//! Forward pass, losses and backward pass of one block of whole rays, all within the cache.

use super::harmonics::view_coefficients;
use super::matrix::{BackwardNetwork, COLOR_INPUTS, Network, NetworkGradient};
use super::plan::{Block, Plan};
use super::simd::{COLUMN_ALIGN, Columns, Epilogue, InstructionSet};
use super::{FieldLosses, GEOMETRY_OUTPUTS, SampleBatch, SdfTarget, VIEW_COEFFICIENTS};

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

/// Buffers for the widest block of a plan.
pub(super) struct Scratch {
    hidden: Vec<f32>,
    outputs: Vec<f32>,
    d_outputs: Vec<f32>,
    d_hidden: Vec<f32>,
    color: ColorScratch,
}

/// Buffers of the color network.
struct ColorScratch {
    /// Column in the block of every column that has color weight.
    columns: Vec<usize>,
    inputs: Vec<f32>,
    first: Vec<f32>,
    second: Vec<f32>,
    rgb: Vec<f32>,
    d_rgb: Vec<f32>,
    d_first: Vec<f32>,
    d_second: Vec<f32>,
    d_features: Vec<f32>,
}

impl Scratch {
    pub fn new(network: &Network, widest: usize) -> Self {
        let rows = |n: usize| vec![0.0; n * widest];
        let hidden = network.hidden();
        let color = ColorScratch {
            columns: Vec::with_capacity(widest),
            inputs: rows(COLOR_INPUTS),
            first: rows(hidden),
            second: rows(hidden),
            rgb: rows(network.color[2].outputs),
            d_rgb: rows(network.color[2].outputs),
            d_first: rows(hidden),
            d_second: rows(hidden),
            d_features: rows(GEOMETRY_OUTPUTS),
        };
        Self {
            hidden: rows(hidden),
            outputs: rows(GEOMETRY_OUTPUTS),
            d_outputs: rows(GEOMETRY_OUTPUTS),
            d_hidden: rows(hidden),
            color,
        }
    }
}

/// What all blocks of a step share.
pub(super) struct StepContext<'a> {
    pub isa: InstructionSet,
    pub batch: &'a SampleBatch,
    pub plan: &'a Plan,
    pub network: &'a Network,
    pub backward: &'a BackwardNetwork,
}

/// The first `rows` rows of a dense matrix with `cols` columns.
fn dense(data: &[f32], rows: usize, cols: usize) -> Columns<'_> {
    Columns { data: &data[..rows * cols], stride: cols, rows }
}

/// One block: reads its columns of `features` (all columns of all levels), writes the gradient of its
/// features to `d_features` (`padded(2 levels)` rows of the block's columns), adds to the layers' gradient,
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
    let hidden = network.hidden();
    // Forward through the geometry network.
    network.geometry[0].apply(isa, features, &mut scratch.hidden, cols, Epilogue::Relu);
    network.geometry[1].apply(
        isa,
        dense(&scratch.hidden, hidden, cols),
        &mut scratch.outputs,
        cols,
        Epilogue::Linear,
    );

    // Losses, and their derivatives by its outputs; padding columns keep a derivative of 0.
    scratch.d_outputs[..GEOMETRY_OUTPUTS * cols].fill(0.0);
    let sdf = sdf_losses(context, block, &scratch.outputs[..cols], &mut scratch.d_outputs[..cols]);
    let color =
        color_losses(context, block, &scratch.outputs, &mut scratch.d_outputs, &mut scratch.color, gradient);

    // Backward, layer by layer: first the gradient of the weights, then that of the layer's inputs.
    let d_outputs = dense(&scratch.d_outputs, GEOMETRY_OUTPUTS, cols);
    gradient.accumulate(isa, 1, d_outputs, dense(&scratch.hidden, hidden, cols), cols);
    backward.geometry[1].apply(isa, d_outputs, &mut scratch.d_hidden, cols, Epilogue::Mask(&scratch.hidden));
    let d_hidden = dense(&scratch.d_hidden, hidden, cols);
    gradient.accumulate(isa, 0, d_hidden, features, cols);
    backward.geometry[0].apply(isa, d_hidden, d_features, cols, Epilogue::Linear);
    FieldLosses { sdf, color }
}

/// TSDF terms of a block and their derivatives.
fn sdf_losses(context: &StepContext<'_>, block: &Block, tsdf: &[f32], d_tsdf: &mut [f32]) -> f64 {
    let batch = context.batch;
    // Of all samples: those that were left out count as zeros, so that batches are weighed alike.
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

/// Color term of a block: runs the color network both ways where it has weight, adds to the features'
/// gradient in rows 1 to 15 of `d_outputs`.
fn color_losses(
    context: &StepContext<'_>,
    block: &Block,
    outputs: &[f32],
    d_outputs: &mut [f32],
    scratch: &mut ColorScratch,
    gradient: &mut NetworkGradient,
) -> f64 {
    let StepContext { isa, network, backward, .. } = *context;
    // Samples in free space carry no color weight: the color network runs on the others alone.
    let Some(cols) = color_inputs(context, block, outputs, scratch) else { return 0.0 };
    let hidden = network.hidden();
    let rgb_rows = network.color[2].outputs;
    let inputs = dense(&scratch.inputs, COLOR_INPUTS, cols);
    network.color[0].apply(isa, inputs, &mut scratch.first, cols, Epilogue::Relu);
    network.color[1].apply(
        isa,
        dense(&scratch.first, hidden, cols),
        &mut scratch.second,
        cols,
        Epilogue::Relu,
    );
    network.color[2].apply(
        isa,
        dense(&scratch.second, hidden, cols),
        &mut scratch.rgb,
        cols,
        Epilogue::Linear,
    );
    isa.sigmoid(&mut scratch.rgb[..3 * cols]);

    scratch.d_rgb[..rgb_rows * cols].fill(0.0);
    let loss = ray_colors(context, block, &scratch.columns, &scratch.rgb, &mut scratch.d_rgb, cols);

    let d_rgb = dense(&scratch.d_rgb, rgb_rows, cols);
    gradient.accumulate(isa, 4, d_rgb, dense(&scratch.second, hidden, cols), cols);
    backward.color[2].apply(isa, d_rgb, &mut scratch.d_second, cols, Epilogue::Mask(&scratch.second));
    let d_second = dense(&scratch.d_second, hidden, cols);
    gradient.accumulate(isa, 3, d_second, dense(&scratch.first, hidden, cols), cols);
    backward.color[1].apply(isa, d_second, &mut scratch.d_first, cols, Epilogue::Mask(&scratch.first));
    let d_first = dense(&scratch.d_first, hidden, cols);
    gradient.accumulate(isa, 2, d_first, inputs, cols);
    backward.color[0].apply(isa, d_first, &mut scratch.d_features, cols, Epilogue::Linear);
    // Back to the columns of the block; those without color weight keep a gradient of 0.
    for feature in 0..GEOMETRY_OUTPUTS - 1 {
        let d = &mut d_outputs[(feature + 1) * block.cols..(feature + 2) * block.cols];
        for (&column, &value) in scratch.columns.iter().zip(&scratch.d_features[feature * cols..]) {
            d[column] = value;
        }
    }
    loss
}

/// Gathers the columns with color weight; returns their number rounded up, `None` if there are none.
fn color_inputs(
    context: &StepContext<'_>,
    block: &Block,
    outputs: &[f32],
    scratch: &mut ColorScratch,
) -> Option<usize> {
    let StepContext { batch, plan, .. } = *context;
    let samples = &plan.sample[block.start..block.start + block.len];
    scratch.columns.clear();
    scratch.columns.extend((0..block.len).filter(|&c| batch.color_weights[samples[c] as usize] != 0.0));
    if scratch.columns.is_empty() {
        return None;
    }
    let cols = scratch.columns.len().next_multiple_of(COLUMN_ALIGN);
    scratch.inputs[..COLOR_INPUTS * cols].fill(0.0);
    let mut view = (usize::MAX, [0.0; VIEW_COEFFICIENTS]);
    for (to, &column) in scratch.columns.iter().enumerate() {
        let ray = samples[column] as usize / batch.samples_per_ray;
        // Columns of one ray follow each other: its harmonics are computed once.
        if view.0 != ray {
            view = (ray, view_coefficients(batch.directions[ray]));
        }
        for (row, value) in view.1.iter().enumerate() {
            scratch.inputs[row * cols + to] = *value;
        }
    }
    for feature in 0..GEOMETRY_OUTPUTS - 1 {
        let from = &outputs[(feature + 1) * block.cols..];
        let row = &mut scratch.inputs[(VIEW_COEFFICIENTS + feature) * cols..][..cols];
        for (value, &column) in row.iter_mut().zip(&scratch.columns) {
            *value = from[column];
        }
    }
    Some(cols)
}

/// Loss of the rays' colors `sum_i w_i rgb_i` and its derivative by the networks' values before the logistic
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
            // docs/method.md (12.8); below the slope of the logistic function, c (1 - c).
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
