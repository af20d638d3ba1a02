//! Collision solids along the paths of the joints: solids in the way are cut, and the free interval of a
//! joint is measured.

use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

use super::{ArticulatedModel, Joint, JointKind};
use geometry::{Pose, bounding_box};
use surface::{ConvexConfig, ConvexSolid, MIN_THICKNESS_M, Plane, TriangleMesh};

/// Longest way between two examined positions of a sweep, meters.
/// chosen: no more than the thickness of walls, so none is skipped
const STEP_M: f64 = 0.003;
/// Largest number of positions of a sweep.
const MAX_STEPS: usize = 600;
/// Pieces smaller than this are dropped, cubic meters. chosen: a cube of 2 mm stops nothing
const MIN_VOLUME_M3: f64 = 1e-8;
/// Depth, as a share of its extent, to which a moving part may reach into a part other than its parent
/// without being stopped by it. chosen: solids are that inexact
const GRAZE_SHARE: f64 = 0.05;
/// Gap of a part on its seat, and anywhere along its motion, as a share of the gap on its sides on the way.
/// measured: over 2 mm MuJoCo and Bullet make no contact; a part that slides along that close jams in Bullet
const SEAT_GAP: f64 = 2.0 / 3.0;
/// Least cosine between a part's velocity and a face's normal at which the part meets or leaves the face
/// straight on.
/// derived: 45 degrees, nearer to straight than to sliding
const STRAIGHT: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Blocks are joined if the block around both is at most this many times as large as the two.
/// chosen: a quarter of air is little
const FUSED: f64 = 1.25;
/// Farthest a revolute joint is swept beyond the observed positions, radians.
/// derived: half a turn; farther, the other way round is the nearer one
pub(super) const MAX_TURN_RAD: f64 = std::f64::consts::PI;

/// Makes room: cuts the solids of other links near those of a moving link, anywhere between its limits and
/// the observed positions (nothing can have been in the way there). The gap is as wide as engines with
/// contact margins need: MuJoCo and Bullet push apart solids that touch at rest.
pub fn clear_paths(model: &mut ArticulatedModel, config: &ConvexConfig) {
    for j in 0..model.joints.len() {
        let joint = model.joints[j].clone();
        let [lower, upper] = model.observed_interval(j);
        // At most a gap before the limit it comes near its seat.
        let near = config.gap_m / lever_m(model, &joint).max(f64::MIN_POSITIVE);
        let [first, last] = [lower.min(joint.limit.lower + near), upper.max(joint.limit.upper - near)];
        let way = sweep_positions(model, &joint, first, last);
        let mut ends = Vec::new();
        for [a, b] in [[joint.limit.lower, first], [last, joint.limit.upper]] {
            if a < b {
                ends.extend(sweep_positions(model, &joint, a, b));
            }
        }
        let seat_m = SEAT_GAP * config.gap_m;
        let stretches = [
            (&way, Gap { along_m: seat_m, across_m: config.gap_m }),
            (&ends, Gap { along_m: seat_m, across_m: seat_m }),
        ];
        for other in 0..model.links.len() {
            // Links below the child move with it.
            if other == joint.child || model.is_below(other, joint.child) {
                continue;
            }
            let moving = model.links[joint.child].collision.clone();
            // The parent is known to be clear. Another part may truly be in the way, unless it is only
            // grazed; but not where the moving part was seen.
            let grazed_m =
                if other == joint.parent { f64::INFINITY } else { GRAZE_SHARE * extent_m(&moving) };
            // The other joints as observed: nothing is known of other combinations.
            for state in model.states.clone() {
                let seen = relative_poses(model, j, other, &state, &[state[j]]);
                for (positions, gap) in stretches {
                    let path = relative_poses(model, j, other, &state, positions);
                    let sweep = Sweep { joint: &joint, path: &path, seen: &seen, gap, grazed_m };
                    carve_paths(&mut model.links[other].collision, &moving, &sweep);
                }
            }
        }
    }
    // Cuts may leave more solids than a link may have.
    for link in &mut model.links {
        keep_most_seen(&mut link.collision, &link.visual, config);
    }
}

