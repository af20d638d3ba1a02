//! Covers a surface with few convex solids: cells are cut in two where a cut removes most of the error, then
//! the pair whose union adds the least error is joined until there are few enough.

use std::sync::Arc;

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use rayon::prelude::*;

use super::{
    ConvexSolid, Plane,
    fit::{Fit, distance_error},
    pieces::{Piece, SeenSurface},
    sample_columns::SampleColumns,
};

/// Number of a cell's faces along which cuts are tried, those with the most error.
const CUT_FACES: usize = 12;
/// Shares of a cell's surface at which cuts across its axes are tried. chosen: quarters
const CUT_SHARES: [f64; 3] = [0.25, 0.5, 0.75];
/// Share of a cell's error that later cuts may remove where the first one removes less. tuned: made and
/// recorded objects (docs/method.md 16)
const HOPE: f64 = 0.1;
/// Surface along a cut and this near it, in tolerances, is not cut: the difference is noise. tuned: made and
/// recorded objects (docs/method.md 16)
const SLACK: f64 = 1.5;
/// A solid must remove the error of at least this share of the surface. tuned: made and recorded objects
/// (docs/method.md 16)
const WORTH: f64 = 1e-3;
/// Number of samples for ranking a cell's cutting planes, and about that for the error of a solid in front of
/// surface outside its cell.
const RANKED: usize = 400;
const FOREIGN: usize = 1000;
/// Cells made for each kept cell: some cuts only help others and are joined again.
const SPARE: usize = 2;

/// Requirements of a cover.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted {
    /// Most solids.
    pub solids: usize,
    /// Tolerated stand-off, meters.
    pub tolerance_m: f64,
    /// Thickness of a wall, meters: the error of surface without a solid.
    pub thin_m: f64,
    /// Thickness of a wall, meters: the error where a surface has none.
    pub wall_m: f64,
}

/// Some pieces of the surface, the solid around them and its error.
struct CoverCell {
    pieces: Vec<Arc<Piece>>,
    samples: Vec<u32>,
    fit: Fit,
    /// Error integrated over the area, square meters.
    loss: f64,
}

/// Convex solids around the pieces of a surface, those with the most surface first.
pub(super) fn covering_solids(seen: &SeenSurface, wanted: &Wanted) -> Vec<ConvexSolid> {
    if seen.samples.is_empty() {
        return Vec::new();
    }
    let cover = Cover { seen, wanted: *wanted, frame: square_directions(seen) };
    let pieces = seen.pieces.iter().map(|p| Arc::new(p.clone())).collect();
    let whole = cover.cell_of_samples(pieces, (0..seen.samples.len() as u32).collect(), 1);
    let mut cells = cover.joined_cells(cover.cut_up(whole));
    let area = |c: &CoverCell| c.samples.iter().map(|&i| seen.samples[i as usize].area_m2).sum::<f64>();
    cells.sort_by(|a, b| area(b).total_cmp(&area(a)));
    cells.iter().filter_map(|c| c.fit.solid(0.25 * wanted.tolerance_m, wanted.thin_m)).collect()
}

struct Cover<'a> {
    seen: &'a SeenSurface,
    wanted: Wanted,
    frame: Vec<Vector3<f64>>,
}

/// Two halves of a cell, and the error that the cut removes.
struct Cut {
    gain: f64,
    halves: [CoverCell; 2],
}

