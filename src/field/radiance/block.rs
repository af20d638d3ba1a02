//! Rendering, losses and backward pass of one block of whole rays.

use std::ops::Range;

use nalgebra::Vector3;

use super::RadianceConfig;
use super::composite::{by_thickness, set_weights};
use super::loss::{RadianceLosses, RayShare, Rendered, RenderedGradient, ray_loss};
use super::ray_batch::RayBatch;
use crate::harmonics::view_gradient;
use crate::matrix::{BackwardNetwork, Network, NetworkGradient};
use crate::passes::{ColorPass, GeometryPass};
use crate::simd::{Columns, InstructionSet};
use crate::{FEATURES, GEOMETRY_OUTPUTS, VIEW_COEFFICIENTS};

/// Largest exponent of the density's derivative. derived: the published one
const SLOPE_EXPONENT: f64 = 15.0;
/// Largest exponent of a density. chosen: one step at this density is opaque, and its square is finite
const DENSITY_EXPONENT: f64 = 80.0;

/// Density per normalised unit from a network's first output: `exp(out - 1)`.
pub(super) fn density_of_output(output: f32) -> f64 {
    (f64::from(output) - 1.0).min(DENSITY_EXPONENT).exp()
}

/// One part's data of a step, shared by all blocks.
pub(super) struct PartView<'a> {
    pub network: &'a Network,
    pub backward: &'a BackwardNetwork,
    /// Encoded features, level-major, of all columns.
    pub features: &'a [f32],
    /// By column, whether the sample lies in the part's cube; outside, density is 0.
    pub inside: &'a [bool],
    /// Unit view direction of every ray in the part's canonical frame.
    pub directions: &'a [Vector3<f64>],
    /// Whether the gradient by the directions is needed.
    pub mobile: bool,
}

/// Input shared by all blocks of a step.
pub(super) struct RenderContext<'a> {
    pub isa: InstructionSet,
    pub config: &'a RadianceConfig,
    pub batch: &'a RayBatch,
    /// Weight of a ray of each state.
    pub shares: [RayShare; 2],
    pub parts: Vec<PartView<'a>>,
}

/// Where a block writes its gradient of one part.
pub(super) struct PartSlot<'a> {
    pub layers: &'a mut NetworkGradient,
    /// `padded(2 levels)` rows of the block's columns.
    pub d_features: &'a mut [f32],
    /// Gradient by the view direction of every ray of the block; unused for the static part.
    pub d_directions: &'a mut [Vector3<f64>],
}

/// Buffers for blocks of at most a number of columns.
pub(super) struct RenderScratch {
    parts: Vec<PartScratch>,
    thickness: Vec<Vec<f64>>,
    weights: Vec<Vec<f64>>,
    /// Per part: gradient by the weights, later by the thicknesses.
    gradient: Vec<Vec<f64>>,
    shown: Vec<Rendered>,
}

/// Buffers of one part.
struct PartScratch {
    geometry: GeometryPass,
    color: ColorPass,
    /// Columns with color, and their number rounded up.
    columns: Vec<usize>,
    cols: usize,
}

impl RenderScratch {
    pub(super) fn new(context: &RenderContext<'_>, widest: usize) -> Self {
        let samples = vec![vec![0.0; widest]; context.parts.len()];
        Self {
            parts: context.parts.iter().map(|p| PartScratch::new(p.network, widest)).collect(),
            thickness: samples.clone(),
            weights: samples.clone(),
            gradient: samples,
            shown: Vec::new(),
        }
    }
}

impl PartScratch {
    fn new(network: &Network, widest: usize) -> Self {
        Self {
            geometry: GeometryPass::new(network, widest),
            color: ColorPass::new(network, widest),
            columns: Vec::with_capacity(widest),
            cols: 0,
        }
    }
}

/// Trains on one block of rays: adds to the layers' gradients, writes those by the features and the
/// directions, and returns the losses.
pub(super) fn train_block(
    context: &RenderContext<'_>,
    rays: Range<usize>,
    scratch: &mut RenderScratch,
    slots: &mut [PartSlot<'_>],
) -> RadianceLosses {
    let samples = context.batch.samples;
    for k in 0..context.parts.len() {
        set_thickness(context, &rays, k, scratch);
    }
    for ray in 0..rays.len() {
        set_weights(&scratch.thickness, ray * samples..(ray + 1) * samples, &mut scratch.weights);
    }
    render_rays(context, &rays, scratch);
    let losses = by_weight(context, &rays, scratch);
    for ray in 0..rays.len() {
        let columns = ray * samples..(ray + 1) * samples;
        by_thickness(&scratch.thickness, &scratch.weights, columns, &mut scratch.gradient);
    }
    for (k, slot) in slots.iter_mut().enumerate() {
        part_backward(context, &rays, k, scratch, slot);
    }
    losses
}

/// The encoded features of a block's columns for one part.
fn block_features<'a>(context: &RenderContext<'a>, rays: &Range<usize>, part: usize) -> Columns<'a> {
    let columns = context.batch.distances.len();
    let data = context.parts[part].features;
    Columns { data: &data[rays.start * context.batch.samples..], stride: columns, rows: data.len() / columns }
}

/// Computes the optical thickness of a part's samples.
fn set_thickness(context: &RenderContext<'_>, rays: &Range<usize>, part: usize, scratch: &mut RenderScratch) {
    let samples = context.batch.samples;
    let view = &context.parts[part];
    let cols = rays.len() * samples;
    let geometry = &mut scratch.parts[part].geometry;
    geometry.forward(context.isa, view.network, block_features(context, rays, part), cols);
    let inside = &view.inside[rays.start * samples..][..cols];
    for (i, a) in scratch.thickness[part][..cols].iter_mut().enumerate() {
        let step = context.batch.rays[rays.start + i / samples].step;
        *a = if inside[i] { density_of_output(geometry.outputs[i]) * step } else { 0.0 };
    }
}

