//! The field as tensors: forward pass and losses of a `SampleBatch`, differentiated by burn.

use burn::tensor::{
    Device, Tensor, TensorData,
    activation::{relu, sigmoid},
};

use super::burn_batch::Piece;
use super::burn_hash::hash_encode;
use super::{FieldParams, GEOMETRY_OUTPUTS, LevelLayout, SampleBatch, VIEW_COEFFICIENTS, view_coefficients};

/// Layout of the parameter tensors.
#[derive(Clone, Debug)]
pub(super) struct FieldShape {
    pub levels: Vec<LevelLayout>,
    /// `[outputs, inputs]` of every layer, geometry before color.
    pub layers: Vec<[usize; 2]>,
    pub geometry_layers: usize,
}

impl FieldShape {
    pub(crate) fn of_params(params: &FieldParams) -> Self {
        let layers = params.geometry.iter().chain(&params.color).map(|l| [l.outputs, l.inputs]);
        Self {
            levels: params.levels.clone(),
            layers: layers.collect(),
            geometry_layers: params.geometry.len(),
        }
    }
}

/// Uploads one tensor per hash level, then weights and biases of every layer, in the order of
/// [`FieldParams::flatten`].
pub(super) fn upload_tensors(shape: &FieldShape, flat: &[f32], device: &Device) -> Vec<Tensor<1>> {
    let tables = shape.levels.iter().map(|l| l.entries * super::FEATURES);
    let layers = shape.layers.iter().flat_map(|[outputs, inputs]| [outputs * inputs, *outputs]);
    let mut rest = flat;
    let tensors = tables.chain(layers).map(|len| {
        let (head, tail) = rest.split_at(len);
        rest = tail;
        float_tensor(head.to_vec(), [len], device)
    });
    tensors.collect()
}

/// Uploads floats.
fn float_tensor<const D: usize>(values: Vec<f32>, shape: [usize; D], device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), device)
}

/// Both loss terms `[1]` of one piece of a batch, divided by the counts of the whole batch.
pub(super) fn piece_losses(
    shape: &FieldShape,
    params: &[Tensor<1>],
    batch: &SampleBatch,
    piece: &Piece,
) -> (Tensor<1>, Tensor<1>) {
    let device = params[0].device();
    let n = piece.samples;
    let (tables, layers) = params.split_at(shape.levels.len());
    let (geometry, color) = layers.split_at(2 * shape.geometry_layers);
    let (geometry_shape, color_shape) = shape.layers.split_at(shape.geometry_layers);

    let points = float_tensor(piece.points.clone(), [n, 3], &device);
    let features = hash_encode(&points, tables, &shape.levels);
    let outputs = network_outputs(features, geometry, geometry_shape);
    let tsdf = outputs.clone().narrow(1, 0, 1);
    let sdf = sdf_loss(&tsdf, &float_tensor(piece.targets.clone(), [n, 4], &device))
        / (batch.rays * batch.samples_per_ray) as f32;
    let lit = piece.lit_rays.len() * piece.per_ray;
    // A color network without rows would be an error.
    if lit == 0 {
        return (sdf, Tensor::zeros([1], &device));
    }
    // Lit samples come first (see `Piece`), so the color network gets a rectangle of them.
    let appearance = outputs.narrow(0, 0, lit).narrow(1, 1, GEOMETRY_OUTPUTS - 1);
    let inputs = Tensor::cat(vec![view_harmonics(batch, piece, &device), appearance], 1);
    let colors = sigmoid(network_outputs(inputs, color, color_shape));
    (sdf, color_loss(colors, batch, piece) / (3 * batch.rays) as f32)
}

/// Rows per product; a layer is computed as a batch of products.
/// derived: the square root of a batch of 65,536, so that sums within and over groups are equally long
const GROUP_ROWS: usize = 256;

/// Layers with ReLU between them: `[points, inputs]` to `[points, outputs]`.
///
/// Rows are grouped and biases are products, because the gradient by a parameter is a sum over all rows: as
/// one product or a plain sum, a few GPU threads would add them serially.
fn network_outputs(x: Tensor<2>, params: &[Tensor<1>], shapes: &[[usize; 2]]) -> Tensor<2> {
    let [rows, inputs] = x.dims();
    let device = x.device();
    let groups = rows.div_ceil(GROUP_ROWS);
    let idle = groups * GROUP_ROWS - rows;
    let filled = if idle > 0 { Tensor::cat(vec![x, Tensor::zeros([idle, inputs], &device)], 0) } else { x };
    let mut x: Tensor<3> = filled.reshape([groups, GROUP_ROWS, inputs]);
    let ones = Tensor::ones([groups, GROUP_ROWS, 1], &device);
    for (k, (pair, &[outputs, inputs])) in params.chunks_exact(2).zip(shapes).enumerate() {
        if k > 0 {
            x = relu(x);
        }
        let weights = pair[0].clone().reshape([1, outputs, inputs]).swap_dims(1, 2);
        x = x.matmul(weights) + ones.clone().matmul(pair[1].clone().reshape([1, 1, outputs]));
    }
    let outputs = x.dims()[2];
    x.reshape([groups * GROUP_ROWS, outputs]).narrow(0, 0, rows)
}

/// Sum of the weighted terms of `SdfTarget` over the samples: `tsdf` `[samples, 1]`, `targets` as in
/// `Piece::targets`.
fn sdf_loss(tsdf: &Tensor<2>, targets: &Tensor<2>) -> Tensor<1> {
    let column = |k: usize| targets.clone().narrow(1, k, 1);
    let below = relu(column(2) - tsdf.clone());
    let empty = column(0) * below.clone();
    let surface = column(1) * (tsdf.clone() - column(2)).square();
    let background = column(3) * below.square();
    (empty + surface + background).sum()
}

/// Harmonics `[lit samples, 16]` of the rays' directions.
fn view_harmonics(batch: &SampleBatch, piece: &Piece, device: &Device) -> Tensor<2> {
    let rays = piece.lit_rays.len();
    let coefficients = piece.lit_rays.iter().flat_map(|&r| view_coefficients(batch.directions[r])).collect();
    let per_ray = float_tensor(coefficients, [rays, 1, VIEW_COEFFICIENTS], device);
    per_ray
        .expand([rays, piece.per_ray, VIEW_COEFFICIENTS])
        .reshape([rays * piece.per_ray, VIEW_COEFFICIENTS])
}

/// Sum over the lit rays and channels of `ray_weight * (sum_i color_weight_i * color_i - observed)^2`.
fn color_loss(colors: Tensor<2>, batch: &SampleBatch, piece: &Piece) -> Tensor<1> {
    let device = colors.device();
    let rays = piece.lit_rays.len();
    let per_ray = piece.per_ray;
    let weights = float_tensor(piece.color_weights.clone(), [rays, 1, per_ray], &device);
    let rendered = weights.matmul(colors.reshape([rays, per_ray, 3])).reshape([rays, 3]);
    let observed =
        float_tensor(piece.lit_rays.iter().flat_map(|&r| batch.colors[r]).collect(), [rays, 3], &device);
    let ray_weights =
        float_tensor(piece.lit_rays.iter().map(|&r| batch.ray_weights[r]).collect(), [rays, 1], &device);
    ((rendered - observed).square() * ray_weights).sum()
}
