//! Geometry for grasps: convex solids, lines through them, boxes among them.

use nalgebra::{Point3, Vector3};

use geometry::Pose;
use surface::{ConvexSolid, Plane, SolidFit, TriangleMesh};

/// Largest distance of a solid from its surface, meters. Also the clearance around a finger, the width of the
/// thinnest held part, and the side of the cells for nearby surface.
/// derived: as of sound solids
pub(super) const STANDS_OFF_M: f64 = SolidFit::MOST_DISTANCE_M;

/// The solids of a link with their planes, in the link's frame.
pub(super) struct Shape(Vec<Solid>);

struct Solid {
    vertices: Vec<Point3<f64>>,
    planes: Vec<Plane>,
    /// Center of a ball around the solid.
    middle: Point3<f64>,
    radius_m: f64,
}

/// A piece of a line: where it begins and ends, meters, and the normals of the faces there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    pub ends_m: [f64; 2],
    pub normals: [Vector3<f64>; 2],
}

impl Span {
    /// Length, meters.
    pub(crate) fn length_m(&self) -> f64 {
        self.ends_m[1] - self.ends_m[0]
    }
}

/// A box: the pose of its middle and half its sides, meters.
#[derive(Clone, Debug)]
pub(super) struct Block {
    pub pose: Pose,
    pub half_m: Vector3<f64>,
}

impl Block {
    /// A box in a frame from its lower to its upper corner, meters.
    pub(crate) fn between_corners(frame: &Pose, lower: [f64; 3], upper: [f64; 3]) -> Self {
        let lower = Vector3::from(lower);
        let upper = Vector3::from(upper);
        let middle = 0.5 * (lower + upper);
        Self { pose: frame * Pose::translation(middle.x, middle.y, middle.z), half_m: 0.5 * (upper - lower) }
    }

    /// The same box in another frame.
    pub(crate) fn in_frame(&self, target_from_source: &Pose) -> Self {
        Self { pose: target_from_source * self.pose, half_m: self.half_m }
    }

    /// Half its extent along a direction, meters.
    fn reach_m(&self, direction: &Vector3<f64>) -> f64 {
        self.pose.rotation.inverse_transform_vector(direction).abs().dot(&self.half_m)
    }

    /// Distance of its nearest corner from a plane, meters; positive if all of it is outside.
    fn above_m(&self, plane: &Plane) -> f64 {
        plane.distance_m(&self.pose.translation.vector.into()) - self.reach_m(&plane.normal)
    }

    /// Whether all of it is in a half space.
    pub(crate) fn is_inside(&self, plane: &Plane) -> bool {
        plane.distance_m(&self.pose.translation.vector.into()) + self.reach_m(&plane.normal) <= 0.0
    }
}

/// The cells that contain a surface, in its frame.
pub(super) struct SeenCells(Vec<[i32; 3]>);

impl SeenCells {
    pub(crate) fn of_surface(surface: &TriangleMesh) -> Self {
        let mut cells = Vec::new();
        for t in 0..surface.triangles.len() {
            let [a, b, c] = surface.corners(t).map(|p| p.cast::<f64>());
            let longest_m = (b - a).norm().max((c - b).norm()).max((a - c).norm());
            let n = (longest_m / STANDS_OFF_M).ceil().max(1.0) as u32;
            for (i, k) in (0..=n).flat_map(|i| (0..=n - i).map(move |k| (i, k))) {
                let share = |x: u32| f64::from(x) / f64::from(n);
                cells.push(cell_of(&(a + (b - a) * share(i) + (c - a) * share(k))));
            }
        }
        cells.sort_unstable();
        cells.dedup();
        Self(cells)
    }

    /// Whether the cell at a place, or one beside it, contains surface.
    pub(crate) fn is_near(&self, p: &Point3<f64>) -> bool {
        let [x, y, z] = cell_of(p);
        let beside = |x: i32| x.saturating_sub(1)..=x.saturating_add(1);
        beside(x).any(|x| beside(y).any(|y| beside(z).any(|z| self.0.binary_search(&[x, y, z]).is_ok())))
    }
}

fn cell_of(p: &Point3<f64>) -> [i32; 3] {
    (p / STANDS_OFF_M).coords.map(|x| x.floor() as i32).into()
}

