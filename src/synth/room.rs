//! A room around an object: floor, one to three walls of plain paint, and things by seed.

use nalgebra::Point3;
use numeric::random::{self, StageRng, stage_rng};

use super::{
    CameraPath, Lacquer, Material, Object, Solid, SynthConfig,
    reach::{Extent, reach_of_object},
    things,
};
use geometry::Pose;

/// Objects whose reach has a smaller half diagonal stand on a table, meters. chosen: what two hands carry
const TABLE_RADIUS_M: f64 = 0.45;
/// Height of a table, meters. chosen: usual tables
const TABLE_M: f64 = 0.72;
/// Thickness of its top, meters. chosen: usual tables
const TOP_M: f64 = 0.03;
/// Range of the way from an object's reach to the edge of the table, meters.
/// chosen: the edge is in the images
const TABLE_RIM_M: [f64; 2] = [0.06, 0.3];
/// Range of the gap between an object's reach and the wall behind it, meters. chosen: furniture at a wall
const BACK_GAP_M: [f64; 2] = [0.0, 0.4];
/// Range of the way from an object's middle to a side wall, in half diagonals of its reach.
/// chosen: a camera that shows the whole object fits on this side, not all around
const SIDE_RADII: [f64; 2] = [2.0, 3.5];
/// Height and thickness of walls, meters. chosen: usual rooms
const WALL_M: f64 = 2.6;
const WALL_THICK_M: f64 = 0.1;
/// Half the length of walls, meters. chosen: beyond the images
const WALL_HALF_M: f64 = 5.0;
/// Shares of rooms with a second wall, and of these with a third. chosen: corners are usual
const SECOND_WALL: f64 = 0.65;
const THIRD_WALL: f64 = 0.4;
/// Thickness of a rug and the gap before an object's reach, meters. chosen: nothing touches it
const RUG_M: f64 = 0.008;
const RUG_GAP_M: f64 = 0.02;
/// Thickness of a window or mirror on a wall, meters. chosen: stands out of the paint, casts no shadow
const PANE_M: f64 = 0.002;
/// Half the sweep of a camera in a room, radians: 75 degrees. chosen: people stand in front of things
const HALF_SWEEP_RAD: f64 = 1.3;
/// Least way from a camera to anything in the room, meters. chosen: a camera and the hand that holds it
const CAMERA_GAP_M: f64 = 0.15;
/// Step by which a sweep is shortened, radians. chosen: far below any sweep
const SWEEP_STEP_RAD: f64 = 0.02;
/// Poses of a path that are looked at.
const PATH_POSES: usize = 240;

/// What stands around an object. It depends on the seed and the object's shape, not on joint positions.
#[derive(Clone, Debug)]
pub struct Room {
    /// Walls and things, in the world.
    pub solids: Vec<Solid>,
    /// Material of the floor: plain paint.
    pub floor: Material,
    /// Height of the floor below the object's foot, meters: 0, or that of a table.
    pub foot_height_m: f64,
}

impl Room {
    /// The room of a configuration; `None` where none is requested.
    pub fn of_config(object: &Object, config: &SynthConfig) -> Option<Self> {
        config.room.then(|| Self::drawn(object, &mut stage_rng(config.seed, "synth/room", 0)))
    }

    /// A random room around an object.
    pub fn drawn(object: &Object, rng: &mut StageRng) -> Self {
        let reach = reach_of_object(object);
        let is_on_table = reach.half_diagonal_m() < TABLE_RADIUS_M;
        let foot_height_m = if is_on_table { TABLE_M } else { 0.0 };
        let back_m = reach.lower.x - random::uniform_in(rng, BACK_GAP_M[0], BACK_GAP_M[1]);
        let mut plan =
            Plan { reach, back_m, sides_m: [None; 2], floor_m: -foot_height_m, solids: Vec::new() };
        plan.add_walls(rng);
        let top = if is_on_table { Some(plan.add_table(rng)) } else { None };
        plan.add_rug(rng);
        plan.add_pane(rng);
        plan.solids.extend(things::shelf_with_things(&plan.reach, plan.back_m, rng));
        let floor = things::drawn_paint([0.25, 0.55], rng);
        plan.add_boxes(top.as_ref(), rng);
        let world_from_rest = object.world_from_rest;
        let solids = plan.solids.into_iter().map(|solid| solid.moved(&world_from_rest)).collect();
        Self { solids, floor, foot_height_m }
    }

