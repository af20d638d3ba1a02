//! Isolation of the object from its surroundings: a mask for every frame.
//!
//! With masks in the recording, only stray depth readings are removed. Without masks, the points of all
//! states outside the background planes (or inside a given box) are collected in cells of space and grouped.
//! The group that changed between states is the object; without a change, the group at the cameras' focus.
//! A plane that something came out of is of the object about that place. All gates are multiples of the error
//! of a reading, which is measured by how far the views of a state disagree.
//! The mask holds the pixels with a point in this group. Pixels with unknown depth, or too close to the
//! support to decide, are in the mask without depth: they count neither as object nor as empty space.

mod background;
mod beside;
mod change;
mod claim;
mod depth_error;
#[cfg(test)]
mod made_rooms;
mod outliers;
mod plane;
mod room;
mod select;
mod stand;
mod support;
mod voxels;

use std::ops::Range;

use nalgebra::Point3;
use rand_core::Rng;
use rayon::prelude::*;

use self::{
    background::{Background, PLANE_CLEARANCE_M, in_box},
    beside::without_things_beside,
    change::{at_rest, changed_cells},
    claim::claimed_planes,
    depth_error::shared_error,
    outliers::outlier_cells,
    plane::{Plane, background_planes, places, sampled_readings},
    room::ShareOfRoom,
    select::{Object, Search, bounds, choose_object, groups_of_states},
    stand::{Standers, stand_of_object},
    support::{Support, find_support},
    voxels::{Cell, CellSet, center_of_cell, dilated_cells, frames_needed, supported_cells},
};
pub use self::{
    change::{CLEARLY, LEAST_PATCH},
    voxels::{cell_of_point, clusters_of_cells},
};
use super::{At, Capture, CaptureConfig, CaptureError, RgbdFrame, Unread, common_focus, pixel_weights};
use common::note::{Note, NoteCode};
use common::stop::{Stop, Stopped};
use numeric::statistics::median;

/// Most planes that do not fill the images and on which the object stands.
/// chosen: a table, a cloth on it and a tray
const MOST_STANDS: usize = 3;
/// Fewest object pixels with depth in a state.
const MIN_PIXELS: usize = 200;
/// Least share of common cells, of the state with fewer cells.
/// chosen: with less, the states show no common object
const MIN_OVERLAP: f64 = 0.02;
/// Largest gap between parts of the object, cells and meters; neighboring cells hang together at any size.
/// chosen: a dark strip without depth; things farther apart stand beside each other
const LINK_CELLS: i32 = 3;
const LINK_M: f64 = 0.03;

/// Sets the mask of every frame.
///
/// # Errors
/// [`CaptureError::Isolation`] if no depth is left on the object, [`CaptureError::NoOverlap`] if the states
/// have no place in common, [`CaptureError::Stopped`].
pub fn isolate(
    capture: &mut Capture,
    config: &CaptureConfig,
    rng: &mut impl Rng,
    stop: &Stop,
) -> Result<(), CaptureError> {
    let masked = capture.states.iter().flatten().filter(|f| f.mask.is_some()).count();
    let all = capture.states.iter().flatten().count();
    if masked > 0 && masked < all {
        // Frames without a mask would show the surroundings as object.
        capture.warnings.push(Note::new(
            NoteCode::MasksIncomplete,
            format!("only {masked} of {all} frames have masks; the masks are not used"),
        ));
        capture.states.iter_mut().flatten().for_each(|f| f.mask = None);
    }
    let size_m = cell_size(capture);
    if masked == all {
        clean_masks(capture, config, size_m, stop)?;
    } else {
        find_object(capture, config, size_m, rng, stop)?;
    }
    capture.object_box_m = Some(check(capture, size_m, stop)?);
    Ok(())
}

