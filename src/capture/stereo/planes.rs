//! A plane for each cell of a hole, passed on from neighbor to neighbor.

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

/// Rounds of passing planes on, each to one half of the cells and then to the other. assumed; faster
/// narrowing steps changed no figure of one made object.
const ROUNDS: usize = 4;
/// Neighbors with planes tried by a cell: beside it, and further off (Galliani 2015).
const NEIGHBORS: [(i32, i32); 8] = [(-1, 0), (1, 0), (0, -1), (0, 1), (-5, 0), (5, 0), (0, -5), (0, 5)];
/// Perturbations of a cell in a round.
const TRIES: usize = 3;
/// Largest perturbation of the first round: share of the inverse depth, and of it across a ray's unit.
/// chosen: a wide first search
const SPREAD: (f64, f64) = (0.02, 0.5);
/// Cells on each side for the slope of read depth.
const SLOPE: usize = 2;

/// Planes `n . x = 1` of a view's cells in its optical frame, 1/m; `cost` says how unlike other views look.
pub(super) struct Planes {
    pub at: Vec<Vector3<f32>>,
    pub cost: Vec<f32>,
}

/// The best confirmed planes of a view's holes.
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
            // Cells of one color read those of the other alone: any number of threads gives the same.
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

/// The best of a cell's plane, its neighbors' and some about them.
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

/// A plane turned and moved along the ray, by less from round to round.
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
    // The turn alone would move the plane along the ray.
    next.z += inverse * (1.0 + draw(SPREAD.0)) - next.dot(ray);
    next
}

/// Planes of the read depth, and in holes those of the nearest reading on the object.
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
    // Breadth first: nearest first.
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

/// Inverse depth read at a cell, 1/meter.
fn inverse_depth(view: &Cells, x: usize, y: usize) -> Option<f32> {
    let depth_m = *view.depth_m.get(y * view.camera.width + x)?;
    (x < view.camera.width && depth_m > 0.0).then(|| 1.0 / depth_m)
}

/// Slope between the readings on both sides, or beside the hole on one.
fn slope_at(before: Option<f32>, here: f32, after: Option<f32>) -> Option<f32> {
    match (before, after) {
        (Some(a), Some(b)) => Some((b - a) / (2 * SLOPE) as f32),
        (Some(a), None) => Some((here - a) / SLOPE as f32),
        (None, Some(b)) => Some((b - here) / SLOPE as f32),
        (None, None) => None,
    }
}

/// The plane of the depth read about a cell.
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
