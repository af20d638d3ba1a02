//! Adam: beta 0.9 and 0.999, epsilon 1e-15, no weight decay (docs/method.md 12.6).

use nalgebra::{RealField, convert};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::neural::{
    feature_grid::FEATURES,
    segmentation::{SegmentationField, SegmentationGradient},
};
use field::{ADAM_BETAS, ADAM_EPSILON};

/// Moments of a short vector and the steps taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Moments<T> {
    first: Vec<T>,
    second: Vec<T>,
    taken: i32,
}

impl<T: Copy + Default> Moments<T> {
    /// No history of a vector of `length`.
    pub(crate) fn new(length: usize) -> Self {
        Self { first: vec![T::default(); length], second: vec![T::default(); length], taken: 0 }
    }
}

impl<T> Moments<T> {
    /// Whether these are moments of a vector of `length`.
    fn has_length(&self, length: usize) -> bool {
        self.first.len() == length && self.second.len() == length
    }
}

impl Moments<f64> {
    /// The change of every parameter for a gradient.
    pub(crate) fn steps(&mut self, gradient: &[f64], rate: f64) -> Vec<f64> {
        self.taken += 1;
        let rule = Rule::<f64>::at(self.taken, rate);
        let moments = self.first.iter_mut().zip(&mut self.second);
        gradient.iter().zip(moments).map(|(g, (m, v))| rule.change(*g, m, v)).collect()
    }
}

/// Moments of a segmentation field. Grid nodes without any gradient so far are passed over: Adam would leave
/// them as they are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct FieldMoments {
    grid: Moments<f32>,
    layers: Vec<Moments<f32>>,
    touched: Vec<bool>,
}

/// Rate and bias corrections of one step.
#[derive(Clone, Copy)]
struct Rule<T> {
    rate: T,
    root: T,
}

impl<T: RealField + Copy> Rule<T> {
    fn at(taken: i32, rate: f64) -> Self {
        // In double precision: at first 1 - b2^t is a thousandth.
        let [b1, b2] = [ADAM_BETAS.0, ADAM_BETAS.1].map(f64::from);
        Self {
            rate: convert(rate / (1.0 - b1.powi(taken))),
            root: convert((1.0 / (1.0 - b2.powi(taken))).sqrt()),
        }
    }

    /// The change of a parameter by its gradient, docs/method.md (12.9); updates its moments. Epsilon stands
    /// outside the root, as in PyTorch.
    fn change(self, g: T, m: &mut T, v: &mut T) -> T {
        let [b1, b2, epsilon]: [T; 3] =
            [ADAM_BETAS.0, ADAM_BETAS.1, ADAM_EPSILON].map(|x| convert(f64::from(x)));
        *m = b1 * *m + (T::one() - b1) * g;
        *v = b2 * *v + (T::one() - b2) * g * g;
        -self.rate * *m / (v.sqrt() * self.root + epsilon)
    }
}

impl Rule<f32> {
    /// Steps parameters and clears the gradient.
    fn apply(self, p: &mut [f32], g: &mut [f32], m: &mut [f32], v: &mut [f32]) {
        for (((p, g), m), v) in p.iter_mut().zip(g).zip(m).zip(v) {
            *p += self.change(std::mem::take(g), m, v);
        }
    }
}

impl FieldMoments {
    /// No history.
    pub(crate) fn new(field: &SegmentationField) -> Self {
        let lengths = field.layers.iter().flat_map(|l| [l.weights.len(), l.biases.len()]);
        Self {
            grid: Moments::new(field.grid.len()),
            layers: lengths.map(Moments::new).collect(),
            touched: vec![false; field.grid.len() / FEATURES],
        }
    }

    /// Whether these are moments of a field of this shape.
    pub(crate) fn has_shape_of(&self, field: &SegmentationField) -> bool {
        let lengths: Vec<usize> =
            field.layers.iter().flat_map(|l| [l.weights.len(), l.biases.len()]).collect();
        self.grid.has_length(field.grid.len())
            && self.touched.len() * FEATURES == field.grid.len()
            && self.layers.len() == lengths.len()
            && self.layers.iter().zip(&lengths).all(|(m, &length)| m.has_length(length))
    }

    /// One step; clears the gradient.
    pub(crate) fn step(
        &mut self,
        field: &mut SegmentationField,
        gradient: &mut SegmentationGradient,
        rate: f64,
    ) {
        self.grid.taken += 1;
        let rule = Rule::<f32>::at(self.grid.taken, rate);
        // A node with a gradient in the past still moves by its moments.
        for (ever, now) in self.touched.iter_mut().zip(&mut gradient.touched) {
            *ever |= std::mem::take(now);
        }
        const SLAB: usize = 4096;
        let parameters =
            (field.grid.par_chunks_mut(SLAB * FEATURES), gradient.grid.par_chunks_mut(SLAB * FEATURES));
        let moments = (
            self.grid.first.par_chunks_mut(SLAB * FEATURES),
            self.grid.second.par_chunks_mut(SLAB * FEATURES),
        );
        let slabs = parameters.into_par_iter().zip(moments).zip(self.touched.par_chunks(SLAB));
        slabs.for_each(|(((p, g), (m, v)), touched)| {
            // The surface touches few of the cube's nodes.
            for (node, _) in touched.iter().enumerate().filter(|(_, t)| **t) {
                let at = node * FEATURES..(node + 1) * FEATURES;
                rule.apply(&mut p[at.clone()], &mut g[at.clone()], &mut m[at.clone()], &mut v[at]);
            }
        });
        let layers = field.layers.iter_mut().zip(&mut gradient.layers);
        for ((layer, by_layer), moments) in layers.zip(self.layers.chunks_exact_mut(2)) {
            rule.apply(
                &mut layer.weights,
                &mut by_layer.weights,
                &mut moments[0].first,
                &mut moments[0].second,
            );
            rule.apply(
                &mut layer.biases,
                &mut by_layer.biases,
                &mut moments[1].first,
                &mut moments[1].second,
            );
        }
    }
}

/// Exponential fall from the first to the last rate over a number of steps.
pub(crate) fn rate_at(range: [f64; 2], step: usize, steps: usize) -> f64 {
    range[0] * (range[1] / range[0]).powf(step as f64 / steps.max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bowl_is_descended() {
        let mut m = Moments::new(2);
        let mut x = [3.0, -1.0];
        for k in 0..400 {
            let g = [2.0 * x[0], 20.0 * x[1]];
            let d = m.steps(&g, rate_at([0.1, 1e-4], k, 400));
            x[0] += d[0];
            x[1] += d[1];
        }
        assert!(x[0].abs() < 0.03 && x[1].abs() < 0.03, "{x:?}");
    }
}