/// Length of the diagonal of the bounding box of some solids, meters.
fn extent_m(solids: &[ConvexSolid]) -> f64 {
    let corners = solids.iter().flat_map(|s| s.vertices.iter().copied());
    bounding_box(corners).map_or(0.0, |(lo, hi)| (hi - lo).norm())
}

/// The interval around the observed one in which no solid of a joint's child touches one of another link
/// (with the other joints as in any observed state). It ends at most half a turn, or the child's own length,
/// beyond the observed positions.
pub fn swept_interval(model: &ArticulatedModel, j: usize) -> [f64; 2] {
    let joint = &model.joints[j];
    let [lower, upper] = model.observed_interval(j);
    let reach = match joint.kind {
        JointKind::Revolute | JointKind::Screw { .. } | JointKind::Free { .. } => MAX_TURN_RAD,
        JointKind::Prismatic => length_along(model, joint),
    };
    let [lowest, highest] = [upper - reach, lower + reach].map(|end| {
        let start = if end < lower { lower } else { upper };
        // Outwards from the observed interval: nothing beyond the first obstacle counts.
        let free =
            sweep_positions(model, joint, start, end).into_iter().take_while(|q| is_free(model, j, *q));
        free.last().unwrap_or(start)
    });
    [lowest.min(lower), highest.max(upper)]
}

/// Whether a joint's child, at a position, meets no solid of any link except those below it, in every
/// observed state of the other joints.
fn is_free(model: &ArticulatedModel, j: usize, position: f64) -> bool {
    let child = model.joints[j].child;
    let mut others = (0..model.links.len()).filter(|&l| l != child && !model.is_below(l, child));
    others.all(|other| {
        let mut poses = model.states.iter().flat_map(|s| relative_poses(model, j, other, s, &[position]));
        !poses.any(|pose| solids_overlap(&model.links[other].collision, &model.links[child].collision, &pose))
    })
}

impl ArticulatedModel {
    /// Lowest and highest position of a joint in the observed states, radians or meters.
    pub fn observed_interval(&self, joint: usize) -> [f64; 2] {
        let all = self.states.iter().filter_map(|s| s.get(joint));
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], &q| [lo.min(q), hi.max(q)])
    }

    /// Whether a link is a descendant of another one.
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

/// Positions from `start` to `end`, both included; between two of them no point of the child moves farther
/// than [`STEP_M`].
fn sweep_positions(model: &ArticulatedModel, joint: &Joint, start: f64, end: f64) -> Vec<f64> {
    let count = (((end - start).abs() * lever_m(model, joint) / STEP_M).ceil() as usize).clamp(1, MAX_STEPS);
    (0..=count).map(|k| start + (end - start) * k as f64 / count as f64).collect()
}

/// Distance moved by the fastest point of a joint's child, meters per unit of its position.
fn lever_m(model: &ArticulatedModel, joint: &Joint) -> f64 {
    let axis = joint.axis.into_inner();
    match joint.kind {
        // All points of a slide move alike.
        JointKind::Prismatic => 1.0,
        JointKind::Revolute | JointKind::Screw { .. } | JointKind::Free { .. } => {
            let vertices = model.links[joint.child].collision.iter().flat_map(|s| &s.vertices);
            vertices.map(|v| v.coords.cross(&axis).norm()).fold(0.0, f64::max)
        }
    }
}

/// `other_from_child` at positions of a joint, the other joints as in a state.
fn relative_poses(
    model: &ArticulatedModel,
    j: usize,
    other: usize,
    state: &[f64],
    positions: &[f64],
) -> Vec<Pose> {
    let child = model.joints[j].child;
    let mut all = state.to_vec();
    let mut poses = Vec::with_capacity(positions.len());
    for &q in positions {
        all[j] = q;
        poses.push(model.world_from_link(other, &all).inverse() * model.world_from_link(child, &all));
    }
    poses
}

