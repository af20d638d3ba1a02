//! Automatic start and end of states, by watching the object for motion while the camera moves around it.
//!
//! Views of a static scene never contradict each other: a surface measured in one is seen, occluded or not
//! measured in another. A surface that another view looks through has moved.

use std::collections::VecDeque;

use capture::RgbdFrame;
use geometry::{Intrinsics, Pose};

/// Columns and rows of a reduced view.
const WIDTH: usize = 96;
const HEIGHT: usize = 72;
/// Number of earlier views compared with a new one.
const REFERENCES: usize = 12;
/// Distance behind the expected surface at which a view looks through it: meters, and share of the depth.
/// chosen: beyond errors of depth and poses
const THROUGH_M: f64 = 0.02;
const THROUGH_SHARE: f64 = 0.02;
/// Least share of contradicting points that counts as motion. chosen: beyond errors of depth
const MOVED_SHARE: f64 = 0.012;
/// Fewest compared points for a decision.
const MIN_POINTS: usize = 150;
/// Number of consecutive views with motion that confirm it.
const CONFIRM: usize = 2;

/// Action to take after a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Turn {
    /// Nothing.
    None,
    /// Start this state.
    Start(usize),
    /// Finish this state: enough was seen.
    Finish(usize),
    /// Finish this state: the object moves, and the last views may show it.
    Moved(usize),
}

/// Settings of automatic states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WatchRule {
    /// Time without motion after which the object counts as at rest, nanoseconds.
    pub still_nanos: i64,
    /// Fewest views of a state.
    pub least: usize,
    /// Number of views at which state 1 ends.
    pub enough: usize,
}

/// A depth image at low resolution.
#[derive(Clone, Debug)]
struct Small {
    camera: Intrinsics,
    world_from_camera: Pose,
    /// Depth in meters, `WIDTH * HEIGHT`; 0 where it is unknown or off the object.
    depth_m: Vec<f32>,
    /// Whether each sample shows the object; always true without masks.
    object: Vec<bool>,
    stamp_nanos: i64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// No view was seen yet.
    Fresh,
    /// This state is being collected.
    Still(usize),
    /// The object is being moved before this state.
    Moving(usize),
    /// Both states are complete.
    Over,
}

/// Watches the object for motion.
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

    /// The watch restarted.
    #[must_use]
    pub(crate) fn renewed(self) -> Self {
        Self::new(self.rule)
    }

    /// The watch for poses in another map: earlier views are no longer compared.
    #[must_use]
    pub(crate) fn in_another_map(self) -> Self {
        Self { references: VecDeque::new(), ..self }
    }

    /// Whether the object is being moved between the states.
    #[must_use]
    pub(crate) fn is_moving(&self) -> bool {
        matches!(self.stage, Stage::Moving(_))
    }

    /// Handles a view; `kept` is the number of kept views per state.
    pub(crate) fn see_view(&mut self, frame: &RgbdFrame, kept: [usize; 2]) -> Turn {
        let stamp_nanos = frame.stamp_nanos;
        let view = Small::of_frame(frame);
        let moved = self.shows_motion(&view);
        self.moved_in_a_row = if moved { self.moved_in_a_row + 1 } else { 0 };
        if moved {
            self.last_motion_nanos = stamp_nanos;
        }
        match self.stage {
            Stage::Fresh => {
                self.remember_view(view);
                // The first views are of state 0, before anyone has moved the object.
                self.stage = Stage::Still(0);
                Turn::Start(0)
            }
            Stage::Still(state) => self.while_still(state, view, moved, kept[state]),
            Stage::Moving(state) => {
                // Only views after the last motion are comparable with later ones.
                if moved {
                    self.references.clear();
                }
                self.remember_view(view);
                let still_since = self
                    .references
                    .front()
                    .map_or(stamp_nanos, |r| r.stamp_nanos)
                    .max(self.last_motion_nanos);
                // People pause while moving an object: a short rest is not a state.
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
                // Too little was seen; the state starts again once the object is at rest.
                (state, false) => Stage::Moving(state),
            };
            return Turn::Moved(state);
        }
        // Motion in one view may be noise: the view is neither used for comparison nor acted on.
        if !moved {
            self.remember_view(view);
        }
        // State 0 ends with motion; no motion follows state 1, so a number of views ends it.
        if state == 1 && kept >= self.rule.enough {
            self.stage = Stage::Over;
            return Turn::Finish(1);
        }
        Turn::None
    }

    /// Stores the first views and a sample of the later ones, so that slow motion is noticed too.
    fn remember_view(&mut self, view: Small) {
        self.seen += 1;
        if self.references.len() < REFERENCES {
            self.references.push_back(view);
        } else if self.seen.is_multiple_of(4) {
            self.references.pop_front();
            self.references.push_back(view);
        }
    }

    /// Whether a view contradicts the stored ones.
    fn shows_motion(&self, view: &Small) -> bool {
        let mut compared = 0;
        let mut through = 0;
        for reference in &self.references {
            // Both ways: the new view looks through a part that is gone, the old view through one that
            // appeared.
            for (from, to) in [(reference, view), (view, reference)] {
                let (n, t) = from.looked_through_by(to);
                compared += n;
                through += t;
            }
        }
        // Few points are no evidence, and single ones are noise at edges.
        compared >= MIN_POINTS && through as f64 > MOVED_SHARE * compared as f64
    }
}

