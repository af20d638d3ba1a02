//! Finds closed poses: a face of a moving part meets its seat on the parent.
//!
//! Both surfaces are given in coordinates of the motion, of which only one changes: the position. Surfaces in
//! the same cell of the other coordinates can meet, and the difference of their positions is the way left.
//! Where many cells have the same way left, two faces meet at once. See docs/method.md (10.5).

use std::collections::BTreeMap;

use super::sweep::MAX_TURN_RAD;
use super::{ArticulatedModel, Joint, JointKind, Seat};
use geometry::normals_of;
use nalgebra::{Point3, Vector3};
use surface::TriangleMesh;

/// Side of the cells, meters.
/// derived: the sweep's step, which does not tell nearer faces apart
const CELL_M: f64 = 0.003;
/// Largest number of cells along the longest side of the moving part: larger parts have larger cells.
/// chosen: memory of a square of cells
const MOST_CELLS: f64 = 400.0;
/// Least cosine between the motion and the normal of a leading face.
/// derived: 45 degrees, nearer to it than to any direction across it
const ALONG: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Least share of the leading cells that reach the seat at once; accidental contacts before it have less.
/// measured: on shared/bags seats hold 0.007 to 0.96 of the reconstructed faces
const BROAD: f64 = 0.005;
/// The same share for a seat at the observed end itself.
/// measured: on shared/bags surfaces joined there hold up to 0.05, seats of carcasses 0.1
const AT_START: f64 = 0.1;
/// Share of its meeting cells, the high spots, on which a face comes to rest. Fusion rounds rims, so the
/// median cell would meet too late.
/// tuned: shared/bags, a quarter against a half
const STANDS_OUT: f64 = 0.25;
/// Depth to which surface of one part may stick to another, as a share of the object's longest side: a larger
/// face within it is the seat.
/// derived: the default truncation of both fused surfaces (docs/method.md 3.1)
const BLUR_SHARE: f64 = 0.04;
/// If a seat at the other end has more than this share of the contact, the closed end is undecided.
/// chosen: odds of two to one
const RIVAL: f64 = 0.5;
/// Farthest way to a seat beyond the observed positions, in lengths of their interval.
/// measured: on shared/bags 1.1 for a lid, less than 0.3 for all others; handles of scissors meet at 3.3
const FARTHEST: f64 = 2.0;

/// The closed end of a joint: a broad face of its child meets an opposite surface of its parent, at or beyond
/// the observed positions. Faces nearer than `tolerance_m` meet. `None` for screws, without contact, and with
/// such a seat at both ends.
pub fn seat_of_joint(model: &ArticulatedModel, j: usize, tolerance_m: f64) -> Option<Seat> {
    let joint = &model.joints[j];
    if joint.kind.family() == super::JointFamily::Screw {
        return None;
    }
    let observed = model.observed_interval(j);
    let (a, b) = rayon::join(
        || seat_at_end(model, joint, false, observed, tolerance_m),
        || seat_at_end(model, joint, true, observed, tolerance_m),
    );
    let share = |s: &Option<Seat>| s.map_or(0.0, |s| s.contact_share);
    let (best, rival) = if share(&a) >= share(&b) { (a, b) } else { (b, a) };
    best.filter(|_| share(&rival) <= RIVAL * share(&best))
}

/// The seat above or below the observed positions.
fn seat_at_end(
    model: &ArticulatedModel,
    joint: &Joint,
    above: bool,
    [lower, upper]: [f64; 2],
    tolerance_m: f64,
) -> Option<Seat> {
    let start = if above { upper } else { -lower };
    let ways = Ways::of_joint(model, joint, above, start, tolerance_m);
    let contact = ways.first_contact(tolerance_m, BLUR_SHARE * model.extent_m())?;
    if contact.way > FARTHEST * (upper - lower) {
        return None;
    }
    let position = if above { start + contact.way } else { -(start + contact.way) };
    Some(Seat { position, std: contact.std, contact_share: contact.share, above })
}

/// The first position at which enough cells meet at once.
struct Contact {
    /// Way to it from the observed end, radians or meters.
    way: f64,
    /// Root mean square deviation of the cells' ways, radians or meters.
    std: f64,
    /// Share of the leading cells that meet.
    share: f64,
}

/// A cell of the two coordinates that the motion does not change.
type Cell = [i64; 2];

/// A spot of surface in the coordinates of a motion.
struct Spot {
    cell: Cell,
    /// Position along the motion, radians or meters.
    along: f64,
    /// Distance the spot moves per unit of position, meters.
    lever_m: f64,
}

/// The ways left to a part's leading cells, sorted.
struct Ways {
    /// Way to the first opposite surface, radians or meters, and the cell's lever, meters.
    left: Vec<[f64; 2]>,
    /// Weight of all leading cells.
    leading: f64,
}

