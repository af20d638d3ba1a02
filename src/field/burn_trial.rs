//! A small gradient that shows whether a device computes correctly.
//!
//! Drivers have been seen that drop most of a sum without an error.

use super::{FieldLosses, SampleBatch, SdfTarget};

/// Rays of the trial.
const RAYS: usize = 64;
/// Samples on each.
const SAMPLES_PER_RAY: usize = 16;
/// Largest difference of a loss, and of a gradient in the Euclidean norm, as a share of what is expected.
/// chosen: far above rounding, far below what a wrong kernel gives
const TOLERANCE: f64 = 0.01;

/// Every kind of loss at points spread over the unit cube.
pub(super) fn trial_batch() -> SampleBatch {
    let samples = RAYS * SAMPLES_PER_RAY;
    // Fractional parts of multiples of the powers of 1 / x, where x^4 = x + 1: evenly spread.
    let spread = |i: usize, base: f64| ((i + 1) as f64 * base).fract() as f32;
    let point = |i: usize| [spread(i, 0.819_172_5), spread(i, 0.671_043_6), spread(i, 0.549_700_5)];
    let target = |i: usize| match i % 4 {
        0 => SdfTarget::Empty { value: 1.0, weight: 1.0 },
        1 => SdfTarget::Surface { value: spread(i, 0.3) - 0.5, weight: 5.0 },
        2 => SdfTarget::Background { value: 0.001, weight: 2.0 },
        _ => SdfTarget::Ignore,
    };
    SampleBatch {
        rays: RAYS,
        samples_per_ray: SAMPLES_PER_RAY,
        points: (0..samples).map(point).collect(),
        targets: (0..samples).map(target).collect(),
        color_weights: (0..samples)
            .map(|i| if i % 3 == 0 { 0.0 } else { 2.0 / SAMPLES_PER_RAY as f32 })
            .collect(),
        directions: vec![[0.6, 0.0, 0.8]; RAYS],
        colors: (0..RAYS).map(point).collect(),
        ray_weights: vec![1.0; RAYS],
    }
}

/// Where a device and the CPU engine differ.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub(super) enum Disagreement {
    #[error("its {name} loss of a trial batch is {found:e}, {expected:e} on the CPU")]
    Loss { name: &'static str, found: f64, expected: f64 },
    #[error("its gradient of a trial batch is {apart:e} off the CPU's, of length {length:e}")]
    Gradient { apart: f64, length: f64 },
}

/// Compares losses and gradient of a device with those expected.
///
/// # Errors
/// What differs.
pub(super) fn agree(
    found: &(FieldLosses, Vec<f32>),
    expected: &(FieldLosses, Vec<f32>),
) -> Result<(), Disagreement> {
    let differs =
        // Negated, here and below, so that NaN differs.
        |found: f64, expected: f64| !((found - expected).abs() <= TOLERANCE * expected.abs() + 1e-9);
    for (name, a, b) in [("SDF", found.0.sdf, expected.0.sdf), ("color", found.0.color, expected.0.color)] {
        if differs(a, b) {
            return Err(Disagreement::Loss { name, found: a, expected: b });
        }
    }
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
    let a = &found.1;
    let b = &expected.1;
    let apart = norm(&mut a.iter().zip(b).map(|(a, b)| f64::from(*a) - f64::from(*b)));
    let length = norm(&mut b.iter().map(|b| f64::from(*b)));
    if a.len() != b.len() || !(apart <= TOLERANCE * length) {
        return Err(Disagreement::Gradient { apart, length });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_that_drops_terms_is_found_out() {
        let losses = FieldLosses { sdf: 0.5, color: 0.1 };
        let expected = (losses, vec![1.0, 2.0, -2.0, 0.0]);
        assert_eq!(agree(&expected, &expected), Ok(()));
        assert_eq!(agree(&(losses, vec![1.001, 2.0, -2.0, 1e-3]), &expected), Ok(()));
        let refused = |found| agree(&found, &expected).unwrap_err().to_string();
        assert!(refused((losses, vec![0.0, 2.0, -2.0, 0.0])).contains("gradient"));
        assert!(refused((losses, vec![f32::NAN, 2.0, -2.0, 0.0])).contains("gradient"));
        assert!(refused((losses, vec![1.0, 2.0, -2.0])).contains("gradient"));
        assert!(refused((FieldLosses { sdf: f64::NAN, ..losses }, expected.1.clone())).contains("SDF"));
        assert!(refused((FieldLosses { color: 0.2, ..losses }, expected.1.clone())).contains("color"));
    }
}
