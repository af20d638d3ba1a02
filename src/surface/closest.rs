//! Exact closest points on a mesh through a tree of bounding boxes.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{TriangleMesh, triangle::closest_on_triangle};

/// Most triangles in a leaf.
const LEAF: usize = 4;

/// The point of a mesh closest to a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosestPoint {
    /// The point, meters.
    pub point: Point3<f32>,
    /// Its triangle.
    pub triangle: u32,
    /// Distance to the query, meters.
    pub distance_m: f32,
}

/// A box of the tree. Inner: `first` is the left child, the right one follows it. Leaf: `count` triangles
/// from `first`.
struct Node {
    low: Vector3<f32>,
    high: Vector3<f32>,
    first: u32,
    count: u32,
}

/// Closest-point queries on one mesh.
pub struct MeshDistance {
    nodes: Vec<Node>,
    corners: Vec<[Vector3<f32>; 3]>,
    /// Index in the mesh of each entry of `corners`.
    triangles: Vec<u32>,
}

impl MeshDistance {
    /// The tree of a mesh; `None` for a mesh without triangles or with coordinates not finite.
    pub fn new(mesh: &TriangleMesh) -> Option<Self> {
        let all: Vec<[Vector3<f32>; 3]> =
            (0..mesh.triangles.len()).map(|t| mesh.corners(t).map(|p| p.coords)).collect();
        if all.is_empty() || all.iter().flatten().any(|p| !p.iter().all(|c| c.is_finite())) {
            return None;
        }
        let mut order: Vec<u32> = (0..all.len() as u32).collect();
        let mut tree =
            Self { nodes: vec![leaf_around(&all, &order, 0)], corners: Vec::new(), triangles: Vec::new() };
        // Node to split and its range of `order`.
        let mut open = vec![(0, 0..order.len())];
        while let Some((node, range)) = open.pop() {
            if range.len() <= LEAF {
                continue;
            }
            let center = |t: u32| all[t as usize][0] + all[t as usize][1] + all[t as usize][2];
            let spread = order[range.clone()]
                .iter()
                .fold((Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY)), |(l, h), &t| {
                    (l.inf(&center(t)), h.sup(&center(t)))
                });
            let axis = (spread.1 - spread.0).imax();
            let middle = range.len() / 2;
            // Equal centers are ordered by number: a mesh always gives the same tree.
            order[range.clone()].select_nth_unstable_by(middle, |&a, &b| {
                center(a)[axis].total_cmp(&center(b)[axis]).then(a.cmp(&b))
            });
            let left = range.start..range.start + middle;
            let right = range.start + middle..range.end;
            tree.nodes[node].first = tree.nodes.len() as u32;
            tree.nodes[node].count = 0;
            open.extend([(tree.nodes.len(), left.clone()), (tree.nodes.len() + 1, right.clone())]);
            tree.nodes.push(leaf_around(&all, &order[left.clone()], left.start));
            tree.nodes.push(leaf_around(&all, &order[right.clone()], right.start));
        }
        // In the order of the leaves: the triangles of a leaf are contiguous in memory.
        tree.corners = order.iter().map(|&t| all[t as usize]).collect();
        tree.triangles = order;
        Some(tree)
    }

    /// The closest point of the mesh. Of equally close ones it is always the same one.
    pub fn closest_point(&self, query: &Point3<f32>) -> ClosestPoint {
        let p = &query.coords;
        let mut best = (f32::INFINITY, Vector3::zeros(), 0);
        let mut open: Vec<(f32, u32)> = Vec::with_capacity(64);
        open.push((0.0, 0));
        while let Some((bound2, index)) = open.pop() {
            let node = &self.nodes[index as usize];
            // A nearer point was found after this box was queued.
            if bound2 >= best.0 {
                continue;
            }
            if node.count == 0 {
                let [near, far] =
                    [node.first, node.first + 1].map(|i| (self.nodes[i as usize].squared_distance(p), i));
                let (near, far) = if near.0 <= far.0 { (near, far) } else { (far, near) };
                // The nearer box is opened first: it may make the other one unnecessary.
                open.extend([far, near]);
                continue;
            }
            for i in node.first as usize..(node.first + node.count) as usize {
                let q = closest_on_triangle(p, &self.corners[i]).0;
                let d2 = (p - q).norm_squared();
                if d2 < best.0 {
                    best = (d2, q, self.triangles[i]);
                }
            }
        }
        ClosestPoint { point: best.1.into(), triangle: best.2, distance_m: best.0.sqrt() }
    }

    /// Distances of many points, meters, in parallel.
    pub fn distances_m(&self, points: &[Point3<f32>]) -> Vec<f32> {
        points.par_iter().with_min_len(256).map(|p| self.closest_point(p).distance_m).collect()
    }
}

