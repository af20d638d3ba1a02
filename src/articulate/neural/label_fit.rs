//! Fits a segmentation field to labelled surface points by cross-entropy, before motions are refined.

use nalgebra::{Point3, Vector3};
use rand_core::Rng;

use crate::neural::segmentation::{SegmentationField, SegmentationGradient, softmax, softmax_backward};
use numeric::random::{index_below, unit_uniform};

/// Labelled points of one state, normalised.
pub(crate) struct LabelSet {
    pub points: Vec<Point3<f64>>,
    pub labels: Vec<u8>,
}

impl LabelSet {
    /// Mean cross-entropy (nats) of `count` random points, and adds its gradient. Each point is moved by up
    /// to `reach` (normalised) along every axis, so the space around the surface takes its label too.
    pub(crate) fn loss(
        &self,
        field: &SegmentationField,
        count: usize,
        reach: f64,
        gradient: &mut SegmentationGradient,
        rng: &mut impl Rng,
    ) -> f64 {
        let parts = field.parts;
        let chosen: Vec<usize> = (0..count).map(|_| index_below(rng, self.points.len())).collect();
        let mut points: Vec<[f32; 3]> = Vec::with_capacity(count);
        for &i in &chosen {
            let p = self.points[i] + Vector3::from_fn(|_, _| (2.0 * unit_uniform(rng) - 1.0) * reach);
            points.push([p.x as f32, p.y as f32, p.z as f32]);
        }
        let activations = field.forward(&points, std::mem::take(&mut gradient.spare));
        let probabilities = softmax(&activations, parts, None);
        let mut by_probabilities = vec![0.0; probabilities.len()];
        let mut total = 0.0;
        for (k, i) in chosen.iter().enumerate() {
            let at = k * parts + usize::from(self.labels[*i]);
            // A probability rounded to 0 must not make the loss infinite.
            let p = probabilities[at].max(1e-9);
            total -= f64::from(p.ln());
            by_probabilities[at] = -1.0 / (p * count as f32);
        }
        let by_logits = softmax_backward(&probabilities, &by_probabilities, parts, activations.stride);
        field.backward(&points, activations, &by_logits, gradient);
        total / count as f64
    }
}
