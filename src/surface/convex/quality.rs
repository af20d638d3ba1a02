//! Measures how well solids lie where a surface was seen.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{ConvexSolid, Plane, rays::Facets};
use crate::{TriangleMesh, sample_surface, triangle::closest_on_triangle};
use numeric::random::stage_rng;

/// Number of examined places on the surface.
const SAMPLES: usize = 4000;
/// Percentile of the reported distance.
/// chosen: few places may be worse than reported
const PERCENTILE: f64 = 0.95;
/// Gaps between solids along a ray up to this are rounding, meters. chosen: above rounding, below any wall
const JOINED_M: f64 = 1e-6;

/// How well solids fit their surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidFit {
    /// Share of the surface with more than [`SolidFit::STAND_OFF_M`] of solid in front of it.
    pub standing_off: f64,
    /// 95th percentile of the distance from the surface to the nearest solid, meters; 0 inside a solid.
    pub distance_m: f64,
}

impl SolidFit {
    /// A solid that stands farther out of its surface gets in the way of contact, meters. tuned: made and
    /// recorded objects (docs/method.md 16)
    pub const STAND_OFF_M: f64 = 0.002;
    /// Largest acceptable share of the surface with solids in front of it. tuned: made and recorded objects
    /// (docs/method.md 16)
    pub const MOST_STANDING_OFF: f64 = 0.05;
    /// Largest acceptable distance, meters. tuned: made and recorded objects (docs/method.md 16)
    pub const MOST_DISTANCE_M: f64 = 0.003;

    /// Measures solids at places spread evenly over a surface; `None` without area or solids.
    pub fn of_solids(mesh: &TriangleMesh, solids: &[ConvexSolid]) -> Option<Self> {
        let samples = sample_surface(mesh, SAMPLES, &mut stage_rng(0, "solid fit", 0));
        let planes: Vec<Vec<Plane>> = solids.iter().map(ConvexSolid::face_planes).collect();
        if samples.points.is_empty() || planes.is_empty() {
            return None;
        }
        let extent_m = mesh.bounds().map_or(0.0, |(lo, hi)| f64::from((hi - lo).norm()));
        let facets = Facets::of_mesh(mesh, extent_m.max(f64::MIN_POSITIVE));
        let found: Vec<(f64, f64)> = samples
            .points
            .par_iter()
            .zip(&samples.normals)
            .map(|(p, n)| {
                let p = p.cast::<f64>();
                let nearest = solids
                    .iter()
                    .zip(&planes)
                    .fold(f64::INFINITY, |nearest, (s, q)| distance_m(s, q, &p, nearest));
                let off = stand_off_m(&planes, &p, &n.cast());
                let n = n.cast();
                // Surface inside the mesh is invisible where the mesh overlaps itself.
                let hidden = off > Self::STAND_OFF_M && is_inside(&facets, &p.coords, &n);
                (if hidden { 0.0 } else { off }, nearest)
            })
            .collect();
        let off = found.iter().filter(|f| f.0 > Self::STAND_OFF_M).count();
        let mut distances: Vec<f64> = found.iter().map(|f| f.1).collect();
        distances.sort_by(f64::total_cmp);
        let last = distances.len() - 1;
        let distance_m = distances[((PERCENTILE * distances.len() as f64) as usize).min(last)];
        Some(Self { standing_off: off as f64 / found.len() as f64, distance_m })
    }

    /// Whether both measures are within their limits.
    pub fn is_sound(&self) -> bool {
        self.standing_off <= Self::MOST_STANDING_OFF && self.distance_m <= Self::MOST_DISTANCE_M
    }
}

impl std::fmt::Display for SolidFit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "stand more than {} mm before {:.1} % of the visible surface, and 5 % of it lies more than {:.1} \
             mm away from them",
            1e3 * Self::STAND_OFF_M,
            100.0 * self.standing_off,
            1e3 * self.distance_m
        )
    }
}

