//! The object told from its surroundings: a mask for every frame.
//!
//! With masks that came with the recording, only depth readings that belong to nothing are forgotten. Without, what is
//! left after the background planes (or what lies in a given box) is gathered in cells of space over both states,
//! grouped, and the group that the cameras look at is the object. A pixel is part of the mask if its point lies in the
//! group; where the depth is unknown or too close to the support to tell, it is part of the mask but has no depth, so
//! that it speaks neither for the object nor for empty space.

mod outliers;
mod plane;
mod select;
mod support;
mod voxels;

use std::collections::HashSet;

use nalgebra::Point3;
use rand_core::Rng;
use rayon::prelude::*;

use self::{
    outliers::outlier_cells,
    plane::{Plane, background_planes},
    select::choose_object,
    support::find_support,
    voxels::{Cell, cell, center, dilated, supported},
};
use super::{Capture, CaptureConfig, CaptureError, NoiseConfig, RgbdFrame, common_focus, pixel_weights};

/// Fewest pixels with depth on the object in a state.
const MIN_PIXELS: usize = 200;
/// Least share of the smaller state's cells that the states must have in common.
const MIN_OVERLAP: f64 = 0.02;

/// Gives every frame its mask.
///
/// # Errors
/// [`CaptureError::Isolation`] where nothing with depth is left as the object, [`CaptureError::NoOverlap`] where the
/// states have no place in common.
pub fn isolate(capture: &mut Capture, config: &CaptureConfig, rng: &mut impl Rng) -> Result<(), CaptureError> {
    let masked = capture.states.iter().flatten().filter(|f| f.mask.is_some()).count();
    let all = capture.states.iter().flatten().count();
    if masked > 0 && masked < all {
        capture.warnings.push(format!("only {masked} of {all} frames have masks; the masks are not used"));
        capture.states.iter_mut().flatten().for_each(|f| f.mask = None);
    }
    let size_m = cell_size(capture);
    if masked == all {
        clean_masks(capture, config, size_m)?;
    } else {
        find_object(capture, config, size_m, rng)?;
    }
    check(capture, size_m)
}

/// Cell size: two standard deviations of the depth noise, or two pixels, at the median depth.
fn cell_size(capture: &Capture) -> f64 {
    let frames = capture.states.iter().flatten();
    let object = |f: &RgbdFrame| -> Vec<f32> {
        (0..f.depth_m.len()).step_by(17).filter(|p| f.is_object(*p)).map(|p| f.depth_m[p]).filter(|d| *d > 0.0).collect()
    };
    let mut depths: Vec<f32> = frames.clone().flat_map(object).collect();
    depths.sort_unstable_by(f32::total_cmp);
    let median = depths.get(depths.len() / 2).map_or(1.0, |d| f64::from(*d));
    let pixel = frames.map(|f| median / f.intrinsics.fx).fold(0.0, f64::max);
    (2.0 * capture.noise.sigma_m(median)).max(2.0 * pixel).clamp(0.002, 0.05)
}

/// Cells that each frame sees, of the pixels that satisfy a test of pixel and world point.
fn seen(frames: &[RgbdFrame], size_m: f64, test: impl Fn(&RgbdFrame, usize, &Point3<f64>) -> bool + Sync) -> Vec<HashSet<Cell>> {
    let of_frame = |f: &RgbdFrame| {
        let points = (0..f.depth_m.len()).filter_map(|p| f.world_point(p).filter(|point| test(f, p, point)));
        points.filter_map(|point| cell(&point, size_m)).collect()
    };
    frames.par_iter().map(of_frame).collect()
}

/// Frames that must agree on a cell.
fn frames_needed(frames: &[RgbdFrame]) -> usize {
    if frames.len() >= 6 { 2 } else { 1 }
}

fn in_box(workspace: Option<[[f64; 3]; 2]>, p: &Point3<f64>) -> bool {
    workspace.is_none_or(|[lower, upper]| (0..3).all(|k| p[k] >= lower[k] && p[k] <= upper[k]))
}