impl Solid {
    fn of_convex(solid: &ConvexSolid) -> Self {
        let (lower, upper) = solid.bounds();
        let middle = nalgebra::center(&lower, &upper);
        let radius_m = solid.vertices.iter().map(|v| (v - middle).norm()).fold(0.0, f64::max);
        Self { vertices: solid.vertices.clone(), planes: solid.face_planes(), middle, radius_m }
    }

    /// The piece of a line through a place that is inside the solid.
    fn span_on_line(&self, at: &Point3<f64>, way: &Vector3<f64>) -> Option<Span> {
        let to_middle = self.middle - at;
        if to_middle.cross(way).norm_squared() > self.radius_m * self.radius_m {
            return None;
        }
        let mut span = Span {
            ends_m: [f64::NEG_INFINITY, f64::INFINITY],
            normals: [Vector3::zeros(), Vector3::zeros()],
        };
        for plane in &self.planes {
            let toward = plane.normal.dot(way);
            let room_m = -plane.distance_m(at);
            if toward.abs() < 1e-9 {
                if room_m < 0.0 {
                    return None;
                }
                continue;
            }
            let end = usize::from(toward > 0.0);
            let t = room_m / toward;
            if (end == 0 && t > span.ends_m[0]) || (end == 1 && t < span.ends_m[1]) {
                (span.ends_m[end], span.normals[end]) = (t, plane.normal);
                if span.ends_m[0] >= span.ends_m[1] {
                    return None;
                }
            }
        }
        Some(span)
    }

    /// Whether no face of either separates it from a box. If only two edges would separate them, they count
    /// as meeting.
    fn meets_block(&self, block: &Block) -> bool {
        let middle: Point3<f64> = block.pose.translation.vector.into();
        let reach_m = self.radius_m + block.half_m.norm();
        if (self.middle - middle).norm_squared() > reach_m * reach_m
            || self.planes.iter().any(|p| block.above_m(p) >= 0.0)
        {
            return false;
        }
        let axes = block.pose.rotation.to_rotation_matrix();
        (0..3).all(|k| {
            let axis = axes.matrix().column(k).into_owned();
            let along = self.vertices.iter().map(|v| axis.dot(&(v - middle)));
            let [low, high] =
                along.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], x| [lo.min(x), hi.max(x)]);
            low < block.half_m[k] && high > -block.half_m[k]
        })
    }
}

impl Shape {
    pub(crate) fn of_solids(solids: &[ConvexSolid]) -> Self {
        Self(solids.iter().map(Solid::of_convex).collect())
    }

    /// Corners of all solids.
    pub(crate) fn vertices(&self) -> impl Iterator<Item = &Point3<f64>> {
        self.0.iter().flat_map(|s| &s.vertices)
    }

    /// The piece of a line around a place that is within the solids; gaps up to `joined_m` count as filled.
    pub(crate) fn span_through(&self, at: &Point3<f64>, way: &Vector3<f64>, joined_m: f64) -> Option<Span> {
        let mut pieces: Vec<Span> = self.0.iter().filter_map(|s| s.span_on_line(at, way)).collect();
        let near =
            |s: &Span, [low, high]: [f64; 2]| s.ends_m[0] <= high + joined_m && s.ends_m[1] >= low - joined_m;
        let first = pieces.iter().position(|s| near(s, [0.0; 2]))?;
        let mut whole = pieces.swap_remove(first);
        while let Some(next) = pieces.iter().position(|s| near(s, whole.ends_m)) {
            let piece = pieces.swap_remove(next);
            if piece.ends_m[0] < whole.ends_m[0] {
                (whole.ends_m[0], whole.normals[0]) = (piece.ends_m[0], piece.normals[0]);
            }
            if piece.ends_m[1] > whole.ends_m[1] {
                (whole.ends_m[1], whole.normals[1]) = (piece.ends_m[1], piece.normals[1]);
            }
        }
        Some(whole)
    }

    /// Whether a box meets a solid.
    pub(crate) fn meets_block(&self, block: &Block) -> bool {
        self.0.iter().any(|s| s.meets_block(block))
    }
}