/// Length of adjoining solids along a direction from a point, meters.
fn stand_off_m(solids: &[Vec<Plane>], p: &Point3<f64>, direction: &Vector3<f64>) -> f64 {
    let mut spans: Vec<[f64; 2]> = solids.iter().filter_map(|s| span(s, p, direction)).collect();
    spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
    spans.iter().fold(0.0, |end, [from, to]| if *from <= end + JOINED_M { end.max(*to) } else { end })
}

/// Where a ray from a point enters and leaves a solid, meters; `None` where it misses it.
fn span(planes: &[Plane], p: &Point3<f64>, direction: &Vector3<f64>) -> Option<[f64; 2]> {
    let mut from = f64::NEG_INFINITY;
    let mut to = f64::INFINITY;
    for plane in planes {
        let height = plane.distance_m(p);
        let speed = plane.normal.dot(direction);
        if speed.abs() < 1e-12 {
            if height > 0.0 {
                return None;
            }
        } else if speed > 0.0 {
            to = to.min(-height / speed);
        } else {
            from = from.max(-height / speed);
        }
        // Most solids are missed by one of their first planes.
        if to <= from.max(0.0) {
            return None;
        }
    }
    Some([from, to])
}

/// Whether the point is inside the object: the ray leaves the surface before it enters it.
fn is_inside(facets: &Facets, p: &Vector3<f64>, direction: &Vector3<f64>) -> bool {
    facets.way_m(p, direction, true) < facets.way_m(p, direction, false)
}

/// Distance of a point to a solid, meters, at most `nearest_m`; 0 inside.
fn distance_m(solid: &ConvexSolid, planes: &[Plane], p: &Point3<f64>, nearest_m: f64) -> f64 {
    let mut outside = f64::NEG_INFINITY;
    for plane in planes {
        outside = outside.max(plane.distance_m(p));
        if outside >= nearest_m {
            return nearest_m;
        }
    }
    if outside <= 0.0 {
        return 0.0;
    }
    // The nearest point lies on a face.
    solid.faces.iter().map(|face| face_distance_m(solid, face, p)).fold(nearest_m, f64::min)
}

/// Distance of a point to a face, meters.
fn face_distance_m(solid: &ConvexSolid, face: &[u32], p: &Point3<f64>) -> f64 {
    let corner = |k: usize| solid.vertices[face[k] as usize];
    (1..face.len().max(1) - 1)
        .map(|k| closest(p, [corner(0), corner(k), corner(k + 1)]))
        .fold(f64::INFINITY, f64::min)
}

fn closest(p: &Point3<f64>, triangle: [Point3<f64>; 3]) -> f64 {
    f64::from(closest_on_triangle(&Vector3::zeros(), &triangle.map(|q| (q - p).cast())).0.norm())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::box_mesh;

    fn cuboid(half: [f64; 3]) -> ConvexSolid {
        ConvexSolid::cuboid(&Point3::from(half.map(|h| -h)), &Point3::from(half))
    }

    #[test]
    fn a_box_fits_itself_and_a_larger_one_stands_off() {
        let mesh = box_mesh(Vector3::new(0.2, 0.1, 0.05));
        let own = SolidFit::of_solids(&mesh, &[cuboid([0.2, 0.1, 0.05])]).unwrap();
        assert!(own.is_sound() && own.standing_off < 1e-9 && own.distance_m < 1e-6, "{own}");
        // Taller by 3 mm at the top and at the bottom, which are 8 of 14 parts of the surface.
        let tall = SolidFit::of_solids(&mesh, &[cuboid([0.2, 0.1, 0.053])]).unwrap();
        assert!(!tall.is_sound() && (tall.standing_off - 8.0 / 14.0).abs() < 0.02, "{tall}");
        let small = SolidFit::of_solids(&mesh, &[cuboid([0.2, 0.1, 0.04])]).unwrap();
        assert!(!small.is_sound() && (small.distance_m - 0.01).abs() < 1e-6, "{small}");
        assert!(SolidFit::of_solids(&mesh, &[]).is_none());
    }
}
