//! States that begin and end by themselves: the object is watched for motion while the camera goes about it.
//!
//! Two views of a still scene never contradict each other: where one measured a surface, the other sees it,
//! something in front of it, or nothing. A surface looked through by another view has moved since.

use std::collections::VecDeque;

use super::view::Pixels;
use geometry::{Intrinsics, Pose};

/// Columns and rows of a watched view.
const WIDTH: usize = 96;
const HEIGHT: usize = 72;
/// Earlier views compared with a new one.
const REFERENCES: usize = 12;
/// A surface this far behind where it was expected was looked through: meters, and share of the depth.
/// chosen: beyond errors of depth and poses
const THROUGH_M: f64 = 0.02;
const THROUGH_SHARE: f64 = 0.02;
/// Least share of contradicting points for motion. chosen: beyond errors of depth
const MOVED_SHARE: f64 = 0.012;
/// Fewest compared points.
const MIN_POINTS: usize = 150;
/// Least views with motion in a row.
const CONFIRM: usize = 2;

/// The action to take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Turn {
    /// Nothing.
    None,
    /// Begin this state.
    Start(usize),
    /// End this state: enough was seen.
    Finish(usize),
    /// End this state: the object moves. The last views may show it moving already.
    Moved(usize),
}

/// Settings of the watch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WatchRule {
    /// The object counts as still after this time without motion, nanoseconds.
    pub still_nanos: i64,
    /// Least views of a state before its end.
    pub least: usize,
    /// Views of state 1 at its end.
    pub enough: usize,
}

/// A depth image made small.
#[derive(Clone, Debug)]
struct Small {
    camera: Intrinsics,
    world_from_camera: Pose,
    /// `WIDTH * HEIGHT`; 0 where nothing is known or the object is not.
    depth_m: Vec<f32>,
    /// Whether a sample is the object; all are without masks.
    object: Vec<bool>,
    stamp_nanos: i64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// No view yet.
    Fresh,
    /// A state is being collected.
    Still(usize),
    /// The object is being moved before this state.
    Moving(usize),
    /// Both states are there.
    Over,
}

/// Watches the object.
#[derive(Clone, Debug)]
pub(crate) struct MotionWatch {
    rule: WatchRule,
    stage: Stage,
    references: VecDeque<Small>,
    seen: usize,
    moved_in_a_row: usize,
    last_motion_nanos: i64,
}

impl MotionWatch {
    /// A watch without views.
    #[must_use]
    pub(crate) fn new(rule: WatchRule) -> Self {
        Self {
            rule,
            stage: Stage::Fresh,
            references: VecDeque::new(),
            seen: 0,
            moved_in_a_row: 0,
            last_motion_nanos: i64::MIN,
        }
    }

    /// The same watch from the beginning.
    #[must_use]
    pub(crate) fn renewed(self) -> Self {
        Self::new(self.rule)
    }

    /// The same watch for poses of another map from now on: earlier views cannot be compared with them.
    #[must_use]
    pub(crate) fn in_another_map(self) -> Self {
        Self { references: VecDeque::new(), ..self }
    }

    /// Whether the object is being moved between the states.
    #[must_use]
    pub(crate) fn is_moving(&self) -> bool {
        matches!(self.stage, Stage::Moving(_))
    }

    /// Takes a view; `kept` are the views kept of each state.
    pub(crate) fn see_view(
        &mut self,
        stamp_nanos: i64,
        pixels: &Pixels,
        world_from_camera: &Pose,
        kept: [usize; 2],
    ) -> Turn {
        let view = Small::new(stamp_nanos, pixels, world_from_camera);
        let moved = self.shows_motion(&view);
        self.moved_in_a_row = if moved { self.moved_in_a_row + 1 } else { 0 };
        if moved {
            self.last_motion_nanos = stamp_nanos;
        }
        match self.stage {
            Stage::Fresh => {
                self.remember_view(view);
                // The first views are state 0: nobody has touched the object yet.
                self.stage = Stage::Still(0);
                Turn::Start(0)
            }
            Stage::Still(state) => self.while_still(state, view, moved, kept[state]),
            Stage::Moving(state) => {
                // Only views after the last motion can be compared with the next view.
                if moved {
                    self.references.clear();
                }
                self.remember_view(view);
                let still_since = self
                    .references
                    .front()
                    .map_or(stamp_nanos, |r| r.stamp_nanos)
                    .max(self.last_motion_nanos);
                // People pause while they move an object: a short rest is no state.
                if stamp_nanos - still_since < self.rule.still_nanos {
                    return Turn::None;
                }
                self.stage = Stage::Still(state);
                Turn::Start(state)
            }
            Stage::Over => Turn::None,
        }
    }

