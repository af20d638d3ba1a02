//! Unseen surface: the border between space seen empty and space never seen (Yamauchi 1997), as patches.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::region::{Cell, PATCH, Region};

/// Largest number of patches; the smallest are left out.
const MOST_PATCHES: usize = 600;
/// Least sum of cell faces in a patch.
/// chosen: noise in the state of a cell adds or removes single faces
const LEAST_FACES: f64 = 2.0;

/// A piece of the border of the seen space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnseenPatch {
    /// Its middle in the world.
    pub center: Point3<f64>,
    /// Unit vector from unseen to empty space.
    pub normal: Vector3<f64>,
    /// Its area, square meters.
    pub area_m2: f64,
}

/// The unseen surface of a region.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Unseen {
    /// The largest patches, ordered by position.
    pub patches: Vec<UnseenPatch>,
    /// Area of all patches, square meters.
    pub area_m2: f64,
    /// Area of the seen surface in the region, square meters.
    pub seen_m2: f64,
}

impl Unseen {
    /// Unseen share of the surface: 1 where nothing was seen.
    pub fn unseen_share(&self) -> f64 {
        let all_m2 = self.area_m2 + self.seen_m2;
        if all_m2 > 0.0 { self.area_m2 / all_m2 } else { 1.0 }
    }
}

/// Sums over the cell faces of a patch.
#[derive(Default)]
struct FaceSums {
    faces: Vector3<f64>,
    centers: Vector3<f64>,
    count: f64,
}

impl FaceSums {
    /// The patch for cells of side `cell_m`; `None` if it has too few faces. The areas of cell faces along a
    /// slanted plane add up to more than its area; summed as vectors, they give its area.
    fn to_patch(&self, cell_m: f64) -> Option<UnseenPatch> {
        let size = self.faces.norm();
        (size >= LEAST_FACES).then(|| UnseenPatch {
            center: Point3::from(self.centers / self.count),
            normal: self.faces / size,
            area_m2: size * cell_m * cell_m,
        })
    }
}

/// The unseen surface of a region; `seen_m2` is the area of its seen surface, square meters.
pub(super) fn unseen_of_region(region: &Region, seen_m2: f64) -> Unseen {
    let mut sums: BTreeMap<[usize; 3], FaceSums> = BTreeMap::new();
    let side = region.side;
    for z in 0..side {
        for y in 0..side {
            for x in 0..side {
                if region.cell_state([x, y, z]) != Cell::Unknown {
                    continue;
                }
                for axis in 0..3 {
                    for step in [-1isize, 1] {
                        let mut other = [x, y, z];
                        let Some(next) = other[axis].checked_add_signed(step).filter(|n| *n < side) else {
                            continue;
                        };
                        other[axis] = next;
                        if region.cell_state(other) == Cell::Empty {
                            let sum = sums.entry([x / PATCH, y / PATCH, z / PATCH]).or_default();
                            sum.faces[axis] += step as f64;
                            sum.centers += (region.middle_of_cell([x, y, z]).coords
                                + region.middle_of_cell(other).coords)
                                / 2.0;
                            sum.count += 1.0;
                        }
                    }
                }
            }
        }
    }
    let mut patches: Vec<UnseenPatch> = sums.values().filter_map(|s| s.to_patch(region.cell_m)).collect();
    let area_m2 = patches.iter().fold(0.0, |sum, p| sum + p.area_m2);
    if patches.len() > MOST_PATCHES {
        let mut areas: Vec<f64> = patches.iter().map(|p| p.area_m2).collect();
        areas.sort_unstable_by(|a, b| b.total_cmp(a));
        let least_m2 = areas[MOST_PATCHES];
        patches.retain(|p| p.area_m2 > least_m2);
    }
    Unseen { patches, area_m2, seen_m2 }
}
