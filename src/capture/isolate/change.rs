//! Changes between states, and within the frames of a state.
//!
//! A frame with depth well behind a cell looks through it; one with depth near the cell sees it. A cell that
//! frames of another state look through has changed: the object moved, or something else did. A cell that
//! more frames of its own state look through than see was in motion, such as a hand or a person.

use nalgebra::Point3;
use rayon::prelude::*;

use super::voxels::{Cell, CellSet, center_of_cell, frames_needed, groups};
use crate::{NoiseConfig, RgbdFrame, poses::pose_noise::PoseNoise};
use common::stop::{Stop, Stopped};

/// Distance of a reading from a cell at which the cell is looked through, standard deviations.
/// chosen: two frames look through a cell at rest as seldom as `BY_CHANCE` says
const GATE_SIGMAS: f64 = 2.0;
/// Share of cells that two frames look through by chance.
/// derived: the square of a normal distribution's share beyond `GATE_SIGMAS` on one side
pub const BY_CHANCE: f64 = 5.2e-4;
/// A cell has changed if this many times as many frames look through it as see it.
/// derived: readings at depth edges see and look through about equally often
pub const CLEARLY: usize = 4;
/// Fewest changed cells in a connected patch.
/// derived: three by three, less one; false changes along an edge can be as many, so counts are compared too
pub const LEAST_PATCH: usize = 8;

/// Number of frames that see a cell, and that look through it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Sight {
    there: usize,
    through: usize,
}

/// Cells of each state at rest: its own frames see them at least as often as they look through them.
pub fn at_rest(
    cells: &[Vec<Cell>],
    states: &[Vec<RgbdFrame>],
    size_m: f64,
    noise: &NoiseConfig,
    stop: &Stop,
) -> Result<Vec<Vec<Cell>>, Stopped> {
    let mut at_rest = Vec::with_capacity(states.len());
    for (cells, frames) in cells.iter().zip(states) {
        at_rest.push(filtered(cells, |c| is_at_rest(c, frames, size_m, noise), stop)?);
    }
    Ok(at_rest)
}

/// Whether the frames of its own state see a cell at least as often as they look through it.
fn is_at_rest(cell: &Cell, frames: &[RgbdFrame], size_m: f64, noise: &NoiseConfig) -> bool {
    let sight = sight_of_point(&center_of_cell(cell, size_m), frames, size_m, noise);
    sight.through < frames_needed(frames.len()) || sight.through <= sight.there
}

/// Cells of all states that frames of another state look through, in patches.
pub fn changed_cells(
    cells: &[Vec<Cell>],
    states: &[Vec<RgbdFrame>],
    size_m: f64,
    noise: &NoiseConfig,
    stop: &Stop,
) -> Result<CellSet, Stopped> {
    let mut changed = CellSet::default();
    for (own, cells) in cells.iter().enumerate() {
        let is_gone = |c: &Cell| is_gone_elsewhere(c, own, states, size_m, noise);
        let patches = groups(&filtered(cells, is_gone, stop)?, 1, stop)?;
        changed.extend(patches.into_iter().filter(|patch| patch.len() >= LEAST_PATCH).flatten());
    }
    Ok(changed)
}

/// Whether a state other than `own` looks through a cell.
pub fn is_gone_elsewhere(
    cell: &Cell,
    own: usize,
    states: &[Vec<RgbdFrame>],
    size_m: f64,
    noise: &NoiseConfig,
) -> bool {
    let point = center_of_cell(cell, size_m);
    let mut others = (0..states.len()).filter(|other| *other != own);
    others.any(|other| is_looked_through(&point, &states[other], size_m, noise))
}

/// Whether enough frames of a state look through a cell.
fn is_looked_through(point: &Point3<f64>, frames: &[RgbdFrame], size_m: f64, noise: &NoiseConfig) -> bool {
    let sight = sight_of_point(point, frames, size_m, noise);
    sight.through >= frames_needed(frames.len()) && sight.through >= CLEARLY * sight.there
}

/// Cells that pass a test, in order.
pub fn filtered(
    cells: &[Cell],
    is_kept: impl Fn(&Cell) -> bool + Sync,
    stop: &Stop,
) -> Result<Vec<Cell>, Stopped> {
    let tested: Vec<Option<Cell>> = cells
        .par_iter()
        .map(|c| {
            stop.check()?;
            Ok(is_kept(c).then_some(*c))
        })
        .collect::<Result<_, Stopped>>()?;
    Ok(tested.into_iter().flatten().collect())
}

