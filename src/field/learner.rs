//! The parameters of a field during training: reading the hash grid, accumulating its gradient, Adam.
//!
//! Results do not depend on the number of threads: the work is always cut into the same pieces, each computed
//! in order.

use std::ops::Range;

use rayon::prelude::*;

use super::matrix::{NetworkGradient, padded_rows};
use super::simd::{AdamStep, InstructionSet, LevelGeometry, PointColumns};
use super::{EngineState, FEATURES, FieldParams};

/// Points of one level per task.
const ENCODE_POINTS: usize = 8192;
/// Number of table floats per flag for zero moments; see [`update_table`].
const CHUNK: usize = 128;
/// Number of floats of a level that one task updates.
const UPDATE_FLOATS: usize = 1024 * CHUNK;

/// Parameters, moments and table gradient of a field.
pub(super) struct Learner {
    pub isa: InstructionSet,
    pub params: FieldParams,
    first: Vec<f32>,
    second: Vec<f32>,
    /// Gradient of the table; all 0 between steps.
    table_gradient: Vec<f32>,
    /// Per chunk of the table, whether it ever received a gradient.
    awake: Vec<bool>,
    steps: u64,
}

/// The gradient of encoded features, block by block: a block of columns `start..end` has its
/// `padded(2 levels)` rows of `end - start` floats at `padded(2 levels) * start`.
#[derive(Clone, Copy)]
pub(super) struct FeatureGradient<'a> {
    pub points: PointColumns<'a>,
    pub blocks: &'a [Range<usize>],
    pub data: &'a [f32],
}

impl Learner {
    /// Continues from a checkpoint on a chosen instruction set.
    ///
    /// # Panics
    /// If moments and parameters differ in number.
    pub(crate) fn resume(state: EngineState, isa: InstructionSet) -> Self {
        let EngineState { params, first, second, steps } = state;
        let n = params.parameter_count();
        assert!(
            first.len() == n && second.len() == n,
            "{n} parameters with {} and {} moments",
            first.len(),
            second.len()
        );
        let floats = params.table.len();
        // Checkpoints hold no flags; nonzero moments show which chunks received a gradient.
        let mut awake = Vec::new();
        for l in &params.levels {
            let range = l.offset..l.offset + l.entries * FEATURES;
            let chunks = first[range.clone()].chunks(CHUNK).zip(second[range].chunks(CHUNK));
            awake.extend(chunks.map(|(m, v)| m.iter().chain(v).any(|&x| x != 0.0)));
        }
        Self { isa, params, table_gradient: vec![0.0; floats], awake, first, second, steps }
    }

    /// The state, as taken by [`Self::resume`].
    pub(crate) fn training_state(&self) -> EngineState {
        EngineState {
            params: self.params.clone(),
            first: self.first.clone(),
            second: self.second.clone(),
            steps: self.steps,
        }
    }

    /// Counts a step; its coefficients are `step_of(number)`, starting from 1.
    pub(crate) fn begin_step(&mut self, step_of: impl FnOnce(u64) -> AdamStep) -> AdamStep {
        self.steps += 1;
        step_of(self.steps)
    }

    /// Features of all levels at all points, level-major: `[2 levels][points]`.
    pub(crate) fn encode_features(&self, points: PointColumns<'_>, features: &mut Vec<f32>) {
        let columns = points.x.len();
        features.resize(FEATURES * self.params.levels.len() * columns, 0.0);
        if columns == 0 {
            return;
        }
        // Level by level, so that one table stays in the cache for many points.
        let tasks: Vec<_> = features
            .chunks_exact_mut(FEATURES * columns)
            .zip(&self.params.levels)
            .flat_map(|(rows, layout)| {
                let (a, b) = rows.split_at_mut(columns);
                a.chunks_mut(ENCODE_POINTS)
                    .zip(b.chunks_mut(ENCODE_POINTS))
                    .enumerate()
                    .map(move |(i, (a, b))| (layout, i, a, b))
            })
            .collect();
        tasks.into_par_iter().for_each(|(layout, i, a, b)| {
            let table = &self.params.table[layout.offset..layout.offset + layout.entries * FEATURES];
            let points = points.columns_in(i * ENCODE_POINTS..i * ENCODE_POINTS + a.len());
            self.isa.encode(LevelGeometry::new(layout), table, points, a, b);
        });
    }

