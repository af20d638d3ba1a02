//! Convex polyhedra: cutting, overlap, volume.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use crate::TriangleMesh;
use geometry::{Pose, bounding_box};

/// Points nearer to a plane than this lie in it, meters. chosen: above rounding, below any reading
const ON_PLANE_M: f64 = 1e-9;

/// The half space `normal . x <= offset_m`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal, pointing out of the half space.
    pub normal: Vector3<f64>,
    /// Distance from the origin along the normal, meters.
    pub offset_m: f64,
}

impl Plane {
    /// Signed distance of a point, meters; positive outside.
    pub fn distance_m(&self, p: &Point3<f64>) -> f64 {
        self.normal.dot(&p.coords) - self.offset_m
    }
}

/// A convex polyhedron, meters. Faces turn counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ConvexSolid {
    /// Corners.
    pub vertices: Vec<Point3<f64>>,
    /// Corners of every face, in order.
    pub faces: Vec<Vec<u32>>,
}

impl ConvexSolid {
    /// A prism: a convex polygon (counter-clockwise seen from the tip of `normal`) swept from `low_m` to
    /// `high_m` along the unit normal.
    pub fn prism(polygon: &[Point3<f64>], normal: &Vector3<f64>, low_m: f64, high_m: f64) -> Self {
        let n = polygon.len() as u32;
        let bottom = polygon.iter().map(|p| p + normal * low_m);
        let vertices = bottom.chain(polygon.iter().map(|p| p + normal * high_m)).collect();
        let sides = (0..n).map(|i| vec![i, (i + 1) % n, n + (i + 1) % n, n + i]);
        let faces = [(0..n).rev().collect(), (n..2 * n).collect()].into_iter().chain(sides).collect();
        Self { vertices, faces }
    }

    /// An axis-aligned box.
    pub fn cuboid(lower: &Point3<f64>, upper: &Point3<f64>) -> Self {
        let polygon = [(lower.x, lower.y), (upper.x, lower.y), (upper.x, upper.y), (lower.x, upper.y)];
        Self::prism(&polygon.map(|(x, y)| Point3::new(x, y, 0.0)), &Vector3::z(), lower.z, upper.z)
    }

    /// The planes of its faces; faces without area have none.
    pub fn face_planes(&self) -> Vec<Plane> {
        self.faces.iter().filter_map(|f| self.face_plane(f)).collect()
    }

    /// The plane of a face; `None` for one without area.
    pub fn face_plane(&self, face: &[u32]) -> Option<Plane> {
        let normal = self.twice_area(face).try_normalize(1e-16)?;
        let heights = face.iter().map(|&i| normal.dot(&self.vertices[i as usize].coords));
        // Rounding leaves the corners of a cut face beside its plane: their mean height fits all best.
        let offset_m = heights.sum::<f64>() / face.len() as f64;
        Some(Plane { normal, offset_m })
    }