/// Side of a cell, meters: two standard deviations of the depth noise or two pixels, at the median depth.
fn cell_size(capture: &Capture) -> f64 {
    let frames = || capture.states.iter().flatten();
    let mut depths_m = Vec::new();
    for frame in frames() {
        let pixels = (0..frame.depth_m.len()).step_by(17).filter(|p| frame.is_object(*p));
        depths_m.extend(pixels.map(|p| f64::from(frame.depth_m[p])).filter(|d| *d > 0.0));
    }
    let depth_m = median(depths_m).unwrap_or(1.0);
    let pixel_m = frames().map(|f| depth_m / f.intrinsics.fx).fold(0.0, f64::max);
    // docs/method.md (2.18): wider than the noise, and than the gaps between pixels.
    (2.0 * capture.noise.sigma_m(depth_m)).max(2.0 * pixel_m).clamp(0.002, 0.05)
}

/// The distinct cells of a frame under its mask, sorted.
fn object_cells(frame: &RgbdFrame, size_m: f64) -> Vec<Cell> {
    let pixels = (0..frame.depth_m.len()).filter(|p| frame.is_object(*p));
    let points = pixels.filter_map(|p| frame.world_point(p));
    let mut cells: Vec<Cell> = points.filter_map(|point| cell_of_point(&point, size_m)).collect();
    // Neighboring pixels mostly lie in the same cell.
    cells.dedup();
    cells.sort_unstable();
    cells.dedup();
    cells
}

/// Largest gap between parts of the object, in cells of this size.
fn link_of_cells(size_m: f64) -> i32 {
    ((LINK_M / size_m).ceil() as i32).clamp(1, LINK_CELLS)
}

fn cells_of_frames(frames: &[RgbdFrame], size_m: f64, stop: &Stop) -> Result<Vec<Vec<Cell>>, Stopped> {
    frames
        .par_iter()
        .map(|f| {
            stop.check()?;
            Ok(object_cells(f, size_m))
        })
        .collect()
}

/// Removes depth under masks that is in outlier cells or outside the workspace.
fn clean_masks(
    capture: &mut Capture,
    config: &CaptureConfig,
    size_m: f64,
    stop: &Stop,
) -> Result<(), Stopped> {
    let states = capture.states.par_iter_mut();
    let forgotten =
        states.map(|frames| forget_outliers(frames, config, size_m, stop)).sum::<Result<usize, Stopped>>()?;
    let frames = capture.states.par_iter().flatten();
    let pixels: usize = frames.map(|f| (0..f.depth_m.len()).filter(|p| f.is_object(*p)).count()).sum();
    capture.notes.push(Note::new(NoteCode::MasksUsed, format!(
        "masks of the recording are used ({pixels} pixels); {forgotten} depth readings in them stand apart \
         and are not used"
    )));
    Ok(())
}

/// Removes the depth of object pixels by a test of their world points; returns the number removed.
fn forget(frame: &mut RgbdFrame, is_bad: impl Fn(&Point3<f64>) -> bool) -> usize {
    let pixels: Vec<usize> = (0..frame.depth_m.len())
        .filter(|&p| frame.is_object(p) && frame.world_point(p).is_some_and(|q| is_bad(&q)))
        .collect();
    for p in &pixels {
        frame.depth_m[*p] = 0.0;
    }
    pixels.len()
}

/// What stands out from the background in all states.
struct Standing {
    /// Of each state.
    supports: Vec<Support>,
    /// Sorted cells of each state, without what moved within it.
    cells: Vec<Vec<Cell>>,
    /// Cells that changed between states.
    changed: CellSet,
    /// Groups of the cells of all states.
    groups: Vec<Vec<Cell>>,
}

