//! Forward and backward passes of a field's two networks on a block of columns.

use super::harmonics::view_coefficients;
use super::matrix::{BackwardNetwork, COLOR_INPUTS, Network, NetworkGradient};
use super::simd::{COLUMN_ALIGN, Columns, Epilogue, InstructionSet};
use super::{GEOMETRY_OUTPUTS, VIEW_COEFFICIENTS};

/// The first `rows` rows of a dense matrix with `cols` columns.
fn dense_rows(data: &[f32], rows: usize, cols: usize) -> Columns<'_> {
    Columns { data: &data[..rows * cols], stride: cols, rows }
}

/// Activations of the geometry network and their gradients, as dense matrices with the block's columns.
pub(super) struct GeometryPass {
    hidden: Vec<f32>,
    d_hidden: Vec<f32>,
    /// [`GEOMETRY_OUTPUTS`] rows, valid after [`Self::forward`].
    pub outputs: Vec<f32>,
    /// Gradient by the outputs, to be set before [`Self::backward`].
    pub d_outputs: Vec<f32>,
}

impl GeometryPass {
    /// Buffers for blocks of at most `widest` columns.
    pub(crate) fn new(network: &Network, widest: usize) -> Self {
        let rows = |n: usize| vec![0.0; n * widest];
        let hidden = network.hidden_rows();
        Self {
            hidden: rows(hidden),
            d_hidden: rows(hidden),
            outputs: rows(GEOMETRY_OUTPUTS),
            d_outputs: rows(GEOMETRY_OUTPUTS),
        }
    }

    pub(crate) fn forward(
        &mut self,
        isa: InstructionSet,
        network: &Network,
        features: Columns<'_>,
        cols: usize,
    ) {
        let hidden = network.hidden_rows();
        network.geometry[0].apply_affine(isa, features, &mut self.hidden, cols, Epilogue::Relu);
        let inner = dense_rows(&self.hidden, hidden, cols);
        network.geometry[1].apply_affine(isa, inner, &mut self.outputs, cols, Epilogue::Linear);
    }

    /// Adds to the layers' gradient and writes the features' gradient, `padded(2 levels)` rows: in each layer
    /// first the gradient by the weights, then by the inputs.
    pub(crate) fn backward(
        &mut self,
        isa: InstructionSet,
        backward: &BackwardNetwork,
        features: Columns<'_>,
        cols: usize,
        gradient: &mut NetworkGradient,
        d_features: &mut [f32],
    ) {
        let hidden = backward.geometry[0].inputs;
        let d_outputs = dense_rows(&self.d_outputs, GEOMETRY_OUTPUTS, cols);
        gradient.accumulate_layer(isa, 1, d_outputs, dense_rows(&self.hidden, hidden, cols), cols);
        let mask = Epilogue::Mask(&self.hidden);
        backward.geometry[1].apply_affine(isa, d_outputs, &mut self.d_hidden, cols, mask);
        let d_hidden = dense_rows(&self.d_hidden, hidden, cols);
        gradient.accumulate_layer(isa, 0, d_hidden, features, cols);
        backward.geometry[0].apply_affine(isa, d_hidden, d_features, cols, Epilogue::Linear);
    }
}

/// Activations of the color network and their gradients, as dense matrices with `cols` columns.
pub(super) struct ColorPass {
    first: Vec<f32>,
    second: Vec<f32>,
    d_first: Vec<f32>,
    d_second: Vec<f32>,
    /// [`COLOR_INPUTS`] rows, set by [`Self::gather_inputs`].
    inputs: Vec<f32>,
    /// Three rows of colors in `[0, 1]`, and padding; valid after [`Self::forward`].
    pub rgb: Vec<f32>,
    /// Gradient by the values before the logistic function, with padding 0; to be set before
    /// [`Self::backward`].
    pub d_rgb: Vec<f32>,
    /// Gradient by the inputs, from the first one that needs it; valid after [`Self::backward`].
    pub d_inputs: Vec<f32>,
}

impl ColorPass {
    /// Buffers for blocks of at most `widest` columns.
    pub(crate) fn new(network: &Network, widest: usize) -> Self {
        let rows = |n: usize| vec![0.0; n * widest];
        let hidden = network.hidden_rows();
        let outputs = network.color[2].outputs;
        Self {
            first: rows(hidden),
            second: rows(hidden),
            d_first: rows(hidden),
            d_second: rows(hidden),
            inputs: rows(COLOR_INPUTS),
            rgb: rows(outputs),
            d_rgb: rows(outputs),
            d_inputs: rows(COLOR_INPUTS),
        }
    }

