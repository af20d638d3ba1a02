//! Composite rendering of several fields along a ray, forward and backward (Liu, Mahdavi-Amiri and Savva
//! 2023, with the many-part form of Weng et al. 2024, supplement).
//!
//! The optical thickness of part k at sample i is `a_ki = sigma_ki delta_i`. With it `alpha_ki = 1 -
//! exp(-a_ki)`, `1 - alpha_i = prod_k (1 - alpha_ki)`, `T_i = prod_{j < i} (1 - alpha_j)` and `w_ki =
//! alpha_ki T_i`. Where several parts are dense at once, their weights sum to more than the absorbed light,
//! and opacities may exceed 1.

use std::ops::Range;

/// Computes the weights of the samples `ray` of every part from their thicknesses `[part][sample]` (at least
/// 0). See docs/method.md (12.21).
pub(super) fn set_weights(thickness: &[Vec<f64>], ray: Range<usize>, weights: &mut [Vec<f64>]) {
    let mut before = 0.0f64;
    for i in ray {
        let transmittance = (-before).exp();
        for (a, w) in thickness.iter().zip(&mut *weights) {
            // 1 - exp(-a), accurate for thin samples.
            w[i] = -(-a[i]).exp_m1() * transmittance;
            before += a[i];
        }
    }
}

/// Replaces the gradient by the weights of the samples `ray` with the gradient by the thicknesses.
pub(super) fn by_thickness(
    thickness: &[Vec<f64>],
    weights: &[Vec<f64>],
    ray: Range<usize>,
    gradient: &mut [Vec<f64>],
) {
    let total = |i: usize| thickness.iter().map(|a| a[i]).sum::<f64>();
    let mut before: f64 = ray.clone().map(total).sum();
    // Effect on all later samples: dT_j / da_ki = -T_j for every j > i.
    let mut behind = 0.0;
    for i in ray.rev() {
        before -= total(i);
        let transmittance = (-before).exp();
        let mut here = 0.0;
        for ((a, w), g) in thickness.iter().zip(weights).zip(&mut *gradient) {
            here += g[i] * w[i];
            // dalpha / da = exp(-a).
            g[i] = g[i] * transmittance * (-a[i]).exp() - behind;
        }
        behind += here;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A made ray of `parts` parts and 12 samples.
    fn made(parts: usize) -> Vec<Vec<f64>> {
        let value = |k: usize, i: usize| 0.4 * (1.0 + ((7 * k + 3 * i) as f64).sin());
        (0..parts).map(|k| (0..12).map(|i| value(k, i)).collect()).collect()
    }

    fn weights_of(thickness: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mut weights = vec![vec![0.0; 12]; thickness.len()];
        set_weights(thickness, 0..12, &mut weights);
        weights
    }

    /// The two-part composite as its equations read.
    #[test]
    fn two_parts_are_the_two_part_composite() {
        let thickness = made(2);
        let mut transmittance = 1.0;
        for (i, (ws, wm)) in weights_of(&thickness)[0].iter().zip(&weights_of(&thickness)[1]).enumerate() {
            let [s, m] = [0, 1].map(|k| 1.0 - (-thickness[k][i]).exp());
            assert!((ws - s * transmittance).abs() < 1e-14 && (wm - m * transmittance).abs() < 1e-14);
            transmittance *= (1.0 - s) * (1.0 - m);
        }
    }

    #[test]
    fn the_gradient_agrees_with_differences() {
        for parts in [1, 2, 3] {
            let thickness = made(parts);
            let by = |k: usize, i: usize| ((5 * k + 2 * i + 1) as f64).cos();
            let value = |a: &[Vec<f64>]| {
                let w = weights_of(a);
                (0..parts).flat_map(|k| (0..12).map(move |i| (k, i))).map(|(k, i)| w[k][i] * by(k, i)).sum()
            };
            let mut gradient: Vec<Vec<f64>> =
                (0..parts).map(|k| (0..12).map(|i| by(k, i)).collect()).collect();
            by_thickness(&thickness, &weights_of(&thickness), 0..12, &mut gradient);
            for k in 0..parts {
                for i in 0..12 {
                    let nudged = |h: f64| -> f64 {
                        let mut a = thickness.clone();
                        a[k][i] += h;
                        value(&a)
                    };
                    let numeric = (nudged(1e-6) - nudged(-1e-6)) / 2e-6;
                    assert!((numeric - gradient[k][i]).abs() < 1e-8);
                }
            }
        }
    }

    #[test]
    fn nothing_has_no_weight_and_a_slab_has_all_of_it() {
        assert!(weights_of(&vec![vec![0.0; 12]; 2]).iter().flatten().all(|&w| w == 0.0));
        let mut slab = vec![vec![0.0; 12]; 2];
        slab[1][5..8].fill(1e4);
        let w = weights_of(&slab);
        assert_eq!(w[1][5], 1.0);
        assert_eq!(w.iter().flatten().sum::<f64>(), 1.0);
    }
}
