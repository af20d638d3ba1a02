//! Tests whether an effect is certainly present, in a recording with a remainder.

use crate::{
    judge::spread::Spread,
    model::joint_model::{Catalogue, Term},
};

/// Whether the strengths of a term, with columns from `at` on, are surely not all neutral. The search only
/// asks whether an effect explains samples, and the remainder may contribute to these; so the confidence
/// region of the strengths decides. An effect with a shape is accepted, since its shape can stand in for
/// strength (a narrower one is stronger). See docs/method.md 14.11.
#[must_use]
pub fn is_surely_there(catalogue: &Catalogue, spread: &Spread, at: usize, term: &Term) -> bool {
    let parameters = catalogue[term.effect].parameters();
    let off: Option<Vec<f64>> =
        term.p.iter().zip(parameters).map(|(p, own)| Some(p - own.neutral?)).collect();
    off.is_none_or(|off| spread.distance_in_region(at, &off) > 1.0)
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::*;
    use crate::model::effects::catalogue;

    #[test]
    fn an_interval_that_holds_no_effect_leaves_it_open() {
        let effects = catalogue(0);
        let spread = |deviation: f64| Spread {
            covariance: DMatrix::from_diagonal_element(3, 3, deviation * deviation),
            witnesses: vec![1e6; 3],
        };
        let is_sure = |name: &str, p: &[f64], deviation: f64| {
            let effect = effects.iter().position(|e| e.name() == name).unwrap();
            is_surely_there(&effects, &spread(deviation), 0, &Term { effect, p: p.to_vec() })
        };
        assert!(is_sure("inertia", &[0.2], 0.1) && !is_sure("inertia", &[0.19], 0.1));
        // Neutral is one for a factor.
        assert!(is_sure("torque_gain", &[0.8], 0.1) && !is_sure("torque_gain", &[1.1], 0.1));
        // An axis tilt has two strengths, unsure one by one and sure together.
        assert!(is_sure("axis_tilt", &[0.18, 0.18], 0.1) && !is_sure("axis_tilt", &[0.18, 0.0], 0.1));
        // The width of a detent makes up for its depth.
        assert!(is_sure("detent", &[0.01, 0.5, 0.1], 0.1));
    }
}