    /// A path with its sweep shortened, so that the camera keeps clear of everything in the room.
    pub fn limited_path(&self, path: CameraPath) -> CameraPath {
        let mut sweep_rad = [-HALF_SWEEP_RAD, HALF_SWEEP_RAD];
        loop {
            let limited = path.clone().with_sweep(sweep_rad);
            let times = (0..=PATH_POSES).map(|i| i as f64 / PATH_POSES as f64);
            let blocked = times.map(|t| (t, limited.pose_at(t))).find(|(_, pose)| !self.is_clear_of(pose));
            let Some((time, _)) = blocked else { return limited };
            // The side of the sweep on which the camera stands.
            let is_first = limited.sweep_at(time) < 0.5 * (sweep_rad[0] + sweep_rad[1]);
            sweep_rad[usize::from(!is_first)] += if is_first { SWEEP_STEP_RAD } else { -SWEEP_STEP_RAD };
            if sweep_rad[0] >= sweep_rad[1] {
                return limited;
            }
        }
    }

    /// Whether a camera at a pose keeps clear of everything.
    fn is_clear_of(&self, world_from_camera: &Pose) -> bool {
        let eye = Point3::from(world_from_camera.translation.vector);
        self.solids.iter().all(|solid| distance_to_box(solid, &eye) > CAMERA_GAP_M)
    }
}

/// Distance from a point to the box around a solid, meters; 0 inside.
pub(super) fn distance_to_box(solid: &Solid, point: &Point3<f64>) -> f64 {
    let at = solid.part_from_solid.inverse() * point;
    (at.coords.abs() - solid.shape.half_sides()).map(|over| over.max(0.0)).norm()
}

/// A room in the making, in the object's rest frame: the front of the object faces +x.
struct Plan {
    reach: Extent,
    /// x of the wall behind the object.
    back_m: f64,
    /// y of the side walls, if they are there.
    sides_m: [Option<f64>; 2],
    /// z of the floor.
    floor_m: f64,
    solids: Vec<Solid>,
}

impl Plan {
    fn add_walls(&mut self, rng: &mut StageRng) {
        let paint = things::drawn_paint([0.5, 0.85], rng);
        let top_m = self.floor_m + WALL_M;
        self.solids.push(Solid::box_between(
            [self.back_m - WALL_THICK_M, -WALL_HALF_M, self.floor_m],
            [self.back_m, WALL_HALF_M, top_m],
            &paint,
        ));
        let has_second = random::is_chosen(rng, SECOND_WALL);
        let has_third = has_second && random::is_chosen(rng, THIRD_WALL);
        let first = random::index_below(rng, 2);
        for side in [first, 1 - first].into_iter().take(usize::from(has_second) + usize::from(has_third)) {
            let away_m = self.reach.half_diagonal_m() * random::uniform_in(rng, SIDE_RADII[0], SIDE_RADII[1]);
            let sign = if side == 0 { -1.0 } else { 1.0 };
            let inner_m = self.reach.center().y + sign * away_m;
            let outer_m = inner_m + sign * WALL_THICK_M;
            self.sides_m[side] = Some(inner_m);
            self.solids.push(Solid::box_between(
                [self.back_m, inner_m.min(outer_m), self.floor_m],
                [self.back_m + 2.0 * WALL_HALF_M, inner_m.max(outer_m), top_m],
                &paint,
            ));
        }
    }

    /// Adds a table below the object; its top.
    fn add_table(&mut self, rng: &mut StageRng) -> Extent {
        let wood = things::drawn_paint([0.2, 0.6], rng);
        let mut rim = || random::uniform_in(rng, TABLE_RIM_M[0], TABLE_RIM_M[1]);
        let behind_m = (self.reach.lower.x - rim()).max(self.back_m);
        let lower = Point3::new(behind_m, self.reach.lower.y - rim(), -TOP_M);
        let upper = Point3::new(self.reach.upper.x + rim(), self.reach.upper.y + rim(), 0.0);
        self.solids.push(Solid::box_between(lower.into(), upper.into(), &wood));
        let leg_m = 2.0 * TOP_M;
        for x in [lower.x, upper.x - leg_m] {
            for y in [lower.y, upper.y - leg_m] {
                let [from, to] = [[x, y, self.floor_m], [x + leg_m, y + leg_m, -TOP_M]];
                self.solids.push(Solid::box_between(from, to, &wood));
            }
        }
        Extent { lower, upper }
    }

    fn add_rug(&mut self, rng: &mut StageRng) {
        let paint = things::drawn_paint([0.15, 0.6], rng);
        // Before the object, or before its table.
        let from_m = self.reach.upper.x + RUG_GAP_M + if self.floor_m < 0.0 { TABLE_RIM_M[1] } else { 0.0 };
        let middle_m = self.reach.center().y;
        let half_m = random::uniform_in(rng, 0.4, 0.9).min(self.free_half_width_m());
        let long_m = random::uniform_in(rng, 0.6, 1.2);
        self.solids.push(Solid::box_between(
            [from_m, middle_m - half_m, self.floor_m],
            [from_m + long_m, middle_m + half_m, self.floor_m + RUG_M],
            &paint,
        ));
    }