    /// Unit normal and area of every face with area, square meters.
    pub fn face_areas(&self) -> impl Iterator<Item = (Vector3<f64>, f64)> + '_ {
        self.faces.iter().filter_map(|f| Some((self.face_plane(f)?.normal, 0.5 * self.twice_area(f).norm())))
    }

    /// Twice the area of a face along its normal.
    fn twice_area(&self, face: &[u32]) -> Vector3<f64> {
        let at = |i: u32| self.vertices[i as usize].coords;
        let origin = at(face[0]);
        face.windows(2).map(|w| (at(w[0]) - origin).cross(&(at(w[1]) - origin))).sum()
    }

    /// The part inside a half space; `None` where there is none.
    pub fn clipped_at(&self, plane: &Plane) -> Option<Self> {
        let side: Vec<f64> = self.vertices.iter().map(|p| plane.distance_m(p)).collect();
        // Corners within rounding of the plane lie on it, so no sliver is cut off.
        if side.iter().all(|s| *s <= ON_PLANE_M) {
            return Some(self.clone());
        }
        if side.iter().all(|s| *s >= -ON_PLANE_M) {
            return None;
        }
        let mut vertices = self.vertices.clone();
        // The two faces of an edge share the vertex where it is cut.
        let mut cuts: BTreeMap<(u32, u32), u32> = BTreeMap::new();
        let mut cap: Vec<u32> =
            (0..side.len() as u32).filter(|&i| side[i as usize].abs() <= ON_PLANE_M).collect();
        let mut faces = Vec::with_capacity(self.faces.len() + 1);
        for face in &self.faces {
            let mut kept = Vec::with_capacity(face.len() + 1);
            for (k, &a) in face.iter().enumerate() {
                let b = face[(k + 1) % face.len()];
                let da = side[a as usize];
                let db = side[b as usize];
                if da <= ON_PLANE_M {
                    kept.push(a);
                }
                if (da < -ON_PLANE_M && db > ON_PLANE_M) || (da > ON_PLANE_M && db < -ON_PLANE_M) {
                    kept.push(*cuts.entry((a.min(b), a.max(b))).or_insert_with(|| {
                        let p = vertices[a as usize];
                        let q = vertices[b as usize];
                        vertices.push(p + (q - p) * (da / (da - db)));
                        vertices.len() as u32 - 1
                    }));
                }
            }
            // A face in the plane is the cap itself.
            let inside = kept.iter().any(|&i| side.get(i as usize).is_some_and(|s| *s < -ON_PLANE_M));
            if kept.len() >= 3 && (inside || kept.iter().any(|&i| i as usize >= side.len())) {
                faces.push(kept);
            }
        }
        cap.extend(cuts.into_values());
        if cap.len() >= 3 {
            faces.push(ordered_around(&vertices, cap, &plane.normal));
        }
        Some(Self { vertices, faces }.without_unused_corners())
    }

    /// The part inside all half spaces; `None` where there is none.
    pub fn clipped_by(&self, planes: &[Plane]) -> Option<Self> {
        planes.iter().try_fold(self.clone(), |solid, plane| solid.clipped_at(plane))
    }

    /// Removes unused corners.
    fn without_unused_corners(self) -> Self {
        let mut index = vec![u32::MAX; self.vertices.len()];
        let mut vertices = Vec::new();
        let mut faces = self.faces;
        for corner in faces.iter_mut().flatten() {
            let slot = &mut index[*corner as usize];
            if *slot == u32::MAX {
                *slot = vertices.len() as u32;
                vertices.push(self.vertices[*corner as usize]);
            }
            *corner = *slot;
        }
        Self { vertices, faces }
    }

    /// Tetrahedra that fill the solid, from its first corner: volume and corners.
    pub fn tetrahedra(&self) -> impl Iterator<Item = (f64, [Point3<f64>; 4])> + '_ {
        let apex = self.vertices.first().copied().unwrap_or_else(Point3::origin);
        self.faces.iter().flat_map(move |f| {
            f.windows(2).skip(1).map(move |w| {
                let [a, b, c] = [f[0], w[0], w[1]].map(|i| self.vertices[i as usize]);
                ((a - apex).cross(&(b - apex)).dot(&(c - apex)) / 6.0, [apex, a, b, c])
            })
        })
    }

    /// Volume, cubic meters.
    pub fn volume_m3(&self) -> f64 {
        self.tetrahedra().map(|(v, _)| v).sum()
    }

    /// Smallest extent along the normal of a face, meters: how thin it is. 0 for a solid without faces.
    pub fn thickness_m(&self) -> f64 {
        let planes = self.face_planes();
        let extents =
            planes.iter().map(|p| self.vertices.iter().map(|v| -p.distance_m(v)).fold(0.0, f64::max));
        extents.min_by(f64::total_cmp).unwrap_or(0.0)
    }

    /// Lower and upper corner of the axis-aligned bounding box.
    pub fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        bounding_box(self.vertices.iter().copied()).unwrap_or_default()
    }

    /// Its axes: the normal of its largest face, the longest side of this face, and their cross product.
    pub fn main_axes(&self) -> Matrix3<f64> {
        let largest =
            self.faces.iter().max_by(|a, b| self.twice_area(a).norm().total_cmp(&self.twice_area(b).norm()));
        let Some(face) = largest else { return Matrix3::identity() };
        let Some(plane) = self.face_plane(face) else { return Matrix3::identity() };
        let at = |k: usize| self.vertices[face[k % face.len()] as usize];
        let sides = (0..face.len()).map(|k| at(k + 1) - at(k));
        let longest = sides.max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared())).unwrap_or_default();
        let along = longest - plane.normal * plane.normal.dot(&longest);
        let Some(along) = Unit::try_new(along, 1e-15) else { return Matrix3::identity() };
        Matrix3::from_columns(&[plane.normal, along.into_inner(), plane.normal.cross(&along)])
    }

    /// The solid moved by a rigid motion.
    #[must_use]
    pub fn transformed(&self, target_from_source: &Pose) -> Self {
        Self {
            vertices: self.vertices.iter().map(|p| target_from_source * p).collect(),
            faces: self.faces.clone(),
        }
    }

    /// How far it reaches into another solid, meters: the shortest way to separate them along a face normal
    /// of either. `None` where they are apart or only touch.
    pub fn penetration_m(&self, other: &Self) -> Option<f64> {
        let theirs = other.face_planes();
        let shortest = self.depth_behind_m(&theirs).min(other.depth_behind_m(&self.face_planes()));
        // Face normals alone may miss a separating axis between two edges; cutting decides.
        (shortest > ON_PLANE_M && self.clipped_by(&theirs).is_some()).then_some(shortest)
    }

    /// Least depth of the solid behind any of some planes, meters, each measured at its deepest corner.
    fn depth_behind_m(&self, planes: &[Plane]) -> f64 {
        let deepest = planes
            .iter()
            .map(|p| self.vertices.iter().map(|v| -p.distance_m(v)).fold(f64::NEG_INFINITY, f64::max));
        deepest.min_by(f64::total_cmp).unwrap_or(f64::NEG_INFINITY)
    }

    /// The surface as triangles.
    pub fn to_mesh(&self) -> TriangleMesh {
        let triangles = self.faces.iter().flat_map(|f| (1..f.len() - 1).map(|k| [f[0], f[k], f[k + 1]]));
        TriangleMesh {
            vertices: self.vertices.iter().map(|p| p.cast()).collect(),
            triangles: triangles.collect(),
            colors: Vec::new(),
        }
    }
}