    fn while_still(&mut self, state: usize, view: Small, moved: bool, kept: usize) -> Turn {
        if self.moved_in_a_row >= CONFIRM {
            self.references.clear();
            self.remember_view(view);
            let enough = kept >= self.rule.least;
            self.stage = match (state, enough) {
                (0, true) => Stage::Moving(1),
                (_, true) => Stage::Over,
                // Too little was seen of it: it begins again once the object is still.
                (state, false) => Stage::Moving(state),
            };
            return Turn::Moved(state);
        }
        // Motion in one view may be noise: the view is neither compared with later ones nor acted on.
        if !moved {
            self.remember_view(view);
        }
        // State 0 ends with the motion; behind state 1 none comes, so a number of views ends it.
        if state == 1 && kept >= self.rule.enough {
            self.stage = Stage::Over;
            return Turn::Finish(1);
        }
        Turn::None
    }

    /// Keeps the first views and every so many of the later ones: slow motion does not hide.
    fn remember_view(&mut self, view: Small) {
        self.seen += 1;
        if self.references.len() < REFERENCES {
            self.references.push_back(view);
        } else if self.seen.is_multiple_of(4) {
            self.references.pop_front();
            self.references.push_back(view);
        }
    }

    /// Whether a view contradicts the earlier ones.
    fn shows_motion(&self, view: &Small) -> bool {
        let mut compared = 0;
        let mut through = 0;
        for reference in &self.references {
            // Both ways: a gone part is looked through in the new view, an appeared one in the old view.
            for (from, to) in [(reference, view), (view, reference)] {
                let (n, t) = from.looked_through_by(to);
                compared += n;
                through += t;
            }
        }
        // Few points say nothing, and single ones are noise at edges.
        compared >= MIN_POINTS && through as f64 > MOVED_SHARE * compared as f64
    }
}

impl Small {
    fn new(stamp_nanos: i64, pixels: &Pixels, world_from_camera: &Pose) -> Self {
        let full = &pixels.intrinsics;
        // Small, as each view is compared with twelve others while images come at 30 Hz.
        let scale = [WIDTH as f64 / full.width as f64, HEIGHT as f64 / full.height as f64];
        // Sample k stands for the pixel in the middle of its cell.
        let place = |k: usize, scale: f64, size: usize| (((k as f64 + 0.5) / scale) as usize).min(size - 1);
        let cells = (0..WIDTH * HEIGHT).map(|k| {
            place(k / WIDTH, scale[1], full.height) * full.width + place(k % WIDTH, scale[0], full.width)
        });
        let at: Vec<usize> = cells.collect();
        let camera = Intrinsics {
            width: WIDTH,
            height: HEIGHT,
            fx: full.fx * scale[0],
            fy: full.fy * scale[1],
            // Integer coordinates are pixel centers, so a scale is one about -0.5.
            cx: (full.cx + 0.5) * scale[0] - 0.5,
            cy: (full.cy + 0.5) * scale[1] - 0.5,
        };
        Self {
            camera,
            world_from_camera: *world_from_camera,
            depth_m: at.iter().map(|i| pixels.depth.pixels[*i]).collect(),
            object: at.iter().map(|i| pixels.mask.as_ref().is_none_or(|m| m.pixels[*i])).collect(),
            stamp_nanos,
        }
    }

    /// Of this view's object points, how many the other view measured near or behind, and how many it looked
    /// through.
    fn looked_through_by(&self, other: &Self) -> (usize, usize) {
        let other_from_self = other.world_from_camera.inverse() * self.world_from_camera;
        let mut compared = 0;
        let mut through = 0;
        for (k, z) in self.depth_m.iter().enumerate().filter(|(k, z)| **z > 0.0 && self.object[*k]) {
            let u = (k % WIDTH) as f64;
            let v = (k / WIDTH) as f64;
            let z = f64::from(*z);
            let c = &self.camera;
            let p = other_from_self * nalgebra::Point3::new((u - c.cx) / c.fx * z, (v - c.cy) / c.fy * z, z);
            let c = &other.camera;
            // Behind the other camera, or too near for any depth camera.
            if p.z < 0.05 {
                continue;
            }
            let u = c.fx * p.x / p.z + c.cx;
            let v = c.fy * p.y / p.z + c.cy;
            let Some(nearest) = other.nearest_depth_m(u, v) else { continue };
            // In front of the expected place something hides it: the point says nothing and is not compared.
            let tolerance = THROUGH_M + THROUGH_SHARE * p.z;
            if f64::from(nearest) > p.z + tolerance {
                through += 1;
                compared += 1;
            } else if f64::from(nearest) > p.z - tolerance {
                compared += 1;
            }
        }
        (compared, through)
    }

