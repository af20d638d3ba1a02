//! Collision solids along the paths of the joints: what stands in the way is cut, and how far a joint gets is
//! measured.

use nalgebra::{Matrix3, Point3, Vector3};

use super::{ArticulatedModel, Joint, JointKind};
use crate::{
    geometry::Pose,
    surface::{ConvexConfig, ConvexSolid, Plane},
};

/// Longest way between two positions of a sweep that are looked at, meters.
const STEP_M: f64 = 0.003;
/// Most positions of a sweep.
const MAX_STEPS: usize = 600;
/// Pieces smaller than this are dropped, cubic meters.
const MIN_VOLUME_M3: f64 = 1e-8;
/// Share of a moving part's extent that it may reach into a part that is not its parent without being stopped
/// by it.
const GRAZE_SHARE: f64 = 0.05;
/// A revolute joint is swept this far at most, radians.
const MAX_TURN_RAD: f64 = std::f64::consts::PI;

/// Makes room: solids of moving links shrink, then what overlaps them anywhere between the observed
/// positions, where nothing can have been in the way, is cut out of the other links' solids, with a gap.
pub fn clear_paths(model: &mut ArticulatedModel, config: &ConvexConfig) {
    for joint in &model.joints {
        for solid in &mut model.links[joint.child].collision {
            // Solids that touch at rest are thrown apart by MuJoCo: moving ones shrink, and the paths are cut
            // around what is left of them.
            *solid = solid.shrunk(config.shrink_m, config.min_thickness_m);
        }
    }
    for j in 0..model.joints.len() {
        let joint = model.joints[j].clone();
        let [lower, upper] = model.observed_interval(j);
        for other in 0..model.links.len() {
            // What hangs on the child moves with it.
            if other == joint.child || model.is_below(other, joint.child) {
                continue;
            }
            let positions = steps(model, &joint, lower, upper);
            let moving = model.links[joint.child].collision.clone();
            // The other joints as they were seen: nothing is known of other combinations.
            for state in model.states.clone() {
                let poses = relative_poses(model, j, other, &state, &positions);
                // The parent is known to be clear; another part may truly stand in the way, unless it is only
                // grazed, but not where it was seen.
                let grazed =
                    if other == joint.parent { f64::INFINITY } else { GRAZE_SHARE * extent_m(&moving) };
                let seen = relative_poses(model, j, other, &state, &[state[j]]);
                carve(&mut model.links[other].collision, &moving, [&poses, &seen], grazed, config);
            }
        }
    }
}

/// Length of the diagonal of the box around some solids, meters.
fn extent_m(solids: &[ConvexSolid]) -> f64 {
    let mut bounds = solids.iter().map(ConvexSolid::bounds);
    let Some(first) = bounds.next() else { return 0.0 };
    let (lo, hi) = bounds.fold(first, |(lo, hi), (l, h)| (lo.inf(&l), hi.sup(&h)));
    (hi - lo).norm()
}

/// The interval around the observed one in which no solid of a joint's child meets one of another link (the
/// other joints as in any observed state); at most half a turn, or the child's own length, beyond the
/// observed positions.
#[must_use]
pub fn swept_interval(model: &ArticulatedModel, j: usize) -> [f64; 2] {
    let joint = &model.joints[j];
    let [lower, upper] = model.observed_interval(j);
    let reach = match joint.kind {
        JointKind::Revolute | JointKind::Screw { .. } | JointKind::Free { .. } => MAX_TURN_RAD,
        JointKind::Prismatic => length_along(model, joint),
    };
    let last = |end: f64| {
        let start = if end < lower { lower } else { upper };
        // Outwards from what was observed: behind the first obstacle nothing counts.
        let free = steps(model, joint, start, end).into_iter().take_while(|q| is_free(model, j, *q));
        free.last().unwrap_or(start)
    };
    [last(upper - reach).min(lower), last(lower + reach).max(upper)]
}