fn solids_overlap(fixed: &[ConvexSolid], moving: &[ConvexSolid], fixed_from_moving: &Pose) -> bool {
    let bounds: Vec<_> = fixed.iter().map(ConvexSolid::bounds).collect();
    moving.iter().any(|m| {
        let m = m.transformed(fixed_from_moving);
        let own = m.bounds();
        fixed.iter().zip(&bounds).any(|(f, b)| boxes_meet(&own, b, 0.0) && m.penetration_m(f).is_some())
    })
}

/// Lower and upper corner of a box.
type Corners = (Point3<f64>, Point3<f64>);

/// Whether two boxes come closer than a gap.
fn boxes_meet(a: &Corners, b: &Corners, gap_m: f64) -> bool {
    (0..3).all(|k| a.0[k] <= b.1[k] + gap_m && b.0[k] <= a.1[k] + gap_m)
}

/// The gap about a moving part, meters.
#[derive(Clone, Copy)]
struct Gap {
    /// Along its motion.
    along_m: f64,
    /// Across its motion; no smaller.
    across_m: f64,
}

/// Poses `fixed_from_moving` of a joint's child, and how deep it may reach into a solid that it only grazes,
/// meters.
struct Sweep<'a> {
    joint: &'a Joint,
    /// Poses along the whole path.
    path: &'a [Pose],
    /// Observed poses.
    seen: &'a [Pose],
    gap: Gap,
    grazed_m: f64,
}

/// Cuts moving solids out of the fixed ones: along the whole path where they only graze one, else only at the
/// observed poses.
fn carve_paths(fixed: &mut Vec<ConvexSolid>, moving: &[ConvexSolid], sweep: &Sweep<'_>) {
    let paths: Vec<[Path; 2]> = moving
        .par_iter()
        .map(|solid| [sweep.path, sweep.seen].map(|poses| Path::new(sweep.joint, solid, poses)))
        .collect();
    let pieces = std::mem::take(fixed).into_par_iter().map(|solid| carved_solid(solid, &paths, sweep));
    let pieces: Vec<Vec<ConvexSolid>> = pieces.collect();
    *fixed = pieces.into_iter().flatten().collect();
}

