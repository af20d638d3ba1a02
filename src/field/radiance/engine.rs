//! Optimiser steps of all fields and half motions.
//!
//! Results do not depend on the number of threads: the work is always cut into the same pieces, each piece is
//! computed in order, and partial sums are added in the order of the pieces.

use std::ops::Range;
use std::sync::Mutex;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::block::{PartSlot, PartView, RenderContext, RenderScratch, train_block};
use super::columns::{PartColumns, canonical_direction};
use super::half_motion::PoseGradient;
use super::loss::{RadianceLosses, RayShare};
use super::motion_adam::{BETAS, MotionState};
use super::pieces::{block_rays, ray_blocks, ray_groups};
use super::position::by_position;
use super::ray_batch::RayBatch;
use super::{HalfMotion, RadianceConfig};
use crate::learner::{FeatureGradient, Learner};
use crate::matrix::{BackwardNetwork, Network, NetworkGradient, padded_rows};
use crate::simd::{AdamStep, InstructionSet, PointColumns};
use crate::{EngineState, FEATURES, VIEW_COEFFICIENTS};
use geometry::Pose;

/// The fields of all parts during training; the first one is static.
pub(super) struct RadianceEngine {
    fields: Vec<Learner>,
    /// Reused between steps.
    columns: Vec<PartColumns>,
}

/// Gradient of the loss of a batch.
pub(super) struct RadianceGradient {
    pub losses: RadianceLosses,
    /// By the layers of every part; the gradients of the tables are in the learners.
    layers: Vec<NetworkGradient>,
    /// By the half motion of every mobile part.
    pub by_pose: Vec<PoseGradient>,
}

impl RadianceEngine {
    /// Continues from the state of each part's field.
    ///
    /// # Panics
    /// If moments and parameters differ in number.
    pub(super) fn new(states: Vec<EngineState>) -> Self {
        let isa = InstructionSet::detect();
        let fields: Vec<_> = states.into_iter().map(|s| Learner::resume(s, isa)).collect();
        let columns = fields.iter().map(|_| PartColumns::default()).collect();
        Self { fields, columns }
    }

    /// The states, as taken by [`Self::new`].
    pub(super) fn field_states(&self) -> Vec<EngineState> {
        self.fields.iter().map(Learner::training_state).collect()
    }

    /// One step of fields and motions along the gradient of a batch; `number` counts from 0.
    ///
    /// The published code evaluates every batch twice, for the fields and for the motions; here one gradient
    /// updates both.
    pub(super) fn train_step(
        &mut self,
        batch: &RayBatch,
        motions: &mut MotionState,
        config: &RadianceConfig,
        number: usize,
    ) -> RadianceLosses {
        let gradient = self.backward(batch, &motions.motions, config);
        let rate = config.field_rate(number) as f32;
        for (k, layers) in gradient.layers.iter().enumerate() {
            let step = self.fields[k].begin_step(|t| AdamStep::with_betas(rate, t, BETAS));
            self.apply_table_gradient(k, batch, Some(step));
            self.fields[k].update_layers(step, layers);
        }
        motions.step_down(self.fields[0].isa, &gradient.by_pose, config.motion_rate(number));
        gradient.losses
    }

    /// Losses and gradients of each part's field in the order of
    /// [`FieldParams::flatten`](crate::FieldParams::flatten); changes no parameter.
    #[cfg(test)]
    pub fn gradient(
        &mut self,
        batch: &RayBatch,
        motions: &[HalfMotion],
        config: &RadianceConfig,
    ) -> (RadianceGradient, Vec<Vec<f32>>) {
        let gradient = self.backward(batch, motions, config);
        let fields = (0..self.fields.len()).map(|k| {
            self.apply_table_gradient(k, batch, None);
            self.fields[k].take_gradient(&gradient.layers[k])
        });
        let fields = fields.collect();
        (gradient, fields)
    }

    /// Computes the gradient of a part's table and updates it with Adam.
    fn apply_table_gradient(&mut self, part: usize, batch: &RayBatch, learning: Option<AdamStep>) {
        let per = batch.samples;
        let blocks: Vec<_> =
            ray_blocks(0..batch.rays.len(), per).map(|r| r.start * per..r.end * per).collect();
        let columns = &self.columns[part];
        let features =
            FeatureGradient { points: columns.point_columns(), blocks: &blocks, data: &columns.d_features };
        self.fields[part].scatter_gradient(features, learning);
    }

