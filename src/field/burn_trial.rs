//! A small gradient that tests a device.
//!
//! Some drivers drop most of a sum without an error.

use super::{FieldLosses, SampleBatch, SdfTarget};

/// Rays of the trial batch.
const RAYS: usize = 64;
/// Samples per ray.
const SAMPLES_PER_RAY: usize = 16;
/// Largest relative difference of a loss, and of the gradient in the Euclidean norm.
/// chosen: far above rounding, far below the error of a faulty kernel
const TOLERANCE: f64 = 0.01;

/// A batch with every kind of loss at points all over the unit cube.
pub(super) fn trial_batch() -> SampleBatch {
    let samples = RAYS * SAMPLES_PER_RAY;
    SampleBatch {
        rays: RAYS,
        samples_per_ray: SAMPLES_PER_RAY,
        points: (0..samples).map(spread_point).collect(),
        targets: (0..samples).map(trial_target).collect(),
        color_weights: (0..samples)
            .map(|i| if i % 3 == 0 { 0.0 } else { 2.0 / SAMPLES_PER_RAY as f32 })
            .collect(),
        directions: vec![[0.6, 0.0, 0.8]; RAYS],
        colors: (0..RAYS).map(spread_point).collect(),
        ray_weights: vec![1.0; RAYS],
    }
}

/// Item `i` of a low-discrepancy sequence in `[0, 1)`: the fractional part of a multiple of `base`.
fn spread(i: usize, base: f64) -> f32 {
    ((i + 1) as f64 * base).fract() as f32
}

/// Item `i` of a low-discrepancy sequence in the unit cube, by powers of 1 / x with x^4 = x + 1.
fn spread_point(i: usize) -> [f32; 3] {
    [spread(i, 0.819_172_5), spread(i, 0.671_043_6), spread(i, 0.549_700_5)]
}

fn trial_target(i: usize) -> SdfTarget {
    match i % 4 {
        0 => SdfTarget::Empty { value: 1.0, weight: 1.0 },
        1 => SdfTarget::Surface { value: spread(i, 0.3) - 0.5, weight: 5.0 },
        2 => SdfTarget::Background { value: 0.001, weight: 2.0 },
        _ => SdfTarget::Ignore,
    }
}

/// How a device disagrees with the CPU engine.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub(super) enum Disagreement {
    #[error("its {name} loss of a trial batch is {found:e}, {expected:e} on the CPU")]
    Loss { name: &'static str, found: f64, expected: f64 },
    #[error("its gradient of a trial batch is {apart:e} off the CPU's, of length {length:e}")]
    Gradient { apart: f64, length: f64 },
}

/// Compares the losses and gradient of a device with the expected ones.
///
/// # Errors
/// The first difference.
pub(super) fn agree(
    found: &(FieldLosses, Vec<f32>),
    expected: &(FieldLosses, Vec<f32>),
) -> Result<(), Disagreement> {
    for (name, a, b) in [("SDF", found.0.sdf, expected.0.sdf), ("color", found.0.color, expected.0.color)] {
        // Negated, here and below, so that NaN counts as a difference.
        if !((a - b).abs() <= TOLERANCE * b.abs() + 1e-9) {
            return Err(Disagreement::Loss { name, found: a, expected: b });
        }
    }
    let a = &found.1;
    let b = &expected.1;
    let apart = euclidean_norm(a.iter().zip(b).map(|(a, b)| f64::from(*a) - f64::from(*b)));
    let length = euclidean_norm(b.iter().map(|b| f64::from(*b)));
    if a.len() != b.len() || !(apart <= TOLERANCE * length) {
        return Err(Disagreement::Gradient { apart, length });
    }
    Ok(())
}

fn euclidean_norm(values: impl Iterator<Item = f64>) -> f64 {
    values.map(|v| v * v).sum::<f64>().sqrt()
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
