//! Grasps of a moving part for a parallel gripper: a narrow piece of it between two free slots
//! (docs/method.md 10.5).

use std::f64::consts::FRAC_PI_4;

use nalgebra::{Matrix3, Point3, Rotation3, Unit, UnitQuaternion, Vector3};

use super::{
    ArticulatedModel, Grasp, Joint, Limit,
    grasp_space::{Block, STANDS_OFF_M, SeenCells, Shape, Span},
};
use geometry::Pose;
use surface::{ConvexSolid, Plane};

/// Widest opening, meters. derived: data sheet of the Franka Hand, a usual parallel hand
const GAP_M: f64 = 0.08;
/// A finger: thickness along the closing direction, width across it, length, meters. chosen: boxes around
/// those of the Franka Hand, as in `run/demonstrate/panda.py`
const FINGER_M: [f64; 3] = [0.012, 0.02, 0.045];
/// The palm: half its size along the closing direction and across it, and its full depth, meters. chosen: as
/// [`FINGER_M`]
const PALM_M: [f64; 3] = [0.1, 0.03, 0.06];
/// Length of the hand's straight approach to the grasp, meters. derived: as in `artitwin demo`
const APPROACH_M: f64 = 0.08;
/// Distance from the fingertips back to the center of the pads, meters. derived: as in `artitwin demo`
const PAD_M: f64 = 0.008;
/// Friction coefficient between pad and part. chosen: of the order of rubber on wood or paint
const FRICTION: f64 = 1.0;
/// Distance between tried places on a face, and of the outermost from its rim, meters.
/// chosen: half a finger's width
const STEP_M: f64 = 0.01;
/// Largest number of places along a face, beside the first.
const MOST_STEPS: usize = 24;
/// Number of steps of the joint between its limits at which the hand must be free.
const POSITIONS: usize = 8;
/// Largest number of grasps of a part.
const MOST: usize = 3;
/// Least distance of two of them, meters. chosen: two fingers side by side
const APART_M: f64 = 0.04;
/// A place is left out if it is worth less than the best by this. chosen: beside a handle no rim is needed
const WORSE: f64 = 0.9;
/// Largest cosine between the approach and the direction in which the part opens. chosen: views saw little of
/// the space behind it
const FROM_BEHIND: f64 = 0.5;
/// Least lever, as a share of the part's largest. chosen: near a hinge a door's rim is no handle
const LEAST_LEVER: f64 = 0.3;
/// Weights of the terms beside the lever. tuned: near those of `artitwin demo`: it opened 10 of 10 handles
const WEIGHTS: Weights = Weights {
    handle: 1.4,
    touch: 1.0,
    shape: 0.3,
    face: 1.0,
    straight: 0.3,
    narrow_per_m: 4.0,
    middle_per_m: 0.5,
};
/// Depth behind a part's foremost place over which the worth of a handle fades, meters.
/// derived: as in `artitwin demo`
const HANDLE_M: f64 = 0.015;

/// Weights of the terms in a grasp's worth.
struct Weights {
    /// For a place that stands out of the part's face.
    handle: f64,
    /// For the share of both pads, at twice their width, that lies on seen surface.
    touch: f64,
    /// For a part that moves in the direction in which the fingers close: a finger drags it along.
    shape: f64,
    /// For faces perpendicular to the closing direction.
    face: f64,
    /// For an approach along an axis of the part.
    straight: f64,
    /// For a narrow part, per meter of width.
    narrow_per_m: f64,
    /// For a place near the center of the face, per meter of distance.
    middle_per_m: f64,
}

/// Poses at which a gripper can hold a joint's child, best first; empty if no hand fits. The hand is free of
/// all solids with the twin closed (in state 0 if no closed end is known), on its approach, and with the
/// joint anywhere between its limits; and it stays above the lowest solid, where the object stands.
pub fn grasps_of_joint(model: &ArticulatedModel, j: usize) -> Vec<Grasp> {
    let Some(scene) = Scene::of_joint(model, j) else { return Vec::new() };
    let mut found: Vec<(f64, Grasp)> = model.links[model.joints[j].child]
        .collision
        .iter()
        .flat_map(seeds_of_solid)
        .flat_map(|s| scene.grasps_at(&s))
        .collect();
    // Equal ones stay in order, so rounding does not choose among them.
    let rank = |value: f64| (1e6 * value).round();
    found.sort_by(|a, b| rank(b.0).total_cmp(&rank(a.0)));
    let mut kept: Vec<(f64, Grasp)> = Vec::new();
    for (worth, grasp) in found {
        if kept.len() == MOST || kept.first().is_some_and(|best| worth < best.0 - WORSE) {
            break;
        }
        let at = |g: &Grasp| g.link_from_grasp.translation.vector;
        let is_new = kept.iter().all(|(_, k)| (at(k) - at(&grasp)).norm() >= APART_M);
        if is_new && scene.is_free_on_the_way(&grasp) {
            kept.push((worth, grasp));
        }
    }
    kept.into_iter().map(|(_, grasp)| grasp).collect()
}