    /// Forward and backward pass of a batch.
    fn backward(
        &mut self,
        batch: &RayBatch,
        motions: &[HalfMotion],
        config: &RadianceConfig,
    ) -> RadianceGradient {
        let halves: Vec<Pose> =
            std::iter::once(Pose::identity()).chain(motions.iter().map(HalfMotion::pose)).collect();
        for ((field, columns), half) in self.fields.iter().zip(&mut self.columns).zip(&halves) {
            columns.fill_from_batch(batch, half, config.half_side);
            let mut features = std::mem::take(&mut columns.features);
            field.encode_features(columns.point_columns(), &mut features);
            columns.features = features;
        }
        let networks: Vec<Network> = self.fields.iter().map(|f| Network::packed_network(&f.params)).collect();
        let mut backwards = Vec::with_capacity(networks.len());
        for (k, network) in networks.iter().enumerate() {
            // Only mobile parts need the gradient by view directions.
            backwards.push(BackwardNetwork::packed_transposes(
                network,
                if k == 0 { VIEW_COEFFICIENTS } else { 0 },
            ));
        }
        let groups = ray_groups(batch.rays.len(), batch.samples);
        let mut tasks: Vec<(Range<usize>, Vec<&mut [f32]>)> =
            groups.iter().map(|g| (g.clone(), Vec::new())).collect();
        let mut parts = Vec::with_capacity(networks.len());
        for (k, columns) in self.columns.iter_mut().enumerate() {
            let rows = padded_rows(FEATURES * self.fields[k].params.levels.len());
            let PartColumns { x, y, z, inside, directions, features, d_features } = columns;
            d_features.resize(rows * batch.distances.len(), 0.0);
            // Each group writes its own part of the gradient.
            let mut rest = d_features.as_mut_slice();
            for (group, pieces) in &mut tasks {
                let (own, others) = rest.split_at_mut(rows * group.len() * batch.samples);
                pieces.push(own);
                rest = others;
            }
            let network = &networks[k];
            let backward = &backwards[k];
            let view = PartView { network, backward, features, inside, directions, mobile: k > 0 };
            parts.push((view, PointColumns { x, y, z }));
        }
        let (parts, points): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
        let isa = self.fields[0].isa;
        let context = RenderContext { isa, config, batch, shares: ray_shares(batch), parts };
        let fields = &self.fields;
        // One buffer per active thread instead of one per group.
        let pool = Mutex::new(Vec::new());
        let sums: Vec<RadianceGradient> = tasks
            .into_par_iter()
            .with_max_len(1)
            .map(|(rays, mut pieces)| {
                let scratch = pool.lock().ok().and_then(|mut p| p.pop());
                let widest = block_rays(batch.samples) * batch.samples;
                let mut scratch = scratch.unwrap_or_else(|| RenderScratch::new(&context, widest));
                let mut sum = run_group(&context, rays.clone(), &halves, &mut scratch, &mut pieces);
                if let Ok(mut p) = pool.lock() {
                    p.push(scratch);
                }
                for (m, by_pose) in sum.by_pose.iter_mut().enumerate() {
                    let k = m + 1;
                    let field = &fields[k];
                    let half = &halves[k];
                    let moved =
                        by_position(field, points[k], pieces[k], batch, &rays, half, config.half_side);
                    by_pose.add_pose_gradient(&moved);
                }
                sum
            })
            .collect();
        // Summed in the order of the groups, whatever the number of threads.
        let mut total = RadianceGradient::zeros(&networks);
        sums.iter().for_each(|sum| total.add_gradient(sum));
        total
    }
}

impl RadianceGradient {
    fn zeros(networks: &[Network]) -> Self {
        Self {
            losses: RadianceLosses::default(),
            layers: networks.iter().map(NetworkGradient::zeros).collect(),
            by_pose: vec![PoseGradient::default(); networks.len() - 1],
        }
    }

    fn add_gradient(&mut self, other: &Self) {
        self.losses.add_terms(&other.losses);
        for (a, b) in self.layers.iter_mut().zip(&other.layers) {
            a.add_gradient(b);
        }
        for (a, b) in self.by_pose.iter_mut().zip(&other.by_pose) {
            a.add_pose_gradient(b);
        }
    }
}

/// Runs the blocks of a group of rays; the motions' gradient by sample positions is computed elsewhere.
fn run_group(
    context: &RenderContext<'_>,
    rays: Range<usize>,
    halves: &[Pose],
    scratch: &mut RenderScratch,
    pieces: &mut [&mut [f32]],
) -> RadianceGradient {
    let batch = context.batch;
    let networks: Vec<&Network> = context.parts.iter().map(|p| p.network).collect();
    let mut sum = RadianceGradient {
        losses: RadianceLosses::default(),
        layers: networks.iter().map(|n| NetworkGradient::zeros(n)).collect(),
        by_pose: vec![PoseGradient::default(); networks.len() - 1],
    };
    let mut d_directions = vec![vec![Vector3::zeros(); block_rays(batch.samples)]; networks.len()];
    for block in ray_blocks(rays.clone(), batch.samples) {
        let parts = sum.layers.iter_mut().zip(&mut *pieces).zip(&mut d_directions);
        let mut slots = Vec::with_capacity(networks.len());
        for ((layers, piece), directions) in parts {
            slots.push(block_slot(layers, piece, directions, &rays, &block));
        }
        let losses = train_block(context, block.clone(), scratch, &mut slots);
        sum.losses.add_terms(&losses);
        for (m, by_pose) in sum.by_pose.iter_mut().enumerate() {
            let half = &halves[m + 1];
            for (ray, by) in batch.rays[block.clone()].iter().zip(&d_directions[m + 1]) {
                if ray.state == 0 {
                    by_pose.add_turned(&canonical_direction(half, 0, &ray.direction), by);
                } else {
                    by_pose.add_turned_back(half, &ray.direction, by);
                }
            }
        }
    }
    sum
}

/// Where a block of a group writes the gradient of one part.
fn block_slot<'a>(
    layers: &'a mut NetworkGradient,
    piece: &'a mut [f32],
    directions: &'a mut [Vector3<f64>],
    group: &Range<usize>,
    block: &Range<usize>,
) -> PartSlot<'a> {
    let per_ray = piece.len() / group.len();
    let d_features = &mut piece[(block.start - group.start) * per_ray..(block.end - group.start) * per_ray];
    PartSlot { layers, d_features, d_directions: &mut directions[..block.len()] }
}

/// Weight of a ray of each state: losses are means over a state, and both states have the same weight.
fn ray_shares(batch: &RayBatch) -> [RayShare; 2] {
    batch.state_counts().map(|(rays, readings)| RayShare {
        ray: 0.5 / rays.max(1) as f64,
        reading: 0.5 / readings.max(1) as f64,
    })
}