/// Counts the frames that see a point and that look through it.
fn sight_of_point(point: &Point3<f64>, frames: &[RgbdFrame], size_m: f64, noise: &NoiseConfig) -> Sight {
    frames.iter().fold(Sight::default(), |sight, frame| match is_behind(point, frame, size_m, noise) {
        Some(true) => Sight { through: sight.through + 1, ..sight },
        Some(false) => Sight { there: sight.there + 1, ..sight },
        None => sight,
    })
}

/// `true` if all readings around a point's pixel are behind it, `false` if one is at its depth; `None` where
/// it is occluded or nothing was read.
fn is_behind(point: &Point3<f64>, frame: &RgbdFrame, size_m: f64, noise: &NoiseConfig) -> Option<bool> {
    let k = &frame.intrinsics;
    let seen = frame.in_camera(point);
    let (u, v) = k.project(&seen)?;
    let x = u.round();
    let y = v.round();
    let is_inside = x >= 1.0 && y >= 1.0 && x + 2.0 <= k.width as f64 && y + 2.0 <= k.height as f64;
    if !is_inside {
        return None;
    }
    let at = y as usize * k.width + x as usize;
    // Half a cell's diagonal, the noise, and pose errors.
    let gate_m = (GATE_SIGMAS * noise.sigma_m(seen.z))
        .hypot(0.5 * 3f64.sqrt() * size_m)
        .hypot(PoseNoise::EXPECTED.displacement_m(seen.z));
    let mut nearest_m = f64::INFINITY;
    let mut is_there = false;
    let mut unknown = 0;
    for row in [at - k.width, at, at + k.width] {
        for &depth_m in &frame.depth_m[row - 1..=row + 1] {
            if depth_m <= 0.0 {
                unknown += 1;
                continue;
            }
            let beyond_m = f64::from(depth_m) - seen.z;
            nearest_m = nearest_m.min(beyond_m);
            is_there |= beyond_m.abs() <= gate_m;
        }
    }
    match () {
        () if is_there => Some(false),
        // Where readings are missing, they might be of the point's surface.
        () if nearest_m > gate_m && unknown == 0 => Some(true),
        () => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Intrinsics, Pose};

    const SIZE_M: f64 = 0.01;

    /// A wall at 1 m with, or without, a plate of 0.1 m at 0.8 m; seen from several places.
    fn frames(plate: &[bool]) -> Vec<RgbdFrame> {
        let k = Intrinsics { width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5 };
        let frame = |(i, has_plate): (usize, &bool)| {
            let eye = Pose::translation(0.01 * i as f64, 0.0, 0.0);
            let depth_m = (0..k.width * k.height).map(|p| {
                let ray = k.ray_at((p % k.width) as f64, (p / k.width) as f64);
                let on_plate = eye * Point3::from(ray * 0.8);
                let is_on = *has_plate && on_plate.x.abs() < 0.05 && on_plate.y.abs() < 0.05;
                if is_on { 0.8 } else { 1.0 }
            });
            RgbdFrame {
                id: String::new(),
                stamp_nanos: 0,
                intrinsics: k,
                world_from_camera: eye,
                rgb: Vec::new(),
                depth_m: depth_m.collect(),
                mask: None,
                readings: Vec::new(),
            }
        };
        plate.iter().enumerate().map(frame).collect()
    }

    fn plate_cells() -> Vec<Cell> {
        (-4..4).flat_map(|x| (-4..4).map(move |y| [x, y, 79])).collect()
    }

    #[test]
    fn what_left_has_changed_and_what_stays_has_not() {
        let noise = NoiseConfig::default();
        let cells = [plate_cells(), Vec::new()];
        let gone = [frames(&[true; 6]), frames(&[false; 6])];
        let found = changed_cells(&cells, &gone, SIZE_M, &noise, &Stop::never()).unwrap();
        assert!(found.len() > 30, "{}", found.len());
        let stays = [frames(&[true; 6]), frames(&[true; 6])];
        assert!(changed_cells(&cells, &stays, SIZE_M, &noise, &Stop::never()).unwrap().is_empty());
        // What the other state did not read says nothing.
        let mut dark = gone;
        dark[1].iter_mut().for_each(|f| f.depth_m.fill(0.0));
        assert!(changed_cells(&cells, &dark, SIZE_M, &noise, &Stop::never()).unwrap().is_empty());
    }

    #[test]
    fn what_is_in_two_frames_of_six_is_on_its_way() {
        let noise = NoiseConfig::default();
        let count = |plate: &[bool]| {
            let cells = at_rest(&[plate_cells()], &[frames(plate)], SIZE_M, &noise, &Stop::never());
            cells.unwrap()[0].len()
        };
        assert_eq!(count(&[true; 6]), 64);
        assert!(count(&[true, true, false, false, false, false]) < 16);
    }
}