/// A place on a face of a part, in its frame.
struct Seed {
    at: Point3<f64>,
    normal: Vector3<f64>,
    /// Distance from the middle of the face, meters.
    off_middle_m: f64,
}

/// Places on the faces of a solid, spread evenly around the center of each face.
fn seeds_of_solid(solid: &ConvexSolid) -> Vec<Seed> {
    let planes = solid.face_planes();
    let mut seeds: Vec<Seed> =
        solid.faces.iter().filter_map(|face| seeds_on_face(solid, face)).flatten().collect();
    seeds.retain(|s| planes.iter().all(|q| q.distance_m(&s.at) < 1e-6));
    seeds
}

/// Places around the center of a face; some may lie beside it. `None` for a face without area.
fn seeds_on_face(solid: &ConvexSolid, face: &[u32]) -> Option<Vec<Seed>> {
    let normal = solid.face_plane(face)?.normal;
    let corners: Vec<Point3<f64>> = face.iter().map(|v| solid.vertices[*v as usize]).collect();
    let sides = (0..face.len()).map(|k| corners[(k + 1) % face.len()] - corners[k]);
    let longest = sides.reduce(|a, b| if b.norm() > a.norm() + 1e-9 { b } else { a })?;
    let along = (longest - normal * normal.dot(&longest)).try_normalize(1e-12)?;
    let across = normal.cross(&along);
    let [a, b] = range_along(&corners, &along);
    let [c, d] = range_along(&corners, &across);
    let height = normal.dot(&corners[0].coords);
    let middle = Point3::from(along * (0.5 * (a + b)) + across * (0.5 * (c + d)) + normal * height);
    let mut seeds = Vec::new();
    for u in stations_along(b - a) {
        for v in stations_along(d - c) {
            seeds.push(Seed { at: middle + along * u + across * v, normal, off_middle_m: u.hypot(v) });
        }
    }
    Some(seeds)
}

/// Lowest and highest place of points along an axis, meters.
fn range_along(points: &[Point3<f64>], axis: &Vector3<f64>) -> [f64; 2] {
    let heights = points.iter().map(|p| axis.dot(&p.coords));
    heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], x| [lo.min(x), hi.max(x)])
}

/// Places along a length, meters from its center, which is one of them.
fn stations_along(length_m: f64) -> Vec<f64> {
    let free_m = length_m - 2.0 * STEP_M;
    if free_m <= 0.0 {
        return vec![0.0];
    }
    let steps = (2 * (0.5 * free_m / STEP_M).ceil() as usize).min(MOST_STEPS);
    (0..=steps).map(|k| free_m * (k as f64 / steps as f64 - 0.5)).collect()
}

/// All other links around the part, at a position of its joint.
struct Surroundings {
    /// Index of each other link, and the pose that maps the part's frame to its frame.
    others: Vec<(usize, Pose)>,
    /// The half space above the object's lowest solid, in the part's frame.
    above_ground: Plane,
}

impl Surroundings {
    /// The surroundings of a link at joint positions; `shapes` are the solids of every link.
    fn of_link(model: &ArticulatedModel, link: usize, shapes: &[Shape], positions: &[f64]) -> Self {
        let world_from: Vec<Pose> =
            (0..model.links.len()).map(|l| model.world_from_link(l, positions)).collect();
        let part_from_world = world_from[link].inverse();
        let others = (0..world_from.len()).filter(|l| *l != link);
        let others = others.map(|l| (l, world_from[l].inverse() * world_from[link])).collect();
        let heights = shapes.iter().zip(&world_from).flat_map(|(s, w)| s.vertices().map(move |v| (w * v).z));
        let ground = part_from_world * Point3::new(0.0, 0.0, heights.fold(f64::INFINITY, f64::min));
        let normal = part_from_world.rotation * -Vector3::z();
        Self { others, above_ground: Plane { normal, offset_m: normal.dot(&ground.coords) } }
    }
}

/// A narrow place of the part, to be held.
struct NarrowPart {
    /// Closing direction of the hand, a unit vector.
    closing: Vector3<f64>,
    /// Where the line along it through `middle` is in the part.
    span: Span,
    middle: Point3<f64>,
}

