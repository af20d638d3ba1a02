//! Short rays into walls.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use crate::TriangleMesh;

/// Least cosine between a ray and the normal of a hit; the ray nearly grazes other triangles. chosen: 78
/// degrees
const MET: f64 = 0.2;
/// Largest number of cells along a mesh. chosen: memory of a cube of cells
const MOST_CELLS: f64 = 32.0;
/// Hits nearer than this are the triangle at the ray's start, meters. chosen: above rounding, below any wall
const START_M: f64 = 1e-5;

/// A triangle: corners and unit normal.
struct RayFacet {
    corners: [Vector3<f64>; 3],
    normal: Vector3<f64>,
}

/// Triangles sorted into cells.
pub(super) struct Facets {
    facets: Vec<RayFacet>,
    cells: BTreeMap<[i64; 3], Vec<u32>>,
    side_m: f64,
    reach_m: f64,
}

impl Facets {
    /// The triangles of a mesh, prepared for rays up to a length.
    pub(super) fn of_mesh(mesh: &TriangleMesh, reach_m: f64) -> Self {
        let facets: Vec<RayFacet> =
            (0..mesh.triangles.len()).filter_map(|t| RayFacet::of_triangle(mesh, t)).collect();
        // Cells as wide as the rays are long, but not too many for a large triangle.
        let extent_m = mesh.bounds().map_or(0.0, |(lo, hi)| f64::from((hi - lo).norm()));
        let side_m = reach_m.max(extent_m / MOST_CELLS).max(f64::from(f32::MIN_POSITIVE));
        let mut cells: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
        for (i, f) in facets.iter().enumerate() {
            let [a, b, c] = f.corners;
            for cell in cells_of(&a.inf(&b).inf(&c), &a.sup(&b).sup(&c), side_m) {
                cells.entry(cell).or_default().push(i as u32);
            }
        }
        Self { facets, cells, side_m, reach_m }
    }

    /// Distance along a ray to the first surface where it leaves the object (`leaves`) or enters one, meters;
    /// infinite beyond the reach.
    pub(super) fn way_m(&self, origin: &Vector3<f64>, direction: &Vector3<f64>, leaves: bool) -> f64 {
        let end = origin + direction * self.reach_m;
        let near = cells_of(&origin.inf(&end), &origin.sup(&end), self.side_m);
        let mut nearest_m = f64::INFINITY;
        for &i in near.filter_map(|cell| self.cells.get(&cell)).flatten() {
            let way_m = self.facets[i as usize].way_m(origin, direction, leaves, nearest_m.min(self.reach_m));
            nearest_m = way_m.unwrap_or(nearest_m);
        }
        nearest_m
    }
}

impl RayFacet {
    /// `None` for a triangle without area.
    fn of_triangle(mesh: &TriangleMesh, t: usize) -> Option<Self> {
        let normal = mesh.area_normal(t).cast::<f64>().try_normalize(0.0)?;
        Some(Self { corners: mesh.corners(t).map(|c| c.coords.cast::<f64>()), normal })
    }

    /// Distance along a ray, if it is less than `most_m`.
    fn way_m(
        &self,
        origin: &Vector3<f64>,
        direction: &Vector3<f64>,
        leaves: bool,
        most_m: f64,
    ) -> Option<f64> {
        let Self { corners, normal } = self;
        let speed = normal.dot(direction);
        if (if leaves { speed } else { -speed }) <= MET {
            return None;
        }
        let s = normal.dot(&(corners[0] - origin)) / speed;
        if !(s > START_M && s < most_m) {
            return None;
        }
        let p = origin + direction * s;
        let mut sides = (0..3).map(|k| (corners[(k + 1) % 3] - corners[k]).cross(&(p - corners[k])));
        sides.all(|turn| turn.dot(normal) >= -1e-15).then_some(s)
    }
}

/// The cells of a box.
fn cells_of(
    lower: &Vector3<f64>,
    upper: &Vector3<f64>,
    side_m: f64,
) -> impl Iterator<Item = [i64; 3]> + use<> {
    let [lo, hi] = [lower, upper].map(|v| [0, 1, 2].map(|k| (v[k] / side_m).floor() as i64));
    (lo[0]..=hi[0])
        .flat_map(move |x| (lo[1]..=hi[1]).flat_map(move |y| (lo[2]..=hi[2]).map(move |z| [x, y, z])))
}