/// A solid with the paths of moving ones cut out.
fn carved_solid(solid: ConvexSolid, paths: &[[Path<'_>; 2]], sweep: &Sweep<'_>) -> Vec<ConvexSolid> {
    // Along the solid's own axes: cuts run with its faces.
    let axes = solid.main_axes();
    let mut gaps = Vec::new();
    for [path, seen] in paths {
        let stands_in_the_way =
            sweep.grazed_m.is_finite() && path.deepest_m(&solid, sweep.gap.across_m) > sweep.grazed_m;
        let poses = if stands_in_the_way { seen } else { path };
        gaps.extend(poses.block_within(&solid, &axes, sweep.gap));
    }
    let mut pieces = vec![solid];
    for gap in fused_blocks(gaps) {
        pieces = pieces.into_iter().flat_map(|p| without_block(p, &axes, &gap)).collect();
    }
    pieces
}

/// A solid at the poses of its path.
struct Path<'a> {
    joint: &'a Joint,
    steps: Vec<PathStep>,
}

/// A solid at one pose.
struct PathStep {
    fixed_from_moving: Pose,
    solid: ConvexSolid,
    bounds: Corners,
}

impl<'a> Path<'a> {
    fn new(joint: &'a Joint, solid: &ConvexSolid, poses: &[Pose]) -> Self {
        let mut steps = Vec::with_capacity(poses.len());
        for pose in poses {
            let moved = solid.transformed(pose);
            steps.push(PathStep { fixed_from_moving: *pose, bounds: moved.bounds(), solid: moved });
        }
        Self { joint, steps }
    }

    /// The steps of the path near a solid.
    fn solids_near(&self, piece: &ConvexSolid, gap_m: f64) -> impl Iterator<Item = &PathStep> {
        let bounds = piece.bounds();
        self.steps.iter().filter(move |step| boxes_meet(&step.bounds, &bounds, gap_m))
    }

    /// Largest depth of the path in a solid, meters.
    fn deepest_m(&self, piece: &ConvexSolid, gap_m: f64) -> f64 {
        self.solids_near(piece, gap_m).filter_map(|step| step.solid.penetration_m(piece)).fold(0.0, f64::max)
    }

    /// The block around the path's pieces within a solid, with a gap: the box around the whole part would cut
    /// far more.
    fn block_within(&self, piece: &ConvexSolid, axes: &Matrix3<f64>, gap: Gap) -> Option<CutBlock> {
        let mut grown = piece.face_planes();
        grown.iter_mut().for_each(|plane| plane.offset_m += gap.across_m);
        let mut block: Option<CutBlock> = None;
        for step in self.solids_near(piece, gap.across_m) {
            let Some(inside) = step.solid.clipped_by(&grown) else { continue };
            for vertex in &inside.vertices {
                let direction = axes.tr_mul(&direction_of(self.joint, &step.fixed_from_moving, vertex));
                let gap_m = direction.map(|d| if d.abs() >= STRAIGHT { gap.along_m } else { gap.across_m });
                let vertex = axes.tr_mul(&vertex.coords);
                let own = CutBlock { lo: vertex - gap_m, hi: vertex + gap_m };
                block = Some(block.map_or(own, |b| b.united_with(&own)));
            }
        }
        block
    }
}

/// Direction in which a joint moves a point of its child, both in the coordinates of the fixed link; zero on
/// the axis of a hinge.
fn direction_of(joint: &Joint, fixed_from_moving: &Pose, point: &Point3<f64>) -> Vector3<f64> {
    let axis = joint.axis.into_inner();
    let around = axis.cross(&fixed_from_moving.inverse().transform_point(point).coords);
    let velocity = match joint.kind {
        JointKind::Prismatic => axis,
        JointKind::Revolute => around,
        JointKind::Screw { pitch_m_per_rad } | JointKind::Free { pitch_m_per_rad } => {
            around + pitch_m_per_rad * axis
        }
    };
    (fixed_from_moving.rotation * velocity).try_normalize(0.0).unwrap_or_default()
}

/// A box along some axes.
#[derive(Clone, Copy)]
struct CutBlock {
    lo: Vector3<f64>,
    hi: Vector3<f64>,
}

impl CutBlock {
    fn united_with(&self, other: &Self) -> Self {
        Self { lo: self.lo.inf(&other.lo), hi: self.hi.sup(&other.hi) }
    }

    fn volume_m3(&self) -> f64 {
        (self.hi - self.lo).product()
    }

    /// Volume of the block around both over the sum of their volumes.
    fn waste_with(&self, other: &Self) -> f64 {
        self.united_with(other).volume_m3() / (self.volume_m3() + other.volume_m3())
    }
}

/// Joins blocks whose common block is hardly larger than both. Fewer cuts leave a solid in fewer pieces.
fn fused_blocks(mut blocks: Vec<CutBlock>) -> Vec<CutBlock> {
    loop {
        let pairs = (0..blocks.len()).flat_map(|a| (a + 1..blocks.len()).map(move |b| (a, b)));
        let wastes = pairs.map(|(a, b)| (blocks[a].waste_with(&blocks[b]), (a, b)));
        let best = wastes.min_by(|x, y| x.0.total_cmp(&y.0));
        let Some((_, (a, b))) = best.filter(|(waste, _)| *waste <= FUSED) else { return blocks };
        let other = blocks.remove(b);
        blocks[a] = blocks[a].united_with(&other);
    }
}

/// Keeps the solids that have the most surface in or near them.
fn keep_most_seen(solids: &mut Vec<ConvexSolid>, visual: &TriangleMesh, config: &ConvexConfig) {
    if solids.len() <= config.max_solids {
        return;
    }
    let planes: Vec<Vec<Plane>> = solids.iter().map(ConvexSolid::face_planes).collect();
    let triangles = (0..visual.triangles.len()).into_par_iter().with_min_len(256);
    let nearest: Vec<Option<usize>> =
        triangles.map(|t| nearest_solid(&planes, &visual.middle_of(t), config.tolerance_m)).collect();
    let mut areas = vec![0.0; solids.len()];
    for (t, i) in nearest.into_iter().enumerate() {
        i.into_iter().for_each(|i| areas[i] += 0.5 * f64::from(visual.area_normal(t).norm()));
    }
    let mut order: Vec<usize> = (0..solids.len()).collect();
    order.sort_by(|a, b| areas[*b].total_cmp(&areas[*a]).then(a.cmp(b)));
    order.truncate(config.max_solids);
    order.sort_unstable();
    *solids = order.iter().map(|&i| solids[i].clone()).collect();
}

/// Index of the solid nearest to a place (by its planes) within a distance, meters.
fn nearest_solid(solids: &[Vec<Plane>], place: &Point3<f64>, within_m: f64) -> Option<usize> {
    let distances =
        solids.iter().map(|s| s.iter().map(|p| p.distance_m(place)).fold(f64::NEG_INFINITY, f64::max));
    let (nearest, distance_m) = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
    (distance_m <= within_m).then_some(nearest)
}

/// Cuts a block along `axes` out of a solid: the block's sides cut it one after the other, the side that
/// leaves most first.
fn without_block(piece: ConvexSolid, axes: &Matrix3<f64>, block: &CutBlock) -> Vec<ConvexSolid> {
    let mut sides = Vec::with_capacity(6);
    for k in 0..3 {
        let axis = axes.column(k).into_owned();
        sides.push(Plane { normal: axis, offset_m: block.lo[k] });
        sides.push(Plane { normal: -axis, offset_m: -block.hi[k] });
    }
    let mut rest = Some(piece);
    let mut kept = Vec::new();
    while let Some(solid) = rest.take() {
        let left_m3: Vec<f64> =
            sides.iter().map(|p| solid.clipped_at(p).map_or(0.0, |s| s.volume_m3())).collect();
        let most = (0..sides.len()).max_by(|&a, &b| left_m3[a].total_cmp(&left_m3[b]).then(b.cmp(&a)));
        let Some(best) = most else { break };
        let plane = sides.remove(best);
        kept.extend(
            solid
                .clipped_at(&plane)
                // Simulators refuse smaller or thinner hulls.
                .filter(|s| s.volume_m3() > MIN_VOLUME_M3 && s.thickness_m() >= MIN_THICKNESS_M),
        );
        // What lies beyond this side is left out of the next cuts, so the pieces do not overlap.
        rest = solid.clipped_at(&Plane { normal: -plane.normal, offset_m: -plane.offset_m });
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example::cabinet;

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
        let mut model = jammed();
        let config = ConvexConfig::default();
        let before = model.links[0].collision[0].volume_m3();
        clear_paths(&mut model, &config);
        let body = &model.links[0].collision;
        assert!((1..=6).contains(&body.len()), "{}", body.len());
        let drawer = &model.links[2].collision;
        for k in 0..=10 {
            let pose = relative_poses(&model, 1, 0, &model.states[0].clone(), &[0.018 * f64::from(k)])[0];
            assert!(!solids_overlap(body, drawer, &pose), "{k}");
        }
        let cut: f64 = before - body.iter().map(ConvexSolid::volume_m3).sum::<f64>();
        // 3 mm are free on all sides but where it comes in.
        assert!((cut / (0.106 * 0.206 * 0.303) - 1.0).abs() < 0.02, "{cut}");
    }

    #[test]
    fn a_link_that_is_not_its_parent_is_cut_where_it_was_seen_and_otherwise_stands_in_the_way() {
        let mut model = jammed();
        let config = ConvexConfig::default();
        model.joints[1].parent = 1;
        model.joints[0].parent_from_joint = Pose::identity();
        model.states = vec![vec![0.0, 0.0], vec![0.0, 0.5]];
        clear_paths(&mut model, &config);
        let meets = |model: &ArticulatedModel, q: f64| {
            solids_overlap(
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
        assert!((swept_interval(&model, 1)[1] - 0.3).abs() < 1e-6, "{:?}", swept_interval(&model, 1));
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
