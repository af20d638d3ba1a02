//! The flat face around a gap in a surface.

use std::collections::BTreeSet;

use nalgebra::{Matrix3, Point2, Point3, Vector3};

use super::reach::Reach;
use crate::TriangleMesh;
use geometry::normals_of;

/// A gap is no wider than this, voxels.
/// tuned: made and recorded objects (docs/method.md 16); a twentieth of the object at the default resolution
const MAX_WIDTH: f64 = 12.0;
/// The surface around is examined up to half the gap's width from it, and at least this far, voxels. tuned:
/// made and recorded objects (docs/method.md 16)
const LEAST_MARGIN: f64 = 2.0;
/// Largest root mean square distance of the surface around from its plane, voxels. chosen: a rim's place is
/// uncertain by half a voxel anyway, and an evenly bent surface deviates as little inside the gap
const MAX_RMS: f64 = 0.5;
/// Largest distance of the rim's own vertices from the plane, voxels. chosen: three times [`MAX_RMS`]
const MAX_STEP: f64 = 1.5;
/// Least length of the area-weighted mean of the unit normals around. tuned: made and recorded objects
/// (docs/method.md 16); at a right angle it is 0.71
const MIN_AGREEMENT: f64 = 0.75;

/// The plane of a face around a gap.
pub(super) struct Face {
    middle: Point3<f64>,
    /// Two directions in the plane; with the outward normal they are right-handed.
    along: [Vector3<f64>; 2],
}

impl Face {
    /// The plane of the face around a rim, given as vertices with the surface on their left; the side from
    /// the last vertex to the first may be missing. `triangles` are those at each vertex. `None` where the
    /// rim is too wide, encloses surface instead of a gap, or the surface around it is not flat or smaller
    /// than the gap.
    pub(super) fn around_rim(
        mesh: &TriangleMesh,
        rim: &[u32],
        reach: &mut Reach<'_>,
        triangles: &[Vec<u32>],
        voxel_m: f64,
    ) -> Option<Self> {
        let rim_points: Vec<Point3<f64>> = rim.iter().map(|&v| mesh.vertices[v as usize].cast()).collect();
        let center = mean_point(&rim_points);
        let half_m = rim_points.iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
        if 2.0 * half_m > MAX_WIDTH * voxel_m {
            return None;
        }
        let sources: Vec<(u32, f64)> = rim.iter().map(|&v| (v, 0.0)).collect();
        let near: Vec<u32> = reach.vertices_within(&sources, half_m.max(LEAST_MARGIN * voxel_m)).to_vec();
        let faces: BTreeSet<u32> = near.iter().flat_map(|&v| &triangles[v as usize]).copied().collect();
        let area_normals = faces.iter().map(|&t| mesh.area_normal(t as usize).cast::<f64>() * 0.5);
        let (sum, area_m2) = area_normals.fold((Vector3::zeros(), 0.0), |(s, a), n| (s + n, a + n.norm()));
        let near: Vec<Point3<f64>> = near.iter().map(|&v| mesh.vertices[v as usize].cast()).collect();
        let middle = mean_point(&near);
        let offsets = near.iter().map(|p| p - middle);
        let scatter = offsets.fold(Matrix3::zeros(), |m, d| m + d * d.transpose()) / near.len() as f64;
        let eigen = scatter.symmetric_eigen();
        let normal: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
        let normal = if normal.dot(&sum) < 0.0 { -normal } else { normal };
        let step = rim_points.iter().map(|p| (p - middle).dot(&normal).abs()).fold(0.0, f64::max);
        if eigen.eigenvalues.min().max(0.0).sqrt() > MAX_RMS * voxel_m
            || step > MAX_STEP * voxel_m
            || sum.dot(&normal) < MIN_AGREEMENT * area_m2
        {
            return None;
        }
        let face = Self { middle, along: normals_of(&normal) };
        // With the surface on its left the rim of a gap turns clockwise.
        let gap_m2 = -signed_area(&rim_points.iter().map(|p| face.in_plane(p)).collect::<Vec<_>>());
        (gap_m2 > 0.0 && gap_m2 <= area_m2).then_some(face)
    }

    /// A point's coordinates in the plane.
    pub(super) fn in_plane(&self, p: &Point3<f64>) -> Point2<f64> {
        let d = p - self.middle;
        Point2::new(d.dot(&self.along[0]), d.dot(&self.along[1]))
    }
}

fn mean_point(points: &[Point3<f64>]) -> Point3<f64> {
    (points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64).into()
}

fn signed_area(polygon: &[Point2<f64>]) -> f64 {
    let n = polygon.len();
    (0..n).map(|k| polygon[k].coords.perp(&polygon[(k + 1) % n].coords)).sum::<f64>() * 0.5
}
