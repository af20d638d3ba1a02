//! All losses of one state at fixed samples and noise, with their gradients: docs/method.md (12.19).

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use crate::{
    neural::{
        collision::collision_loss,
        config::ArticulationConfig,
        consistency::Consistency,
        loss_term::LossTerm,
        matching_loss::Matching,
        motion_params::{MotionGradient, Motions, Way},
        occupancy::{BackwardFlow, occupancy_loss},
        ray_batch::RayBatch,
        segmentation::{GumbelNoise, SegmentationField, SegmentationGradient, softmax, softmax_backward},
        state_model::Volume,
        uniform_batch::UniformBatch,
    },
    observations::LiftedMatch,
};

/// Loss terms of a step, each unweighted and the mean of the two states, and their weighted total.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ArticulationLosses {
    /// Signed distance consistency, truncation distances.
    pub sdf: f64,
    /// Color consistency.
    pub color: f64,
    /// Occupancy consistency.
    pub occupancy: f64,
    /// Collision on ray samples.
    pub collision_rays: f64,
    /// Collision on uniform points.
    pub collision_uniform: f64,
    /// Reprojection of matches, image heights.
    pub matching: f64,
    /// Cross-entropy of given labels, nats, while they are fitted.
    pub labels: f64,
    /// The weighted sum that is minimised.
    pub total: f64,
}

impl ArticulationLosses {
    /// Mean of the losses of two states.
    pub fn mean(a: &Self, b: &Self) -> Self {
        let m = |f: fn(&Self) -> f64| 0.5 * (f(a) + f(b));
        Self {
            sdf: m(|l| l.sdf),
            color: m(|l| l.color),
            occupancy: m(|l| l.occupancy),
            collision_rays: m(|l| l.collision_rays),
            collision_uniform: m(|l| l.collision_uniform),
            matching: m(|l| l.matching),
            labels: m(|l| l.labels),
            total: m(|l| l.total),
        }
    }
}

/// The samples of one step for the losses of one state.
pub(crate) struct StateBatch<'a> {
    /// Samples of this state's rays.
    pub rays: &'a RayBatch,
    /// Matches, moved from this state to the other.
    pub matches: &'a [LiftedMatch],
    /// Points of the other state for occupancy and collision; `None` while these losses are not active.
    pub uniform: Option<&'a UniformBatch>,
    /// Samples of the other state's rays, for collision; `None` while that loss is not active.
    pub collision: Option<&'a [Point3<f64>]>,
    /// Noise on the logits.
    pub noise: GumbelNoise,
}

/// One state's share of the problem: `source` is the state of the segmentation, `target` the other one.
pub(crate) struct Objective<'a> {
    pub source: &'a Volume<'a>,
    pub target: &'a Volume<'a>,
    /// The direction from source to target.
    pub way: Way,
    pub motions: &'a Motions,
    pub config: &'a ArticulationConfig,
}

/// Query points of the segmentation, group after group, with the gradients returned for them.
struct Queries {
    parts: usize,
    points: Vec<[f32; 3]>,
    noise: Vec<f32>,
    by_probabilities: Vec<f32>,
    by_motions: MotionGradient,
    total: f64,
}

impl Queries {
    /// Adds a group; the index of a point determines its noise.
    fn push(
        &mut self,
        noise: GumbelNoise,
        group: u64,
        points: impl Iterator<Item = (u64, Point3<f64>)>,
    ) -> std::ops::Range<usize> {
        let start = self.points.len();
        for (index, point) in points {
            self.points.push([point.x as f32, point.y as f32, point.z as f32]);
            self.noise
                .extend((0..self.parts as u64).map(|k| noise.noise_at(group, index * self.parts as u64 + k)));
        }
        start..self.points.len()
    }

    fn row(&self, range: &std::ops::Range<usize>) -> std::ops::Range<usize> {
        range.start * self.parts..range.end * self.parts
    }

    /// Adds a weighted loss on a group, and returns its value.
    fn add(&mut self, range: &std::ops::Range<usize>, weight: f64, term: LossTerm) -> f64 {
        let row = self.row(range);
        for (sum, g) in self.by_probabilities[row].iter_mut().zip(&term.by_probabilities) {
            *sum += weight as f32 * g;
        }
        self.by_motions.merge(&term.by_motions.scaled(weight));
        self.total += weight * term.value;
        term.value
    }
}