/// Whether a joint's child at a position meets no solid of a link that it does not carry, in any observed
/// state of the other joints.
fn is_free(model: &ArticulatedModel, j: usize, position: f64) -> bool {
    let child = model.joints[j].child;
    let meets = |other: usize| {
        let mut poses = model.states.iter().flat_map(|s| relative_poses(model, j, other, s, &[position]));
        poses.any(|pose| overlaps(&model.links[other].collision, &model.links[child].collision, &pose))
    };
    let carried = |link: usize| link == child || model.is_below(link, child);
    !(0..model.links.len()).any(|other| !carried(other) && meets(other))
}

impl ArticulatedModel {
    /// Lowest and highest position of a joint in the observed states, radians or meters.
    #[must_use]
    pub fn observed_interval(&self, joint: usize) -> [f64; 2] {
        let all = self.states.iter().filter_map(|s| s.get(joint));
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], &q| [lo.min(q), hi.max(q)])
    }

    /// Whether a link hangs on another one through any number of joints.
    #[must_use]
    pub fn is_below(&self, link: usize, above: usize) -> bool {
        let parent = |l: usize| self.joints.iter().find(|j| j.child == l).map(|j| j.parent);
        std::iter::successors(parent(link), |&l| parent(l)).take(self.links.len()).any(|l| l == above)
    }
}

/// Extent of a joint's child along the axis, meters.
fn length_along(model: &ArticulatedModel, joint: &Joint) -> f64 {
    let along = model.links[joint.child]
        .collision
        .iter()
        .flat_map(|s| &s.vertices)
        .map(|v| v.coords.dot(&joint.axis));
    let [lo, hi] = along.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], x| [lo.min(x), hi.max(x)]);
    (hi - lo).max(0.0)
}

/// Positions from `start` to `end`, both included, no point of the child moving further than [`STEP_M`]
/// between two.
fn steps(model: &ArticulatedModel, joint: &Joint, start: f64, end: f64) -> Vec<f64> {
    let axis = joint.axis.into_inner();
    let lever = |s: &ConvexSolid| s.vertices.iter().map(|v| v.coords.cross(&axis).norm()).fold(0.0, f64::max);
    let lever_m = match joint.kind {
        // All points of a slide move alike.
        JointKind::Prismatic => 1.0,
        JointKind::Revolute | JointKind::Screw { .. } | JointKind::Free { .. } => {
            model.links[joint.child].collision.iter().map(lever).fold(0.0, f64::max)
        }
    };
    let count = (((end - start).abs() * lever_m / STEP_M).ceil() as usize).clamp(1, MAX_STEPS);
    (0..=count).map(|k| start + (end - start) * k as f64 / count as f64).collect()
}

/// `other_from_child` at positions of a joint, the other joints as in a state.
fn relative_poses(
    model: &ArticulatedModel,
    j: usize,
    other: usize,
    state: &[f64],
    positions: &[f64],
) -> Vec<Pose> {
    let pose = |&q: &f64| {
        let mut all = state.to_vec();
        all[j] = q;
        model.world_from_link(other, &all).inverse() * model.world_from_link(model.joints[j].child, &all)
    };
    positions.iter().map(pose).collect()
}

fn overlaps(fixed: &[ConvexSolid], moving: &[ConvexSolid], fixed_from_moving: &Pose) -> bool {
    let bounds: Vec<_> = fixed.iter().map(ConvexSolid::bounds).collect();
    moving.iter().any(|m| {
        let m = m.transformed(fixed_from_moving);
        let own = m.bounds();
        fixed.iter().zip(&bounds).any(|(f, b)| boxes_meet(&own, b, 0.0) && m.penetration_m(f).is_some())
    })
}

/// Whether two boxes (lower and upper corners) come closer than a gap.
fn boxes_meet(a: &(Point3<f64>, Point3<f64>), b: &(Point3<f64>, Point3<f64>), gap_m: f64) -> bool {
    (0..3).all(|k| a.0[k] <= b.1[k] + gap_m && b.0[k] <= a.1[k] + gap_m)
}

