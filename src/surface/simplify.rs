//! Reduces the number of triangles at the same shape: edge collapse by quadric error (Garland and Heckbert
//! 1997).

use std::{cmp::Reverse, collections::BinaryHeap};

use nalgebra::{Matrix3, Point3, Vector3};

use super::{TriangleMesh, drop_unused_vertices, edges::Edges};

/// Weight of the planes at open borders, relative to the surface.
/// chosen: borders move less than the surface
const BORDER_WEIGHT: f64 = 10.0;
/// Pull towards the middle of a collapsed edge, relative to the quadric: it decides where the surface is
/// flat.
/// chosen: negligible against any bend
const CENTERING: f64 = 1e-4;
/// Least cosine of the turn of a triangle's normal in a collapse. chosen: 73 degrees
const MIN_TURN_COSINE: f64 = 0.3;
/// Triangles around a vertex for which memory is reserved at once: six are usual.
const USUAL_RING: usize = 8;

/// The mesh with at most `max_triangles` triangles, or as few as possible: collapses keep its topology and
/// turn no triangle over. The edge whose collapse changes the shape least always goes first; it stops early
/// when the next collapse would move the surface by more than `max_error_m` (root mean square over its area).
/// Colors are interpolated. Deterministic.
pub fn simplify(mesh: &TriangleMesh, max_triangles: usize, max_error_m: f64) -> TriangleMesh {
    let mut work = Collapse::of_mesh(mesh, max_error_m * max_error_m);
    while work.alive > max_triangles {
        let Some(candidate) = work.next() else { break };
        work.try_collapse(&candidate);
    }
    work.collapsed_mesh()
}

/// Weighted squared distances to planes: `x^T a x + 2 b^T x + c`, and the weight.
#[derive(Clone, Copy, Default)]
struct Quadric {
    a: Matrix3<f64>,
    b: Vector3<f64>,
    c: f64,
    weight: f64,
}

impl Quadric {
    fn of_plane(normal: &Vector3<f64>, point: &Vector3<f64>, weight: f64) -> Self {
        let d = -normal.dot(point);
        Self { a: normal * normal.transpose() * weight, b: normal * (d * weight), c: d * d * weight, weight }
    }

    fn add(&mut self, other: &Self) {
        self.a += other.a;
        self.b += other.b;
        self.c += other.c;
        self.weight += other.weight;
    }

    /// Mean squared distance of a point to the planes.
    fn mean_square(&self, x: &Vector3<f64>) -> f64 {
        let sum = x.dot(&(self.a * x)) + 2.0 * self.b.dot(x) + self.c;
        if self.weight > 0.0 { (sum / self.weight).max(0.0) } else { 0.0 }
    }

    /// The point with the least error, close to `middle` where many have it.
    fn best_point(&self, middle: &Vector3<f64>) -> Vector3<f64> {
        // On a plane or a line the quadric alone is singular; the pull makes it solvable.
        let pull = CENTERING * self.a.trace();
        let system = self.a + Matrix3::identity() * pull;
        cholesky_solution(&system, &(middle * pull - self.b)).unwrap_or(*middle)
    }
}

/// Solution of a symmetric system by its Cholesky factor, bit for bit that of nalgebra's dynamic version;
/// `None` where it is not positive definite.
fn cholesky_solution(a: &Matrix3<f64>, b: &Vector3<f64>) -> Option<Vector3<f64>> {
    let root = |square: f64| (square > 0.0).then(|| square.sqrt());
    let l00 = root(a[(0, 0)])?;
    let l10 = a[(1, 0)] / l00;
    let l20 = a[(2, 0)] / l00;
    let l11 = root(a[(1, 1)] - l10 * l10)?;
    let l21 = (a[(2, 1)] - l10 * l20) / l11;
    let l22 = root(a[(2, 2)] - l20 * l20 - l21 * l21)?;
    let y0 = b[0] / l00;
    let y1 = (b[1] - y0 * l10) / l11;
    let y2 = (b[2] - y0 * l20 - y1 * l21) / l22;
    let z = y2 / l22;
    let y = (y1 - l21 * z) / l11;
    Some(Vector3::new((y0 - (l10 * y + l20 * z)) / l00, y, z))
}

/// An edge in the queue; stale once one of its ends has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Candidate {
    /// Bits of the cost: as it is not negative, they sort like it.
    cost_bits: u64,
    ends: [u32; 2],
    versions: [u32; 2],
}

/// Low bits of a cost that do not affect its bin: costs in a bin differ by less than a quarter.
const BIN_SHIFT: u32 = 50;
/// Number of bins for all non-negative costs.
const BINS: usize = 1 << (63 - BIN_SHIFT);

