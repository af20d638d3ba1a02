//! Effects of the other joints of a chain on one joint.

use crate::trig::sin_cos;

/// Inertia and load of a joint between two samples, due to the other joints.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Carried {
    /// Inertia, kg m^2 or kg.
    pub inertia: f64,
    /// Its rate of change, kg m^2/s or kg/s.
    pub inertia_rate: f64,
    /// Load, N m or N: factors of 1, q, sin q, cos q, sin 2q, cos 2q.
    pub load: [f64; 6],
}

impl Carried {
    /// The mean of several.
    #[must_use]
    pub fn mean_of(several: &[Self]) -> Self {
        let share = 1.0 / several.len().max(1) as f64;
        let mut mean = Self::default();
        for one in several {
            mean.inertia += share * one.inertia;
            mean.inertia_rate += share * one.inertia_rate;
            for (sum, x) in mean.load.iter_mut().zip(one.load) {
                *sum += share * x;
            }
        }
        mean
    }

    /// Load and its slope at a position.
    #[must_use]
    pub fn load_and_slope(&self, position: f64) -> (f64, f64) {
        let [constant, slope, s1, c1, s2, c2] = self.load;
        let linear = constant + slope * position;
        if [s1, c1, s2, c2] == [0.0; 4] {
            return (linear, slope);
        }
        let (s, c) = sin_cos(position);
        let ss = 2.0 * s * c;
        let cc = c * c - s * s;
        (linear + s1 * s + c1 * c + s2 * ss + c2 * cc, slope + s1 * c - c1 * s + 2.0 * (s2 * cc - c2 * ss))
    }
}