/// Weight of a cell: the longer its lever, the better it shows the position, and the better it holds the
/// part.
fn weight_of_lever(lever_m: f64) -> f64 {
    lever_m * lever_m
}

impl Ways {
    /// The ways from `start` on in the direction of motion; surfaces may overlap by the tolerance.
    fn of_joint(model: &ArticulatedModel, joint: &Joint, above: bool, start: f64, tolerance_m: f64) -> Self {
        let child = &model.links[joint.child].visual;
        let frame = Frame::of_joint(joint, above, child);
        let parent = model.links[joint.parent].visual.transformed(&joint.parent_from_joint.inverse());
        let mut seats: BTreeMap<Cell, Vec<f64>> = BTreeMap::new();
        for spot in frame.spots_of_mesh(&parent, -1.0) {
            seats.entry(spot.cell).or_default().push(spot.along);
        }
        // Lever and least way of every leading cell.
        let mut first: BTreeMap<Cell, (f64, Option<f64>)> = BTreeMap::new();
        for spot in frame.spots_of_mesh(child, 1.0) {
            let slack = tolerance_m / spot.lever_m;
            let ways = seats.get(&spot.cell).into_iter().flatten().map(|along| {
                let way = along - spot.along - start;
                // Turns are equivalent up to whole ones.
                if frame.turns { (way + slack).rem_euclid(std::f64::consts::TAU) - slack } else { way }
            });
            let own = ways.filter(|w| *w >= -slack).min_by(f64::total_cmp);
            let known = &mut first.entry(spot.cell).or_insert((spot.lever_m, None)).1;
            *known = own.into_iter().chain(*known).min_by(f64::total_cmp);
        }
        let leading = first.values().map(|(lever_m, _)| weight_of_lever(*lever_m)).sum();
        let mut left: Vec<[f64; 2]> = first.into_values().filter_map(|(l, w)| Some([w?, l])).collect();
        if frame.turns {
            left.retain(|w| w[0] <= MAX_TURN_RAD);
        }
        left.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Self { left, leading }
    }

    /// Contact with the first face; `None` if the part is stopped before it, or faces meet one after the
    /// other.
    fn first_contact(&self, tolerance_m: f64, blur_m: f64) -> Option<Contact> {
        let steps = self.contact_steps(tolerance_m);
        let least = BROAD * self.leading;
        let peaks = (0..steps.len()).filter(|&k| steps[k].is_peak(&steps, tolerance_m));
        let faces = peaks.map(|peak| self.face_about(&steps, peak));
        let faces = faces.filter(|f| {
            // Where the two surfaces separate in the state at this end, some of one may stick to the other.
            let starts = f.cells[f.cells.len() / 4];
            f.weight >= if starts[0] * starts[1] <= tolerance_m { AT_START * self.leading } else { least }
        });
        let seat = faces.reduce(|seat, next| {
            let behind = seat.first.apart_m(next.first) <= blur_m && next.weight > seat.weight;
            if behind { next } else { seat }
        })?;
        let first = seat.first.way;
        let before = self.left.iter().filter(|w| (first - w[0]) * w[1] > blur_m);
        let before: f64 = before.map(|w| weight_of_lever(w[1])).sum();
        let width_m = seat.cells.iter().map(|w| (w[0] - first) * w[1]).fold(0.0, f64::max);
        // The ways are sorted.
        let way = seat.cells[(STANDS_OUT * seat.cells.len() as f64) as usize][0];
        let square: f64 = seat.cells.iter().map(|w| weight_of_lever(w[1]) * (w[0] - way).powi(2)).sum();
        let stands = before <= least && width_m <= blur_m;
        stands.then(|| Contact { way, std: (square / seat.weight).sqrt(), share: seat.weight / self.leading })
    }

    /// The face around a peak: as far as half as many cells as at the peak meet at once (noise spreads them),
    /// and never more.
    fn face_about<'a>(&'a self, steps: &'a [Step], peak: usize) -> Face<'a> {
        let most = steps[peak].met;
        let holds = |s: &&Step| (0.5 * most..=most).contains(&s.met);
        let before = steps[..peak].iter().rev().take_while(holds).count();
        let after = steps[peak..].iter().take_while(holds).count();
        let first = &steps[peak - before];
        let from = self.left.partition_point(|w| w[0] < first.way);
        // A step extends to the next one.
        let next = steps.get(peak + after);
        let to = next.map_or(self.left.len(), |s| self.left.partition_point(|w| w[0] < s.way));
        let cells = &self.left[from..to];
        Face { first, cells, weight: cells.iter().map(|w| weight_of_lever(w[1])).sum() }
    }

