//! A bounding volume hierarchy over boxes, to find those that a ray meets.

use nalgebra::{Point3, Vector3};

/// Most boxes of a leaf.
const LEAF: usize = 2;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bounds {
    /// Lower corner, meters.
    pub lower: Point3<f64>,
    /// Upper corner, meters.
    pub upper: Point3<f64>,
}

impl Bounds {
    fn joined_with(self, other: &Self) -> Self {
        Self { lower: self.lower.inf(&other.lower), upper: self.upper.sup(&other.upper) }
    }

    /// Whether a ray meets the box before the multiple `farthest`; `inverse` is one over its direction.
    fn meets_ray(&self, origin: &Point3<f64>, inverse: &Vector3<f64>, farthest: f64) -> bool {
        let mut near = 0.0f64;
        let mut far = farthest;
        for k in 0..3 {
            let a = (self.lower[k] - origin[k]) * inverse[k];
            let b = (self.upper[k] - origin[k]) * inverse[k];
            // A ray in the plane of a side gives NaN, which min and max ignore.
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        near <= far
    }
}

struct Node {
    bounds: Bounds,
    /// Range of the node's boxes in `order`; empty for an inner node, whose first child is the next node.
    start: usize,
    end: usize,
    /// Index of an inner node's second child.
    second: usize,
}

/// The hierarchy.
pub(super) struct Bvh {
    nodes: Vec<Node>,
    order: Vec<usize>,
}

impl Bvh {
    /// Splits at the median along the longest side until each leaf holds at most two boxes.
    pub(crate) fn new(boxes: &[Bounds]) -> Self {
        let mut bvh = Self { nodes: Vec::new(), order: (0..boxes.len()).collect() };
        if !boxes.is_empty() {
            bvh.build(boxes, 0, boxes.len());
        }
        bvh
    }

    fn build(&mut self, boxes: &[Bounds], start: usize, end: usize) {
        let members = &mut self.order[start..end];
        let bounds = members.iter().skip(1).fold(boxes[members[0]], |all, &b| all.joined_with(&boxes[b]));
        let here = self.nodes.len();
        self.nodes.push(Node { bounds, start, end, second: 0 });
        if end - start <= LEAF {
            return;
        }
        let axis = (bounds.upper - bounds.lower).imax();
        let center = |b: &usize| boxes[*b].lower[axis] + boxes[*b].upper[axis];
        // Ties are broken by index, so that the same boxes give the same tree.
        members.sort_by(|a, b| center(a).total_cmp(&center(b)).then(a.cmp(b)));
        let middle = (start + end) / 2;
        // An empty range marks an inner node.
        (self.nodes[here].start, self.nodes[here].end) = (0, 0);
        self.build(boxes, start, middle);
        self.nodes[here].second = self.nodes.len();
        self.build(boxes, middle, end);
    }

    /// Calls `visit` for every box that the ray meets before the farthest distance, which `visit` updates.
    pub(crate) fn visit_boxes(
        &self,
        origin: &Point3<f64>,
        ray: &Vector3<f64>,
        mut farthest: f64,
        mut visit: impl FnMut(usize) -> f64,
    ) {
        let inverse = ray.map(f64::recip);
        let mut stack = [0usize; 64];
        let mut height = usize::from(!self.nodes.is_empty());
        while height > 0 {
            height -= 1;
            let at = stack[height];
            let node = &self.nodes[at];
            if !node.bounds.meets_ray(origin, &inverse, farthest) {
                continue;
            }
            if node.end > node.start {
                for &b in &self.order[node.start..node.end] {
                    farthest = visit(b);
                }
            } else {
                // Median splits keep the depth to the logarithm of the number of boxes.
                (stack[height], stack[height + 1]) = (node.second, at + 1);
                height += 2;
            }
        }
    }
}
