//! The field engine of the CPU: level-major hash encoding, blocks of whole rays, owner-computes scatter.
//!
//! Results do not depend on the number of threads: work is cut into the same pieces whatever runs them, every
//! piece is computed in order, and partial sums are added in the order of the pieces.

use std::sync::Mutex;

use rayon::prelude::*;

use super::block::{Scratch, StepContext, train_block};
use super::matrix::{BackwardNetwork, Network, NetworkGradient, padded};
use super::plan::Plan;
use super::simd::{AdamStep, Columns, InstructionSet, LevelGeometry};
use super::{EngineState, FEATURES, FieldEngine, FieldLosses, FieldParams, SampleBatch};

/// Points that one task encodes at one level.
const ENCODE_POINTS: usize = 8192;
/// Table floats whose moments are known to be 0 or not together; see [`update_table`].
const CHUNK: usize = 128;
/// Floats of a level that one task updates.
const UPDATE_FLOATS: usize = 1024 * CHUNK;

/// What a step of [`CpuEngine`] consists of, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepPhase {
    /// Samples that have a loss are put into blocks.
    Plan,
    /// Features are read from the hash grid.
    Encode,
    /// Both networks run forward and backward, with the losses between.
    Networks,
    /// The features' gradient is added to the table's, and Adam moves the table.
    Table,
    /// Adam moves the networks' layers.
    Layers,
}

/// Trains a field on the CPU.
pub struct CpuEngine {
    isa: InstructionSet,
    params: FieldParams,
    first: Vec<f32>,
    second: Vec<f32>,
    /// Gradient of the table; all 0 between steps.
    table_gradient: Vec<f32>,
    /// Chunks of the table that a gradient has reached.
    awake: Vec<bool>,
    steps: u64,
    /// Encoded features and their gradient; kept between steps for their memory.
    features: Vec<f32>,
    d_features: Vec<f32>,
}

impl CpuEngine {
    /// Fresh moments on the fastest instruction set of this processor.
    #[must_use]
    pub fn new(params: FieldParams) -> Self {
        let n = params.parameters();
        Self::resume(EngineState { params, first: vec![0.0; n], second: vec![0.0; n], steps: 0 })
    }

    /// Continues from a checkpoint.
    ///
    /// # Panics
    /// If the moments do not have the parameters' number.
    #[must_use]
    pub fn resume(state: EngineState) -> Self {
        Self::with_instructions(state, InstructionSet::detect())
    }

    /// As [`Self::resume`], on a chosen instruction set.
    ///
    /// # Panics
    /// If the moments do not have the parameters' number.
    #[must_use]
    pub fn with_instructions(state: EngineState, isa: InstructionSet) -> Self {
        let EngineState { params, first, second, steps } = state;
        let n = params.parameters();
        assert!(
            first.len() == n && second.len() == n,
            "{n} parameters with {} and {} moments",
            first.len(),
            second.len()
        );
        let floats = params.table.len();
        // A checkpoint has no such flags; moments show where a gradient was.
        let moved = |(m, v): (&[f32], &[f32])| m.iter().chain(v).any(|&x| x != 0.0);
        let awake = params.levels.iter().flat_map(|l| {
            let range = l.offset..l.offset + l.entries * FEATURES;
            first[range.clone()].chunks(CHUNK).zip(second[range].chunks(CHUNK)).map(moved).collect::<Vec<_>>()
        });
        let awake = awake.collect();
        Self {
            isa,
            params,
            table_gradient: vec![0.0; floats],
            awake,
            first,
            second,
            steps,
            features: Vec::new(),
            d_features: Vec::new(),
        }
    }

    /// The parameters as they stand.
    #[must_use]
    pub fn params(&self) -> &FieldParams {
        &self.params
    }

