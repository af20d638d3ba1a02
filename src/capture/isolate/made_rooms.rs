//! The isolation on made rooms, read with errors as a stereo matcher makes them.

use nalgebra::{Point3, Vector3};
use rand_core::Rng;

use super::{
    background::in_box,
    cells_of_frames, isolate,
    plane::tests::{Block, hit, normal},
    refuse_room,
    select::Object,
    voxels::Cell,
};
use crate::{Capture, CaptureConfig, CaptureError, NoiseConfig, RgbdFrame};
use common::stop::Stop;
use geometry::{Intrinsics, Pose};
use numeric::random::stage_rng;

const CAMERA: Intrinsics = Intrinsics { width: 160, height: 120, fx: 140.0, fy: 140.0, cx: 79.5, cy: 59.5 };
/// Pixels between the nodes of an error that neighbors share.
const NODE: usize = 10;
/// Columns and rows of nodes.
const NODES: [usize; 2] = [160 / NODE + 2, 120 / NODE + 2];
/// Standard deviation of that error at 1 m, meters, three times that of the noise.
const MATCHER_M: f64 = 0.009;
const VIEWS: usize = 10;
const FLOOR: Block = [[-9.0, -9.0, -0.1], [9.0, 9.0, 0.0]];

/// A room: what stands in each state, where the cameras look, and from how far.
struct Room {
    states: [Vec<Block>; 2],
    target: Point3<f64>,
    distance_m: f64,
}

impl Room {
    fn frame(&self, state: usize, view: usize, rng: &mut impl Rng) -> RgbdFrame {
        let angle = -0.7 + 1.4 * view as f64 / (VIEWS - 1) as f64;
        let height_m = if view.is_multiple_of(2) { 0.7 } else { 0.35 } * self.distance_m;
        let away = Vector3::new(angle.sin(), -angle.cos(), 0.0) * self.distance_m;
        let eye = self.target + away + Vector3::z() * height_m;
        let world_from_camera = Pose::face_towards(&eye, &self.target, &-Vector3::z());
        let nodes: Vec<f64> = (0..NODES[0] * NODES[1]).map(|_| normal(rng)).collect();
        let mut depth_m = Vec::new();
        for p in 0..CAMERA.width * CAMERA.height {
            let [u, v] = [p % CAMERA.width, p / CAMERA.width];
            let ray = world_from_camera.rotation * CAMERA.ray_at(u as f64, v as f64);
            let hits = self.states[state].iter().filter_map(|b| hit(&eye, &ray, b));
            let d = hits.fold(f64::INFINITY, f64::min);
            let error = MATCHER_M * shared_error(&nodes, u, v) + 0.001 * normal(rng);
            depth_m.push(if d < 6.0 { (d + d * d * error) as f32 } else { 0.0 });
        }
        RgbdFrame {
            id: format!("{state}_{view:04}"),
            stamp_nanos: 0,
            intrinsics: CAMERA,
            world_from_camera,
            rgb: vec![[0; 3]; CAMERA.width * CAMERA.height],
            depth_m,
            mask: None,
            readings: Vec::new(),
        }
    }

    fn capture(&self) -> Capture {
        let mut capture = Capture::of_states(2);
        capture.noise = NoiseConfig::default();
        for state in 0..2 {
            let rng = &mut stage_rng(7, "made room", state as u64);
            capture.states[state] = (0..VIEWS).map(|view| self.frame(state, view, rng)).collect();
        }
        capture
    }

    fn isolated(&self) -> Result<Found, CaptureError> {
        let raw = self.capture();
        let mut capture = raw.clone();
        let rng = &mut stage_rng(0, "made room/isolate", 0);
        isolate(&mut capture, &CaptureConfig::default(), rng, &Stop::never())?;
        Ok(Found { raw, capture })
    }
}

/// A room as it was read, and with the object isolated.
struct Found {
    raw: Capture,
    capture: Capture,
}

impl Found {
    /// Share of the readings of a state in a box that are kept as the object.
    fn kept_in(&self, state: usize, block: &Block) -> f64 {
        let [kept, all] = self.counts(state, block);
        kept as f64 / all as f64
    }