    /// Ways a quarter of the tolerance apart, each with the weight of the cells that are in contact there
    /// within the tolerance.
    fn contact_steps(&self, tolerance_m: f64) -> Vec<Step> {
        let mut steps: Vec<Step> = Vec::new();
        for &[way, lever_m] in &self.left {
            if steps.last().is_none_or(|s| (way - s.way) * lever_m >= 0.25 * tolerance_m) {
                let met = self.left.iter().filter(|w| (w[0] - way).abs() * w[1] <= tolerance_m);
                steps.push(Step { way, lever_m, met: met.map(|w| weight_of_lever(w[1])).sum() });
            }
        }
        steps
    }
}

/// A way, with the contact there.
struct Step {
    way: f64,
    lever_m: f64,
    /// Weight of the cells in contact.
    met: f64,
}

impl Step {
    /// Distance between two steps, meters.
    fn apart_m(&self, other: &Self) -> f64 {
        (self.way - other.way).abs() * self.lever_m.min(other.lever_m)
    }

    /// Whether no step around it has more contact.
    fn is_peak(&self, steps: &[Self], tolerance_m: f64) -> bool {
        let near = steps.iter().filter(|s| s.apart_m(self) <= 2.0 * tolerance_m);
        near.map(|s| s.met).fold(0.0, f64::max) <= self.met
    }
}

/// Cells that come into contact nearly at once.
struct Face<'a> {
    first: &'a Step,
    /// Sorted by way; never empty, as steps are ways of cells.
    cells: &'a [[f64; 2]],
    weight: f64,
}

/// Coordinates of a motion: two that it does not change, and the position.
struct Frame {
    axis: Vector3<f64>,
    across: [Vector3<f64>; 2],
    turns: bool,
    cell_m: f64,
}

impl Frame {
    /// In the joint's frame at position 0; the axis is reversed if needed, so the motion goes upwards.
    fn of_joint(joint: &Joint, above: bool, child: &TriangleMesh) -> Self {
        let axis = if above { joint.axis.into_inner() } else { -joint.axis.into_inner() };
        let extent_m = child.bounds().map_or(0.0, |(lo, hi)| f64::from((hi - lo).max()));
        Self {
            axis,
            across: normals_of(&axis),
            turns: joint.kind != JointKind::Prismatic,
            cell_m: CELL_M.max(extent_m / MOST_CELLS),
        }
    }

    /// Spots of the surface that faces along the motion (`sign` 1) or against it (-1), at least one in every
    /// cell it covers.
    fn spots_of_mesh(&self, mesh: &TriangleMesh, sign: f64) -> Vec<Spot> {
        let mut spots = Vec::new();
        for t in 0..mesh.triangles.len() {
            let Some(normal) = mesh.area_normal(t).cast::<f64>().try_normalize(0.0) else { continue };
            let [a, b, c] = mesh.corners(t).map(|p| p.cast::<f64>());
            let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
            let n = ((longest / self.cell_m).ceil() as usize).clamp(1, 1000);
            // Centers of the small triangles oriented like the large one, and of those between.
            for i in 0..n {
                for k in 0..n - i {
                    for shift in [1.0 / 3.0, 2.0 / 3.0].into_iter().take(1 + usize::from(i + k + 1 < n)) {
                        let [u, v] = [i, k].map(|x| (x as f64 + shift) / n as f64);
                        let point = a + (b - a) * u + (c - a) * v;
                        spots.extend(self.spot_at(&point, &normal, sign));
                    }
                }
            }
        }
        spots
    }

