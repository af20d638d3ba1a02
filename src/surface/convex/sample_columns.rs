//! Samples of a surface stored by column, for vector instructions.

use nalgebra::Vector3;

use super::{Plane, pieces::Sample};
use numeric::vectorized;

/// Cosine below which a ray runs along a face and leaves the solid elsewhere. chosen: above rounding
pub(super) const GRAZING: f64 = 1e-3;

/// Positions, meters, normals, areas, square meters, and face indices of some samples.
pub(super) struct SampleColumns {
    places: [Vec<f64>; 3],
    normals: [Vec<f64>; 3],
    pub areas_m2: Vec<f64>,
    pub faces: Vec<u32>,
}

/// Samples relative to a plane's normal: heights along it, meters, and the cosines of their own normals to
/// it.
#[derive(Default)]
pub(super) struct Slopes {
    pub heights: Vec<f64>,
    pub speeds: Vec<f64>,
}

/// Distances of samples in front of planes, and of planes in front of samples, meters.
struct Distances {
    /// Distance from each sample along its normal to the first plane.
    nearest: Vec<f64>,
    /// How far each sample lies outside.
    outside: Vec<f64>,
}

impl SampleColumns {
    pub(super) fn of_samples<'a>(samples: impl Iterator<Item = &'a Sample>) -> Self {
        let mut columns = Self {
            places: Default::default(),
            normals: Default::default(),
            areas_m2: Vec::new(),
            faces: Vec::new(),
        };
        for sample in samples {
            for k in 0..3 {
                columns.places[k].push(sample.place[k]);
                columns.normals[k].push(sample.normal[k]);
            }
            columns.areas_m2.push(sample.area_m2);
            columns.faces.push(sample.face);
        }
        columns
    }

    pub(super) fn len(&self) -> usize {
        self.faces.len()
    }

    /// Writes the heights and cosines of the samples relative to a normal.
    pub(super) fn write_slopes(&self, normal: &Vector3<f64>, slopes: &mut Slopes) {
        slopes.heights.resize(self.len(), 0.0);
        slopes.speeds.resize(self.len(), 0.0);
        along(&self.places, normal, &mut slopes.heights);
        along(&self.normals, normal, &mut slopes.speeds);
    }

    /// Distances between the solid behind all planes and each sample, meters: of the sample outside the
    /// solid, or of the solid in front of the sample along its normal.
    pub(super) fn distances_m(&self, planes: &[Plane]) -> Vec<f64> {
        let n = self.len();
        let mut found = Distances { nearest: vec![f64::INFINITY; n], outside: vec![0.0; n] };
        let mut slopes = Slopes::default();
        for plane in planes {
            self.write_slopes(&plane.normal, &mut slopes);
            stand(&slopes, plane.offset_m, &mut found);
        }
        let distances = found.nearest.into_iter().zip(found.outside);
        distances.map(|(nearest, outside)| if outside > 0.0 { outside } else { nearest }).collect()
    }
}

vectorized! {
    /// Writes the inner products of vectors with an axis.
    fn along(columns: &[Vec<f64>; 3], axis: &Vector3<f64>, products: &mut [f64]) = products_of
}

#[inline(always)]
fn products_of(columns: &[Vec<f64>; 3], axis: &Vector3<f64>, products: &mut [f64]) {
    let [x, y, z] = columns;
    for (((x, y), z), product) in x.iter().zip(y).zip(z).zip(products) {
        *product = axis.x * x + axis.y * y + axis.z * z;
    }
}

vectorized! {
    /// Updates the distances with a plane.
    fn stand(slopes: &Slopes, offset_m: f64, distances: &mut Distances) = stand_before
}

#[inline(always)]
fn stand_before(slopes: &Slopes, offset_m: f64, distances: &mut Distances) {
    let Slopes { heights, speeds } = slopes;
    let all = heights.iter().zip(speeds).zip(&mut distances.nearest).zip(&mut distances.outside);
    for (((height, speed), nearest), outside) in all {
        let depth = offset_m - height;
        let met = if *speed > GRAZING { depth / speed } else { f64::INFINITY };
        *nearest = if met < *nearest { met } else { *nearest };
        *outside = if -depth > *outside { -depth } else { *outside };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cube_stands_before_what_lies_in_it_and_what_lies_out_of_it_stands_out() {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let planes: Vec<Plane> =
            axes.into_iter().flat_map(|n| [n, -n]).map(|normal| Plane { normal, offset_m: 0.5 }).collect();
        let sample = |x: f64, normal: Vector3<f64>| Sample {
            place: Vector3::new(x, 0.1, 0.0),
            normal,
            area_m2: 1.0,
            face: 0,
        };
        let slanted = Vector3::new(0.6, 0.8, 0.0);
        let samples = [
            sample(0.2, Vector3::x()),
            sample(0.2, -Vector3::x()),
            // Along its normal the cube ends at y = 0.5 first.
            sample(0.0, slanted),
            sample(0.7, Vector3::x()),
        ];
        // Many of them, so whole registers and the rest are both met.
        let many: Vec<Sample> = samples.iter().copied().cycle().take(4 * 11).collect();
        let found = SampleColumns::of_samples(many.iter()).distances_m(&planes);
        for of_four in found.chunks_exact(4) {
            let off =
                of_four.iter().zip([0.3, 0.7, 0.5, 0.2]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-12, "{of_four:?}");
        }
    }
}
