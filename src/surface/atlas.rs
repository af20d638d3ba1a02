//! A mesh laid out flat: charts packed into a square picture.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::{
    TriangleMesh,
    outline::{hull_2d, rectangle_direction},
    patches::{Patch, grown_patches},
};
use geometry::bounding_box;

/// Empty texels around a chart, so filtering does not mix charts.
/// chosen: one texel for bilinear filtering, and one to spare
const MARGIN_PX: f64 = 2.0;
/// Factor by which texels grow until the charts fit. chosen: few trials, little resolution lost
const COARSER: f64 = 1.15;
/// Greatest depth of a chart about its plane, as a share of the mesh's extent.
/// chosen: a deeper chart stretches its texels
const DEPTH_SHARE: f64 = 0.2;

/// Where the triangles of a mesh lie in a square texture.
#[derive(Clone, Debug, PartialEq)]
pub struct Atlas {
    /// Side of the texture, pixels.
    pub size_px: usize,
    /// Size of a texel on the surface, meters.
    pub texel_m: f64,
    /// Corners of every triangle, pixels (x right, y down; the middle of a pixel is at .5).
    pub corners_px: Vec<[Point2<f64>; 3]>,
    /// Chart of every triangle.
    pub chart: Vec<u32>,
}

/// A chart laid flat: corners of its triangles in meters from its lower corner, and its size.
struct Chart {
    triangles: Vec<u32>,
    corners_m: Vec<[Point2<f64>; 3]>,
    size_m: Vector2<f64>,
}

/// Lays the mesh out in charts: no triangle turns by more than 35 degrees from the first of its chart. A
/// texel measures `texel_m`, or as little as sides of `max_px` pixels allow. Charts never overlap.
/// Deterministic.
pub fn atlas_of_mesh(mesh: &TriangleMesh, texel_m: f64, max_px: usize) -> Atlas {
    let extent_m = mesh.bounds().map_or(0.0, |(lo, hi)| f64::from((hi - lo).norm()));
    let mut charts: Vec<Chart> =
        grown_patches(mesh, DEPTH_SHARE * extent_m).iter().map(|p| lay_flat(mesh, p)).collect();
    // Shelf packing wastes least when heights descend.
    charts.sort_by(|a, b| b.size_m.y.total_cmp(&a.size_m.y).then(b.size_m.x.total_cmp(&a.size_m.x)));
    // Starting near the finest size `max_px` allows keeps the loop short.
    let mut texel_m = texel_m.max(extent_m / (2.0 * max_px as f64)).max(1e-9);
    let (size_px, places) = loop {
        if let Some(found) = packed_on_shelves(&charts, texel_m, max_px) {
            break found;
        }
        texel_m *= COARSER;
    };
    let mut atlas = Atlas {
        size_px,
        texel_m,
        // Triangles without area are in no patch and so in no chart: they get the middle of one pixel.
        corners_px: vec![[Point2::new(0.5, 0.5); 3]; mesh.triangles.len()],
        chart: vec![u32::MAX; mesh.triangles.len()],
    };
    for (k, (chart, place)) in charts.iter().zip(&places).enumerate() {
        for (t, corners) in chart.triangles.iter().zip(&chart.corners_m) {
            atlas.corners_px[*t as usize] = corners.map(|p| Point2::from(place + p.coords / texel_m));
            atlas.chart[*t as usize] = k as u32;
        }
    }
    atlas
}

impl Atlas {
    /// Texture coordinates of a triangle's corners in `[0, 1]`, v up.
    pub fn texture_coordinates(&self, triangle: usize) -> [[f64; 2]; 3] {
        let size = self.size_px as f64;
        self.corners_px[triangle].map(|p| [(p.x / size).clamp(0.0, 1.0), (1.0 - p.y / size).clamp(0.0, 1.0)])
    }
}

/// A patch seen along its normal, turned until the rectangle around it is smallest and stands upright.
fn lay_flat(mesh: &TriangleMesh, patch: &Patch) -> Chart {
    let z = patch.normal;
    // Any axis not nearly parallel to the normal.
    let x = z.cross(&if z.x.abs() < 0.8 { Vector3::x() } else { Vector3::y() }).normalize();
    let axes = Matrix3::from_columns(&[x, z.cross(&x), z]);
    let mut corners = Vec::with_capacity(patch.triangles.len());
    for &t in &patch.triangles {
        let in_axes = mesh.corners(t as usize).map(|p| axes.tr_mul(&(p.cast::<f64>() - patch.center)));
        corners.push(in_axes.map(|p| Point2::new(p.x, p.y)));
    }
    let all: Vec<Point2<f64>> = corners.iter().flatten().copied().collect();
    let d = rectangle_direction(&hull_2d(&all));
    let turned = |p: &Point2<f64>| Point2::new(p.coords.dot(&d), d.perp(&p.coords));
    let (lower, upper) = bounding_box(all.iter().map(turned)).unwrap_or_default();
    let size = upper - lower;
    let corners_m =
        corners.iter().map(|c| c.map(|p| laid_wide(Point2::from(turned(&p) - lower), &size))).collect();
    let size_m = if size.y > size.x { size.yx() } else { size };
    Chart { triangles: patch.triangles.clone(), corners_m, size_m }
}

