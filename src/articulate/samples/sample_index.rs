//! Nearest surface samples by position and normal, on a grid of cells.

use nalgebra::{Point3, Vector3};

use crate::observations::SurfaceSamples;
use geometry::bounding_box;
use numeric::lists::Lists;

/// Largest number of cells of an index; larger scenes get larger cells.
///
/// chosen: 8 MB of cells
const MOST_CELLS: f64 = 2e6;
/// Factor by which cells grow until they are few enough.
///
/// chosen: a few trials, and little is given away
const LARGER: f64 = 1.5;

/// Samples sorted into cells of the search radius.
pub(crate) struct SampleIndex<'a> {
    samples: &'a SurfaceSamples,
    origin: Point3<f64>,
    cell_m: f64,
    reach_m: f64,
    dims: [usize; 3],
    /// Samples of every cell.
    cells: Lists<u32>,
    /// Positions of the samples in that order: those of a row of cells are contiguous in memory.
    points: Vec<Point3<f64>>,
}

impl<'a> SampleIndex<'a> {
    /// An index for searches up to `reach_m`.
    pub(crate) fn new(samples: &'a SurfaceSamples, reach_m: f64) -> Self {
        let (origin, upper) = bounding_box(samples.points.iter().copied()).unwrap_or_default();
        let extent = upper - origin;
        let mut cell_m = reach_m;
        let dims_of = |cell: f64| [0, 1, 2].map(|k| (extent[k] / cell).floor() + 1.0);
        // In a large scene, cells of a short reach would take more memory than the samples.
        while dims_of(cell_m).iter().product::<f64>() > MOST_CELLS {
            cell_m *= LARGER;
        }
        let dims = dims_of(cell_m).map(|d| d as usize);
        let no_cells = Lists::of_entries(0, std::iter::empty());
        let index = Self { samples, origin, cell_m, reach_m, dims, cells: no_cells, points: Vec::new() };
        let sample_cells: Vec<u32> = samples
            .points
            .iter()
            .map(|p| index.cell_index(index.cell_of(p).map(|c| c as usize)) as u32)
            .collect();
        let cells = Lists::of_entries(dims.iter().product(), sample_cells.iter().copied().zip(0..));
        let points = cells.entries().iter().map(|&i| samples.points[i as usize]).collect();
        Self { cells, points, ..index }
    }

    fn cell_of(&self, p: &Point3<f64>) -> [i64; 3] {
        let g = (p - self.origin) / self.cell_m;
        [0, 1, 2].map(|k| g[k].floor() as i64)
    }

    fn cell_index(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.dims[0] * (y + self.dims[1] * z)
    }

    /// Visits all samples in the cells around a point with their positions: every sample within the reach,
    /// and some beyond.
    pub(crate) fn visit_around(&self, point: &Point3<f64>, mut visit: impl FnMut(usize, &Point3<f64>)) {
        let c = self.cell_of(point);
        let low = c.map(|c| (c - 1).max(0));
        let high = [0, 1, 2].map(|k| (c[k] + 1).min(self.dims[k] as i64 - 1));
        if low[0] > high[0] {
            return;
        }
        // Cells are at least as wide as the reach, so the 27 around a point contain all samples within it.
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                let [first, last] =
                    [low[0], high[0]].map(|x| self.cell_index([x, y, z].map(|c| c as usize)) as u32);
                let row = self.cells.range_of_lists(first, last);
                let samples = self.cells.entries()[row.clone()].iter().zip(&self.points[row]);
                samples.for_each(|(&i, p)| visit(i as usize, p));
            }
        }
    }

    /// Distance to the nearest sample, meters; the reach where none is nearer.
    pub(crate) fn distance_m(&self, point: &Point3<f64>) -> f64 {
        let mut squared = self.reach_m * self.reach_m;
        self.visit_around(point, |_, p| squared = squared.min((p - point).norm_squared()));
        squared.sqrt()
    }

    /// The sample with the smallest `|dp|^2 + (reach |dn| / 2)^2`, if this is below the reach squared:
    /// opposite sides of a thin sheet never match. See docs/method.md (6.3).
    pub(crate) fn nearest_sample(&self, point: &Point3<f64>, normal: &Vector3<f64>) -> Option<usize> {
        // derived: the square of the half in that distance
        let bend = 0.25 * self.reach_m * self.reach_m;
        let mut best = None;
        let mut best_squared = self.reach_m * self.reach_m;
        self.visit_around(point, |i, p| {
            let squared = (p - point).norm_squared();
            // The normal is read only where the distance alone does not decide.
            if squared < best_squared {
                let with_normal = squared + bend * (self.samples.normals[i] - normal).norm_squared();
                if with_normal < best_squared {
                    (best, best_squared) = (Some(i), with_normal);
                }
            }
        });
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_sample_is_that_of_an_exhaustive_search() {
        let mut samples = SurfaceSamples::default();
        for i in 0..500 {
            let t = f64::from(i);
            samples.points.push(Point3::new((t * 0.7).sin(), (t * 1.3).cos(), (t * 0.31).sin() * 0.3));
            samples.normals.push(Vector3::new((t * 0.2).cos(), (t * 0.2).sin(), 0.0));
        }
        let index = SampleIndex::new(&samples, 0.2);
        let mut found = 0;
        for i in 0..200 {
            let t = f64::from(i) + 0.5;
            let p = Point3::new((t * 0.71).sin() * 1.2, (t * 1.29).cos(), (t * 0.3).sin() * 0.3);
            let n = Vector3::new((t * 0.2).cos(), (t * 0.2).sin(), 0.0);
            let metric = |j: usize| {
                (samples.points[j] - p).norm_squared() + 0.01 * (samples.normals[j] - n).norm_squared()
            };
            let best =
                (0..500).min_by(|&a, &b| metric(a).total_cmp(&metric(b))).filter(|&j| metric(j) < 0.04);
            assert_eq!(index.nearest_sample(&p, &n), best);
            found += usize::from(best.is_some());
        }
        assert!(found > 50 && found < 200, "{found}");
    }

    #[test]
    fn the_other_side_of_a_sheet_is_no_neighbor() {
        let samples = SurfaceSamples {
            points: vec![Point3::new(0.0, 0.0, 0.004), Point3::origin()],
            normals: vec![Vector3::z(), -Vector3::z()],
            colors: vec![[0.5; 3]; 2],
        };
        let index = SampleIndex::new(&samples, 0.02);
        assert_eq!(index.nearest_sample(&Point3::new(0.0, 0.001, 0.001), &Vector3::z()), Some(0));
        assert_eq!(index.nearest_sample(&Point3::new(0.0, 0.001, 0.003), &-Vector3::z()), Some(1));
        assert_eq!(
            SampleIndex::new(&SurfaceSamples::default(), 0.1)
                .nearest_sample(&Point3::origin(), &Vector3::z()),
            None
        );
    }
}