/// Corners of a convex polygon in order around a normal.
fn ordered_around(vertices: &[Point3<f64>], mut corners: Vec<u32>, normal: &Vector3<f64>) -> Vec<u32> {
    let at = |i: u32| vertices[i as usize];
    let center =
        Point3::from(corners.iter().map(|&i| at(i).coords).sum::<Vector3<f64>>() / corners.len() as f64);
    // Starting at the farthest corner, the angles suffer least from rounding.
    let far =
        corners.iter().map(|&i| at(i) - center).max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
    let Some(u) = far.and_then(|f| (f - normal * normal.dot(&f)).try_normalize(1e-15)) else {
        return corners;
    };
    let v = normal.cross(&u);
    let angle = |i: u32| (at(i) - center).dot(&v).atan2((at(i) - center).dot(&u));
    corners.sort_by(|a, b| angle(*a).total_cmp(&angle(*b)).then(a.cmp(b)));
    corners
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn unit_box() -> ConvexSolid {
        ConvexSolid::cuboid(&Point3::new(-0.5, -0.5, -0.5), &Point3::new(0.5, 0.5, 0.5))
    }

    /// Every side of a face has its counterpart, and the volume is positive.
    fn is_closed(solid: &ConvexSolid) -> bool {
        let sides = solid.faces.iter().flat_map(|f| (0..f.len()).map(|k| (f[k], f[(k + 1) % f.len()])));
        let all: std::collections::BTreeSet<_> = sides.collect();
        all.iter().all(|(a, b)| all.contains(&(*b, *a))) && solid.volume_m3() > 0.0
    }

    proptest! {
        #[test]
        fn two_halves_make_the_whole(n in prop::array::uniform3(-1.0..1.0f64), offset in -0.4..0.4f64) {
            prop_assume!(Vector3::from(n).norm() > 0.1);
            let normal = Vector3::from(n).normalize();
            let plane = Plane { normal, offset_m: offset };
            let other = Plane { normal: -normal, offset_m: -offset };
            let halves = [plane, other].map(|p| unit_box().clipped_at(&p).unwrap());
            prop_assert!(halves.iter().all(is_closed));
            prop_assert!((halves[0].volume_m3() + halves[1].volume_m3() - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn a_corner_cut_off_is_a_tetrahedron() {
        let normal = Vector3::new(1.0, 1.0, 1.0).normalize();
        let corner =
            unit_box().clipped_at(&Plane { normal: -normal, offset_m: -(1.2 / 3f64.sqrt()) }).unwrap();
        assert_eq!((corner.vertices.len(), corner.faces.len()), (4, 4));
        assert!((corner.volume_m3() - 0.3f64.powi(3) / 6.0).abs() < 1e-12);
    }

    #[test]
    fn overlap_is_measured_along_the_shortest_way_out() {
        let a = unit_box();
        let moved =
            |x: f64, turn: f64| a.transformed(&Pose::new(Vector3::new(x, 0.1, 0.0), Vector3::z() * turn));
        assert!((a.penetration_m(&moved(0.97, 0.0)).unwrap() - 0.03).abs() < 1e-12);
        assert_eq!(a.penetration_m(&moved(1.0, 0.0)), None);
        assert_eq!(a.penetration_m(&moved(1.3, 0.7)), None);
        assert!(a.penetration_m(&moved(1.1, 0.7)).is_some());
    }
}