/// A priority queue of candidates. Only those of the lowest bin are sorted: a heap of all would not fit in
/// the processor's cache.
struct Queue {
    /// Index of the bin in the heap.
    bin: usize,
    heap: BinaryHeap<Reverse<Candidate>>,
    /// The other candidates; the bins up to `bin` are empty.
    bins: Vec<Vec<Candidate>>,
}

impl Queue {
    fn new() -> Self {
        Self { bin: 0, heap: BinaryHeap::new(), bins: vec![Vec::new(); BINS] }
    }

    fn push(&mut self, candidate: Candidate) {
        let bin = (candidate.cost_bits >> BIN_SHIFT) as usize;
        if bin <= self.bin { self.heap.push(Reverse(candidate)) } else { self.bins[bin].push(candidate) }
    }

    /// The least candidate; invalid ones of a bin are dropped when the queue reaches it.
    fn pop(&mut self, valid: impl Fn(&Candidate) -> bool) -> Option<Candidate> {
        while self.heap.is_empty() {
            self.bin += 1;
            let of_bin = std::mem::take(self.bins.get_mut(self.bin)?);
            self.heap = of_bin.into_iter().filter(&valid).map(Reverse).collect();
        }
        self.heap.pop().map(|Reverse(candidate)| candidate)
    }
}

/// The mesh while it shrinks. Positions are relative to the first vertex.
struct Collapse {
    origin: Vector3<f64>,
    positions: Vec<Vector3<f64>>,
    colors: Vec<Vector3<f64>>,
    quadrics: Vec<Quadric>,
    versions: Vec<u32>,
    triangles: Vec<Option<[u32; 3]>>,
    /// Triangles around each vertex.
    rings: Vec<Vec<u32>>,
    alive: usize,
    queue: Queue,
    /// Largest cost of a collapse, square meters.
    max_cost: f64,
}

impl Collapse {
    fn of_mesh(mesh: &TriangleMesh, max_cost: f64) -> Self {
        let origin = mesh.vertices.first().map(|p| p.coords.cast()).unwrap_or_default();
        let has_colors = mesh.colors.len() == mesh.vertices.len();
        let colors = if has_colors {
            mesh.colors.iter().map(|c| Vector3::from(c.map(f64::from))).collect()
        } else {
            Vec::new()
        };
        let count = mesh.vertices.len();
        let mut work = Self {
            // Quadrics lose digits far from the origin.
            origin,
            positions: mesh.vertices.iter().map(|p| p.coords.cast() - origin).collect(),
            colors,
            quadrics: vec![Quadric::default(); count],
            versions: vec![0; count],
            triangles: mesh.triangles.iter().map(|t| Some(*t)).collect(),
            rings: (0..count).map(|_| Vec::with_capacity(USUAL_RING)).collect(),
            alive: mesh.triangles.len(),
            queue: Queue::new(),
            max_cost,
        };
        for (t, corners) in mesh.triangles.iter().enumerate() {
            let normal = work.area_normal(corners);
            for &v in corners {
                work.rings[v as usize].push(t as u32);
                if let Some(unit) = normal.try_normalize(0.0) {
                    let plane = Quadric::of_plane(&unit, &work.positions[corners[0] as usize], normal.norm());
                    work.quadrics[v as usize].add(&plane);
                }
            }
        }
        work.hold_borders(mesh);
        work
    }

    /// Adds planes through open sides, perpendicular to their triangle, and queues all edges.
    fn hold_borders(&mut self, mesh: &TriangleMesh) {
        let edges = Edges::of_mesh(mesh);
        for (a, same) in edges.by_lower_end() {
            let (b, side) = same[0];
            if same.len() == 1 {
                let p = self.positions[a as usize];
                let q = self.positions[b as usize];
                let across = (q - p).cross(&self.area_normal(&mesh.triangles[side as usize / 3]));
                if let Some(unit) = across.try_normalize(0.0) {
                    // Weighted by the square of the side's length, as a triangle is weighted by its area.
                    let plane = Quadric::of_plane(&unit, &p, BORDER_WEIGHT * (q - p).norm_squared());
                    self.quadrics[a as usize].add(&plane);
                    self.quadrics[b as usize].add(&plane);
                }
            }
        }
        for (a, same) in edges.by_lower_end() {
            self.enqueue_edge([a, same[0].0]);
        }
    }

    /// Twice the area times the unit normal.
    fn area_normal(&self, corners: &[u32; 3]) -> Vector3<f64> {
        let [a, b, c] = corners.map(|v| self.positions[v as usize]);
        (b - a).cross(&(c - a))
    }