/// Turns a point of a rectangle by a right angle where the rectangle is higher than wide: shelves waste less.
/// A turn does not mirror the chart. The result's y points down, as that of pixels.
fn laid_wide(p: Point2<f64>, size: &Vector2<f64>) -> Point2<f64> {
    if size.y > size.x { Point2::new(size.y - p.y, size.x - p.x) } else { Point2::new(p.x, size.y - p.y) }
}

/// Packs the charts on shelves of a square: its side and the upper left corner of every chart, pixels; `None`
/// where `max_px` is too small.
fn packed_on_shelves(charts: &[Chart], texel_m: f64, max_px: usize) -> Option<(usize, Vec<Vector2<f64>>)> {
    let size = |c: &Chart| c.size_m.map(|s| (s / texel_m).ceil() + 2.0 * MARGIN_PX);
    let area: f64 = charts.iter().map(|c| size(c).product()).sum();
    let widest = charts.iter().map(|c| size(c).x).fold(16.0, f64::max);
    // Shelves leave gaps, so the area is only where the search begins.
    let mut side = (1.05 * area.sqrt()).max(widest).ceil();
    loop {
        if side > max_px as f64 {
            return None;
        }
        let mut at = Vector2::zeros();
        let mut shelf = 0.0;
        let mut places = Vec::with_capacity(charts.len());
        for chart in charts {
            let s = size(chart);
            if at.x + s.x > side {
                at = Vector2::new(0.0, at.y + shelf);
                shelf = 0.0;
            }
            places.push(at + Vector2::repeat(MARGIN_PX));
            at.x += s.x;
            shelf = f64::max(shelf, s.y);
        }
        if at.y + shelf <= side {
            return Some((side as usize, places));
        }
        side = (side * 1.04).ceil();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        outline::polygon_area,
        shapes::{box_mesh, sphere_mesh},
    };

    /// Share of the texels that more than one chart claims, and the distortion of areas.
    fn defects(mesh: &TriangleMesh, atlas: &Atlas) -> (usize, f64) {
        let mut owner = vec![u32::MAX; atlas.size_px * atlas.size_px];
        let mut twice = 0;
        let mut worst = 1.0f64;
        for (t, c) in atlas.corners_px.iter().enumerate() {
            let flat = polygon_area(c).abs() * atlas.texel_m * atlas.texel_m;
            worst = worst.min(flat / (0.5 * f64::from(mesh.area_normal(t).norm())));
            let middle = Point2::from((c[0].coords + c[1].coords + c[2].coords) / 3.0);
            let slot = &mut owner[middle.y as usize * atlas.size_px + middle.x as usize];
            twice += usize::from(*slot != u32::MAX && *slot != atlas.chart[t]);
            *slot = atlas.chart[t];
        }
        (twice, worst)
    }

    #[test]
    fn a_box_keeps_its_areas_and_every_face_its_place() {
        let mesh = box_mesh(Vector3::new(0.3, 0.2, 0.1));
        let atlas = atlas_of_mesh(&mesh, 0.002, 4096);
        let (twice, worst) = defects(&mesh, &atlas);
        assert!(twice == 0 && worst > 0.999, "{twice} {worst}");
        assert!((atlas.texel_m - 0.002).abs() < 1e-12 && atlas.size_px < 700, "{}", atlas.size_px);
        assert!(
            (0..12).all(|t| polygon_area(&atlas.corners_px[t]) < 0.0),
            "seen from outside, pixels go down"
        );
        assert!(
            atlas
                .corners_px
                .iter()
                .flatten()
                .all(|p| p.x >= 1.0 && p.y >= 1.0 && p.x.max(p.y) <= atlas.size_px as f64 - 1.0)
        );
    }

    #[test]
    fn a_sphere_fits_into_little_space() {
        let mesh = sphere_mesh(0.3, 40);
        let atlas = atlas_of_mesh(&mesh, 0.0001, 256);
        let (twice, worst) = defects(&mesh, &atlas);
        assert!(atlas.size_px <= 256 && twice == 0 && worst > 0.6, "{twice} {worst}");
        assert!(atlas_of_mesh(&TriangleMesh::default(), 0.001, 64).corners_px.is_empty());
    }
}