/// A moving part and everything else.
struct Scene<'a> {
    joint: &'a Joint,
    part: Shape,
    /// Its visual surface.
    seen: SeenCells,
    /// Solids of every link.
    shapes: Vec<Shape>,
    /// Three orthogonal axes of the part, in its frame.
    axes: [Vector3<f64>; 3],
    /// Surroundings with the joint closed; `moving` are those over its limits.
    closed: Surroundings,
    moved: Vec<Surroundings>,
    /// Largest lever of a corner of the part, meters.
    reach_m: f64,
    /// Signs of the joint's opening direction; both if no closed end is known.
    opens: Vec<f64>,
}

impl<'a> Scene<'a> {
    fn of_joint(model: &'a ArticulatedModel, j: usize) -> Option<Self> {
        let joint = &model.joints[j];
        let part = Shape::of_solids(&model.links[joint.child].collision);
        let shapes: Vec<Shape> = model.links.iter().map(|l| Shape::of_solids(&l.collision)).collect();
        let closed = model.closed_state().or_else(|| model.states.first().cloned())?;
        let Limit { lower, upper, .. } = joint.limit;
        let mut moved = Vec::with_capacity(POSITIONS + 1);
        for k in 0..=POSITIONS {
            let mut positions = closed.clone();
            positions[j] = lower + (upper - lower) * k as f64 / POSITIONS as f64;
            moved.push(Surroundings::of_link(model, joint.child, &shapes, &positions));
        }
        let opens = joint.limit.closed.map_or(vec![1.0, -1.0], |s| vec![if s.above { -1.0 } else { 1.0 }]);
        let axes = square_axes(&model.links[joint.child].collision)?;
        let closed = Surroundings::of_link(model, joint.child, &shapes, &closed);
        let seen = SeenCells::of_surface(&model.links[joint.child].visual);
        let mut scene = Self { joint, part, seen, shapes, axes, closed, moved, reach_m: 0.0, opens };
        scene.reach_m = scene.part.vertices().map(|v| scene.lever_m(v)).fold(1e-9, f64::max);
        Some(scene)
    }

    /// Worth and grasp, for each grasp at a place.
    fn grasps_at(&self, seed: &Seed) -> Vec<(f64, Grasp)> {
        let Some(NarrowPart { closing, span, middle }) = self.narrow_part(seed) else { return Vec::new() };
        let off_rad =
            closing.dot(&-span.normals[0]).min(closing.dot(&span.normals[1])).clamp(-1.0, 1.0).acos();
        if off_rad > FRICTION.atan() {
            return Vec::new();
        }
        let width_m = span.length_m();
        let lever_m = self.lever_m(&middle);
        // Close to the axis a hold hardly moves the part; on the axis itself a hand can turn it.
        if lever_m < LEAST_LEVER * self.reach_m && lever_m > 0.5 * width_m {
            return Vec::new();
        }
        let is_seen = match self.seen_ends(&middle, &closing, &span) {
            // The solid fills space that is empty in reality.
            0 => return Vec::new(),
            ends => ends == 2,
        };
        let way = self.direction_of_motion(&middle);
        let mut found = Vec::new();
        for approach in self.approach_directions(&closing) {
            let Some(above) = self.part.span_through(&middle, &-approach, STANDS_OFF_M) else { continue };
            // Depth of the pads' center in the part.
            let rise_m = above.ends_m[1];
            let pose = hand_pose(&closing, &approach, &(middle + approach * PAD_M));
            let grasp = Grasp { link_from_grasp: pose, width_m, off_rad, is_seen };
            let from_behind =
                way.is_some_and(|w| self.opens.iter().all(|s| s * w.dot(&approach) > FROM_BEHIND));
            if rise_m <= FINGER_M[2] - PAD_M && !from_behind && self.is_free(&grasp) {
                found.push((self.worth_of_grasp(seed, &grasp, &(middle - approach * rise_m)), grasp));
            }
        }
        found
    }

    /// The part at a place, where it is narrower than the opening of the hand; `None` where it is not. See
    /// docs/method.md (10.6).
    fn narrow_part(&self, seed: &Seed) -> Option<NarrowPart> {
        let fits = |s: &Span| (STANDS_OFF_M..=GAP_M - 2.0 * STANDS_OFF_M).contains(&s.length_m());
        let first = self.part.span_through(&seed.at, &-seed.normal, STANDS_OFF_M).filter(fits)?;
        // A place inside the part cannot be reached.
        if first.ends_m[0] < -1e-6 {
            return None;
        }
        // Half-way between both faces, so they are equally far from perpendicular.
        let closing = (first.normals[1] - first.normals[0]).try_normalize(1e-6)?;
        let inside = seed.at - seed.normal * (0.5 * first.length_m());
        let span = self.part.span_through(&inside, &closing, STANDS_OFF_M).filter(fits)?;
        let half_m = 0.5 * span.length_m();
        let middle = inside + closing * (span.ends_m[1] - half_m);
        Some(NarrowPart { closing, span: Span { ends_m: [-half_m, half_m], ..span }, middle })
    }