    fn spot_at(&self, point: &Point3<f64>, normal: &Vector3<f64>, sign: f64) -> Option<Spot> {
        let [x, y] = self.across.map(|d| d.dot(&point.coords));
        let height = self.axis.dot(&point.coords);
        let (velocity, across, along) = if self.turns {
            let velocity = self.axis.cross(&point.coords);
            (velocity, [x.hypot(y), height], y.atan2(x))
        } else {
            (self.axis, [x, y], height)
        };
        let lever_m = velocity.norm();
        let looks = sign * normal.dot(&velocity) > ALONG * lever_m;
        // On the axis nothing moves.
        (looks && lever_m > self.cell_m).then(|| Spot {
            cell: across.map(|c| (c / self.cell_m).floor() as i64),
            along,
            lever_m,
        })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::example::{box_mesh, cabinet};
    use geometry::Pose;
    use surface::merged_mesh;

    const TOLERANCE_M: f64 = 0.003;

    fn board(lower: [f32; 3], upper: [f32; 3]) -> TriangleMesh {
        box_mesh(lower, upper, [90; 3])
    }

    /// A carcass, open towards x, with a front that slides along x; both are turned in the world.
    fn drawer(seen: [f64; 2]) -> ArticulatedModel {
        let mut model = cabinet();
        let frame = Pose::from_parts(
            Vector3::new(0.1, 0.2, 0.3).into(),
            UnitQuaternion::from_euler_angles(0.3, -0.2, 0.5),
        );
        let walls = merged_mesh(&[
            &board([-0.3, -0.2, 0.0], [0.0, -0.18, 0.3]),
            &board([-0.3, 0.18, 0.0], [0.0, 0.2, 0.3]),
            &board([-0.3, -0.18, 0.0], [0.0, 0.18, 0.02]),
            &board([-0.3, -0.18, 0.02], [-0.28, 0.18, 0.3]),
        ]);
        let front = merged_mesh(&[
            &board([0.04, -0.2, 0.0], [0.06, 0.2, 0.3]),
            &board([-0.2, -0.15, 0.04], [0.04, 0.15, 0.2]),
        ]);
        model.links.truncate(2);
        model.joints.truncate(1);
        model.links[0].visual = walls.transformed(&frame);
        model.links[1].visual = front;
        let joint = &mut model.joints[0];
        (joint.kind, joint.axis, joint.parent_from_joint) = (JointKind::Prismatic, Vector3::x_axis(), frame);
        model.states = seen.map(|q| vec![q]).to_vec();
        model
    }

    #[test]
    fn a_drawer_closes_where_its_front_meets_the_rim_and_not_where_its_back_meets_the_wall() {
        let found = seat_of_joint(&drawer([0.0, 0.15]), 0, TOLERANCE_M).unwrap();
        assert!((found.position + 0.04).abs() < 1e-6 && !found.above && found.std < 1e-6, "{found:?}");
        // The rim's share of the front.
        assert!((0.1..0.3).contains(&found.contact_share), "{found:?}");
        // The same, seen from the other side of the axis.
        let mut model = drawer([0.0, -0.15]);
        model.joints[0].axis = -Vector3::x_axis();
        let mirrored = seat_of_joint(&model, 0, TOLERANCE_M).unwrap();
        assert!((mirrored.position - 0.04).abs() < 1e-6 && mirrored.above, "{mirrored:?}");
    }

    #[test]
    fn a_drawer_that_was_seen_closed_is_closed_there() {
        let mut model = drawer([-0.041, 0.15]);
        let found = seat_of_joint(&model, 0, TOLERANCE_M).unwrap();
        assert!((found.position + 0.04).abs() < 1e-6, "{found:?}");
        // Without walls there is nothing to meet.
        model.links[0].visual = TriangleMesh::default();
        assert_eq!(seat_of_joint(&model, 0, TOLERANCE_M), None);
    }

    /// A door about z at the corner of a plate in the plane y = 0; it stands 1.2 rad open.
    fn door() -> ArticulatedModel {
        let mut model = drawer([0.0, 0.5]);
        model.joints[0].kind = JointKind::Revolute;
        model.joints[0].axis = Vector3::z_axis();
        model.links[0].visual =
            board([0.0, 0.0, 0.0], [0.4, 0.02, 0.5]).transformed(&model.joints[0].parent_from_joint);
        let open =
            Pose::from_parts(Vector3::zeros().into(), UnitQuaternion::from_euler_angles(0.0, 0.0, -1.2));
        model.links[1].visual = board([0.0, -0.02, 0.0], [0.4, 0.0, 0.5]).transformed(&open);
        model
    }

    #[test]
    fn a_door_closes_where_it_lies_on_its_frame() {
        let mut model = door();
        model.states = vec![vec![0.0], vec![-1.3]];
        let found = seat_of_joint(&model, 0, TOLERANCE_M).unwrap();
        assert!((found.position - 1.2).abs() < 1e-3 && found.above, "{found:?}");
        assert!(found.contact_share > 0.9 && found.std < 0.01, "{found:?}");
        // Of a door that was hardly moved nothing says where it closes.
        model.states[1] = vec![-0.3];
        assert_eq!(seat_of_joint(&model, 0, TOLERANCE_M), None);
    }

    #[test]
    fn between_two_equal_walls_none_is_the_closed_end() {
        let mut model = drawer([-0.02, 0.02]);
        model.links[0].visual = merged_mesh(&[
            &board([-0.3, -0.2, 0.0], [-0.28, 0.2, 0.3]),
            &board([0.28, -0.2, 0.0], [0.3, 0.2, 0.3]),
        ])
        .transformed(&model.joints[0].parent_from_joint);
        model.links[1].visual = board([-0.1, -0.2, 0.0], [0.1, 0.2, 0.3]);
        assert_eq!(seat_of_joint(&model, 0, TOLERANCE_M), None);
    }

    #[test]
    fn screws_have_no_seat() {
        let mut model = drawer([0.0, 0.15]);
        model.joints[0].kind = JointKind::Screw { pitch_m_per_rad: 0.01 };
        assert_eq!(seat_of_joint(&model, 0, TOLERANCE_M), None);
    }
}