/// Cuts moving solids out of the fixed ones: along the whole path where they do not reach deeper into one
/// than `grazed_m`, otherwise at the poses at which they were seen. `fixed_from_moving` is the path, then
/// these.
fn carve(
    fixed: &mut Vec<ConvexSolid>,
    moving: &[ConvexSolid],
    fixed_from_moving: [&[Pose]; 2],
    grazed_m: f64,
    config: &ConvexConfig,
) {
    for solid in moving {
        let [path, seen] =
            fixed_from_moving.map(|poses| poses.iter().map(|p| solid.transformed(p)).collect::<Vec<_>>());
        let met = |piece: &ConvexSolid| {
            let near = path.iter().filter(|p| boxes_meet(&p.bounds(), &piece.bounds(), config.gap_m));
            near.filter_map(|p| p.penetration_m(piece)).fold(0.0, f64::max)
        };
        let parts = |piece: ConvexSolid| {
            let stands_in_the_way = grazed_m.is_finite() && met(&piece) > grazed_m;
            cut(piece, if stands_in_the_way { &seen } else { &path }, config)
        };
        *fixed = fixed.drain(..).flat_map(parts).collect();
    }
    // Cuts divide solids into more than a link may have; the smallest are dropped.
    fixed.sort_by(|a, b| b.volume_m3().total_cmp(&a.volume_m3()));
    fixed.truncate(config.max_solids);
}

/// What of a solid lies outside the box (along the solid's own axes) around all that a path comes into it.
fn cut(piece: ConvexSolid, path: &[ConvexSolid], config: &ConvexConfig) -> Vec<ConvexSolid> {
    let grown: Vec<Plane> =
        piece.planes().into_iter().map(|p| Plane { offset_m: p.offset_m + config.gap_m, ..p }).collect();
    let bounds = piece.bounds();
    // Along the solid's own axes, so that cuts run with its faces.
    let axes = piece.axes();
    let (mut lo, mut hi) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for moved in path {
        if !boxes_meet(&moved.bounds(), &bounds, config.gap_m) {
            continue;
        }
        // Only what comes into the solid counts: the box around the whole part would cut far more.
        let Some(inside) = moved.clipped_by(&grown) else { continue };
        for v in &inside.vertices {
            let p = axes.tr_mul(&v.coords);
            (lo, hi) = (lo.inf(&p), hi.sup(&p));
        }
    }
    if lo.x > hi.x {
        return vec![piece];
    }
    let gap = Vector3::repeat(config.gap_m);
    without_box(piece, &axes, &(lo - gap), &(hi + gap), config)
}

