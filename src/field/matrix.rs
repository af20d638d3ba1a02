//! Layers packed for the matrix kernels, and their gradients.

use super::simd::{Columns, Epilogue, InstructionSet};
use super::{FieldParams, GEOMETRY_OUTPUTS, Layer, VIEW_COEFFICIENTS};

/// Rows of the color network's input: view coefficients, features, and a row of zeros.
pub(super) const COLOR_INPUTS: usize = VIEW_COEFFICIENTS + GEOMETRY_OUTPUTS;

/// Rounds up to whole register tiles.
pub(super) fn padded_rows(rows: usize) -> usize {
    rows.next_multiple_of(4)
}

/// A row-major matrix `[outputs][inputs]`; rows beyond the layer's outputs and columns beyond its inputs are
/// 0.
pub(super) struct Matrix {
    pub outputs: usize,
    pub inputs: usize,
    weights: Vec<f32>,
    biases: Option<Vec<f32>>,
}

impl Matrix {
    /// A layer with outputs padded to whole tiles and inputs padded to `inputs`.
    pub(crate) fn packed_layer(layer: &Layer, inputs: usize) -> Self {
        let outputs = padded_rows(layer.outputs);
        let mut weights = vec![0.0; outputs * inputs];
        for (row, source) in weights.chunks_exact_mut(inputs).zip(layer.weights.chunks_exact(layer.inputs)) {
            row[..layer.inputs].copy_from_slice(source);
        }
        let mut biases = layer.biases.clone();
        biases.resize(outputs, 0.0);
        Self { outputs, inputs, weights, biases: Some(biases) }
    }

    /// The transposed weights from input row `from` on, without biases, for the backward pass.
    pub(crate) fn transposed(&self, from: usize) -> Self {
        let outputs = padded_rows(self.inputs - from);
        let mut weights = vec![0.0; outputs * self.outputs];
        for (o, row) in self.weights.chunks_exact(self.inputs).enumerate() {
            for (k, &w) in row[from..].iter().enumerate() {
                weights[k * self.outputs + o] = w;
            }
        }
        Self { outputs, inputs: self.outputs, weights, biases: None }
    }

    /// The weights of a range of inputs, without biases.
    pub(crate) fn input_columns(&self, range: std::ops::Range<usize>) -> Self {
        let weights =
            self.weights.chunks_exact(self.inputs).flat_map(|row| &row[range.clone()]).copied().collect();
        Self { outputs: self.outputs, inputs: range.len(), weights, biases: None }
    }

    /// `y = epilogue(W x + b)`; `y` has `outputs` rows of `cols` floats.
    pub(crate) fn apply_affine(
        &self,
        isa: InstructionSet,
        x: Columns<'_>,
        y: &mut [f32],
        cols: usize,
        epilogue: Epilogue<'_>,
    ) {
        isa.matmul(&self.weights, self.biases.as_deref(), x, y, cols, epilogue);
    }

    /// `y = epilogue(W x)`.
    pub(crate) fn apply_linear(
        &self,
        isa: InstructionSet,
        x: Columns<'_>,
        y: &mut [f32],
        cols: usize,
        epilogue: Epilogue<'_>,
    ) {
        isa.matmul(&self.weights, None, x, y, cols, epilogue);
    }
}

/// The five layers of a field, ready for the kernels.
pub(super) struct Network {
    /// `2 levels -> hidden -> 16`.
    pub geometry: [Matrix; 2],
    /// `32 -> hidden -> hidden -> 4`.
    pub color: [Matrix; 3],
}

impl Network {
    pub(crate) fn packed_network(params: &FieldParams) -> Self {
        let hidden = padded_rows(params.geometry[0].outputs);
        let [g, c] = [&params.geometry, &params.color];
        Self {
            geometry: [Matrix::packed_layer(&g[0], g[0].inputs), Matrix::packed_layer(&g[1], hidden)],
            color: [
                Matrix::packed_layer(&c[0], COLOR_INPUTS),
                Matrix::packed_layer(&c[1], hidden),
                Matrix::packed_layer(&c[2], hidden),
            ],
        }
    }

    /// Number of rows of hidden activations.
    pub(crate) fn hidden_rows(&self) -> usize {
        self.geometry[0].outputs
    }
}

/// The transposed layers for the backward pass.
pub(super) struct BackwardNetwork {
    pub geometry: [Matrix; 2],
    /// The first one carries gradients to the color network's inputs from `from` on.
    pub color: [Matrix; 3],
}

impl BackwardNetwork {
    /// `from` is the first input of the color network that needs a gradient: [`VIEW_COEFFICIENTS`] if view
    /// directions are given, else 0.
    pub(crate) fn packed_transposes(network: &Network, from: usize) -> Self {
        let g = &network.geometry;
        let c = &network.color;
        Self {
            geometry: [g[0].transposed(0), g[1].transposed(0)],
            color: [c[0].transposed(from), c[1].transposed(0), c[2].transposed(0)],
        }
    }
}

/// Gradients of the packed layers.
#[derive(Clone)]
pub(super) struct NetworkGradient {
    layers: Vec<LayerGradient>,
}

/// Gradient of one packed layer.
#[derive(Clone)]
struct LayerGradient {
    weights: Vec<f32>,
    biases: Vec<f32>,
    inputs: usize,
}

impl LayerGradient {
    fn zeros(matrix: &Matrix) -> Self {
        let weights = vec![0.0; matrix.weights.len()];
        Self { weights, biases: vec![0.0; matrix.outputs], inputs: matrix.inputs }
    }
}

impl NetworkGradient {
    pub(crate) fn zeros(network: &Network) -> Self {
        Self { layers: network.geometry.iter().chain(&network.color).map(LayerGradient::zeros).collect() }
    }

    /// Adds the gradient of layer `layer` (0, 1 geometry; 2, 3, 4 color) from its output's gradient and its
    /// input.
    pub(crate) fn accumulate_layer(
        &mut self,
        isa: InstructionSet,
        layer: usize,
        dy: Columns<'_>,
        x: Columns<'_>,
        cols: usize,
    ) {
        let g = &mut self.layers[layer];
        isa.weight_gradient(dy, x, cols, &mut g.weights, &mut g.biases);
    }

    pub(crate) fn add_gradient(&mut self, other: &Self) {
        for (a, b) in self.layers.iter_mut().zip(&other.layers) {
            for (x, y) in a.weights.iter_mut().chain(&mut a.biases).zip(b.weights.iter().chain(&b.biases)) {
                *x += y;
            }
        }
    }

    /// The gradient of the unpadded layers in the order of [`FieldParams::flatten`], without the table.
    pub(crate) fn unpadded_values(&self, params: &FieldParams) -> Vec<f32> {
        let mut flat = Vec::new();
        for (layer, g) in params.geometry.iter().chain(&params.color).zip(&self.layers) {
            for row in g.weights.chunks_exact(g.inputs).take(layer.outputs) {
                flat.extend_from_slice(&row[..layer.inputs]);
            }
            flat.extend_from_slice(&g.biases[..layer.outputs]);
        }
        flat
    }
}