impl Small {
    fn of_frame(frame: &RgbdFrame) -> Self {
        let full = &frame.intrinsics;
        // Low resolution, as each view is compared with twelve others at 30 Hz.
        let scale = [WIDTH as f64 / full.width as f64, HEIGHT as f64 / full.height as f64];
        // Sample k is the pixel at the center of its cell.
        let place = |k: usize, scale: f64, size: usize| (((k as f64 + 0.5) / scale) as usize).min(size - 1);
        let cells = (0..WIDTH * HEIGHT).map(|k| {
            place(k / WIDTH, scale[1], full.height) * full.width + place(k % WIDTH, scale[0], full.width)
        });
        let at: Vec<usize> = cells.collect();
        Self {
            camera: full.at_size(WIDTH, HEIGHT),
            world_from_camera: frame.world_from_camera,
            depth_m: at.iter().map(|i| frame.depth_m[*i]).collect(),
            object: at.iter().map(|i| frame.mask.as_ref().is_none_or(|m| m[*i])).collect(),
            stamp_nanos: frame.stamp_nanos,
        }
    }

    /// Number of this view's object points that the other view can judge, and of those that it looks through.
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
            // Behind the other camera, or closer than depth cameras measure.
            if p.z < 0.05 {
                continue;
            }
            let u = c.fx * p.x / p.z + c.cx;
            let v = c.fy * p.y / p.z + c.cy;
            let Some(nearest) = other.nearest_depth_m(u, v) else { continue };
            // A closer surface occludes the point, which is then not compared.
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

    /// The least depth of the four samples around a position, so that edges are not taken for holes; `None`
    /// where one is unknown.
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

    const S: i64 = 1_000_000_000;

    /// A wall at 1.5 m with a box in front of it whose face stands at `face_m`, seen from `x`.
    fn view(stamp_nanos: i64, x: f64, face_m: f64) -> RgbdFrame {
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
        RgbdFrame {
            id: String::new(),
            stamp_nanos,
            intrinsics: camera,
            world_from_camera: Pose::new(Vector3::new(x, 0.0, 0.0), Vector3::zeros()),
            rgb: vec![[0; 3]; size],
            depth_m: (0..size).map(depth).collect(),
            mask: None,
            readings: Vec::new(),
        }
    }

    /// Turns of a watch over views every 0.1 s; `face_m` by the number of the view.
    fn turns(views: usize, face_m: impl Fn(usize) -> f64) -> Vec<(usize, Turn)> {
        let mut watch = MotionWatch::new(WatchRule { still_nanos: S, least: 5, enough: 8 });
        let mut kept = [0; 2];
        let mut state = 0;
        let mut found = Vec::new();
        for i in 0..views {
            let frame = view(i as i64 * S / 10, 0.2 * (0.3 * i as f64).sin(), face_m(i));
            match watch.see_view(&frame, kept) {
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