impl Cover<'_> {
    /// The cell of some pieces and samples; its solid and error are computed from every `step`-th sample and,
    /// with `step` above one, from some of the pieces.
    fn cell_of_samples(&self, pieces: Vec<Arc<Piece>>, samples: Vec<u32>, step: usize) -> CoverCell {
        let of = self.sample_columns(samples.iter().step_by(step).copied());
        let tolerance_m = self.wanted.tolerance_m;
        let sizes = [tolerance_m, self.wanted.thin_m];
        let some = if step > 1 { (pieces.len() / RANKED).max(1) } else { 1 };
        let around = pieces.iter().step_by(some).map(AsRef::as_ref);
        let fit = Fit::new(self.seen, around, &of, &self.frame, sizes);
        let own: f64 = fit.weighed_errors(&of, tolerance_m).iter().sum();
        let loss = own * step as f64 + self.error_before_others(&fit, &samples);
        CoverCell { pieces, samples, fit, loss }
    }

    fn sample_columns(&self, samples: impl Iterator<Item = u32>) -> SampleColumns {
        SampleColumns::of_samples(samples.map(|i| &self.seen.samples[i as usize]))
    }

    /// The error of a solid in front of the samples of other cells, estimated from some of them; `own` are
    /// its samples, sorted.
    fn error_before_others(&self, fit: &Fit, own: &[u32]) -> f64 {
        let count = self.seen.samples.len();
        let step = count.div_ceil(FOREIGN).max(1);
        let foreign = (0..count as u32)
            .step_by(step)
            .filter(|i| fit.holds(&self.seen.samples[*i as usize].place) && own.binary_search(i).is_err());
        let foreign = self.sample_columns(foreign);
        fit.weighed_errors(&foreign, self.wanted.tolerance_m).iter().sum::<f64>() * step as f64
    }

    /// Cuts cells where it helps most, until no cut is worth a solid or there are enough cells to join.
    fn cut_up(&self, whole: CoverCell) -> Vec<CoverCell> {
        let least = WORTH * self.seen.area_m2;
        let mut done = Vec::new();
        let mut open: Vec<(CoverCell, Cut)> = Vec::new();
        let mut fresh = vec![whole];
        while done.len() + open.len() + fresh.len() < SPARE * self.wanted.solids || !fresh.is_empty() {
            let cuts: Vec<_> = fresh.par_iter().map(|cell| self.best_cut(cell)).collect();
            for (cell, cut) in fresh.drain(..).zip(cuts) {
                match cut.filter(|cut| cut.gain.max(HOPE * cell.loss) > least) {
                    Some(cut) => open.push((cell, cut)),
                    None => done.push(cell),
                }
            }
            if done.len() + open.len() >= SPARE * self.wanted.solids {
                break;
            }
            // It may take more than one cut to remove a large error.
            let hopes: Vec<f64> = open.iter().map(|(cell, cut)| cut.gain.max(HOPE * cell.loss)).collect();
            let most = (0..open.len()).max_by(|&a, &b| hopes[a].total_cmp(&hopes[b]).then(b.cmp(&a)));
            let Some(i) = most else { break };
            fresh.extend(open.remove(i).1.halves);
        }
        done.extend(open.into_iter().map(|(cell, _)| cell));
        done
    }

    /// The cut of a cell with the most gain.
    fn best_cut(&self, cell: &CoverCell) -> Option<Cut> {
        if cell.loss <= WORTH * self.seen.area_m2 {
            return None;
        }
        // All planes are ranked by some of the samples, the best by all.
        let step = (cell.samples.len() / RANKED).max(1);
        let halves: Vec<Option<[CoverCell; 2]>> =
            self.cutting_planes(cell).par_iter().map(|plane| self.halves_at(cell, plane, step)).collect();
        let loss = |h: &[CoverCell; 2]| h[0].loss + h[1].loss;
        let best = halves.into_iter().flatten().min_by(|a, b| loss(a).total_cmp(&loss(b)))?;
        let whole = |h: CoverCell| if step > 1 { self.cell_of_samples(h.pieces, h.samples, 1) } else { h };
        let [left, right] = best;
        let halves: [CoverCell; 2] = rayon::join(|| whole(left), || whole(right)).into();
        Some(Cut { gain: cell.loss - loss(&halves), halves })
    }

    /// Planes for cuts of a cell: along its faces with the most error, and across its axes.
    fn cutting_planes(&self, cell: &CoverCell) -> Vec<Plane> {
        let mut by_face: Vec<(u32, f64, f64, u32)> = Vec::new();
        let samples = self.sample_columns(cell.samples.iter().copied());
        let distances = samples.distances_m(&cell.fit.planes);
        let faces = samples.faces.iter().zip(&samples.areas_m2);
        for ((&i, distance_m), (&face, area_m2)) in cell.samples.iter().zip(distances).zip(faces) {
            let off = distance_error(distance_m, self.wanted.tolerance_m);
            match by_face.iter_mut().find(|f| f.0 == face) {
                Some(f) => {
                    f.1 += area_m2 * off;
                    if off > f.2 {
                        (f.2, f.3) = (off, i);
                    }
                }
                None => by_face.push((face, area_m2 * off, off, i)),
            }
        }
        by_face.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let along = by_face.iter().take(CUT_FACES).map(|f| {
            let normal = self.seen.faces[f.0 as usize];
            Plane { normal, offset_m: normal.dot(&self.seen.samples[f.3 as usize].place) }
        });
        let mut planes: Vec<Plane> = along.collect();
        let axes = self.frame.iter().step_by(2).copied().chain(self.principal_axes(cell));
        for axis in axes {
            let mut heights: Vec<(f64, f64)> = cell
                .samples
                .iter()
                .map(|&i| &self.seen.samples[i as usize])
                .map(|s| (axis.dot(&s.place), s.area_m2))
                .collect();
            heights.sort_by(|a, b| a.0.total_cmp(&b.0));
            let total: f64 = heights.iter().map(|h| h.1).sum();
            for share in CUT_SHARES {
                let mut below = 0.0;
                let at = heights.iter().find(|h| {
                    below += h.1;
                    below >= share * total
                });
                planes.extend(at.map(|h| Plane { normal: axis, offset_m: h.0 }));
            }
        }
        planes
    }

    fn principal_axes(&self, cell: &CoverCell) -> [Vector3<f64>; 3] {
        let of = || cell.samples.iter().map(|&i| &self.seen.samples[i as usize]);
        let area: f64 = of().map(|s| s.area_m2).sum();
        let middle = of().map(|s| s.place * s.area_m2).sum::<Vector3<f64>>() / area.max(f64::MIN_POSITIVE);
        let spread = of()
            .map(|s| (s.place - middle) * (s.place - middle).transpose() * s.area_m2)
            .sum::<Matrix3<f64>>();
        let vectors = SymmetricEigen::new(spread).eigenvectors;
        [0, 1, 2].map(|k| vectors.column(k).into_owned())
    }

    /// The two halves of a cell; `None` where one would be empty.
    fn halves_at(&self, cell: &CoverCell, plane: &Plane, step: usize) -> Option<[CoverCell; 2]> {
        let slack_m = SLACK * self.wanted.tolerance_m;
        let mut pieces = [Vec::new(), Vec::new()];
        for piece in &cell.pieces {
            match piece.cut_at(plane, slack_m) {
                [Some(_), None] => pieces[0].push(Arc::clone(piece)),
                [None, Some(_)] => pieces[1].push(Arc::clone(piece)),
                halves => {
                    for (side, half) in pieces.iter_mut().zip(halves) {
                        side.extend(half.map(Arc::new));
                    }
                }
            }
        }
        let (back, front): (Vec<u32>, Vec<u32>) =
            cell.samples.iter().partition(|&&i| self.seen.samples[i as usize].is_behind(plane, slack_m));
        let [behind, before] = pieces;
        if behind.is_empty() || before.is_empty() || back.is_empty() || front.is_empty() {
            return None;
        }
        Some([self.cell_of_samples(behind, back, step), self.cell_of_samples(before, front, step)])
    }

    /// Joins cells, the pair whose union adds the least error first, while there are too many or the pair
    /// adds no more than a solid is worth. A cell may be left out instead where this costs least.
    fn joined_cells(&self, cells: Vec<CoverCell>) -> Vec<CoverCell> {
        let free = WORTH * self.seen.area_m2;
        let mut cells: Vec<Option<CoverCell>> = cells.into_iter().map(Some).collect();
        let mut count = cells.len();
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        let near: Vec<(usize, usize)> =
            (0..cells.len()).flat_map(|a| (a + 1..count).map(move |b| (a, b))).collect();
        pairs.extend(self.added_errors(&cells, near));
        loop {
            pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)).then(b.2.cmp(&a.2)));
            let pair = pairs.last().copied();
            let (drop_cost, dropped) = self.cheapest_to_drop(&cells);
            if count > self.wanted.solids && pair.is_none_or(|p| drop_cost < p.0) {
                cells[dropped] = None;
                count -= 1;
                pairs.retain(|p| p.1 != dropped && p.2 != dropped);
                continue;
            }
            let Some((_, a, b)) = pair.filter(|p| p.0 <= free || count > self.wanted.solids) else {
                break;
            };
            let (Some(left), Some(right)) = (cells[a].take(), cells[b].take()) else { break };
            pairs.retain(|p| ![p.1, p.2].iter().any(|i| [a, b].contains(i)));
            cells.push(Some(self.united_cell(&left, &right)));
            count -= 1;
            let new = cells.len() - 1;
            pairs.extend(self.added_errors(&cells, (0..new).map(|i| (i, new)).collect()));
        }
        cells.into_iter().flatten().collect()
    }

    fn united_cell(&self, a: &CoverCell, b: &CoverCell) -> CoverCell {
        let pieces = a.pieces.iter().chain(&b.pieces).cloned().collect();
        let mut samples: Vec<u32> = a.samples.iter().chain(&b.samples).copied().collect();
        samples.sort_unstable();
        self.cell_of_samples(pieces, samples, 1)
    }

    /// Error added by joining each pair of neighboring cells, with the pair.
    fn added_errors(
        &self,
        cells: &[Option<CoverCell>],
        pairs: Vec<(usize, usize)>,
    ) -> Vec<(f64, usize, usize)> {
        let near_pairs = pairs.into_par_iter().filter_map(|(a, b)| {
            let left = cells[a].as_ref()?;
            let right = cells[b].as_ref()?;
            are_near(left, right, self.wanted.wall_m).then_some(())?;
            Some((self.united_cell(left, right).loss - left.loss - right.loss, a, b))
        });
        near_pairs.collect()
    }

    /// The cost and index of the cell whose removal costs least.
    fn cheapest_to_drop(&self, cells: &[Option<CoverCell>]) -> (f64, usize) {
        let nothing = distance_error(2.0 * self.wanted.wall_m, self.wanted.tolerance_m);
        let mut costs = Vec::with_capacity(cells.len());
        for (i, cell) in cells.iter().enumerate() {
            if let Some(cell) = cell {
                let areas_m2 = cell.samples.iter().map(|&i| self.seen.samples[i as usize].area_m2);
                costs.push((areas_m2.sum::<f64>() * nothing - cell.loss, i));
            }
        }
        let cheapest = costs.into_iter().min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        cheapest.unwrap_or((f64::INFINITY, 0))
    }
}

