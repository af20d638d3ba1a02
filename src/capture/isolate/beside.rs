//! Things that stand beside the object on the same floor or before the same wall.
//!
//! Readings just off a plane, as of a rug or of errors that many pixels share, link what stands on it. So the
//! object is what hangs together farther from the planes, and of what is near them only what lies about it.

use super::{
    background::Background,
    change::BY_CHANCE,
    claim::frame_of_cells,
    select::{ALSO, bounds},
    voxels::{Cell, CellSet, center_of_cell, groups},
};
use common::stop::{Stop, Stopped};

/// Height over a plane up to which readings link nothing, meters and cells.
/// chosen: a rug and the errors of a floor in a usual room
const LINKS_NOTHING_M: f64 = 0.03;
const LINKS_NOTHING: f64 = 3.0;

/// The cells of the object without those that it is linked with only along a background plane. Where no more
/// changed than chance explains, nothing says which of them the object is, and all are kept.
pub(super) fn without_things_beside(
    cells: Vec<Cell>,
    changed: &CellSet,
    background: &Background<'_>,
    reach: i32,
    size_m: f64,
    stop: &Stop,
) -> Result<Vec<Cell>, Stopped> {
    let changed_of = |piece: &[Cell]| piece.iter().filter(|c| changed.contains(*c)).count() as f64;
    let all = changed_of(&cells);
    if all <= BY_CHANCE * cells.len() as f64 {
        return Ok(cells);
    }
    let near_m = LINKS_NOTHING_M.max(LINKS_NOTHING * size_m);
    let (near, far): (Vec<Cell>, Vec<Cell>) =
        cells.iter().partition(|c| background.is_near_plane(&center_of_cell(c, size_m), near_m));
    let pieces = groups(&far, reach, stop)?;
    let most = pieces.iter().map(|p| changed_of(p)).fold(0.0, f64::max);
    // What lies flat has too little above.
    if 2.0 * most < all {
        return Ok(cells);
    }
    let moved: Vec<&Vec<Cell>> = pieces.iter().filter(|p| changed_of(p) > ALSO * most).collect();
    let (lower, upper) = bounds(moved.iter().copied().flatten());
    let is_inside = |c: &Cell| (0..3).all(|k| c[k] >= lower[k] - reach && c[k] <= upper[k] + reach);
    let mut kept: Vec<Cell> = Vec::new();
    for piece in &pieces {
        if changed_of(piece) > ALSO * most || piece.iter().all(is_inside) {
            kept.extend(piece);
        }
    }
    let [lower, upper] = frame_of_cells(lower, upper);
    kept.extend(near.into_iter().filter(|c| (0..3).all(|k| c[k] >= lower[k] && c[k] <= upper[k])));
    kept.sort_unstable();
    Ok(kept)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CaptureConfig, NoiseConfig};

    /// A block of 20 x 20 x 20 cells from this one along x.
    fn block(x: i32) -> impl Iterator<Item = Cell> {
        (0..8000).map(move |i| [x + i % 20, i / 20 % 20, i / 400])
    }

    #[test]
    fn what_changed_by_chance_chooses_nothing() {
        let config = CaptureConfig::default();
        let background = Background { planes: Vec::new(), config: &config, noise: NoiseConfig::default() };
        let cells: Vec<Cell> = block(0).chain(block(100)).collect();
        let kept = |count: usize| {
            let changed: CellSet = block(100).take(count).collect();
            let stop = Stop::never();
            without_things_beside(cells.clone(), &changed, &background, 2, 0.002, &stop).unwrap().len()
        };
        assert_eq!([kept(8), kept(9)], [16_000, 8000]);
    }
}
