//! A model as a file format can express it.

use super::{
    format::{Expression, Format},
    joint_model::{Catalogue, JointModel, Term},
};

/// The model as a format can express it, in effects of the catalogue.
pub fn expressed_model(format: Format, model: &JointModel, catalogue: &Catalogue) -> JointModel {
    // The nuisances stay: they belong to the recording, not to the format.
    let mut held = JointModel { terms: Vec::new(), ..model.clone() };
    for term in &model.terms {
        match catalogue[term.effect].in_format(format, &term.p, &model.plant) {
            Expression::Native => held.terms.push(term.clone()),
            Expression::Approximated(nearest) => held.terms.extend(nearest.into_iter().filter_map(|n| {
                let effect = match n.effect {
                    None => Some(term.effect),
                    Some(name) => catalogue.iter().position(|e| e.name() == name),
                };
                Some(Term { effect: effect?, p: n.p })
            })),
            Expression::NotExpressible => {}
        }
    }
    held
}