    /// As [`FieldEngine::step`]; `after` is called with every phase once it is done.
    pub fn step_by_phases(
        &mut self,
        batch: &SampleBatch,
        learning_rate: f32,
        mut after: impl FnMut(StepPhase),
    ) -> FieldLosses {
        let plan = Plan::new(batch);
        after(StepPhase::Plan);
        self.encode(&plan);
        after(StepPhase::Encode);
        let (losses, gradient) = self.networks(batch, &plan);
        after(StepPhase::Networks);
        self.steps += 1;
        let step = AdamStep::new(learning_rate, self.steps);
        self.scatter(&plan, Some(step));
        after(StepPhase::Table);
        let gradient = gradient.unpack(&self.params);
        self.update_layers(step, gradient);
        after(StepPhase::Layers);
        losses
    }

    /// Features of all columns.
    fn encode(&mut self, plan: &Plan) {
        self.features.resize(FEATURES * self.params.levels.len() * plan.columns(), 0.0);
        encode(self.isa, &self.params, plan, &mut self.features);
    }

    /// Forward and backward pass from the features to their gradient; returns the losses and the layers'
    /// gradient.
    fn networks(&mut self, batch: &SampleBatch, plan: &Plan) -> (FieldLosses, NetworkGradient) {
        let network = Network::pack(&self.params);
        let backward = BackwardNetwork::pack(&network);
        let columns = plan.columns();
        let rows = FEATURES * self.params.levels.len();
        let d_rows = padded(rows);
        self.d_features.resize(d_rows * columns, 0.0);
        let mut rest = self.d_features.as_mut_slice();
        // Each group writes a piece of the gradient of its own.
        let mut tasks = Vec::with_capacity(plan.groups.len());
        for group in &plan.groups {
            let (own, others) = rest.split_at_mut(plan.group_columns(group).len() * d_rows);
            tasks.push((group.clone(), own));
            rest = others;
        }
        let context = StepContext { isa: self.isa, batch, plan, network: &network, backward: &backward };
        let features = &self.features;
        // As many buffers as threads are at work, in place of one a group.
        let pool = Mutex::new(Vec::new());
        let run = |(group, mut own): (std::ops::Range<usize>, &mut [f32])| {
            let scratch = pool.lock().ok().and_then(|mut p| p.pop());
            let mut scratch = scratch.unwrap_or_else(|| Scratch::new(&network, plan.widest()));
            let mut gradient = NetworkGradient::zeros(&network);
            let mut losses = FieldLosses::default();
            for block in &plan.blocks[group] {
                let (d, others) = own.split_at_mut(block.cols * d_rows);
                own = others;
                let view = Columns { data: &features[block.start..], stride: columns, rows };
                let l = train_block(&context, block, view, &mut scratch, &mut gradient, d);
                losses = FieldLosses { sdf: losses.sdf + l.sdf, color: losses.color + l.color };
            }
            if let Ok(mut p) = pool.lock() {
                p.push(scratch);
            }
            (losses, gradient)
        };
        let parts: Vec<_> = tasks.into_par_iter().map(run).collect();
        // Summed in the order of the groups, whatever the number of threads.
        let mut losses = FieldLosses::default();
        let mut gradient = NetworkGradient::zeros(&network);
        for (l, g) in &parts {
            losses = FieldLosses { sdf: losses.sdf + l.sdf, color: losses.color + l.color };
            gradient.add(g);
        }
        (losses, gradient)
    }