    /// Share of what is kept as the object in a state that lies in a box.
    fn share_in(&self, state: usize, block: &Block) -> f64 {
        let everywhere = [[-99.0; 3], [99.0; 3]];
        self.counts(state, block)[0] as f64 / self.counts(state, &everywhere)[0] as f64
    }

    /// Number of readings in a box that are kept, and of all in it.
    fn counts(&self, state: usize, block: &Block) -> [usize; 2] {
        let mut counts = [0, 0];
        for (raw, frame) in self.raw.states[state].iter().zip(&self.capture.states[state]) {
            for pixel in 0..raw.depth_m.len() {
                let Some(point) = raw.world_point(pixel) else { continue };
                if in_box(Some(*block), &point) {
                    counts[0] += usize::from(frame.is_object(pixel) && frame.depth_m[pixel] > 0.0);
                    counts[1] += 1;
                }
            }
        }
        counts
    }

    fn notes(&self) -> Vec<&str> {
        self.capture.notes.iter().map(|n| n.text.as_str()).collect()
    }
}

/// The error at a pixel between its four nodes.
fn shared_error(nodes: &[f64], u: usize, v: usize) -> f64 {
    let at = (v / NODE) * NODES[0] + u / NODE;
    let [right, down] = [u % NODE, v % NODE].map(|k| k as f64 / NODE as f64);
    let rows = [at, at + NODES[0]].map(|i| (1.0 - right) * nodes[i] + right * nodes[i + 1]);
    // Variance is less between nodes.
    1.5 * ((1.0 - down) * rows[0] + down * rows[1])
}

const WALL_BEHIND: Block = [[-9.0, 0.7, 0.0], [9.0, 0.8, 3.0]];
const WALL_LEFT: Block = [[-1.7, -9.0, 0.0], [-1.6, 9.0, 3.0]];
const WALL_RIGHT: Block = [[1.6, -9.0, 0.0], [1.7, 9.0, 3.0]];

/// A chest with a drawer that is drawn so far, meters.
fn chest(drawn_m: f64) -> [Block; 2] {
    let drawer = [[-0.22, -0.25 - drawn_m, 0.3], [0.22, -0.2, 0.55]];
    [[[-0.25, -0.25, 0.0], [0.25, 0.25, 0.6]], drawer]
}

#[test]
fn a_chest_before_one_two_or_three_walls_is_found() {
    let boxes = [[[0.7, 0.3, 0.0], [0.9, 0.5, 0.25]], [[-0.9, 0.1, 0.0], [-0.75, 0.25, 0.15]]];
    for walls in [&[WALL_BEHIND][..], &[WALL_BEHIND, WALL_LEFT], &[WALL_BEHIND, WALL_LEFT, WALL_RIGHT]] {
        let around = [&[FLOOR][..], walls, &boxes].concat();
        let states = [0.03, 0.22].map(|drawn_m| [&around[..], &chest(drawn_m)].concat());
        let found = Room { states, target: Point3::new(0.0, 0.0, 0.3), distance_m: 1.5 }.isolated().unwrap();
        for state in 0..2 {
            let whole = [[-0.3, -0.55, 0.1], [0.3, 0.3, 0.65]];
            let kept = found.kept_in(state, &whole);
            let share = found.share_in(state, &[[-0.35, -0.6, -0.1], [0.35, 0.35, 0.7]]);
            let case = format!("{} walls, state {state}: {kept} {share} {:?}", walls.len(), found.notes());
            assert!(kept > 0.8 && share > 0.95, "{case}");
        }
    }
}