    /// Number of ends of a span that are on the visual surface.
    fn seen_ends(&self, at: &Point3<f64>, way: &Vector3<f64>, span: &Span) -> usize {
        span.ends_m.iter().filter(|end| self.seen.is_near(&(at + way * **end))).count()
    }

    /// Eight approach directions around a closing direction, those along the part's axes first.
    fn approach_directions(&self, closing: &Vector3<f64>) -> impl Iterator<Item = Vector3<f64>> + use<> {
        let off = |a: &Vector3<f64>| a.dot(closing).abs();
        let nearest = self.axes.iter().copied().reduce(|a, b| if off(&b) < off(&a) - 1e-6 { b } else { a });
        let first = nearest.and_then(|a| (a - closing * a.dot(closing)).try_normalize(1e-6));
        let about = Unit::new_unchecked(*closing);
        let turn = move |k: u8| UnitQuaternion::from_axis_angle(&about, f64::from(k) * FRAC_PI_4);
        first.into_iter().flat_map(move |a| [0, 2, 4, 6, 1, 3, 5, 7].map(|k| turn(k) * a))
    }

    /// Whether the hand and its approach are free when the twin is closed.
    fn is_free(&self, grasp: &Grasp) -> bool {
        let palm = palm_block(grasp, APPROACH_M);
        finger_blocks(grasp).iter().chain([&palm]).all(|b| !self.part.meets_block(b))
            && [holding_block(grasp), palm].iter().all(|b| self.is_clear(b, &self.closed))
    }

    /// Whether the holding hand stays free over the joint's limits.
    fn is_free_on_the_way(&self, grasp: &Grasp) -> bool {
        let blocks = [holding_block(grasp), palm_block(grasp, 0.0)];
        self.moved.iter().all(|s| blocks.iter().all(|b| self.is_clear(b, s)))
    }

    /// Whether a box, given in the part's frame, is above ground and meets no other link.
    fn is_clear(&self, block: &Block, about: &Surroundings) -> bool {
        block.is_inside(&about.above_ground)
            && !about.others.iter().any(|(l, pose)| self.shapes[*l].meets_block(&block.in_frame(pose)))
    }

    /// Number of pads that touch seen surface across their width, where the part is about as wide as the
    /// grasp.
    fn touching_pads(&self, at: &Point3<f64>, closing: &Vector3<f64>, width_m: f64) -> usize {
        let Some(span) = self.part.span_through(at, closing, STANDS_OFF_M) else { return 0 };
        let is_as_wide = span.ends_m.iter().all(|e| (e.abs() - 0.5 * width_m).abs() <= STANDS_OFF_M);
        if is_as_wide { self.seen_ends(at, closing, &span) } else { 0 }
    }

    /// Worth of a grasp whose approach enters the part at `front`.
    fn worth_of_grasp(&self, seed: &Seed, grasp: &Grasp, front: &Point3<f64>) -> f64 {
        let axes = grasp.link_from_grasp.rotation.to_rotation_matrix();
        let [closing, across, approach] = [0, 1, 2].map(|k| axes.matrix().column(k).into_owned());
        let middle = grasp.link_from_grasp * Point3::new(0.0, 0.0, -PAD_M);
        let places = (-4..=4).map(|k| middle + across * (f64::from(k) * 0.25 * FINGER_M[1]));
        let touching: usize = places.map(|at| self.touching_pads(&at, &closing, grasp.width_m)).sum();
        let touch = touching as f64 / 18.0;
        let way = self.direction_of_motion(&middle);
        let lever = self.lever_m(&middle) / self.reach_m;
        let ways = way.into_iter().flat_map(|w| self.opens.iter().map(move |s| w * *s));
        let ahead_m = ways.map(|w| self.ahead_m(front, &w)).fold(f64::INFINITY, f64::min);
        let straight = self.axes.iter().map(|a| a.dot(&approach).abs()).fold(0.0, f64::max);
        // docs/method.md (10.7).
        lever
            + WEIGHTS.handle * (-ahead_m / HANDLE_M).exp()
            + WEIGHTS.touch * touch
            + WEIGHTS.shape * way.map_or(0.0, |w| w.dot(&closing).abs())
            + WEIGHTS.face * grasp.off_rad.cos()
            + WEIGHTS.straight * straight
            - WEIGHTS.narrow_per_m * grasp.width_m
            - WEIGHTS.middle_per_m * seed.off_middle_m
    }

