//! Sets with one effect of a found set replaced: growing one by one misses sets whose first member is weaker
//! alone.

use crate::{
    fit::shooting::MAX_FIT_FREE,
    model::joint_model::{Catalogue, JointModel},
};

/// All sets with one effect of `set` replaced by one of `others`, single-effect models; parameters are taken
/// from both. Overlapping effects, sets too large to be fitted and `known` sets are left out.
#[must_use]
pub fn exchanged_sets(
    catalogue: &Catalogue,
    set: &JointModel,
    others: &[&JointModel],
    known: impl Fn(&[usize]) -> bool,
) -> Vec<JointModel> {
    let spec = |effect: usize| catalogue[effect].effect_spec();
    let mut found: Vec<JointModel> = Vec::new();
    for i in 0..set.terms.len() {
        for new in others.iter().filter_map(|other| other.terms.first()) {
            let mut model = set.clone();
            model.terms.remove(i);
            if model.terms.iter().any(|t| spec(t.effect).overlaps_with(spec(new.effect))) {
                continue;
            }
            model.terms.push(new.clone());
            let effects = model.effect_indices();
            let is_new = effects != set.effect_indices()
                && !known(&effects)
                && !found.iter().any(|f| f.effect_indices() == effects);
            if is_new && model.free_count() <= MAX_FIT_FREE {
                found.push(model);
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{
        actuator::Actuator,
        effects::catalogue,
        plant::{Load, Plant},
    };

    #[test]
    fn each_effect_makes_room_for_each_other_once() {
        let effects = catalogue(0);
        let of = |name: &str| effects.iter().position(|e| e.name() == name).unwrap();
        let plant = Plant {
            inertia: 0.1,
            damping: 0.0,
            friction: 0.0,
            load: Load::default(),
            most_load: 0.0,
            actuator: Actuator::default(),
        };
        let nothing = JointModel::of_plant(&plant);
        let alone = |name: &str, p: &[f64]| nothing.clone().with_effect(of(name), p);
        let set = alone("encoder_scale", &[1.1]).with_effect(of("viscous_friction"), &[0.2]);
        let friction = alone("coulomb_friction", &[0.3]);
        let bias = alone("constant_bias", &[0.1]);
        let own = alone("viscous_friction", &[0.4]);
        let gain = alone("torque_gain", &[1.2]);
        let others = [&friction, &bias, &own, &gain];
        let sorted = |names: [&str; 2]| {
            let mut effects = names.map(of).to_vec();
            effects.sort_unstable();
            effects
        };
        let known = sorted(["encoder_scale", "constant_bias"]);
        let found: Vec<Vec<usize>> = exchanged_sets(&effects, &set, &others, |e| e == known)
            .iter()
            .map(JointModel::effect_indices)
            .collect();
        assert!(found.contains(&sorted(["coulomb_friction", "viscous_friction"])), "{found:?}");
        assert!(found.contains(&sorted(["encoder_scale", "coulomb_friction"])), "{found:?}");
        assert!(found.contains(&sorted(["constant_bias", "viscous_friction"])), "{found:?}");
        assert!(!found.iter().any(|f| f == &known || f.len() != 2), "{found:?}");
        // The set itself is no exchange, and nothing stands beside itself.
        assert!(!found.contains(&set.effect_indices()) && found.iter().all(|f| f[0] != f[1]), "{found:?}");
        let mut once = found.clone();
        once.sort();
        once.dedup();
        assert_eq!(once.len(), found.len());
    }
}