/// Forgets depth under masks that stands apart, or lies outside the workspace.
fn clean_masks(capture: &mut Capture, config: &CaptureConfig, size_m: f64) -> Result<(), CaptureError> {
    let mut forgotten = 0;
    for frames in &mut capture.states {
        let cells = supported(&seen(frames, size_m, |f, p, _| f.is_object(p)), 1);
        let bad = outlier_cells(&cells, size_m);
        let workspace = config.isolate.workspace;
        let clean = |f: &mut RgbdFrame| {
            let outlier = |f: &RgbdFrame, p: usize| {
                let point = f.world_point(p).filter(|_| f.is_object(p));
                point.is_some_and(|q| !in_box(workspace, &q) || cell(&q, size_m).is_none_or(|c| bad.contains(&c)))
            };
            let pixels: Vec<usize> = (0..f.depth_m.len()).filter(|p| outlier(f, *p)).collect();
            for p in &pixels {
                f.depth_m[*p] = 0.0;
            }
            pixels.len()
        };
        forgotten += frames.par_iter_mut().map(clean).sum::<usize>();
    }
    let pixels: usize = capture.states.iter().flatten().map(|f| (0..f.depth_m.len()).filter(|p| f.is_object(*p)).count()).sum();
    capture.notes.push(format!(
        "masks of the recording are used ({pixels} pixels); {forgotten} depth readings in them stand apart and are not used"
    ));
    Ok(())
}

/// What is taken for background.
struct Background<'a> {
    planes: Vec<Plane>,
    config: &'a CaptureConfig,
    noise: NoiseConfig,
}

impl Background<'_> {
    /// The plane nearest to a point.
    fn nearest_plane(&self, point: &Point3<f64>) -> Option<usize> {
        let height = |p: &usize| self.planes[*p].height_m(point).abs();
        (0..self.planes.len()).min_by(|a, b| height(a).total_cmp(&height(b)))
    }

    /// Whether a point is above all planes by more than its noise.
    fn is_above(&self, frame: &RgbdFrame, pixel: usize, point: &Point3<f64>) -> bool {
        let k = &frame.intrinsics;
        let ray = frame.world_from_camera.rotation * k.ray((pixel % k.width) as f64, (pixel / k.width) as f64);
        let sigma = self.noise.sigma_m(f64::from(frame.depth_m[pixel]));
        let isolate = &self.config.isolate;
        self.planes.iter().all(|p| p.height_m(point) > isolate.plane_clearance_m + isolate.plane_sigmas * p.height_sigma_m(&ray, sigma))
    }
}

fn find_object(capture: &mut Capture, config: &CaptureConfig, size_m: f64, rng: &mut impl Rng) -> Result<(), CaptureError> {
    let workspace = config.isolate.workspace;
    let planes = match workspace {
        Some(_) if !config.isolate.plane_in_workspace => Vec::new(),
        _ => background_planes(&capture.states.iter().flatten().collect::<Vec<_>>(), &capture.noise, rng),
    };
    for p in &planes {
        let n = p.normal;
        capture.notes.push(format!(
            "background plane taken away: normal ({:.3}, {:.3}, {:.3}), {:.4} m from the world's origin",
            n.x, n.y, n.z, p.offset_m
        ));
    }
    let background = Background { planes, config, noise: capture.noise };
    let support = |frames: &Vec<RgbdFrame>| {
        let weights: Vec<Vec<f32>> = frames.par_iter().map(|f| pixel_weights(f, &capture.noise)).collect();
        find_support(frames, &weights, size_m, &background)
    };
    let supports: Vec<_> = capture.states.iter().map(support).collect();
    let cells: Vec<Vec<Cell>> = supports.iter().map(|s| s.cells.clone()).collect();
    let poses: Vec<_> = capture.states.iter().flatten().map(|f| f.world_from_camera).collect();
    let reach = config.isolate.link_distance_m.map_or(3, |d| ((d / size_m).ceil() as i32).clamp(1, 20));
    let object = choose_object(&cells, size_m, reach, common_focus(&poses), workspace.is_some())?;
    capture.notes.push(object.note.clone());
    for (s, frames) in capture.states.iter_mut().enumerate() {
        let own: Vec<Cell> = cells[s].iter().filter(|c| object.contains(c)).copied().collect();
        let near = dilated(&own, 1);
        let is_object = |p: &Point3<f64>| in_box(workspace, p) && cell(p, size_m).is_some_and(|c| near.contains(&c));
        let is_known =
            |f: &RgbdFrame, pixel: usize, p: &Point3<f64>| background.is_above(f, pixel, p) || supports[s].is_solid(p, size_m, &background);
        frames.par_iter_mut().for_each(|f| paint(f, &silhouette(f, &own, size_m), is_object, is_known));
    }
    Ok(())
}