#[test]
fn a_door_that_is_shut_in_its_wall_is_found_with_the_wall_about_it() {
    let jambs = [
        [[-4.0, 0.0, 0.0], [-0.4, 0.1, 3.0]],
        [[0.4, 0.0, 0.0], [4.0, 0.1, 3.0]],
        [[-0.4, 0.0, 1.6], [0.4, 0.1, 3.0]],
    ];
    let next_room = [[-9.0, 2.0, 0.0], [9.0, 2.1, 3.0]];
    let around = [&[FLOOR, next_room][..], &jambs].concat();
    let shut = [[-0.4, 0.0, 0.0], [0.4, 0.04, 1.6]];
    let open = [[-0.44, -0.8, 0.0], [-0.4, 0.0, 1.6]];
    let states = [shut, open].map(|door| [&around[..], &[door]].concat());
    let found = Room { states, target: Point3::new(0.0, 0.0, 0.9), distance_m: 2.2 }.isolated().unwrap();
    let ajar = found.kept_in(1, &[[-0.6, -0.75, 0.2], [-0.3, -0.2, 1.5]]);
    let in_wall = found.kept_in(0, &[[-0.35, -0.15, 0.3], [0.35, 0.15, 1.5]]);
    let wall = found.kept_in(1, &[[0.45, -0.1, 0.4], [0.6, 0.1, 1.5]]);
    let far = found.kept_in(1, &[[1.3, -0.5, 0.0], [4.0, 0.5, 3.0]]);
    let case = format!("{ajar} {in_wall} {wall} {far} {:?}", found.notes());
    assert!(ajar > 0.7 && in_wall > 0.7 && wall > 0.7 && far < 0.05, "{case}");
}

#[test]
fn a_drawer_that_was_flush_with_its_front_is_found_with_the_front_about_it() {
    let around = vec![FLOOR, [[-3.0, 0.0, 0.0], [3.0, 0.6, 3.0]]];
    let drawer = [[-0.25, -0.25, 0.45], [0.25, 0.0, 0.7]];
    let states = [around.clone(), [&around[..], &[drawer]].concat()];
    let found = Room { states, target: Point3::new(0.0, 0.0, 0.6), distance_m: 1.4 }.isolated().unwrap();
    let drawn = found.kept_in(1, &[[-0.28, -0.3, 0.42], [0.28, -0.05, 0.75]]);
    let flush = found.kept_in(0, &[[-0.25, -0.05, 0.45], [0.25, 0.05, 0.7]]);
    let far = found.kept_in(0, &[[0.8, -0.3, 0.0], [3.0, 0.7, 0.8]]);
    assert!(drawn > 0.7 && flush > 0.7 && far < 0.05, "{drawn} {flush} {far} {:?}", found.notes());
}

#[test]
fn a_thing_at_the_edge_of_a_table_is_found() {
    let table = [[-1.2, -0.4, 0.7], [1.2, 0.9, 0.74]];
    let base = [[-0.15, -0.4, 0.74], [0.15, -0.15, 0.9]];
    let other = [[-0.5, 0.0, 0.74], [-0.4, 0.1, 0.85]];
    let around = [FLOOR, [[-9.0, 1.5, 0.0], [9.0, 1.6, 3.0]], table, base, other];
    let lids = [[[-0.15, -0.4, 0.9], [0.0, -0.15, 1.0]], [[0.0, -0.4, 0.9], [0.15, -0.15, 1.0]]];
    let states = lids.map(|lid| [&around[..], &[lid]].concat());
    let found = Room { states, target: Point3::new(0.0, -0.2, 0.85), distance_m: 0.8 }.isolated().unwrap();
    for state in 0..2 {
        let kept = found.kept_in(state, &[[-0.2, -0.45, 0.78], [0.2, -0.1, 1.05]]);
        let share = found.share_in(state, &[[-0.22, -0.47, 0.68], [0.22, -0.08, 1.07]]);
        assert!(kept > 0.8 && share > 0.9, "state {state}: {kept} {share} {:?}", found.notes());
    }
}

/// Blocks moved up.
fn raised(blocks: &[Block], by_m: f64) -> Vec<Block> {
    let raise = |corner: [f64; 3]| [corner[0], corner[1], corner[2] + by_m];
    blocks.iter().map(|[lower, upper]| [raise(*lower), raise(*upper)]).collect()
}