fn find_object(
    capture: &mut Capture,
    config: &CaptureConfig,
    size_m: f64,
    rng: &mut impl Rng,
    stop: &Stop,
) -> Result<(), CaptureError> {
    capture.unread = Unread::Unknown;
    capture.shared_error = shared_error(&capture.states, &capture.noise, stop)?;
    let workspace = config.isolate.workspace;
    let noise = capture.noise.scaled(1f64.hypot(capture.shared_error));
    let frames: Vec<&RgbdFrame> = capture.states.iter().flatten().collect();
    let cameras = places(&frames);
    let samples = sampled_readings(&frames, &noise);
    let planes = background_planes(samples.clone(), &cameras, rng, stop)?;
    let mut background = Background { planes, config, noise };
    let mut standing = standing_out(capture, &background, size_m, stop)?;
    if workspace.is_none() {
        // A rug lies on a floor, and a tray on a table.
        for _ in 0..MOST_STANDS {
            let standers = Standers::new(&standing.changed, size_m, !capture.tracking.is_empty(), stop)?;
            let Some(standers) = standers else { break };
            let stand = stand_of_object(&samples, &cameras, &standers, &background, rng);
            let Some(stand) = stand else { break };
            background.planes.push(stand);
            standing = standing_out(capture, &background, size_m, stop)?;
        }
    }
    for plane in &background.planes {
        let text = format!("background plane taken away: {plane}");
        capture.notes.push(Note::new(NoteCode::BackgroundRemoved, text));
    }
    if workspace.is_none() {
        let claims = claimed_planes(&standing, &background, &capture.states, size_m, stop)?;
        for &(plane, object_box_m) in &claims {
            let plane = &mut background.planes[plane];
            plane.object_box_m = Some(object_box_m);
            capture.notes.push(Note::new(NoteCode::BackgroundRemoved, given_back(plane, object_box_m)));
        }
        if !claims.is_empty() {
            standing = standing_out(capture, &background, size_m, stop)?;
        }
    }
    let mut object = choose(capture, &background, size_m, &standing)?;
    if object.is_by_change {
        let reach = link_of_cells(size_m);
        let all = object.cells.len();
        object.cells =
            without_things_beside(object.cells, &standing.changed, &background, reach, size_m, stop)?;
        if object.cells.len() < all {
            let beside = all - object.cells.len();
            object.note += &format!("; {beside} of these cells are of what stands beside it");
        }
        refuse_room(capture, &object, size_m, stop)?;
    }
    capture.notes.push(Note::new(NoteCode::ObjectIsolated, object.note.clone()));
    for (s, frames) in capture.states.iter_mut().enumerate() {
        let own: Vec<Cell> = standing.cells[s].iter().filter(|c| object.contains(c)).copied().collect();
        // Too few frames see the cells at the rim, but their points belong to the object.
        let near = dilated_cells(&own, 1);
        frames.par_iter_mut().try_for_each(|frame| {
            stop.check()?;
            let silhouette = silhouette(frame, &own, size_m);
            paint(
                frame,
                &silhouette,
                |p| in_box(workspace, p) && cell_of_point(p, size_m).is_some_and(|c| near.contains(&c)),
                |f, pixel, p| {
                    background.is_above(f, pixel, p) || standing.supports[s].is_solid(p, size_m, &background)
                },
            );
            Ok::<_, Stopped>(())
        })?;
    }
    Ok(())
}

/// Says that a plane is of the object in a box, meters.
fn given_back(plane: &Plane, [lower, upper]: [[f64; 3]; 2]) -> String {
    let corner = |c: [f64; 3]| c.map(|v| format!("{v:.3}")).join(", ");
    format!(
        "a background plane is of the object, which came out of it, in the box ({}) to ({}) m: {plane}",
        corner(lower),
        corner(upper)
    )
}

