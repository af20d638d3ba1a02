//! Condition for a single name: its weight among all rivals.

/// Least weight of a single name.
/// chosen: one minus a level of 5 %, as for the intervals.
pub(super) const NAME_WEIGHT: f64 = 0.95;

/// Least gain of twice the log likelihood for one of `effects` effects to have the weight of a name. A priori
/// all effects are equally probable, and one effect is as probable as none.
/// See docs/method.md (14.16).
#[must_use]
pub fn least_gain(effects: usize) -> f64 {
    2.0 * (effects as f64 * NAME_WEIGHT / (1.0 - NAME_WEIGHT)).ln()
}

/// Number of rivals in the smallest class reaching `NAME_WEIGHT` together with the set of weight `own`: none
/// if this suffices alone. `rivals` are weights sorted from the largest.
#[must_use]
pub fn rivals_in_doubt(own: f64, rivals: &[f64]) -> usize {
    let wanted = NAME_WEIGHT * (own + rivals.iter().sum::<f64>());
    let held = rivals.iter().scan(own, |held, w| {
        let before = *held;
        *held += w;
        Some(before)
    });
    held.take_while(|held| *held < wanted).count()
}

/// The rivals in doubt beside a set of weight 1, heaviest first, and the total weight of all.
#[must_use]
pub fn in_doubt(mut rivals: Vec<(Vec<usize>, f64)>) -> (Vec<(Vec<usize>, f64)>, f64) {
    rivals.sort_by(|a, b| b.1.total_cmp(&a.1));
    let weights: Vec<f64> = rivals.iter().map(|(_, w)| *w).collect();
    rivals.truncate(rivals_in_doubt(1.0, &weights));
    (rivals, 1.0 + weights.iter().sum::<f64>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rivals_are_in_doubt_until_the_rest_weighs_a_twentieth() {
        assert_eq!(rivals_in_doubt(1.0, &[]), 0);
        assert_eq!(rivals_in_doubt(1.0, &[0.05]), 0);
        assert_eq!(rivals_in_doubt(1.0, &[0.06]), 1);
        // Many of little weight count as one of much.
        assert_eq!(rivals_in_doubt(1.0, &[0.03, 0.03]), 1);
        assert_eq!(rivals_in_doubt(0.5, &[0.4, 0.06, 0.04]), 2);
        // Any unit of weight.
        assert_eq!(rivals_in_doubt(50.0, &[40.0, 6.0, 4.0]), 2);
    }

    #[test]
    fn sets_in_doubt_are_sorted_and_all_weigh() {
        let sets = vec![(vec![3], 0.01), (vec![1], 0.2), (vec![2], 0.5)];
        let (rivals, total) = in_doubt(sets);
        assert_eq!(rivals, [(vec![2], 0.5), (vec![1], 0.2)]);
        assert!((total - 1.71).abs() < 1e-12);
    }

    #[test]
    fn the_least_gain_gives_the_weight_of_a_name() {
        for effects in [1, 22, 100] {
            let odds = (0.5 * least_gain(effects)).exp() / effects as f64;
            assert!((odds / (1.0 + odds) - NAME_WEIGHT).abs() < 1e-12);
        }
    }
}
