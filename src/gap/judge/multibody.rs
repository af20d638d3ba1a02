//! Joints of a chain moving together, judged together: their findings are fitted again in one common rollout,
//! and simplified as far as it allows.

use crate::{
    fit::{
        multibody::{
            joints::Joints,
            shooting::{MultibodyFit, MultibodyPace, multibody_fit, window_sizes},
        },
        problem::Problem,
        shooting::Free,
    },
    judge::{
        assess::Examined,
        search::price_of_model,
        simplify::{SIMPLER, special_terms},
        spread::{Spread, with_common},
    },
    model::joint_model::{JointModel, Term},
    twin_tree::TwinTree,
};

/// A joint of a chain: its index in the tree, its runs, and its findings.
type Member<'e, 'c> = (usize, &'e mut Examined<'c>);

/// Fits the findings at the joints of each chain again, together.
pub fn fit_chains(tree: &TwinTree, examined: &mut [Member]) {
    let mut done: Vec<usize> = Vec::new();
    for first in 0..examined.len() {
        let joint = examined[first].0;
        if done.contains(&joint) {
            continue;
        }
        let chain = connected_joints(tree, joint);
        done.extend(&chain);
        let mut members: Vec<&mut Member> =
            examined.iter_mut().filter(|(j, e)| chain.contains(j) && e.diagnosis.is_sufficient()).collect();
        // A joint without a diagnosis has no place in the common rollout.
        if members.len() < 2 || members.len() < chain.len() {
            continue;
        }
        let Some(again) = fitted_together(tree, &members) else { continue };
        for ((_, examined), (model, spread)) in members.iter_mut().zip(again) {
            let is_given = examined.is_given();
            examined.diagnosis.fit_again(&examined.problem, model, spread, is_given);
        }
    }
}

/// A joint and all joints moving it or moved by it, at any distance in the tree.
fn connected_joints(tree: &TwinTree, joint: usize) -> Vec<usize> {
    let mut all = vec![joint];
    let mut next = 0;
    while next < all.len() {
        let more = tree.chain_joints(all[next]).into_iter().filter(|j| !all.contains(j)).collect::<Vec<_>>();
        all.extend(more);
        next += 1;
    }
    all
}

/// Models of joints fitted together, each with its uncertainty; `None` if the joints were not recorded
/// together, nothing was found at any, or held-out runs are predicted no better.
fn fitted_together(tree: &TwinTree, members: &[&mut Member]) -> Option<Vec<(JointModel, Spread)>> {
    let models: Vec<JointModel> =
        members.iter().map(|m| m.1.diagnosis.effects_or_nearest().clone()).collect();
    let indices: Vec<usize> = members.iter().map(|m| m.0).collect();
    let runs: Vec<&Problem> = members.iter().map(|m| &m.1.problem).collect();
    let fitted = simplest_fit(&Joints::new(tree, indices.clone(), &runs)?, &models)?;
    let held_out: Vec<&Problem> = members.iter().map(|m| &m.1.held_out).collect();
    let held_out = Joints::new(tree, indices, &held_out).filter(|j| j.window_count() > 0)?;
    // In units of the fit's residual at each joint.
    let in_units = |w: &Vec<f64>| w.iter().zip(&fitted.size).map(|(x, unit)| (x / unit).powi(2)).sum::<f64>();
    let missed = |models: &[JointModel]| window_sizes(&held_out, models).iter().map(in_units).sum::<f64>();
    if missed(&fitted.models) >= missed(&models) {
        return None;
    }
    let mut first = 0;
    let mut own = Vec::with_capacity(members.len());
    for (model, member) in fitted.models.iter().zip(members) {
        let n = model.free_count();
        let mut covariance = fitted.covariance.view((first, first), (n, n)).into_owned();
        let witnesses = fitted.witnesses[first..first + n].to_vec();
        if member.1.diagnosis.noise.has_remainder() {
            covariance = with_common(&covariance, &witnesses);
        }
        first += n;
        own.push((model.clone(), Spread { covariance, witnesses }));
    }
    Some(own)
}

/// The members' effects fitted together, without those unnecessary in the chain, and with special cases in
/// place of general effects.
fn simplest_fit(joints: &Joints, models: &[JointModel]) -> Option<MultibodyFit> {
    if joints.window_count() == 0 || models.iter().all(|m| m.terms.is_empty()) {
        return None;
    }
    let mut chosen = multibody_fit(joints, models, None, Free::All, MultibodyPace::THOROUGH);
    loop {
        let own = fit_score(joints, &chosen);
        let trials = simpler_models(joints, &chosen).into_iter().map(|(models, lead)| {
            let trial = multibody_fit(joints, &models, Some(&chosen.starts), Free::All, MultibodyPace::TRIAL);
            (fit_score(joints, &trial) - own + lead, trial)
        });
        match trials.max_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((ahead, trial)) if ahead > 0.0 => {
                chosen = multibody_fit(
                    joints,
                    &trial.models,
                    Some(&trial.starts),
                    Free::All,
                    MultibodyPace::THOROUGH,
                );
            }
            _ => return Some(chosen),
        }
    }
}

/// Twice the log likelihood minus the prices of the models.
fn fit_score(joints: &Joints, fitted: &MultibodyFit) -> f64 {
    let prices = joints.problems.iter().zip(&fitted.models).map(|(p, m)| price_of_model(p, m));
    fitted.twice_likelihood - prices.sum::<f64>()
}

/// An effect is kept if a strength is at least this many standard deviations from its neutral value.
/// chosen: without the effect twice the log likelihood falls by the square of this, more than any effect's
/// price.
const SURE: f64 = 6.0;

/// The models with one effect removed, or replaced by a special case, each with its allowed loss of score.
fn simpler_models(joints: &Joints, fitted: &MultibodyFit) -> Vec<(Vec<JointModel>, f64)> {
    let models = &fitted.models;
    let mut all = Vec::new();
    let mut first = 0;
    for (i, model) in models.iter().enumerate() {
        for (t, (at, term)) in model.placed_terms().enumerate() {
            if !has_sure_strength(&joints.problems[i], fitted, first + at, term) {
                let mut without = models.clone();
                without[i].terms.remove(t);
                all.push((without, 0.0));
            }
            for special_term in special_terms(&joints.problems[i], term) {
                let mut special = models.clone();
                special[i].terms[t] = special_term;
                all.push((special, SIMPLER));
            }
        }
        first += model.free_count();
    }
    all
}

/// Whether any strength of a term, with columns from `first` on, is surely off its neutral value.
fn has_sure_strength(problem: &Problem, fitted: &MultibodyFit, first: usize, term: &Term) -> bool {
    let parameters = problem.catalogue[term.effect].parameters();
    (0..term.p.len()).any(|k| {
        let deviation = fitted.covariance[(first + k, first + k)].sqrt();
        parameters[k].neutral.is_some_and(|neutral| (term.p[k] - neutral).abs() > SURE * deviation)
    })
}