    /// Half the width of the floor that is free about the object's middle.
    fn free_half_width_m(&self) -> f64 {
        let middle_m = self.reach.center().y;
        self.sides_m.iter().flatten().map(|side| (side - middle_m).abs()).fold(WALL_HALF_M, f64::min)
    }

    /// Adds a window or a mirror to a side wall, or to the wall behind where there is none: it has no depth.
    fn add_pane(&mut self, rng: &mut StageRng) {
        let glass = Material { lacquer: Some(Lacquer::everywhere()), ..things::drawn_paint([0.5, 1.0], rng) };
        let half_m = random::uniform_in(rng, 0.25, 0.45);
        let [low, high] = [0.9, 1.9].map(|z| self.floor_m + z);
        let along_m = random::uniform_in(rng, 0.1, 0.8);
        let side = self.sides_m.iter().flatten().next();
        self.solids.push(if let Some(wall) = side {
            let inner_m = wall - (wall - self.reach.center().y).signum() * PANE_M;
            let from_m = self.back_m + along_m;
            let [from, to] = [wall.min(inner_m), wall.max(inner_m)];
            Solid::box_between([from_m, from, low], [from_m + 2.0 * half_m, to, high], &glass)
        } else {
            let middle_m = self.reach.lower.y - half_m - along_m;
            let [from, to] = [middle_m - half_m, middle_m + half_m];
            Solid::box_between([self.back_m, from, low], [self.back_m + PANE_M, to, high], &glass)
        });
    }

    /// Adds boxes and cans on the floor, and on a table.
    fn add_boxes(&mut self, top: Option<&Extent>, rng: &mut StageRng) {
        // Things keep out of all that is there, the object's reach and the table included.
        let mut taken: Vec<Extent> = self.solids.iter().map(Extent::of_solid).collect();
        taken.push(self.reach);
        let radius_m = self.reach.half_diagonal_m();
        let center = self.reach.center();
        let mut places = vec![
            (
                Extent {
                    lower: Point3::new(self.back_m, center.y - 2.0 * radius_m, self.floor_m),
                    upper: Point3::new(center.x + 1.2 * radius_m, center.y + 2.0 * radius_m, self.floor_m),
                },
                [0.1, 0.25],
            );
            things::ON_FLOOR
        ];
        if let Some(top) = top {
            let lower = Point3::new(top.lower.x, top.lower.y, 0.0);
            places.extend(vec![(Extent { lower, upper: top.upper }, [0.02, 0.06]); things::ON_TABLE]);
        }
        for (place, half_sides_m) in places {
            let Some(thing) = things::thing_on(&place, half_sides_m, &taken, rng) else { continue };
            taken.push(Extent::of_solid(&thing));
            self.solids.push(thing);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Family, generate, recording::camera_path};

    #[test]
    fn rooms_keep_clear_of_the_object_and_of_the_cameras() {
        let mut tables = 0;
        let mut walls = 0;
        for (seed, family) in (0..30).zip(Family::ALL.into_iter().cycle()) {
            let config = SynthConfig { seed, family: Some(family), room: true, ..SynthConfig::default() };
            let object = generate(&config).unwrap();
            let room = Room::of_config(&object, &config).unwrap();
            tables += usize::from(room.foot_height_m > 0.0);
            walls += room.solids.iter().filter(|s| s.shape.half_sides().max() == WALL_HALF_M).count();
            // The whole way of every joint by itself, and both states.
            let mut states = vec![object.clone()];
            for k in 1..object.parts.len() {
                let mut moved = object.clone();
                let joint = moved.parts[k].joint.as_mut().unwrap();
                joint.positions = joint.limits;
                states.push(moved);
            }
            for state in states.iter().flat_map(|o| [0, 1].map(|k| o.meshes_in_world(k))).flatten() {
                for vertex in &state.vertices {
                    let inside =
                        room.solids.iter().filter(|s| distance_to_box(s, &vertex.cast()) == 0.0).count();
                    // The object stands on its table.
                    let is_foot = f64::from(vertex.z) < 1e-6;
                    assert!(inside == 0 || is_foot, "{} {seed} {vertex}", family.name());
                }
            }
            for state in 0..2 {
                let path = camera_path(&object, state, &config);
                for i in 0..=1000 {
                    let eye = Point3::from(path.pose_at(f64::from(i) / 1000.0).translation.vector);
                    let away = room.solids.iter().map(|s| distance_to_box(s, &eye)).fold(9.0, f64::min);
                    assert!(away > 0.1, "{} {seed} {away}", family.name());
                }
                let [low, high] = path.sweep();
                assert!(high - low > 1.2, "{} {seed} {low} {high}", family.name());
            }
        }
        assert!(tables > 5 && tables < 25 && walls > 40, "{tables} {walls}");
    }
}