    /// The least depth of the four samples about a place: no edge is taken for a hole; `None` where one is
    /// unknown.
    fn nearest_depth_m(&self, u: f64, v: f64) -> Option<f32> {
        if !(u >= 1.0 && v >= 1.0 && u < WIDTH as f64 - 2.0 && v < HEIGHT as f64 - 2.0) {
            return None;
        }
        let u = u as usize;
        let v = v as usize;
        let around = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(du, dv)| self.depth_m[(v + dv) * WIDTH + u + du]);
        around.iter().all(|z| *z > 0.0).then(|| around.into_iter().fold(f32::INFINITY, f32::min))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use io::image_codec::Raster;

    const S: i64 = 1_000_000_000;

    /// A wall at 1.5 m with a box in front of it whose face stands at `face_m`, seen from `x`.
    fn view(x: f64, face_m: f64) -> (Pixels, Pose) {
        let width = 320;
        let height = 240;
        let camera = Intrinsics { width, height, fx: 300.0, fy: 300.0, cx: 160.0, cy: 120.0 };
        let depth = |i: usize| {
            let ray =
                [((i % width) as f64 - camera.cx) / camera.fx, ((i / width) as f64 - camera.cy) / camera.fy];
            let hits = (ray[0] * face_m + x).abs() < 0.15 && (ray[1] * face_m).abs() < 0.1;
            if hits { face_m as f32 } else { 1.5 }
        };
        let size = width * height;
        let pixels = Pixels {
            intrinsics: camera,
            color: Raster { width, height, pixels: vec![[0; 3]; size] },
            depth: Raster { width, height, pixels: (0..size).map(depth).collect() },
            mask: None,
        };
        (pixels, Pose::new(Vector3::new(x, 0.0, 0.0), Vector3::zeros()))
    }

    /// Turns of a watch over views every 0.1 s; `face_m` by the number of the view.
    fn turns(views: usize, face_m: impl Fn(usize) -> f64) -> Vec<(usize, Turn)> {
        let mut watch = MotionWatch::new(WatchRule { still_nanos: S, least: 5, enough: 8 });
        let mut kept = [0; 2];
        let mut state = 0;
        let mut found = Vec::new();
        for i in 0..views {
            let (pixels, pose) = view(0.2 * (0.3 * i as f64).sin(), face_m(i));
            match watch.see_view(i as i64 * S / 10, &pixels, &pose, kept) {
                Turn::None => kept[state] += usize::from(!watch.is_moving()),
                turn => {
                    if let Turn::Start(s) = turn {
                        (state, kept[s]) = (s, 0);
                    }
                    found.push((i, turn));
                }
            }
        }
        found
    }

    #[test]
    fn a_camera_that_moves_about_a_still_object_is_no_motion() {
        assert_eq!(turns(60, |_| 1.2), [(0, Turn::Start(0))]);
    }

    #[test]
    fn the_states_lie_before_and_after_the_motion_whichever_way_it_goes() {
        for (before, after) in [(1.2, 1.0), (1.0, 1.2)] {
            let face = |i: usize| before + (after - before) * (i as f64 - 20.0).clamp(0.0, 10.0) / 10.0;
            let found = turns(80, face);
            let turns: Vec<Turn> = found.iter().map(|f| f.1).collect();
            assert_eq!(turns, [Turn::Start(0), Turn::Moved(0), Turn::Start(1), Turn::Finish(1)], "{found:?}");
            assert!((21..26).contains(&found[1].0) && (38..46).contains(&found[2].0), "{found:?}");
        }
    }

    #[test]
    fn a_state_that_was_too_short_begins_again() {
        let found = turns(80, |i| 1.0 + 0.02 * (i as f64).min(10.0));
        let states: Vec<Turn> = found.iter().map(|f| f.1).take(3).collect();
        assert_eq!(states, [Turn::Start(0), Turn::Moved(0), Turn::Start(0)], "{found:?}");
    }
}