    /// Summed quadric of an edge's ends and the best place for its new vertex.
    fn quadric_and_place(&self, [a, b]: [u32; 2]) -> (Quadric, Vector3<f64>) {
        let mut quadric = self.quadrics[a as usize];
        quadric.add(&self.quadrics[b as usize]);
        let middle = (self.positions[a as usize] + self.positions[b as usize]) * 0.5;
        (quadric, quadric.best_point(&middle))
    }

    fn enqueue_edge(&mut self, [a, b]: [u32; 2]) {
        let ends = [a.min(b), a.max(b)];
        let (quadric, place) = self.quadric_and_place(ends);
        let cost = quadric.mean_square(&place);
        if cost <= self.max_cost {
            let versions = ends.map(|v| self.versions[v as usize]);
            self.queue.push(Candidate { cost_bits: cost.to_bits(), ends, versions });
        }
    }

    /// The edge with the least cost.
    fn next(&mut self) -> Option<Candidate> {
        let versions = &self.versions;
        self.queue.pop(|c| c.versions == c.ends.map(|v| versions[v as usize]))
    }

    /// Neighbors of a vertex, ascending.
    fn neighbors(&self, v: u32) -> Vec<u32> {
        let ring = &self.rings[v as usize];
        let mut found = Vec::with_capacity(2 * ring.len());
        let corners = ring.iter().filter_map(|&t| self.triangles[t as usize]).flatten();
        found.extend(corners.filter(|&u| u != v));
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Collapses the edge unless it is stale, would change the topology or turn a triangle over.
    fn try_collapse(&mut self, candidate: &Candidate) {
        let [a, b] = candidate.ends;
        if candidate.versions != [self.versions[a as usize], self.versions[b as usize]] {
            return;
        }
        let ring = self.rings[a as usize].iter().copied();
        let between: Vec<u32> =
            ring.filter(|t| self.triangles[*t as usize].is_some_and(|c| c.contains(&b))).collect();
        let others = self.neighbors(b);
        let common = self.neighbors(a).iter().filter(|v| others.binary_search(v).is_ok()).count();
        // The link condition: both ends may share only the neighbors in the edge's own triangles.
        if common != between.len() || between.is_empty() || between.len() > 2 {
            return;
        }
        let (quadric, place) = self.quadric_and_place([a, b]);
        if self.turns_over(a, b, &place) || self.turns_over(b, a, &place) {
            return;
        }
        if !self.colors.is_empty() {
            let p = self.positions[a as usize];
            let q = self.positions[b as usize];
            let share = ((place - p).dot(&(q - p)) / (q - p).norm_squared().max(1e-300)).clamp(0.0, 1.0);
            self.colors[a as usize] = self.colors[a as usize].lerp(&self.colors[b as usize], share);
        }
        self.positions[a as usize] = place;
        self.quadrics[a as usize] = quadric;
        for t in between {
            self.triangles[t as usize] = None;
            self.alive -= 1;
        }
        for t in std::mem::take(&mut self.rings[b as usize]) {
            if let Some(corners) = &mut self.triangles[t as usize] {
                *corners = corners.map(|v| if v == b { a } else { v });
                self.rings[a as usize].push(t);
            }
        }
        let triangles = &self.triangles;
        self.rings[a as usize].retain(|&t| triangles[t as usize].is_some());
        self.versions[a as usize] += 1;
        self.versions[b as usize] += 1;
        // Older entries of these edges stay in the queue and are skipped as stale.
        for v in self.neighbors(a) {
            self.enqueue_edge([a, v]);
        }
    }

    /// Whether moving a vertex turns a remaining triangle (one without `gone`) too far.
    fn turns_over(&self, moved: u32, gone: u32, place: &Vector3<f64>) -> bool {
        self.rings[moved as usize]
            .iter()
            .filter_map(|&t| self.triangles[t as usize])
            .filter(|c| !c.contains(&gone))
            .any(|corners| {
                let before = self.area_normal(&corners);
                let [p, q, r] = corners.map(|v| if v == moved { *place } else { self.positions[v as usize] });
                let after = (q - p).cross(&(r - p));
                after.dot(&before) <= MIN_TURN_COSINE * after.norm() * before.norm()
            })
    }

    fn collapsed_mesh(self) -> TriangleMesh {
        let vertices = self.positions.iter().map(|p| Point3::from((p + self.origin).cast::<f32>())).collect();
        let colors = self.colors.iter().map(|c| [c.x, c.y, c.z].map(|v| v.round() as u8)).collect();
        drop_unused_vertices(&TriangleMesh {
            vertices,
            triangles: self.triangles.into_iter().flatten().collect(),
            colors,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        edge_defects, is_watertight, marching_cubes,
        shapes::{color_of, cuboid, grid_of, sphere, torus, volume_m3},
    };
    use proptest::prelude::*;

    #[test]
    fn a_box_of_many_triangles_keeps_its_shape_with_few() {
        let shape = cuboid(Vector3::new(0.305, 0.205, 0.155));
        let mesh = marching_cubes(&grid_of(0.5, 61, &shape), 0.0);
        let small = simplify(&mesh, 200, f64::INFINITY);
        assert!(mesh.triangles.len() > 5000 && small.triangles.len() <= 200);
        assert!(is_watertight(&small));
        assert!((volume_m3(&small) / volume_m3(&mesh) - 1.0).abs() < 0.01);
        assert!(small.vertices.iter().all(|p| shape(&p.cast()).abs() < 0.008));
    }

    #[test]
    fn topology_and_colors_stay() {
        let mut mesh = marching_cubes(&grid_of(0.5, 50, torus(0.3, 0.1)), 0.0);
        mesh.colors = mesh.vertices.iter().map(|p| color_of(&p.cast())).collect();
        let small = simplify(&mesh, 1000, f64::INFINITY);
        assert!(is_watertight(&small) && small.triangles.len() <= 1000);
        assert_eq!(small.vertices.len() * 2, small.triangles.len());
        for (p, c) in small.vertices.iter().zip(&small.colors) {
            let expected = color_of(&p.cast());
            assert!((0..3).all(|k| c[k].abs_diff(expected[k]) < 12), "{c:?} {expected:?}");
        }
        assert_eq!(small, simplify(&mesh, 1000, f64::INFINITY));
    }

    fn candidates(costs: &[u64], first: u32) -> Vec<Candidate> {
        let of = |(end, cost_bits): (u32, &u64)| Candidate {
            cost_bits: *cost_bits,
            ends: [end, u32::MAX],
            versions: [0; 2],
        };
        (first..).zip(costs).map(of).collect()
    }

    proptest! {
        #[test]
        fn candidates_come_in_their_order_and_late_ones_too(
            costs in prop::collection::vec(0..=f64::MAX.to_bits(), 1..80),
            late in prop::collection::vec(0..=f64::MAX.to_bits(), 0..20),
        ) {
            let mut left = candidates(&costs, 0);
            let late = candidates(&late, 100);
            let mut queue = Queue::new();
            left.iter().for_each(|c| queue.push(*c));
            let first = queue.pop(|_| true);
            prop_assert_eq!(first, left.iter().min().copied());
            late.iter().for_each(|c| queue.push(*c));
            left.extend(late);
            left.retain(|c| Some(*c) != first);
            left.sort_unstable();
            prop_assert_eq!(std::iter::from_fn(|| queue.pop(|_| true)).collect::<Vec<_>>(), left);
        }
    }

    #[test]
    fn the_error_bound_stops_it() {
        let mesh = marching_cubes(&grid_of(0.5, 41, sphere(0.4)), 0.0);
        let small = simplify(&mesh, 0, 0.002);
        assert!(small.triangles.len() > 100 && small.triangles.len() < mesh.triangles.len() / 4);
        assert!(small.vertices.iter().all(|p| (p.coords.norm() - 0.4).abs() < 0.01));
        assert_eq!(simplify(&mesh, mesh.triangles.len(), 1.0).triangles, mesh.triangles);
    }

    #[test]
    fn open_borders_stay_where_they_are() {
        let mut grid = grid_of(0.5, 41, sphere(0.4));
        for i in 0..grid.values.len() {
            if grid.position_of_index(i).z < -0.01 {
                grid.values[i] = f32::NAN;
            }
        }
        let mesh = marching_cubes(&grid, 0.0);
        let small = simplify(&mesh, 300, f64::INFINITY);
        assert!(small.triangles.len() <= 300 && edge_defects(&small).non_manifold == 0);
        let (lower, upper) = small.bounds().unwrap();
        assert!(lower.z.abs() < 0.02 && (upper.z - 0.4).abs() < 0.01 && (upper.x - 0.4).abs() < 0.015);
        assert!((small.area_m2() / mesh.area_m2() - 1.0).abs() < 0.02);
    }

    proptest! {
        #[test]
        fn systems_are_solved_as_by_nalgebra(
            v in prop::array::uniform9(-1.0..1.0f64),
            b in prop::array::uniform3(-9.0..9.0f64),
        ) {
            let root = Matrix3::from_row_slice(&v);
            let system = root * root.transpose();
            let b = Vector3::from(b);
            prop_assert_eq!(cholesky_solution(&system, &b), system.cholesky().map(|c| c.solve(&b)));
            prop_assert_eq!(cholesky_solution(&-system, &b), None);
        }
    }
}