impl Objective<'_> {
    /// Losses of a batch, and their gradient by the motions; adds to the gradient of the field.
    pub(crate) fn evaluate(
        &self,
        field: &SegmentationField,
        batch: &StateBatch<'_>,
        gradient: &mut SegmentationGradient,
    ) -> (ArticulationLosses, MotionGradient) {
        let parts = field.parts;
        // Points of the other state are moved back to this one, the state of the segmentation.
        let back = self.way.reverse();
        let uniform = batch
            .uniform
            .map(|u| BackwardFlow::gather(&u.points, Some(&u.weights), self.source, self.motions, back));
        let contact =
            batch.collision.map(|points| BackwardFlow::gather(points, None, self.source, self.motions, back));

        let mut queries = Queries {
            parts,
            points: Vec::new(),
            noise: Vec::new(),
            by_probabilities: Vec::new(),
            by_motions: MotionGradient::zero(parts),
            total: 0.0,
        };
        // Query points: ray samples, starts of matches, candidates of occupancy and of collision.
        let samples = batch.rays.points.iter().enumerate().map(|(i, p)| (i as u64, *p));
        let near = queries.push(batch.noise, 0, samples);
        let starts = batch.matches.iter().enumerate();
        let starts =
            starts.map(|(i, m)| (i as u64, self.source.scene.normalise(&Matching::start(m, self.way))));
        let matched = queries.push(batch.noise, 1, starts);
        let [filled, touching] = [(2, &uniform), (3, &contact)].map(|(group, flow)| {
            let candidates = flow.iter().flat_map(|f| &f.candidates);
            queries.push(batch.noise, group, candidates.map(|c| ((c.point * parts + c.part) as u64, c.image)))
        });

        // All groups in one pass: a pass has a fixed cost, and all groups query the same field.
        let activations = field.forward(&queries.points, std::mem::take(&mut gradient.spare));
        let probabilities = softmax(&activations, parts, Some(&queries.noise));
        queries.by_probabilities = vec![0.0; probabilities.len()];

        // Every loss adds its gradient by the probabilities of its group and by the motions.
        let mut losses = ArticulationLosses::default();
        self.add_consistency(batch, &near, &probabilities, &mut queries, &mut losses);
        self.add_matching(batch, &matched, &probabilities, &mut queries, &mut losses);
        self.add_volumes(
            [uniform.as_ref(), contact.as_ref()],
            [&filled, &touching],
            &probabilities,
            &mut queries,
            &mut losses,
        );
        losses.total = queries.total;

        // Back through the softmax and the field; the field gives the gradient by the points as well.
        let by_logits =
            softmax_backward(&probabilities, &queries.by_probabilities, parts, activations.stride);
        let by_points = field.backward(&queries.points, activations, &by_logits, gradient);
        // Motions also determine the places of the candidates.
        for (flow, range) in [(&uniform, filled), (&contact, touching)] {
            if let Some(flow) = flow {
                queries.by_motions.merge(&flow.by_motions(&by_points[range]));
            }
        }
        (losses, queries.by_motions)
    }

    fn add_consistency(
        &self,
        batch: &StateBatch<'_>,
        range: &std::ops::Range<usize>,
        probabilities: &[f32],
        queries: &mut Queries,
        losses: &mut ArticulationLosses,
    ) {
        let Self { source, target, motions, way, config } = *self;
        let weights = &config.weights;
        let consistency = Consistency { batch: batch.rays, source, target, motions, way, config };
        let p = &probabilities[queries.row(range)];
        if weights.sdf > 0.0 {
            losses.sdf = queries.add(range, weights.sdf, consistency.sdf_loss(p));
        }
        if weights.color > 0.0 {
            losses.color = queries.add(range, weights.color, consistency.color_loss(p));
        }
    }

    fn add_matching(
        &self,
        batch: &StateBatch<'_>,
        range: &std::ops::Range<usize>,
        probabilities: &[f32],
        queries: &mut Queries,
        losses: &mut ArticulationLosses,
    ) {
        let weights = &self.config.weights;
        let matching =
            Matching { matches: batch.matches, target: self.target, motions: self.motions, way: self.way };
        let p = &probabilities[queries.row(range)];
        if weights.matching > 0.0 && !range.is_empty() {
            losses.matching = queries.add(range, weights.matching, matching.pixel_loss(p));
        }
    }

    fn add_volumes(
        &self,
        [uniform, contact]: [Option<&BackwardFlow<'_>>; 2],
        [filled, touching]: [&std::ops::Range<usize>; 2],
        probabilities: &[f32],
        queries: &mut Queries,
        losses: &mut ArticulationLosses,
    ) {
        let weights = &self.config.weights;
        if let Some(flow) = uniform {
            let p = &probabilities[queries.row(filled)];
            if weights.occupancy > 0.0 {
                let term = occupancy_loss(flow, p, self.target, self.source, self.config);
                losses.occupancy = queries.add(filled, weights.occupancy, term);
            }
            if weights.collision > 0.0 {
                losses.collision_uniform = queries.add(filled, weights.collision, collision_loss(flow, p));
            }
        }
        if let Some(flow) = contact
            && weights.collision > 0.0
        {
            let p = &probabilities[queries.row(touching)];
            losses.collision_rays = queries.add(touching, weights.collision, collision_loss(flow, p));
        }
    }
}
