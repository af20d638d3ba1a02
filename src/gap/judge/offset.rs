//! A friction with slightly different bounds in the two directions is the same law as a symmetric one with an
//! offset of the effort; no motion distinguishes them.

use nalgebra::DMatrix;

use crate::{
    fit::problem::Problem,
    judge::spread::Spread,
    model::joint_model::{JointModel, Term},
};

/// Standard deviation of an offset, as a share of the friction.
/// measured: eval/gap/machines.md; 0.14 to 0.2 on three real machines.
const OFFSET: f64 = 0.15;

/// Replaces an asymmetric friction by a Coulomb friction and a constant bias if its asymmetry is more
/// probably such an offset than uniformly distributed between none and all of the friction. `given` effects
/// keep their names.
#[must_use]
pub fn with_offset(
    problem: &Problem,
    model: JointModel,
    spread: Spread,
    given: &[usize],
) -> (JointModel, Spread) {
    if !given.is_empty() {
        return (model, spread);
    }
    let index = |name: &str| problem.catalogue.iter().position(|e| e.name() == name);
    let (Some(asymmetric), Some(coulomb), Some(bias)) =
        (index("asymmetric_friction"), index("coulomb_friction"), index("constant_bias"))
    else {
        return (model, spread);
    };
    let beside = model.terms.iter().any(|t| t.effect == bias);
    let Some((at, term)) = model.placed_terms().find(|(_, t)| t.effect == asymmetric && !beside) else {
        return (model, spread);
    };
    let mean = 0.5 * (term.p[0] + term.p[1]);
    let half = 0.5 * (term.p[1] - term.p[0]);
    // Densities of the share: half a normal distribution, and a uniform one with density 1.
    let share = half / (mean * OFFSET);
    let density = (2.0 / std::f64::consts::PI).sqrt() / OFFSET * (-0.5 * share * share).exp();
    if !(density > 1.0) {
        return (model, spread);
    }
    let mut other = model.clone();
    let place = model.terms.iter().position(|t| t.effect == asymmetric).unwrap_or_default();
    other.terms[place] = Term { effect: coulomb, p: vec![mean] };
    // In adjacent positions the two terms take over its columns.
    other.terms.insert(place + 1, Term { effect: bias, p: vec![half] });
    let mut by = DMatrix::identity(spread.covariance.nrows(), spread.covariance.nrows());
    let columns = [(at, at, 0.5), (at, at + 1, 0.5), (at + 1, at, -0.5), (at + 1, at + 1, 0.5)];
    columns.into_iter().for_each(|(i, j, x)| by[(i, j)] = x);
    let mut witnesses = spread.witnesses;
    let fewer = witnesses[at].min(witnesses[at + 1]);
    witnesses[at..at + 2].fill(fewer);
    (other, Spread { covariance: &by * spread.covariance * by.transpose(), witnesses })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        judge::simulated::{pendulum, simulated, with},
        model::{
            effect::{At, Response},
            effects::catalogue,
        },
        record::drive::Hold,
    };

    #[test]
    fn a_small_asymmetry_is_an_offset_and_a_large_one_is_not() {
        let effects = catalogue(0);
        let plant = pendulum(0.6);
        let logs = vec![simulated(
            &effects,
            &JointModel::of_plant(&plant),
            0,
            &mut <rand_pcg::Pcg64Mcg as rand_core::SeedableRng>::seed_from_u64(1),
        )];
        let problem = Problem::new(&effects, &plant, true, logs, Hold::Zero);
        let spread = || Spread {
            covariance: DMatrix::from_diagonal(&nalgebra::DVector::from_vec(vec![0.0, 4.0, 4.0, 1.0])),
            witnesses: vec![1.0, 9.0, 6.0, 3.0],
        };
        let of = |p: [f64; 2]| {
            with(&effects, &plant, &[("asymmetric_friction", &p), ("viscous_friction", &[0.1])])
        };
        let (same, _) = with_offset(&problem, of([0.1, 0.3]), spread(), &[]);
        assert_eq!(same, of([0.1, 0.3]));
        let (other, known) = with_offset(&problem, of([0.2, 0.24]), spread(), &[]);
        let names: Vec<&str> = other.terms.iter().map(|t| effects[t.effect].name()).collect();
        assert_eq!(names, ["coulomb_friction", "constant_bias", "viscous_friction"]);
        assert!((known.covariance[(1, 1)] - 2.0).abs() < 1e-12 && known.covariance[(3, 3)] == 1.0);
        assert_eq!(known.witnesses, [1.0, 6.0, 6.0, 3.0]);
        // Both ways the effort at slip is the same.
        let slip = |model: &JointModel, direction: f64| {
            let term = |t: &Term| {
                let mut r = Response::default();
                effects[t.effect].write_response(&At { direction, ..At::default() }, &t.p, &mut r);
                let resists = effects[t.effect].place() == crate::model::effect::Place::Friction;
                if resists { -direction * r.value } else { r.value }
            };
            model.terms.iter().map(term).sum::<f64>()
        };
        for direction in [1.0, -1.0] {
            let a = slip(&of([0.2, 0.24]), direction);
            let b = slip(&other, direction);
            assert!((a - b).abs() < 1e-12, "{a} {b}");
        }
    }
}
