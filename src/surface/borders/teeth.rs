//! Teeth and shreds of a border: surface that no disk on the surface covers.

use super::{
    loops::border_loops,
    reach::{Neighbors, Reach},
    sheet::Sheet,
    straight::MAX_MOVE,
};
use crate::{components::connected_components, edges::sides_by_vertex};

/// Least radius of a disk, voxels. tuned: made and recorded objects (docs/method.md 16); strips narrower than
/// two voxels hold less surface than noise
const LEAST_RADIUS: f64 = 1.0;
/// Largest radius of a disk, voxels; larger ones show nothing more. derived: a rim of 8 voxels bends by one,
/// [`SLACK`], from such a disk
const LARGEST_RADIUS: f64 = 8.0;
/// Largest distance of a vertex outside a disk, voxels. derived: it can still be moved into line from there;
/// the slack also makes up for disks being on vertices only
const SLACK: f64 = MAX_MOVE;

/// A loose piece is a shred if its area is less than that of a disk of this radius, voxels. tuned: made and
/// recorded objects (docs/method.md 16)
const SHRED_RADIUS: f64 = 4.0;

/// Removes shreds; the largest piece stays.
pub(super) fn drop_shreds(sheet: &mut Sheet, voxel_m: f64) {
    let (labels, sizes) = connected_components(&sheet.mesh);
    let mut areas_m2 = vec![0.0; sizes.len()];
    for (t, &label) in labels.iter().enumerate() {
        areas_m2[label as usize] += 0.5 * f64::from(sheet.mesh.area_normal(t).norm());
    }
    let largest_m2 = areas_m2.iter().copied().fold(0.0, f64::max);
    let least_m2 = largest_m2.min(std::f64::consts::PI * (SHRED_RADIUS * voxel_m).powi(2));
    let kept: Vec<bool> = labels.iter().map(|&label| areas_m2[label as usize] >= least_m2).collect();
    sheet.keep_marked(&kept);
}

/// Removes triangles joined by one side only, until there are none.
pub(super) fn drop_hanging(sheet: &mut Sheet) {
    loop {
        let sides = sides_by_vertex(&sheet.mesh);
        let mut kept = Vec::with_capacity(sheet.mesh.triangles.len());
        for &[a, b, c] in &sheet.mesh.triangles {
            let open = [(a, b), (b, c), (c, a)].into_iter().filter(|&(p, q)| !sides.list_at(q).contains(&p));
            kept.push(open.count() < 2);
        }
        if kept.iter().all(|k| *k) {
            return;
        }
        sheet.keep_marked(&kept);
    }
}

/// Removes the triangles with a corner outside every disk. A disk lies on the surface around a vertex,
/// reaches to the border, and has a radius of at least one voxel. This is the opening of mathematical
/// morphology.
pub(super) fn drop_teeth(sheet: &mut Sheet, voxel_m: f64) {
    let Some(loops) = border_loops(&sheet.mesh) else { return };
    let kept: Vec<bool> = {
        let neighbors = Neighbors::of_mesh(&sheet.mesh);
        let mut reach = Reach::new(&sheet.mesh, &neighbors);
        let border: Vec<(u32, f64)> = loops.iter().flatten().map(|&v| (v, 0.0)).collect();
        let near = reach.vertices_within(&border, LARGEST_RADIUS * voxel_m).to_vec();
        // A point lies outside a disk by its distance from the center less the radius.
        let middles: Vec<(u32, f64)> = near
            .into_iter()
            .map(|v| (v, -reach.distance_m(v)))
            .filter(|(_, less)| *less <= -LEAST_RADIUS * voxel_m)
            .collect();
        let mut is_border_near = vec![false; sheet.mesh.vertices.len()];
        for &v in sheet.mesh.triangles.iter().flatten() {
            is_border_near[v as usize] = reach.distance_m(v) < LARGEST_RADIUS * voxel_m;
        }
        reach.vertices_within(&middles, SLACK * voxel_m);
        let is_tooth = |v: &u32| is_border_near[*v as usize] && reach.distance_m(*v).is_infinite();
        sheet.mesh.triangles.iter().map(|t| !t.iter().any(is_tooth)).collect()
    };
    sheet.keep_marked(&kept);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{borders::plates::plate, shapes::box_mesh};

    #[test]
    fn a_plate_with_straight_borders_keeps_all_but_the_tips_of_its_corners() {
        let mut sheet = Sheet::of_mesh(&plate(20, 12, |_, _| true));
        let before = sheet.mesh.triangles.len();
        drop_teeth(&mut sheet, 1.0);
        assert!(before - sheet.mesh.triangles.len() <= 6, "{}", before - sheet.mesh.triangles.len());
    }

    #[test]
    fn teeth_and_a_narrow_strip_go_and_a_broad_one_stays() {
        // A body 20 x 10, teeth three cells high above, a strip of one cell and one of four at its right.
        let tooth = |x: u32, y: u32| y >= 10 && x < 20 && x % 3 == 1;
        let strips = |x: u32, y: u32| x >= 20 && (y == 1 || (4..8).contains(&y));
        let has = |x: u32, y: u32| (x < 20 && y < 10) || tooth(x, y) || strips(x, y);
        let mut sheet = Sheet::of_mesh(&plate(30, 13, has));
        drop_teeth(&mut sheet, 1.0);
        let vertices = || sheet.mesh.triangles.iter().flatten().map(|&v| sheet.mesh.vertices[v as usize]);
        let far = |y: f32| vertices().filter(|p| p.x > 24.0 && (p.y - y).abs() < 1.1).count();
        assert_eq!(far(1.0), 0);
        assert!(far(6.0) > 20);
        // What is left of teeth can be moved into line.
        assert!(vertices().all(|p| p.y <= 11.0));
    }

    #[test]
    fn a_piece_by_itself_stays_if_it_is_large() {
        // Pieces of 30, 5 and 9 cells' length in a row.
        let apart = |x: u32, _: u32| ![30, 36].contains(&x);
        let mut sheet = Sheet::of_mesh(&plate(46, 8, apart));
        drop_shreds(&mut sheet, 1.0);
        assert_eq!(sheet.mesh.triangles.len(), 2 * 8 * (30 + 9));
        let mut small = Sheet::of_mesh(&plate(3, 3, |_, _| true));
        drop_shreds(&mut small, 1.0);
        assert_eq!(small.mesh.triangles.len(), 18);
    }

    #[test]
    fn a_lone_strip_hangs_and_a_closed_mesh_does_not() {
        let mut sheet = Sheet::of_mesh(&plate(9, 1, |_, _| true));
        drop_hanging(&mut sheet);
        assert!(sheet.mesh.is_empty());
        let mut closed = Sheet::of_mesh(&box_mesh(nalgebra::Vector3::repeat(0.1)));
        drop_hanging(&mut closed);
        drop_teeth(&mut closed, 0.01);
        assert_eq!(closed.mesh.triangles.len(), 12);
    }
}