/// Collects what stands out from the background.
fn standing_out(
    capture: &Capture,
    background: &Background<'_>,
    size_m: f64,
    stop: &Stop,
) -> Result<Standing, Stopped> {
    let mut supports = Vec::with_capacity(capture.states.len());
    for frames in &capture.states {
        let weights: Vec<Vec<f32>> = frames
            .par_iter()
            .map(|f| {
                stop.check()?;
                Ok(pixel_weights(f, &capture.noise))
            })
            .collect::<Result<_, Stopped>>()?;
        supports.push(find_support(frames, &weights, size_m, background, stop)?);
    }
    let seen: Vec<Vec<Cell>> = supports.iter().map(|s| s.cells.clone()).collect();
    // Hands or persons in some frames are no part of the scene.
    let cells = at_rest(&seen, &capture.states, size_m, &background.noise, stop)?;
    let changed = changed_cells(&cells, &capture.states, size_m, &background.noise, stop)?;
    let groups = groups_of_states(&cells, link_of_cells(size_m), stop)?;
    Ok(Standing { supports, cells, changed, groups })
}

/// Refuses what changed if it is the room.
fn refuse_room(capture: &Capture, object: &Object, size_m: f64, stop: &Stop) -> Result<(), CaptureError> {
    let share = ShareOfRoom::of_object(object, &capture.states, size_m, stop)?;
    if !share.is_room() {
        return Ok(());
    }
    let reason = format!(
        "what changed hangs together with {:.0} % of all that was read, and {:.0} % of what is at the \
         images' borders, so it is the room rather than an object",
        100.0 * share.cells,
        100.0 * share.borders
    );
    Err(CaptureError::Isolation { reason })
}

/// Removes depth of one state under masks in outlier cells or outside the workspace; returns the number of
/// readings removed.
fn forget_outliers(
    frames: &mut [RgbdFrame],
    config: &CaptureConfig,
    size_m: f64,
    stop: &Stop,
) -> Result<usize, Stopped> {
    // One frame suffices, as masks leave no noisy background.
    let cells = supported_cells(&cells_of_frames(frames, size_m, stop)?, 1);
    let bad = outlier_cells(&cells, size_m, stop)?;
    let workspace = config.isolate.workspace;
    frames
        .par_iter_mut()
        .map(|f| {
            stop.check()?;
            Ok(forget(f, |p| {
                !in_box(workspace, p) || cell_of_point(p, size_m).is_none_or(|c| bad.contains(&c))
            }))
        })
        .sum()
}

/// Finds the object among what stands out.
fn choose(
    capture: &Capture,
    background: &Background<'_>,
    size_m: f64,
    standing: &Standing,
) -> Result<Object, CaptureError> {
    let isolate = &background.config.isolate;
    let poses: Vec<_> = capture.states.iter().flatten().map(|f| f.world_from_camera).collect();
    // The same distance to a plane as between cells of a group.
    let reach = link_of_cells(size_m);
    let touching_m = PLANE_CLEARANCE_M + f64::from(reach + 1) * size_m;
    let search = Search {
        size_m,
        reach,
        changed: &standing.changed,
        is_at_support: &|c| {
            background.planes.iter().any(|p| p.height_m(&center_of_cell(c, size_m)).abs() <= touching_m)
        },
        focus: common_focus(&poses),
        at: isolate.at.as_ref().map(|at| place(at, &capture.states)).transpose()?,
        takes_all: isolate.workspace.is_some(),
    };
    choose_object(&search, &standing.groups)
}

/// The given point on the object in the world, or the point at a given pixel.
fn place(at: &At, states: &[Vec<RgbdFrame>]) -> Result<Point3<f64>, CaptureError> {
    let refuse = |reason: String| CaptureError::Setting { key: "capture.isolate.at", reason };
    match at {
        At::Point(point) => Ok(Point3::from(*point)),
        At::Pixel { frame, pixel: [u, v] } => {
            let found = states.iter().flatten().find(|f| f.id == *frame);
            let found = found.ok_or_else(|| refuse(format!("no frame `{frame}` was kept")))?;
            let k = &found.intrinsics;
            let is_inside = *u < k.width && *v < k.height;
            let point = is_inside.then(|| found.world_point(v * k.width + u)).flatten();
            point.ok_or_else(|| refuse(format!("frame `{frame}` has no depth at pixel ({u}, {v})")))
        }
    }
}