    /// Lever of a place about the joint's axis, meters; 1 on a slide.
    fn lever_m(&self, p: &Point3<f64>) -> f64 {
        if self.joint.kind.turns() { p.coords.cross(&self.joint.axis).norm() } else { 1.0 }
    }

    /// Unit direction of motion of a point of the part; `None` on the axis of a turn.
    fn direction_of_motion(&self, p: &Point3<f64>) -> Option<Vector3<f64>> {
        let axis = self.joint.axis.into_inner();
        let way = match self.joint.kind.pitch_m_per_rad() {
            _ if !self.joint.kind.turns() => axis,
            pitch => axis.cross(&p.coords) + axis * pitch.unwrap_or(0.0),
        };
        way.try_normalize(1e-3)
    }

    /// Length of the part beyond a place in its opening direction, along the nearest of its axes, meters.
    fn ahead_m(&self, place: &Point3<f64>, way: &Vector3<f64>) -> f64 {
        let along = |a: &Vector3<f64>| a.dot(way).abs();
        let face = self.axes.iter().copied().reduce(|a, b| if along(&b) > along(&a) { b } else { a });
        let face = face.map_or(*way, |a| a * a.dot(way).signum());
        self.part.vertices().map(|v| face.dot(&(v - place))).fold(0.0, f64::max)
    }
}

/// Three orthogonal axes of a part: the normal with the most area, that with the most area perpendicular to
/// it, and their cross product.
fn square_axes(solids: &[ConvexSolid]) -> Option<[Vector3<f64>; 3]> {
    let mut faces: Vec<(Vector3<f64>, f64)> = solids.iter().flat_map(ConvexSolid::face_areas).collect();
    let first = main_direction(&faces)?;
    for (normal, _) in &mut faces {
        *normal -= first * first.dot(normal);
    }
    let second = main_direction(&faces)?;
    Some([first, second, first.cross(&second)])
}

/// The unit direction with the most area among normals with areas. Faces with the same or the opposite
/// direction count together.
fn main_direction(faces: &[(Vector3<f64>, f64)]) -> Option<Vector3<f64>> {
    let mut weighted = Vec::with_capacity(faces.len());
    for direction in faces.iter().filter_map(|(n, _)| n.try_normalize(0.5)) {
        let weight: f64 = faces.iter().map(|(m, area)| area * m.dot(&direction).powi(8)).sum();
        weighted.push((weight, direction));
    }
    let best = weighted.into_iter().reduce(|a, b| if b.0 > a.0 * (1.0 + 1e-9) { b } else { a });
    best.map(|b| b.1)
}

/// A hand's pose: x is the closing direction, z the approach.
fn hand_pose(closing: &Vector3<f64>, approach: &Vector3<f64>, tip: &Point3<f64>) -> Pose {
    let axes = Matrix3::from_columns(&[*closing, approach.cross(closing), *approach]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Pose::from_parts(tip.coords.into(), rotation)
}

/// Both fingers with some clearance, open by the width of the part and its possible bulge.
fn finger_blocks(grasp: &Grasp) -> [Block; 2] {
    let inner = 0.5 * grasp.width_m + STANDS_OFF_M;
    let outer = inner + FINGER_M[0] + STANDS_OFF_M;
    [[-outer, -inner], [inner, outer]].map(|[a, b]| of_fingers(grasp, a, b))
}

/// Both fingers and the space between them.
fn holding_block(grasp: &Grasp) -> Block {
    let outer = 0.5 * grasp.width_m + FINGER_M[0] + 2.0 * STANDS_OFF_M;
    of_fingers(grasp, -outer, outer)
}

fn of_fingers(grasp: &Grasp, from_m: f64, to_m: f64) -> Block {
    let half = 0.5 * FINGER_M[1] + STANDS_OFF_M;
    Block::between_corners(&grasp.link_from_grasp, [from_m, -half, -FINGER_M[2]], [to_m, half, STANDS_OFF_M])
}

/// The space swept by the palm on its approach to the grasp.
fn palm_block(grasp: &Grasp, way_m: f64) -> Block {
    let [half, wide, deep] = PALM_M;
    let back = -FINGER_M[2] - deep - way_m;
    Block::between_corners(&grasp.link_from_grasp, [-half, -wide, back], [half, wide, -FINGER_M[2]])
}
