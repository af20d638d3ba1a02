//! Search for a plane in each cell of a hole, by propagation between neighbors.

use std::collections::VecDeque;

use nalgebra::Vector3;
use rand_core::Rng;
use rayon::prelude::*;

use super::{
    cells::Cells,
    likeness::{Eye, Patch, UNKNOWN},
};
use common::stop::{Stop, Stopped};
use numeric::random::{self, stage_rng};

/// Rounds of propagation, each over both halves of a checkerboard. chosen: faster narrowing changed no result
/// on a synthetic object
const ROUNDS: usize = 4;
/// Offsets of the neighbors with planes to try: adjacent and distant ones (Galliani 2015).
const NEIGHBORS: [(i32, i32); 8] = [(-1, 0), (1, 0), (0, -1), (0, 1), (-5, 0), (5, 0), (0, -5), (0, 5)];
/// Perturbations per cell and round.
const TRIES: usize = 3;
/// Largest perturbation in the first round: relative to the inverse depth, and per unit across the ray.
/// chosen: a wide first search
const SPREAD: (f64, f64) = (0.02, 0.5);
/// Reach in cells for the slope of measured depth.
const SLOPE: usize = 2;

/// Planes `n . x = 1` of a view's cells in its optical frame, 1/m; `cost` is the photo-consistency cost.
pub(super) struct Planes {
    pub at: Vec<Vector3<f32>>,
    pub cost: Vec<f32>,
}