impl Node {
    /// Squared distance of a point to the box.
    fn squared_distance(&self, p: &Vector3<f32>) -> f32 {
        (self.low - p).sup(&(p - self.high)).sup(&Vector3::zeros()).norm_squared()
    }
}

/// The leaf around the given triangles, from `first` on.
fn leaf_around(all: &[[Vector3<f32>; 3]], triangles: &[u32], first: usize) -> Node {
    let low = Vector3::repeat(f32::INFINITY);
    let high = Vector3::repeat(f32::NEG_INFINITY);
    let corners = triangles.iter().flat_map(|&t| &all[t as usize]);
    let (low, high) = corners.fold((low, high), |(l, h), p| (l.inf(p), h.sup(p)));
    Node { low, high, first: first as u32, count: triangles.len() as u32 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        merged_mesh, sample_surface,
        shapes::{box_mesh, cuboid, sphere_mesh},
    };
    use numeric::random::stage_rng;
    use proptest::prelude::*;

    #[test]
    fn distances_to_a_box_are_exact() {
        let half = Vector3::new(0.3, 0.2, 0.1);
        let tree = MeshDistance::new(&box_mesh(half.cast())).unwrap();
        for p in [[0.0, 0.0, 0.0], [0.5, 0.1, 0.0], [0.4, 0.5, -0.6], [0.29, 0.0, 0.0]] {
            let p = Point3::from(p);
            assert!(
                (f64::from(tree.closest_point(&p.cast()).distance_m) - cuboid(half)(&p).abs()).abs() < 1e-6
            );
        }
    }

    #[test]
    fn points_of_the_mesh_are_on_it() {
        let mesh = sphere_mesh(0.4, 60);
        let tree = MeshDistance::new(&mesh).unwrap();
        let samples = sample_surface(&mesh, 2000, &mut stage_rng(2, "sample", 0));
        assert!(tree.distances_m(&samples.points).iter().all(|d| *d < 1e-6));
        assert!(MeshDistance::new(&TriangleMesh::default()).is_none());
    }

    proptest! {
        #[test]
        fn equals_brute_force(
            points in prop::collection::vec(prop::array::uniform3(-1.0..1.0f32), 8),
            seed in 0..50u64,
        ) {
            let mut mesh = merged_mesh(&[&sphere_mesh(0.3, 6), &box_mesh(Vector3::new(0.5, 0.1, 0.4))]);
            let mut rng = stage_rng(seed, "shake", 0);
            for p in &mut mesh.vertices {
                p.x += 0.2 * (rand_core::Rng::next_u32(&mut rng) as f32 / u32::MAX as f32);
            }
            let tree = MeshDistance::new(&mesh).unwrap();
            for p in points.into_iter().map(Point3::from) {
                let on = |t: usize| closest_on_triangle(&p.coords, &mesh.corners(t).map(|c| c.coords)).0;
                let brute = (0..mesh.triangles.len())
                    .map(|t| (p.coords - on(t)).norm())
                    .fold(f32::INFINITY, f32::min);
                let found = tree.closest_point(&p);
                prop_assert!((found.distance_m - brute).abs() < 1e-6);
                prop_assert!(((found.point - p).norm() - found.distance_m).abs() < 1e-6);
            }
        }
    }
}