/// Renders color, opacity and distance of the rays.
fn render_rays(context: &RenderContext<'_>, rays: &Range<usize>, scratch: &mut RenderScratch) {
    let samples = context.batch.samples;
    let parts = context.parts.len();
    let cols = rays.len() * samples;
    let empty = Rendered { color: [1.0; 3], opacities: vec![0.0; parts], distance: 0.0 };
    scratch.shown.clear();
    scratch.shown.resize(rays.len(), empty);
    for (k, part) in scratch.parts.iter_mut().enumerate() {
        let view = &context.parts[k];
        let weights = &scratch.weights[k][..cols];
        let distances = &context.batch.distances[rays.start * samples..];
        for (i, (w, t)) in weights.iter().zip(distances).enumerate() {
            let shown = &mut scratch.shown[i / samples];
            shown.opacities[k] += w;
            // Distance as in docs/method.md (12.22).
            shown.distance += w * t;
        }
        part.columns.clear();
        part.columns.extend((0..cols).filter(|&i| weights[i] > context.config.color_threshold));
        if part.columns.is_empty() {
            continue;
        }
        part.cols = part.color.gather_inputs(
            &part.geometry.outputs,
            cols,
            &part.columns,
            |column| rays.start + column / samples,
            |ray| view.directions[ray].map(|x| x as f32).into(),
        );
        part.color.forward(context.isa, view.network, part.cols);
        for (i, &column) in part.columns.iter().enumerate() {
            let shown = &mut scratch.shown[column / samples];
            for (c, sum) in shown.color.iter_mut().enumerate() {
                *sum += weights[column] * (f64::from(part.color.rgb[c * part.cols + i]) - 1.0);
            }
        }
    }
}

/// Losses of the rays with their derivatives by weights and colors.
fn by_weight(
    context: &RenderContext<'_>,
    rays: &Range<usize>,
    scratch: &mut RenderScratch,
) -> RadianceLosses {
    let samples = context.batch.samples;
    let batch = context.batch;
    let mut losses = RadianceLosses::default();
    let mut by: Vec<RenderedGradient> = Vec::with_capacity(rays.len());
    for (ray, shown) in batch.rays[rays.clone()].iter().zip(&scratch.shown) {
        let (loss, gradient) = ray_loss(ray, shown, context.shares[ray.state], context.config);
        losses.add_terms(&loss);
        by.push(gradient);
    }
    let distances = &batch.distances[rays.start * samples..rays.end * samples];
    for (k, part) in scratch.parts.iter_mut().enumerate() {
        for (i, (g, t)) in scratch.gradient[k].iter_mut().zip(distances).enumerate() {
            let by = &by[i / samples];
            *g = by.opacities[k] + by.distance * t;
        }
        let cols = part.cols;
        let color = &mut part.color;
        let rows = context.parts[k].network.color[2].outputs;
        color.d_rgb[..rows * cols].fill(0.0);
        for (i, &column) in part.columns.iter().enumerate() {
            let by = &by[column / samples];
            let w = scratch.weights[k][column];
            for (c, by_color) in by.color.iter().enumerate() {
                let value = f64::from(color.rgb[c * cols + i]);
                scratch.gradient[k][column] += by_color * (value - 1.0);
                // The slope of the logistic function is v (1 - v).
                color.d_rgb[c * cols + i] = (by_color * w * value * (1.0 - value)) as f32;
            }
        }
    }
    losses
}

/// From the derivatives by colors and thicknesses to those by a part's layers, features and directions.
fn part_backward(
    context: &RenderContext<'_>,
    rays: &Range<usize>,
    k: usize,
    scratch: &mut RenderScratch,
    slot: &mut PartSlot<'_>,
) {
    let isa = context.isa;
    let samples = context.batch.samples;
    let view = &context.parts[k];
    let cols = rays.len() * samples;
    let PartScratch { geometry, color, columns, cols: color_cols } = &mut scratch.parts[k];
    geometry.d_outputs[..GEOMETRY_OUTPUTS * cols].fill(0.0);
    let inside = &view.inside[rays.start * samples..][..cols];
    for (i, g) in scratch.gradient[k][..cols].iter().enumerate() {
        if inside[i] {
            let step = context.batch.rays[rays.start + i / samples].step;
            let slope = (f64::from(geometry.outputs[i]) - 1.0).min(SLOPE_EXPONENT).exp();
            geometry.d_outputs[i] = (g * step * slope) as f32;
        }
    }
    if view.mobile {
        slot.d_directions.fill(Vector3::zeros());
    }
    if !columns.is_empty() {
        color.backward(isa, view.backward, *color_cols, slot.layers);
        let first = if view.mobile { VIEW_COEFFICIENTS } else { 0 };
        color.return_features(first, columns, *color_cols, &mut geometry.d_outputs, cols);
        if view.mobile {
            let mut by_views = vec![[0.0; VIEW_COEFFICIENTS]; rays.len()];
            for (i, &column) in columns.iter().enumerate() {
                for (row, sum) in by_views[column / samples].iter_mut().enumerate() {
                    *sum += f64::from(color.d_inputs[row * *color_cols + i]);
                }
            }
            for (i, by) in by_views.iter().enumerate() {
                let direction = view.directions[rays.start + i];
                slot.d_directions[i] = view_gradient(direction.into(), by).into();
            }
        }
    }
    let features = block_features(context, rays, k);
    debug_assert!(features.rows.is_multiple_of(FEATURES));
    geometry.backward(isa, view.backward, features, cols, slot.layers, slot.d_features);
}