/// Mask of one frame: pixels whose point is part of the object and, where the depth is unknown, those in its outline.
/// Depth that may as well be background is forgotten.
fn paint(
    frame: &mut RgbdFrame,
    outline: &[bool],
    is_object: impl Fn(&Point3<f64>) -> bool,
    is_known: impl Fn(&RgbdFrame, usize, &Point3<f64>) -> bool,
) {
    let mut mask = outline.to_vec();
    for (pixel, inside) in mask.iter_mut().enumerate() {
        if let Some(point) = frame.world_point(pixel) {
            *inside = is_object(&point);
            if *inside && !is_known(frame, pixel, &point) {
                frame.depth_m[pixel] = 0.0;
            }
        }
    }
    frame.mask = Some(mask);
}

/// Pixels onto which cells project, each as a square of its size.
fn silhouette(frame: &RgbdFrame, cells: &[Cell], size_m: f64) -> Vec<bool> {
    let k = &frame.intrinsics;
    let mut covered = vec![false; k.width * k.height];
    for c in cells {
        let point = frame.in_camera(&center(c, size_m));
        let Some((u, v)) = k.project(&point) else { continue };
        let half = 0.5 * size_m * k.fx.max(k.fy) / point.z;
        let span = |mid: f64, count: usize| {
            let from = (mid - half).round().max(0.0) as usize;
            from..((mid + half).round().max(-1.0) + 1.0).min(count as f64) as usize
        };
        for y in span(v, k.height) {
            for x in span(u, k.width) {
                covered[y * k.width + x] = true;
            }
        }
    }
    covered
}

/// Refuses states without depth on the object and states without a common place.
fn check(capture: &Capture, size_m: f64) -> Result<(), CaptureError> {
    let mut cells = Vec::new();
    for (state, frames) in capture.states.iter().enumerate() {
        let pixels = frames.iter().flat_map(|f| (0..f.depth_m.len()).filter(|p| f.is_object(*p) && f.depth_m[*p] > 0.0)).count();
        if pixels < MIN_PIXELS {
            let reason = format!(
                "in state {state} only {pixels} pixels with depth are left as the object, too few; check masks, workspace and the \
                 holes in the depth images"
            );
            return Err(CaptureError::Isolation { reason });
        }
        cells.push(supported(&seen(frames, size_m, |f, p, _| f.is_object(p)), frames_needed(frames)));
    }
    let Some((first, others)) = cells.split_first() else { return Ok(()) };
    let near = dilated(first, 1);
    for (k, other) in others.iter().enumerate() {
        let common = other.iter().filter(|c| near.contains(*c)).count();
        let share = common as f64 / first.len().min(other.len()).max(1) as f64;
        if share < MIN_OVERLAP {
            return Err(CaptureError::NoOverlap { state: k + 1, share_percent: 100.0 * share });
        }
    }
    Ok(())
}