/// A solid without a box along `axes`: the sides of the box cut it one after the other, the one that leaves
/// most first.
fn without_box(
    piece: ConvexSolid,
    axes: &Matrix3<f64>,
    lo: &Vector3<f64>,
    hi: &Vector3<f64>,
    config: &ConvexConfig,
) -> Vec<ConvexSolid> {
    let outside = |k: usize, upper: bool| {
        let axis = axes.column(k).into_owned();
        if upper {
            Plane { normal: -axis, offset_m: -hi[k] }
        } else {
            Plane { normal: axis, offset_m: lo[k] }
        }
    };
    let mut sides: Vec<Plane> = (0..6).map(|i| outside(i / 2, i % 2 == 1)).collect();
    let (mut rest, mut kept) = (Some(piece), Vec::new());
    while let Some(solid) = rest.take() {
        let left = |p: &Plane| solid.clipped(p).map_or(0.0, |s| s.volume_m3());
        let Some(best) =
            (0..sides.len()).max_by(|a, b| left(&sides[*a]).total_cmp(&left(&sides[*b])).then(b.cmp(a)))
        else {
            break;
        };
        let plane = sides.remove(best);
        kept.extend(
            solid
                .clipped(&plane)
                // Simulators refuse hulls that are smaller or thinner.
                .filter(|s| s.volume_m3() > MIN_VOLUME_M3 && s.thickness_m() >= config.min_thickness_m),
        );
        // What lies beyond this side is left out of the next cuts: the pieces do not overlap.
        rest = solid.clipped(&Plane { normal: -plane.normal, offset_m: -plane.offset_m });
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::example::cabinet;

    fn cuboid(lower: [f64; 3], upper: [f64; 3]) -> ConvexSolid {
        ConvexSolid::cuboid(&lower.into(), &upper.into())
    }

    /// The example with a body of one block, which its drawer (along z of its frame) slides out of.
    fn jammed() -> ArticulatedModel {
        let mut model = cabinet();
        model.links.iter_mut().for_each(|l| l.collision.clear());
        model.links[0].collision = vec![cuboid([-0.2, -0.25, 0.0], [0.2, 0.25, 0.6])];
        model.links[2].collision = vec![cuboid([-0.05, -0.1, 0.0], [0.05, 0.1, 0.3])];
        model.joints[1].parent_from_joint =
            Pose::new(Vector3::new(0.2, 0.0, 0.3), Vector3::y() * std::f64::consts::FRAC_PI_2);
        model.links[2].collision[0].vertices.iter_mut().for_each(|v| v.z -= 0.3);
        model
    }

    #[test]
    fn the_path_is_cut_free_with_a_gap_and_no_more() {
        let (mut model, config) = (jammed(), ConvexConfig::default());
        let before = model.links[0].collision[0].volume_m3();
        clear_paths(&mut model, &config);
        let body = &model.links[0].collision;
        assert!((1..=6).contains(&body.len()), "{}", body.len());
        let drawer = &model.links[2].collision;
        for k in 0..=10 {
            let pose = relative_poses(&model, 1, 0, &model.states[0].clone(), &[0.018 * f64::from(k)])[0];
            assert!(!overlaps(body, drawer, &pose), "{k}");
        }
        let cut: f64 = before - body.iter().map(ConvexSolid::volume_m3).sum::<f64>();
        assert!((cut / (0.1 * 0.2 * 0.3) - 1.0).abs() < 0.05, "{cut}");
    }

    #[test]
    fn a_link_that_is_not_its_parent_is_cut_where_it_was_seen_and_otherwise_stands_in_the_way() {
        let (mut model, config) = (jammed(), ConvexConfig::default());
        model.joints[1].parent = 1;
        model.joints[0].parent_from_joint = Pose::identity();
        model.states = vec![vec![0.0, 0.0], vec![0.0, 0.5]];
        clear_paths(&mut model, &config);
        let meets = |model: &ArticulatedModel, q: f64| {
            overlaps(
                &model.links[0].collision,
                &model.links[2].collision,
                &relative_poses(model, 1, 0, &model.states[0], &[q])[0],
            )
        };
        assert!(!meets(&model, 0.0) && !meets(&model, 0.5), "they overlap where they were seen");
        model.links[0].collision.push(cuboid([0.3, -0.1, 0.2], [0.32, 0.1, 0.4]));
        clear_paths(&mut model, &config);
        assert!(meets(&model, 0.25), "what stands in the way is gone");
    }

    #[test]
    fn the_sweep_ends_where_something_stands() {
        let mut model = jammed();
        clear_paths(&mut model, &ConvexConfig::default());
        // A wall 0.1 m behind the open drawer, and the back of the body behind the closed one.
        model.links[0].collision.push(cuboid([0.48, -0.1, 0.2], [0.5, 0.1, 0.4]));
        let [lower, upper] = swept_interval(&model, 1);
        assert!((upper - 0.28).abs() < 0.004 && upper <= 0.2811, "{upper}");
        assert!((-0.004..=0.0).contains(&lower), "{lower}");
        model.links[0].collision.clear();
        assert!((swept_interval(&model, 1)[1] - 0.298).abs() < 1e-6, "{:?}", swept_interval(&model, 1));
    }

    #[test]
    fn links_below_are_known() {
        let mut model = cabinet();
        model.joints[1].parent = 1;
        assert!(
            model.is_below(2, 1) && model.is_below(2, 0) && !model.is_below(1, 2) && !model.is_below(0, 0)
        );
    }
}