/// Mask of a frame: pixels with a point of the object and, where depth is unknown, pixels inside its outline.
/// Depth that may be background is removed.
fn paint(
    frame: &mut RgbdFrame,
    outline: &[bool],
    is_object: impl Fn(&Point3<f64>) -> bool,
    is_known: impl Fn(&RgbdFrame, usize, &Point3<f64>) -> bool,
) {
    // Unknown depth is decided by the outline, so that a hole in the object is not taken for empty space.
    let mut mask = outline.to_vec();
    for (pixel, inside) in mask.iter_mut().enumerate() {
        if let Some(point) = frame.world_point(pixel) {
            *inside = is_object(&point);
            // Object or support: undecidable here, so the pixel keeps no depth.
            if *inside && !is_known(frame, pixel, &point) {
                frame.depth_m[pixel] = 0.0;
            }
        }
    }
    frame.mask = Some(mask);
}

/// Pixels covered by the projected cells, each as a square of its size.
fn silhouette(frame: &RgbdFrame, cells: &[Cell], size_m: f64) -> Vec<bool> {
    let k = &frame.intrinsics;
    let mut covered = vec![false; k.width * k.height];
    for c in cells {
        let point = frame.in_camera(&center_of_cell(c, size_m));
        let Some((u, v)) = k.project(&point) else { continue };
        // By the longer focal length, so that the squares leave no gaps.
        let half = 0.5 * size_m * k.fx.max(k.fy) / point.z;
        for y in pixels_about(v, half, k.height) {
            for x in pixels_about(u, half, k.width) {
                covered[y * k.width + x] = true;
            }
        }
    }
    covered
}

/// Pixels below `count` at most `half` from a coordinate.
fn pixels_about(middle: f64, half: f64, count: usize) -> Range<usize> {
    let first = (middle - half).round().max(0.0) as usize;
    first..((middle + half).round().max(-1.0) + 1.0).min(count as f64) as usize
}

/// Checks that every state has depth on the object, and that all share a place. Returns the box around the
/// object in all states: lower and upper corner, meters.
fn check(capture: &Capture, size_m: f64, stop: &Stop) -> Result<[[f64; 3]; 2], CaptureError> {
    let mut cells = Vec::new();
    for (state, frames) in capture.states.iter().enumerate() {
        let pixels = frames
            .iter()
            .flat_map(|f| (0..f.depth_m.len()).filter(|p| f.is_object(*p) && f.depth_m[*p] > 0.0))
            .count();
        if pixels < MIN_PIXELS {
            let reason = format!(
                "in state {state} only {pixels} pixels with depth are left as the object, too few; check \
                 masks, workspace and the holes in the depth images"
            );
            return Err(CaptureError::Isolation { reason });
        }
        cells.push(supported_cells(&cells_of_frames(frames, size_m, stop)?, frames_needed(frames.len())));
    }
    let (lower, upper) = bounds(cells.iter().flatten());
    let corners = [lower, upper.map(|v| v.saturating_add(1))].map(|c| c.map(|v| f64::from(v) * size_m));
    let Some((first, others)) = cells.split_first() else { return Ok(corners) };
    // Noise may put the same surface into a neighboring cell.
    let near = dilated_cells(first, 1);
    for (k, other) in others.iter().enumerate() {
        let common = other.iter().filter(|c| near.contains(*c)).count();
        // Relative to the smaller state, so that fewer views do not look like less overlap.
        let share = common as f64 / first.len().min(other.len()).max(1) as f64;
        // Without a common place, the world frames differ or the objects do.
        if share < MIN_OVERLAP {
            return Err(CaptureError::NoOverlap { state: k + 1, share_percent: 100.0 * share });
        }
    }
    Ok(corners)
}