    /// Collects the inputs of some columns of a block from its geometry outputs of `block_cols` columns,
    /// given the ray of each column and the unit direction of each ray. Returns the number of columns,
    /// rounded up.
    pub(crate) fn gather_inputs(
        &mut self,
        outputs: &[f32],
        block_cols: usize,
        columns: &[usize],
        ray_of: impl Fn(usize) -> usize,
        direction_of: impl Fn(usize) -> [f32; 3],
    ) -> usize {
        let cols = columns.len().next_multiple_of(COLUMN_ALIGN);
        self.inputs[..COLOR_INPUTS * cols].fill(0.0);
        let mut view = (usize::MAX, [0.0; VIEW_COEFFICIENTS]);
        for (to, &column) in columns.iter().enumerate() {
            let ray = ray_of(column);
            // Columns of one ray are consecutive, so its harmonics are computed once.
            if view.0 != ray {
                view = (ray, view_coefficients(direction_of(ray)));
            }
            for (row, value) in view.1.iter().enumerate() {
                self.inputs[row * cols + to] = *value;
            }
        }
        for feature in 0..GEOMETRY_OUTPUTS - 1 {
            let from = &outputs[(feature + 1) * block_cols..];
            let row = &mut self.inputs[(VIEW_COEFFICIENTS + feature) * cols..][..cols];
            for (value, &column) in row.iter_mut().zip(columns) {
                *value = from[column];
            }
        }
        cols
    }

    /// Writes the gradient by the features into the geometry outputs' gradient of the block, at the gathered
    /// columns; `features` is the features' first row in `d_inputs`.
    pub(crate) fn return_features(
        &self,
        features: usize,
        columns: &[usize],
        cols: usize,
        d_outputs: &mut [f32],
        block_cols: usize,
    ) {
        for feature in 0..GEOMETRY_OUTPUTS - 1 {
            let d = &mut d_outputs[(feature + 1) * block_cols..(feature + 2) * block_cols];
            for (&column, &value) in columns.iter().zip(&self.d_inputs[(features + feature) * cols..]) {
                d[column] = value;
            }
        }
    }

    pub(crate) fn forward(&mut self, isa: InstructionSet, network: &Network, cols: usize) {
        let hidden = network.hidden_rows();
        let inputs = dense_rows(&self.inputs, COLOR_INPUTS, cols);
        network.color[0].apply_affine(isa, inputs, &mut self.first, cols, Epilogue::Relu);
        let first = dense_rows(&self.first, hidden, cols);
        network.color[1].apply_affine(isa, first, &mut self.second, cols, Epilogue::Relu);
        let second = dense_rows(&self.second, hidden, cols);
        network.color[2].apply_affine(isa, second, &mut self.rgb, cols, Epilogue::Linear);
        isa.sigmoid(&mut self.rgb[..3 * cols]);
    }

    /// Adds to the layers' gradient and writes the gradient by the inputs.
    pub(crate) fn backward(
        &mut self,
        isa: InstructionSet,
        backward: &BackwardNetwork,
        cols: usize,
        gradient: &mut NetworkGradient,
    ) {
        let [hidden, rows] = [backward.color[1].inputs, backward.color[2].inputs];
        let d_rgb = dense_rows(&self.d_rgb, rows, cols);
        gradient.accumulate_layer(isa, 4, d_rgb, dense_rows(&self.second, hidden, cols), cols);
        backward.color[2].apply_affine(isa, d_rgb, &mut self.d_second, cols, Epilogue::Mask(&self.second));
        let d_second = dense_rows(&self.d_second, hidden, cols);
        gradient.accumulate_layer(isa, 3, d_second, dense_rows(&self.first, hidden, cols), cols);
        backward.color[1].apply_affine(isa, d_second, &mut self.d_first, cols, Epilogue::Mask(&self.first));
        let d_first = dense_rows(&self.d_first, hidden, cols);
        gradient.accumulate_layer(isa, 2, d_first, dense_rows(&self.inputs, COLOR_INPUTS, cols), cols);
        backward.color[0].apply_affine(isa, d_first, &mut self.d_inputs, cols, Epilogue::Linear);
    }
}
