//! The recorded path of a point of the moving part.

use nalgebra::{UnitQuaternion, Vector3};
use numeric::statistics::median;

/// Positions of a point in one frame, with rotations and stamps where they were recorded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointTrack {
    /// Name of the recording.
    pub name: String,
    /// Stamps, seconds, increasing; empty where there are none.
    pub time_s: Vec<f64>,
    /// Positions, meters.
    pub position: Vec<Vector3<f64>>,
    /// Rotations `frame_from_point`; empty where positions alone were recorded.
    pub rotation: Vec<UnitQuaternion<f64>>,
}

impl PointTrack {
    /// Medians of groups of neighboring samples, so that at most `most` remain: their errors are alike, and
    /// outliers change no median.
    #[must_use]
    pub fn grouped(&self, most: usize) -> Self {
        let size = self.position.len().div_ceil(most).max(1);
        let middles = |values: &[f64]| values.chunks(size).map(|c| c[c.len() / 2]).collect();
        Self {
            name: self.name.clone(),
            time_s: middles(&self.time_s),
            position: self.position.chunks(size).map(middle_vector).collect(),
            rotation: self.rotation.chunks(size).map(middle_rotation).collect(),
        }
    }

    /// Time of every sample as a share of the recording; by their number where there are no stamps.
    #[must_use]
    pub fn shares_of_time(&self) -> Vec<f64> {
        let n = self.position.len();
        let by_number: Vec<f64> = (0..n).map(|k| k as f64 / n as f64).collect();
        let (Some(first), Some(last)) = (self.time_s.first(), self.time_s.last()) else { return by_number };
        if last <= first {
            return by_number;
        }
        self.time_s.iter().map(|t| (t - first) / (last - first)).collect()
    }

    /// Rotation vectors from the middle sample's rotation, radians, without jumps by full turns; empty
    /// without rotations.
    #[must_use]
    pub fn spins(&self) -> Vec<Vector3<f64>> {
        let Some(middle) = self.rotation.get(self.rotation.len() / 2) else { return Vec::new() };
        let mut spins: Vec<Vector3<f64>> =
            self.rotation.iter().map(|r| geometry::log_so3(&(r * middle.inverse()))).collect();
        let half = spins.len() / 2;
        for k in half + 1..spins.len() {
            spins[k] = nearest_branch(&spins[k], &spins[k - 1]);
        }
        for k in (0..half).rev() {
            spins[k] = nearest_branch(&spins[k], &spins[k + 1]);
        }
        spins
    }
}

/// Medians of each coordinate.
fn middle_vector(vectors: &[Vector3<f64>]) -> Vector3<f64> {
    Vector3::from_fn(|c, _| median(vectors.iter().map(|v| v[c]).collect()).unwrap_or(0.0))
}

/// The middle rotation of a group, moved by the median of the others against it.
fn middle_rotation(rotations: &[UnitQuaternion<f64>]) -> UnitQuaternion<f64> {
    let middle = rotations[rotations.len() / 2];
    let off: Vec<Vector3<f64>> =
        rotations.iter().map(|r| geometry::log_so3(&(r * middle.inverse()))).collect();
    geometry::exp_so3(&middle_vector(&off)) * middle
}

/// Of all rotation vectors of one rotation, the one nearest to another vector.
fn nearest_branch(spin: &Vector3<f64>, other: &Vector3<f64>) -> Vector3<f64> {
    let angle = spin.norm();
    if angle < 1e-9 {
        return *spin;
    }
    let unit = spin / angle;
    let turns = ((unit.dot(other) - angle) / std::f64::consts::TAU).round();
    unit * (angle + turns * std::f64::consts::TAU)
}