#[test]
fn a_table_whose_edges_are_seen_is_not_of_the_object_on_it() {
    let table = [[-0.6, -0.65, 0.66], [0.6, 0.5, 0.7]];
    let around = [FLOOR, WALL_BEHIND, table];
    let states = [0.03, 0.22].map(|drawn_m| [&around[..], &raised(&chest(drawn_m), 0.7)].concat());
    let found = Room { states, target: Point3::new(0.0, 0.0, 1.0), distance_m: 1.7 }.isolated().unwrap();
    for state in 0..2 {
        let kept = found.kept_in(state, &[[-0.3, -0.55, 0.8], [0.3, 0.3, 1.35]]);
        let share = found.share_in(state, &[[-0.35, -0.6, 0.66], [0.35, 0.35, 1.4]]);
        assert!(kept > 0.8 && share > 0.95, "state {state}: {kept} {share} {:?}", found.notes());
    }
}

#[test]
fn the_top_of_a_box_is_not_a_stand_of_its_cap() {
    // The box's top is level, wider than what moves on it, and nothing that moves lies below it.
    let around = [FLOOR, WALL_BEHIND, [[-0.17, -0.13, 0.0], [0.17, 0.13, 0.12]]];
    let handles = [[[-0.07, -0.02, 0.12], [0.07, 0.02, 0.2]], [[-0.02, -0.07, 0.12], [0.02, 0.07, 0.2]]];
    let states = handles.map(|handle| [&around[..], &[handle]].concat());
    let found = Room { states, target: Point3::new(0.0, 0.0, 0.1), distance_m: 0.7 }.isolated().unwrap();
    for state in 0..2 {
        let kept = found.kept_in(state, &[[-0.19, -0.15, 0.05], [0.19, 0.15, 0.22]]);
        let share = found.share_in(state, &[[-0.2, -0.16, -0.05], [0.2, 0.16, 0.25]]);
        assert!(kept > 0.8 && share > 0.9, "state {state}: {kept} {share} {:?}", found.notes());
    }
}

#[test]
fn things_beside_the_object_on_one_rug_are_not_of_it() {
    let rug = [[-1.0, -1.0, 0.0], [1.0, 0.5, 0.012]];
    let boxes = [[[0.45, -0.2, 0.0], [0.65, 0.0, 0.4]], [[-0.7, 0.0, 0.0], [-0.45, 0.25, 0.3]]];
    let around = [&[FLOOR, WALL_BEHIND, rug][..], &boxes].concat();
    let states = [0.03, 0.22].map(|drawn_m| [&around[..], &chest(drawn_m)].concat());
    let found = Room { states, target: Point3::new(0.0, 0.0, 0.3), distance_m: 1.5 }.isolated().unwrap();
    for state in 0..2 {
        let kept = found.kept_in(state, &[[-0.3, -0.55, 0.1], [0.3, 0.3, 0.65]]);
        let share = found.share_in(state, &[[-0.4, -0.65, -0.1], [0.4, 0.4, 0.7]]);
        assert!(kept > 0.8 && share > 0.95, "state {state}: {kept} {share} {:?}", found.notes());
    }
}

#[test]
fn a_room_is_not_taken_for_the_object() {
    let states = [0.03, 0.22].map(|drawn_m| [&[FLOOR, WALL_BEHIND][..], &chest(drawn_m)].concat());
    let capture = Room { states, target: Point3::new(0.0, 0.0, 0.3), distance_m: 1.5 }.capture();
    let size_m = 0.025;
    let mut room = Vec::new();
    for frames in &capture.states {
        room.extend(cells_of_frames(frames, size_m, &Stop::never()).unwrap().concat());
    }
    room.sort_unstable();
    room.dedup();
    let is_of_chest = |c: &Cell| (-13..13).contains(&c[0]) && (-22..12).contains(&c[1]) && c[2] > 1;
    let chest: Vec<Cell> = room.iter().filter(|c| is_of_chest(c)).copied().collect();
    let refused = |cells: &[Cell]| {
        let object = Object { cells: cells.to_vec(), is_by_change: true, note: String::new() };
        refuse_room(&capture, &object, size_m, &Stop::never()).map_err(|e| e.to_string())
    };
    assert_eq!(refused(&chest), Ok(()));
    let reason = refused(&room).unwrap_err();
    assert!(reason.contains("it is the room") && reason.contains("--at"), "{reason}");
}
