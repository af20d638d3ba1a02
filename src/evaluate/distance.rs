//! Exact distance from points to a triangle mesh.

use nalgebra::{Point3, Vector3};

use surface::TriangleMesh;

/// Most triangles in a leaf.
const LEAF: usize = 4;

struct Node {
    lower: Point3<f64>,
    upper: Point3<f64>,
    /// First triangle of a leaf; for an inner node the index of its second half. The first half follows the
    /// node directly.
    next: usize,
    /// Number of triangles in a leaf; 0 for an inner node.
    count: usize,
}

/// Tree of bounding boxes over the triangles of a mesh.
pub(crate) struct MeshDistance {
    nodes: Vec<Node>,
    triangles: Vec<[Point3<f64>; 3]>,
}

impl MeshDistance {
    /// Builds the tree of a mesh.
    #[must_use]
    pub(crate) fn new(mesh: &TriangleMesh) -> Self {
        let mut triangles: Vec<_> =
            (0..mesh.triangles.len()).map(|t| mesh.corners(t).map(|p| p.cast::<f64>())).collect();
        let mut nodes = Vec::with_capacity(triangles.len());
        build_nodes(&mut nodes, &mut triangles, 0);
        Self { nodes, triangles }
    }

    /// Distance to the nearest triangle, meters; infinite without triangles.
    #[must_use]
    pub(crate) fn distance_m(&self, point: &Point3<f64>) -> f64 {
        let mut best = f64::INFINITY;
        if !self.triangles.is_empty() {
            self.visit_node(0, point, &mut best);
        }
        best.sqrt()
    }

    fn visit_node(&self, index: usize, point: &Point3<f64>, best: &mut f64) {
        let node = &self.nodes[index];
        if node.count > 0 {
            for triangle in &self.triangles[node.next..node.next + node.count] {
                *best = best.min((closest_on_triangle(triangle, point) - point).norm_squared());
            }
            return;
        }
        let mut halves = [index + 1, node.next].map(|i| (self.gap_squared(i, point), i));
        // The nearer half first: its distance usually rules out the other.
        halves.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (gap, half) in halves {
            if gap < *best {
                self.visit_node(half, point, best);
            }
        }
    }

    fn gap_squared(&self, index: usize, point: &Point3<f64>) -> f64 {
        let node = &self.nodes[index];
        let outside = (node.lower - point).sup(&(point - node.upper)).sup(&Vector3::zeros());
        outside.norm_squared()
    }
}

fn build_nodes(nodes: &mut Vec<Node>, triangles: &mut [[Point3<f64>; 3]], first: usize) {
    let start =
        (Point3::from(Vector3::repeat(f64::INFINITY)), Point3::from(Vector3::repeat(f64::NEG_INFINITY)));
    let (lower, upper) = triangles.iter().flatten().fold(start, |(lo, hi), p| (lo.inf(p), hi.sup(p)));
    let index = nodes.len();
    nodes.push(Node { lower, upper, next: first, count: triangles.len() });
    if triangles.len() <= LEAF {
        return;
    }
    let axis = (upper - lower).imax();
    let middle = triangles.len() / 2;
    let key = |t: &[Point3<f64>; 3]| t.iter().map(|p| p[axis]).sum::<f64>();
    // Split at the median: the depth is logarithmic for any mesh.
    triangles.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
    let (left, right) = triangles.split_at_mut(middle);
    // Now an inner node: the first half follows directly, the second starts at `next`.
    nodes[index].count = 0;
    build_nodes(nodes, left, first);
    nodes[index].next = nodes.len();
    build_nodes(nodes, right, first + middle);
}

/// Closest point on a triangle (Ericson, Real-Time Collision Detection, 5.1.5).
fn closest_on_triangle([a, b, c]: &[Point3<f64>; 3], p: &Point3<f64>) -> Point3<f64> {
    // By the region of the point's projection: corner a, corner b, edge ab, corner c, edge ac, edge bc,
    // inside.
    let ab = b - a;
    let ac = c - a;
    let ap = p - a;
    let d1 = ab.dot(&ap);
    let d2 = ac.dot(&ap);
    if d1 <= 0.0 && d2 <= 0.0 {
        return *a;
    }
    let bp = p - b;
    let d3 = ab.dot(&bp);
    let d4 = ac.dot(&bp);
    if d3 >= 0.0 && d4 <= d3 {
        return *b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let d5 = ab.dot(&cp);
    let d6 = ac.dot(&cp);
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    // A triangle without area has no interior.
    if sum > 0.0 { a + ab * (vb / sum) + ac * (vc / sum) } else { *a }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface_metrics::sample_surface;
    use model::example::box_mesh;
    use numeric::random::stage_rng;
    use surface::merged_mesh;

    #[test]
    fn agrees_with_boxes_and_with_a_full_search() {
        let half = Vector3::new(0.5, 1.0, 1.5);
        let cube = box_mesh([0.0; 3], [1.0, 2.0, 3.0], [0; 3]);
        let mut rng = stage_rng(5, "test", 0);
        let cloud = sample_surface(&box_mesh([-1.0; 3], [4.0; 3], [0; 3]), 300, &mut rng);
        let distance = MeshDistance::new(&cube);
        for p in &cloud {
            let q = (p.coords - half).abs() - half;
            let exact = if q.max() > 0.0 { q.sup(&Vector3::zeros()).norm() } else { -q.max() };
            assert!((distance.distance_m(p) - exact).abs() < 1e-6);
        }
        let boxes: Vec<_> =
            (0..40).map(|i| box_mesh([i as f32 * 0.1; 3], [i as f32 * 0.1 + 0.05; 3], [0; 3])).collect();
        let many = merged_mesh(&boxes.iter().collect::<Vec<_>>());
        let distance = MeshDistance::new(&many);
        for p in &cloud {
            let all = (0..many.triangles.len())
                .map(|t| (closest_on_triangle(&many.corners(t).map(|c| c.cast()), p) - p).norm());
            assert!((distance.distance_m(p) - all.fold(f64::INFINITY, f64::min)).abs() < 1e-12);
        }
        assert!(MeshDistance::new(&TriangleMesh::default()).distance_m(&Point3::origin()).is_infinite());
    }
}