/// Whether no face of either cell's solid separates them by more than a gap.
fn are_near(a: &CoverCell, b: &CoverCell, gap_m: f64) -> bool {
    !is_apart(&a.fit, b, gap_m) && !is_apart(&b.fit, a, gap_m)
}

/// Whether all pieces of a cell lie more than a gap in front of one plane of another's solid.
fn is_apart(fit: &Fit, other: &CoverCell, gap_m: f64) -> bool {
    fit.planes.iter().any(|p| other.pieces.iter().all(|piece| lowest_m(piece, p) > p.offset_m + gap_m))
}

/// Lowest height of a piece along a plane's normal, meters.
fn lowest_m(piece: &Piece, plane: &Plane) -> f64 {
    piece.front.iter().map(|v| plane.normal.dot(v)).fold(f64::INFINITY, f64::min)
        + plane.normal.dot(&piece.back).min(0.0)
}

/// Both directions of three orthogonal axes: the normal with the most area, that with the most area
/// perpendicular to it, and their cross product.
fn square_directions(seen: &SeenSurface) -> Vec<Vector3<f64>> {
    let mut areas = vec![0.0; seen.faces.len()];
    seen.samples.iter().for_each(|s| areas[s.face as usize] += s.area_m2);
    let mut axes: Vec<Vector3<f64>> = Vec::new();
    for _ in 0..2 {
        let across = |n: &Vector3<f64>| axes.iter().fold(*n, |n, a| n - a * a.dot(&n));
        let best = (0..areas.len()).max_by(|&i, &j| {
            let [a, b] = [i, j].map(|k| areas[k] * across(&seen.faces[k]).norm_squared());
            a.total_cmp(&b).then(j.cmp(&i))
        });
        let direction = best.and_then(|k| across(&seen.faces[k]).try_normalize(1e-6));
        axes.extend(
            direction
                .or_else(|| [Vector3::x(), Vector3::y()].iter().find_map(|d| across(d).try_normalize(0.5))),
        );
    }
    if let [x, y] = axes[..] {
        axes.push(x.cross(&y));
    }
    axes.iter().flat_map(|a| [*a, -a]).collect()
}