    /// Adds the table's gradient, every level by one task, and calls `after` on the level.
    fn scatter(&mut self, plan: &Plan, learning: Option<AdamStep>) {
        let d_rows = padded(FEATURES * self.params.levels.len());
        let isa = self.isa;
        let d_features = &self.d_features;
        let sizes: Vec<usize> = self.params.levels.iter().map(|l| l.entries * FEATURES).collect();
        let chunks: Vec<usize> = sizes.iter().map(|s| s.div_ceil(CHUNK)).collect();
        // One task a level adds to its table, so that additions need no atomics and keep their order.
        let gradients = split(&mut self.table_gradient, &sizes);
        let table = split(&mut self.params.table, &sizes);
        let (first, second) = (split(&mut self.first, &sizes), split(&mut self.second, &sizes));
        let awake = split(&mut self.awake, &chunks);
        let tables = table.into_iter().zip(first).zip(second).zip(awake);
        let mut levels: Vec<_> = self.params.levels.iter().enumerate().zip(gradients).zip(tables).collect();
        levels.reverse(); // fine levels take longest
        // One level a task: several large ones in one piece of work would leave threads idle.
        levels.into_par_iter().with_max_len(1).for_each(
            |(((l, layout), gradient), (((table, first), second), awake))| {
                let level = LevelGeometry::new(layout);
                for block in &plan.blocks {
                    let d = &d_features[d_rows * block.start..][..d_rows * block.cols];
                    let (a, b) = (
                        &d[FEATURES * l * block.cols..][..block.cols],
                        &d[(FEATURES * l + 1) * block.cols..][..block.cols],
                    );
                    isa.scatter(
                        level,
                        gradient,
                        plan.points().range(block.start..block.start + block.cols),
                        a,
                        b,
                    );
                }
                if let Some(step) = learning {
                    update_table(isa, step, table, first, second, gradient, awake);
                }
            },
        );
    }

    /// Adam on the layers; `gradient` in the order of [`FieldParams::flatten`] without the table.
    fn update_layers(&mut self, step: AdamStep, mut gradient: Vec<f32>) {
        let floats = self.params.table.len();
        let (mut first, mut second) = (&mut self.first[floats..], &mut self.second[floats..]);
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
}

impl FieldEngine for CpuEngine {
    fn step(&mut self, batch: &SampleBatch, learning_rate: f32) -> FieldLosses {
        self.step_by_phases(batch, learning_rate, |_| {})
    }

    fn gradient(&mut self, batch: &SampleBatch) -> (FieldLosses, Vec<f32>) {
        let plan = Plan::new(batch);
        self.encode(&plan);
        let (losses, gradient) = self.networks(batch, &plan);
        self.scatter(&plan, None);
        let mut all = self.table_gradient.clone();
        // A step expects zeros, and Adam, which clears them, did not run.
        self.table_gradient.fill(0.0);
        all.extend(gradient.unpack(&self.params));
        (losses, all)
    }

    fn state(&self) -> EngineState {
        EngineState {
            params: self.params.clone(),
            first: self.first.clone(),
            second: self.second.clone(),
            steps: self.steps,
        }
    }
}

/// Cuts the front of a slice into pieces of the given sizes.
fn split<'a, T>(mut rest: &'a mut [T], sizes: &[usize]) -> Vec<&'a mut [T]> {
    let mut pieces = Vec::with_capacity(sizes.len());
    for &size in sizes {
        let (piece, others) = rest.split_at_mut(size);
        pieces.push(piece);
        rest = others;
    }
    pieces
}

/// Features of all levels at all columns, level-major: `[2 levels][columns]`.
fn encode(isa: InstructionSet, params: &FieldParams, plan: &Plan, features: &mut [f32]) {
    let columns = plan.columns();
    if columns == 0 {
        return;
    }
    // Level by level: one table stays in the cache while many points read it.
    let tasks: Vec<_> = features
        .chunks_exact_mut(FEATURES * columns)
        .zip(&params.levels)
        .flat_map(|(rows, layout)| {
            let (a, b) = rows.split_at_mut(columns);
            a.chunks_mut(ENCODE_POINTS)
                .zip(b.chunks_mut(ENCODE_POINTS))
                .enumerate()
                .map(move |(i, (a, b))| (layout, i, a, b))
        })
        .collect();
    tasks.into_par_iter().for_each(|(layout, i, a, b)| {
        let table = &params.table[layout.offset..layout.offset + layout.entries * FEATURES];
        let points = plan.points().range(i * ENCODE_POINTS..i * ENCODE_POINTS + a.len());
        isa.encode(LevelGeometry::new(layout), table, points, a, b);
    });
}

/// Adam on the table of one level.
///
/// This is dense Adam: every entry moves by its momentum in every step. Chunks that no gradient has ever
/// reached have moments of 0 and would not move, so they are skipped; that changes no bit of the result.
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
