//! The field engine on the CPU: hash encoding level by level, blocks of whole rays, one table owner per
//! scatter.
//!
//! Results do not depend on the number of threads: the work is always cut into the same pieces, each piece is
//! computed in order, and partial sums are added in the order of the pieces.

use std::sync::Mutex;

use rayon::prelude::*;

use super::block::{Scratch, StepContext, train_block};
use super::learner::{FeatureGradient, Learner};
use super::matrix::{BackwardNetwork, Network, NetworkGradient, padded_rows};
use super::plan::{Block, Plan};
use super::simd::{AdamStep, Columns, InstructionSet};
use super::{EngineState, FEATURES, FieldEngine, FieldLosses, FieldParams, SampleBatch, VIEW_COEFFICIENTS};

/// Phases of a step of [`CpuEngine`], in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepPhase {
    /// Samples with a loss are arranged in blocks.
    Plan,
    /// Features are read from the hash grid.
    Encode,
    /// Both networks run forward and backward, with the losses in between.
    Networks,
    /// The features' gradient is added to the table's, and Adam updates the table.
    Table,
    /// Adam updates the networks' layers.
    Layers,
}

/// Trains a field on the CPU.
pub struct CpuEngine {
    learner: Learner,
    /// Encoded features and their gradient, reused between steps.
    features: Vec<f32>,
    d_features: Vec<f32>,
}

impl CpuEngine {
    /// Starts with zero moments on the fastest instruction set.
    pub fn new(params: FieldParams) -> Self {
        Self::resume(EngineState::untrained(params))
    }

    /// Continues from a checkpoint.
    ///
    /// # Panics
    /// If moments and parameters differ in number.
    pub fn resume(state: EngineState) -> Self {
        Self::with_instructions(state, InstructionSet::detect())
    }

    /// As [`Self::resume`], with a given instruction set.
    ///
    /// # Panics
    /// If moments and parameters differ in number.
    pub fn with_instructions(state: EngineState, isa: InstructionSet) -> Self {
        Self { learner: Learner::resume(state, isa), features: Vec::new(), d_features: Vec::new() }
    }

    /// As [`FieldEngine::train_step`]; calls `after` at the end of every phase.
    pub fn step_by_phases(
        &mut self,
        batch: &SampleBatch,
        learning_rate: f32,
        mut after: impl FnMut(StepPhase),
    ) -> FieldLosses {
        let plan = Plan::new(batch);
        after(StepPhase::Plan);
        self.learner.encode_features(plan.point_columns(), &mut self.features);
        after(StepPhase::Encode);
        let (losses, gradient) = self.train_networks(batch, &plan);
        after(StepPhase::Networks);
        let step = self.learner.begin_step(|number| AdamStep::new(learning_rate, number));
        self.apply_table_gradient(&plan, Some(step));
        after(StepPhase::Table);
        self.learner.update_layers(step, &gradient);
        after(StepPhase::Layers);
        losses
    }

    /// Forward and backward pass from the features to their gradient; returns the losses and the layers'
    /// gradient.
    fn train_networks(&mut self, batch: &SampleBatch, plan: &Plan) -> (FieldLosses, NetworkGradient) {
        let network = Network::packed_network(&self.learner.params);
        let backward = BackwardNetwork::packed_transposes(&network, VIEW_COEFFICIENTS);
        let columns = plan.column_count();
        let rows = FEATURES * self.learner.params.levels.len();
        let d_rows = padded_rows(rows);
        self.d_features.resize(d_rows * columns, 0.0);
        let mut rest = self.d_features.as_mut_slice();
        // Each group writes its own part of the gradient.
        let mut tasks = Vec::with_capacity(plan.groups.len());
        for group in &plan.groups {
            let (own, others) = rest.split_at_mut(plan.group_columns(group).len() * d_rows);
            tasks.push((group.clone(), own));
            rest = others;
        }
        let context =
            StepContext { isa: self.learner.isa, batch, plan, network: &network, backward: &backward };
        let features = Columns { data: &self.features, stride: columns, rows };
        // One buffer per active thread instead of one per group.
        let pool = Mutex::new(Vec::new());
        let parts: Vec<_> = tasks
            .into_par_iter()
            .map(|(group, d_features)| {
                let scratch = pool.lock().ok().and_then(|mut p| p.pop());
                let mut scratch = scratch.unwrap_or_else(|| Scratch::new(&network, plan.widest_block()));
                let part = train_group(&context, &plan.blocks[group], features, &mut scratch, d_features);
                if let Ok(mut p) = pool.lock() {
                    p.push(scratch);
                }
                part
            })
            .collect();
        // Summed in the order of the groups, whatever the number of threads.
        let mut losses = FieldLosses::default();
        let mut gradient = NetworkGradient::zeros(&network);
        for (l, g) in &parts {
            losses = FieldLosses { sdf: losses.sdf + l.sdf, color: losses.color + l.color };
            gradient.add_gradient(g);
        }
        (losses, gradient)
    }

    /// Computes the table's gradient and updates the table with Adam.
    fn apply_table_gradient(&mut self, plan: &Plan, learning: Option<AdamStep>) {
        let blocks: Vec<_> = plan.blocks.iter().map(|b| b.start..b.start + b.cols).collect();
        let features =
            FeatureGradient { points: plan.point_columns(), blocks: &blocks, data: &self.d_features };
        self.learner.scatter_gradient(features, learning);
    }
}

/// Forward and backward pass of a group of blocks: writes the features' gradient block by block; returns the
/// losses and the layers' gradient.
fn train_group(
    context: &StepContext<'_>,
    blocks: &[Block],
    features: Columns<'_>,
    scratch: &mut Scratch,
    d_features: &mut [f32],
) -> (FieldLosses, NetworkGradient) {
    let d_rows = padded_rows(features.rows);
    let mut rest = d_features;
    let mut gradient = NetworkGradient::zeros(context.network);
    let mut losses = FieldLosses::default();
    for block in blocks {
        let (d, others) = rest.split_at_mut(block.cols * d_rows);
        rest = others;
        let own = Columns { data: &features.data[block.start..], ..features };
        let l = train_block(context, block, own, scratch, &mut gradient, d);
        losses = FieldLosses { sdf: losses.sdf + l.sdf, color: losses.color + l.color };
    }
    (losses, gradient)
}

impl FieldEngine for CpuEngine {
    fn train_step(&mut self, batch: &SampleBatch, learning_rate: f32) -> FieldLosses {
        self.step_by_phases(batch, learning_rate, |_| {})
    }

    fn loss_gradient(&mut self, batch: &SampleBatch) -> (FieldLosses, Vec<f32>) {
        let plan = Plan::new(batch);
        self.learner.encode_features(plan.point_columns(), &mut self.features);
        let (losses, gradient) = self.train_networks(batch, &plan);
        self.apply_table_gradient(&plan, None);
        (losses, self.learner.take_gradient(&gradient))
    }

    fn training_state(&self) -> EngineState {
        self.learner.training_state()
    }
}