    /// Computes the table's gradient, one task per level, and updates the table with Adam.
    pub(crate) fn scatter_gradient(&mut self, features: FeatureGradient<'_>, learning: Option<AdamStep>) {
        let d_rows = padded_rows(FEATURES * self.params.levels.len());
        let isa = self.isa;
        let sizes: Vec<usize> = self.params.levels.iter().map(|l| l.entries * FEATURES).collect();
        let chunks: Vec<usize> = sizes.iter().map(|s| s.div_ceil(CHUNK)).collect();
        // One task per level, so additions need no atomics and keep their order.
        let gradients = split_by_sizes(&mut self.table_gradient, &sizes);
        let table = split_by_sizes(&mut self.params.table, &sizes);
        let first = split_by_sizes(&mut self.first, &sizes);
        let second = split_by_sizes(&mut self.second, &sizes);
        let awake = split_by_sizes(&mut self.awake, &chunks);
        let tables = table.into_iter().zip(first).zip(second).zip(awake);
        let mut levels: Vec<_> = self.params.levels.iter().enumerate().zip(gradients).zip(tables).collect();
        levels.reverse(); // fine levels take longest
        // One level per task: several large ones together would leave threads idle.
        levels.into_par_iter().with_max_len(1).for_each(
            |(((l, layout), gradient), (((table, first), second), awake))| {
                let level = LevelGeometry::new(layout);
                for block in features.blocks {
                    let cols = block.len();
                    let d = &features.data[d_rows * block.start..][..d_rows * cols];
                    let a = &d[FEATURES * l * cols..][..cols];
                    let b = &d[(FEATURES * l + 1) * cols..][..cols];
                    isa.scatter(level, gradient, features.points.columns_in(block.clone()), a, b);
                }
                if let Some(step) = learning {
                    update_table(isa, step, table, first, second, gradient, awake);
                }
            },
        );
    }

    /// Adam update of the layers.
    pub(crate) fn update_layers(&mut self, step: AdamStep, gradient: &NetworkGradient) {
        let mut gradient = gradient.unpadded_values(&self.params);
        let floats = self.params.table.len();
        let mut first = &mut self.first[floats..];
        let mut second = &mut self.second[floats..];
        let mut gradient = gradient.as_mut_slice();
        for layer in self.params.geometry.iter_mut().chain(&mut self.params.color) {
            for values in [&mut layer.weights, &mut layer.biases] {
                let n = values.len();
                let (m, rest_m) = first.split_at_mut(n);
                let (v, rest_v) = second.split_at_mut(n);
                let (g, rest_g) = gradient.split_at_mut(n);
                self.isa.adam(step, values, m, v, g);
                (first, second, gradient) = (rest_m, rest_v, rest_g);
            }
        }
    }

    /// The whole gradient in the order of [`FieldParams::flatten`]; the table's gradient is reset to 0.
    pub(crate) fn take_gradient(&mut self, layers: &NetworkGradient) -> Vec<f32> {
        let mut all = self.table_gradient.clone();
        self.table_gradient.fill(0.0);
        all.extend(layers.unpadded_values(&self.params));
        all
    }
}

/// Splits the front of a slice into pieces of the given sizes.
fn split_by_sizes<'a, T>(mut rest: &'a mut [T], sizes: &[usize]) -> Vec<&'a mut [T]> {
    let mut pieces = Vec::with_capacity(sizes.len());
    for &size in sizes {
        let (piece, others) = rest.split_at_mut(size);
        pieces.push(piece);
        rest = others;
    }
    pieces
}

/// Adam update of the table of one level.
///
/// This is dense Adam: momentum moves every entry in every step. Chunks that never received a gradient have
/// zero moments; skipping them changes no bit.
fn update_table(
    isa: InstructionSet,
    step: AdamStep,
    table: &mut [f32],
    first: &mut [f32],
    second: &mut [f32],
    gradient: &mut [f32],
    awake: &mut [bool],
) {
    let pieces = table
        .par_chunks_mut(UPDATE_FLOATS)
        .zip(first.par_chunks_mut(UPDATE_FLOATS))
        .zip(second.par_chunks_mut(UPDATE_FLOATS))
        .zip(gradient.par_chunks_mut(UPDATE_FLOATS))
        .zip(awake.par_chunks_mut(UPDATE_FLOATS / CHUNK));
    pieces.for_each(|((((p, m), v), g), awake)| {
        for (flag, g) in awake.iter_mut().zip(g.chunks(CHUNK)) {
            *flag = *flag || g.iter().any(|&x| x != 0.0);
        }
        let mut from = 0;
        while from < awake.len() {
            let to = (from..awake.len()).find(|&c| awake[c] != awake[from]).unwrap_or(awake.len());
            if awake[from] {
                let range = from * CHUNK..(to * CHUNK).min(p.len());
                isa.adam(
                    step,
                    &mut p[range.clone()],
                    &mut m[range.clone()],
                    &mut v[range.clone()],
                    &mut g[range],
                );
            }
            from = to;
        }
    });
}