/// The best planes in a view's holes.
pub(super) fn propagated_planes(
    view: &Cells,
    eyes: &[Eye<'_>],
    seed: u64,
    stop: &Stop,
) -> Result<Planes, Stopped> {
    stop.check()?;
    let mut planes = extended_planes(view);
    let width = view.camera.width;
    let holes: Vec<usize> = (0..view.hole.len()).filter(|&c| view.hole[c]).collect();
    let patches: Vec<Option<Patch>> = holes.par_iter().map(|&cell| Patch::about_cell(view, cell)).collect();
    let costs: Vec<f32> = holes
        .par_iter()
        .zip(&patches)
        .map(|(&cell, patch)| {
            stop.check()?;
            Ok(patch.as_ref().map_or(UNKNOWN, |p| p.plane_cost(&planes.at[cell], eyes)))
        })
        .collect::<Result<_, Stopped>>()?;
    holes.iter().zip(costs).for_each(|(&cell, cost)| planes.cost[cell] = cost);
    for round in 0..ROUNDS {
        for half in 0..2 {
            // Cells of one color read only those of the other, so the result does not depend on the number of
            // threads.
            let better: Vec<Option<(Vector3<f32>, f32)>> = holes
                .par_iter()
                .zip(&patches)
                .map(|(&cell, patch)| {
                    stop.check()?;
                    let is_due = (cell % width + cell / width) % 2 == half;
                    let Some(patch) = patch.as_ref().filter(|_| is_due) else { return Ok(None) };
                    let step = (round * 2 + half) * view.hole.len() + cell;
                    let rng = &mut stage_rng(seed, "capture/stereo", step as u64);
                    Ok(Some(best_plane_of_cell(view, cell, &planes, patch, eyes, round, rng)))
                })
                .collect::<Result<_, Stopped>>()?;
            for (&cell, better) in holes.iter().zip(better) {
                if let Some((plane, cost)) = better {
                    (planes.at[cell], planes.cost[cell]) = (plane, cost);
                }
            }
        }
    }
    Ok(planes)
}

/// The best among a cell's plane, its neighbors' planes and perturbations.
fn best_plane_of_cell(
    view: &Cells,
    cell: usize,
    planes: &Planes,
    patch: &Patch<'_>,
    eyes: &[Eye<'_>],
    round: usize,
    rng: &mut impl Rng,
) -> (Vector3<f32>, f32) {
    let w = view.camera.width as i32;
    let h = view.camera.height as i32;
    let x = cell as i32 % w;
    let y = cell as i32 / w;
    let neighbors = NEIGHBORS.iter().map(|(dx, dy)| (x + dx, y + dy));
    let inside = neighbors.filter(|(x, y)| (0..w).contains(x) && (0..h).contains(y));
    let passed_on = inside.map(|(x, y)| planes.at[(y * w + x) as usize]).filter(|p| *p != Vector3::zeros());
    let mut best = planes.at[cell];
    let mut least = planes.cost[cell];
    for plane in passed_on {
        let cost = patch.plane_cost(&plane, eyes);
        if cost < least {
            (best, least) = (plane, cost);
        }
    }
    let ray = view.ray_of_cell(cell);
    for _ in 0..TRIES {
        let plane = perturbed_plane(&best, &ray, round, rng);
        let cost = patch.plane_cost(&plane, eyes);
        if cost < least {
            (best, least) = (plane, cost);
        }
    }
    (best, least)
}

/// A plane rotated and moved along the ray, by less in later rounds.
fn perturbed_plane(
    plane: &Vector3<f32>,
    ray: &Vector3<f32>,
    round: usize,
    rng: &mut impl Rng,
) -> Vector3<f32> {
    let scale = 0.5f64.powi(round as i32);
    let inverse = plane.dot(ray);
    let mut draw = |size: f64| (size * scale * random::uniform_in(rng, -1.0, 1.0)) as f32;
    let mut next = plane + Vector3::new(draw(SPREAD.1) * inverse, draw(SPREAD.1) * inverse, 0.0);
    // The rotation alone would move the plane along the ray.
    next.z += inverse * (1.0 + draw(SPREAD.0)) - next.dot(ray);
    next
}

/// Planes of the measured depth; cells in holes take the plane of the nearest reading on the object.
fn extended_planes(view: &Cells) -> Planes {
    let count = view.hole.len();
    let mut planes = Planes { at: vec![Vector3::zeros(); count], cost: vec![UNKNOWN; count] };
    let mut front = VecDeque::new();
    for cell in 0..count {
        if let Some(plane) = plane_of_readings(view, cell).filter(|_| view.on_object[cell]) {
            planes.at[cell] = plane;
            front.push_back(cell);
        }
    }
    let w = view.camera.width;
    let h = view.camera.height;
    // Breadth first, hence nearest first.
    while let Some(cell) = front.pop_front() {
        let x = cell % w;
        let y = cell / w;
        let beside = [
            (x > 0).then(|| cell - 1),
            (x + 1 < w).then_some(cell + 1),
            (y > 0).then(|| cell - w),
            (y + 1 < h).then_some(cell + w),
        ];
        for next in beside.into_iter().flatten().filter(|&n| view.hole[n]) {
            if planes.at[next] == Vector3::zeros() {
                planes.at[next] = planes.at[cell];
                front.push_back(next);
            }
        }
    }
    planes
}

/// Measured inverse depth of a cell, 1/meter.
fn inverse_depth(view: &Cells, x: usize, y: usize) -> Option<f32> {
    let depth_m = *view.depth_m.get(y * view.camera.width + x)?;
    (x < view.camera.width && depth_m > 0.0).then(|| 1.0 / depth_m)
}

/// Slope between the readings on both sides, or on one side next to a hole.
fn slope_at(before: Option<f32>, here: f32, after: Option<f32>) -> Option<f32> {
    match (before, after) {
        (Some(a), Some(b)) => Some((b - a) / (2 * SLOPE) as f32),
        (Some(a), None) => Some((here - a) / SLOPE as f32),
        (None, Some(b)) => Some((b - here) / SLOPE as f32),
        (None, None) => None,
    }
}

/// The plane of the depth measured around a cell.
fn plane_of_readings(view: &Cells, cell: usize) -> Option<Vector3<f32>> {
    let w = view.camera.width;
    let x = cell % w;
    let y = cell / w;
    let here = inverse_depth(view, x, y)?;
    let left = x.checked_sub(SLOPE).and_then(|x| inverse_depth(view, x, y));
    let above = y.checked_sub(SLOPE).and_then(|y| inverse_depth(view, x, y));
    let across = slope_at(left, here, inverse_depth(view, x + SLOPE, y))?;
    let down = slope_at(above, here, inverse_depth(view, x, y + SLOPE))?;
    let nx = across * view.camera.fx as f32;
    let ny = down * view.camera.fy as f32;
    let ray = view.ray_of_cell(cell);
    Some(Vector3::new(nx, ny, here - nx * ray.x - ny * ray.y))
}
