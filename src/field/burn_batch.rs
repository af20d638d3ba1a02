//! The computed samples of a batch, ordered so that the color network gets a rectangle of them.

use std::ops::Range;

use super::{SampleBatch, SdfTarget};

/// Most samples computed at once; a larger batch is split between rays. This bounds the memory of a step:
/// about 2 kB per sample with 64 hidden units.
const PIECE_SAMPLES: usize = 1 << 17;

/// Samples of a range of rays. First come `per_ray` samples of each ray with color loss; the others have TSDF
/// supervision only. Samples without any loss are left out.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Piece {
    /// Number of samples.
    pub samples: usize,
    /// `[samples, 3]` positions in the unit cube.
    pub points: Vec<f32>,
    /// `[samples, 4]`: weight of `max(value - s, 0)`, of `(s - value)^2`, `value`, weight of `max(value - s,
    /// 0)^2`.
    pub targets: Vec<f32>,
    /// Rays with color loss, by their index in the batch.
    pub lit_rays: Vec<usize>,
    /// Number of samples of each of these rays.
    pub per_ray: usize,
    /// `[lit rays, per_ray]` color weights.
    pub color_weights: Vec<f32>,
}

/// Splits a batch into pieces of whole rays; pieces without any loss are left out.
pub(super) fn batch_pieces(batch: &SampleBatch) -> Vec<Piece> {
    let rays = (PIECE_SAMPLES / batch.samples_per_ray.max(1)).max(1);
    let starts = (0..batch.rays).step_by(rays);
    starts.map(|s| Piece::new(batch, s..(s + rays).min(batch.rays))).filter(|p| p.samples > 0).collect()
}

impl Piece {
    fn new(batch: &SampleBatch, rays: Range<usize>) -> Self {
        let lit = |i: usize| batch.color_weights[i] != 0.0;
        let of_ray = |ray: usize| ray * batch.samples_per_ray..(ray + 1) * batch.samples_per_ray;
        let lit_counts: Vec<usize> = rays.clone().map(|r| of_ray(r).filter(|&i| lit(i)).count()).collect();
        let per_ray = lit_counts.iter().copied().max().unwrap_or(0);
        let mut piece = Self { per_ray, ..Self::default() };
        let mut rest = Vec::new();
        for (ray, &count) in rays.zip(&lit_counts) {
            // Rays with fewer samples of color weight are filled up with samples of weight 0.
            let mut fill = if count > 0 { per_ray - count } else { 0 };
            for i in of_ray(ray) {
                if lit(i) || fill > 0 {
                    fill -= usize::from(!lit(i));
                    piece.push_sample(batch, i);
                    piece.color_weights.push(batch.color_weights[i]);
                } else if batch.targets[i] != SdfTarget::Ignore {
                    rest.push(i);
                }
            }
            piece.lit_rays.extend((count > 0).then_some(ray));
        }
        // After the samples of rays with color: the color network processes those as a rectangle.
        for i in rest {
            piece.push_sample(batch, i);
        }
        piece
    }

    fn push_sample(&mut self, batch: &SampleBatch, i: usize) {
        self.samples += 1;
        self.points.extend_from_slice(&batch.points[i]);
        self.targets.extend_from_slice(&match batch.targets[i] {
            SdfTarget::Ignore => [0.0; 4],
            SdfTarget::Empty { value, weight } => [weight, 0.0, value, 0.0],
            SdfTarget::Surface { value, weight } => [0.0, weight, value, 0.0],
            SdfTarget::Background { value, weight } => [0.0, 0.0, value, weight],
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 4 rays of 3 samples: two lit, one lit, none lit, without any loss. Positions are `[sample, 0, 0]`.
    fn batch() -> SampleBatch {
        let empty = |w| SdfTarget::Empty { value: 1.0, weight: w };
        let mut targets = vec![empty(1.0); 12];
        targets[4] = SdfTarget::Surface { value: 0.25, weight: 2.0 };
        targets[7] = SdfTarget::Ignore;
        targets[8] = SdfTarget::Background { value: 0.125, weight: 3.0 };
        targets[9..].fill(SdfTarget::Ignore);
        SampleBatch {
            rays: 4,
            samples_per_ray: 3,
            points: (0..12).map(|i| [i as f32, 0.0, 0.0]).collect(),
            targets,
            color_weights: vec![0.0, 0.5, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            directions: vec![[0.0, 0.0, 1.0]; 4],
            colors: vec![[0.5; 3]; 4],
            ray_weights: vec![1.0; 4],
        }
    }

    #[test]
    fn lit_samples_come_first_and_idle_ones_not_at_all() {
        let pieces = batch_pieces(&batch());
        assert_eq!(pieces.len(), 1);
        let p = &pieces[0];
        let order: Vec<usize> = p.points.chunks(3).map(|x| x[0] as usize).collect();
        assert_eq!(order, [1, 2, 3, 4, 0, 5, 6, 8]);
        assert_eq!((p.lit_rays.as_slice(), p.per_ray, p.samples), ([0, 1].as_slice(), 2, 8));
        assert_eq!(p.color_weights, [0.5, 0.5, 0.0, 1.0]);
        assert_eq!(p.targets[12..16], [0.0, 2.0, 0.25, 0.0]);
        assert_eq!(p.targets[28..], [0.0, 0.0, 0.125, 3.0]);
    }

    #[test]
    fn long_batches_are_cut_between_rays() {
        let per_ray = PIECE_SAMPLES / 2;
        let n = 3 * per_ray;
        let batch = SampleBatch {
            rays: 3,
            samples_per_ray: per_ray,
            points: vec![[0.5; 3]; n],
            targets: vec![SdfTarget::Empty { value: 1.0, weight: 1.0 }; n],
            color_weights: vec![0.0; n],
            directions: vec![[0.0, 0.0, 1.0]; 3],
            colors: vec![[0.5; 3]; 3],
            ray_weights: vec![1.0; 3],
        };
        assert_eq!(
            batch_pieces(&batch).iter().map(|p| p.samples).collect::<Vec<_>>(),
            [2 * per_ray, per_ray]
        );
    }
}
