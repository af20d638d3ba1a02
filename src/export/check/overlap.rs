//! Checks for overlap at rest and along the path of every joint.

use nalgebra::Point3;

use super::{
    description::{Description, JointText},
    finding::Findings,
    placement::Placement,
    rule::Rule,
    welds::Welds,
};
use geometry::{Pose, bounding_box};
use surface::ConvexSolid;

/// Overlap at rest deeper than this is an error, meters. chosen: above rounding, below any contact
const REST_M: f64 = 1e-5;
/// Overlap along a path deeper than this is an error, meters. chosen: contacts of simulators take as much
const SWEEP_M: f64 = 1e-3;
/// Number of steps along a path.
const STEPS: usize = 60;
/// Limit of work: pairs of links, and products of faces and corners of pairs of solids. Measured: either
/// takes about two seconds; a cabinet of 6 parts with 100 solids takes 38,000 pairs and 2 million products.
const WORK: Work = Work { pairs: 100_000_000, products: 200_000_000 };

/// Number of link pairs that take as long as computing a pose (measured).
const POSE: usize = 20;

/// The work that is still allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Work {
    pairs: u64,
    products: u64,
}

impl Work {
    /// Takes some of it; `None`, now and from then on, if too little is left.
    fn take_share(&mut self, pairs: u64, products: u64) -> Option<()> {
        match (self.pairs.checked_sub(pairs), self.products.checked_sub(products)) {
            (Some(pairs), Some(products)) => *self = Self { pairs, products },
            _ => *self = Self { pairs: 0, products: 0 },
        }
        (self.pairs > 0 && self.products > 0).then_some(())
    }
}

/// The solids of a link.
struct Body<'a> {
    solids: &'a [ConvexSolid],
    bounds: Vec<(Point3<f64>, Point3<f64>)>,
    /// A sphere around all of them.
    center: Point3<f64>,
    radius_m: f64,
}

impl<'a> Body<'a> {
    fn new(solids: &'a [ConvexSolid]) -> Self {
        let bounds: Vec<_> = solids.iter().map(ConvexSolid::bounds).collect();
        let corners = bounds.iter().flat_map(|(lo, hi)| [*lo, *hi]);
        let (lo, hi) = bounding_box(corners).unwrap_or_default();
        let center = nalgebra::center(&lo, &hi);
        // Slightly larger than the box, so rounding does not separate touching solids.
        Self { solids, bounds, center, radius_m: 0.5 * (hi - lo).norm() * (1.0 + 1e-9) + 1e-9 }
    }
}

pub(super) fn check_overlap(
    description: &Description,
    solids: &[Vec<ConvexSolid>],
    welds: &Welds,
    found: &mut Findings,
) {
    let mut work = WORK;
    if check_within(description, solids, welds, &mut work, found).is_none() {
        found.add_warning(
            Rule::Overlap,
            "robot",
            "has so many links and solids that lie near each other that only a part of them was looked at; \
             split the model, or use fewer solids",
        );
    }
}

/// `None` if the work exceeds the limit.
fn check_within(
    description: &Description,
    solids: &[Vec<ConvexSolid>],
    welds: &Welds,
    work: &mut Work,
    found: &mut Findings,
) -> Option<()> {
    let placement = Placement::new(description);
    let bodies: Vec<Body> = solids.iter().map(|s| Body::new(s)).collect();
    let rest: Vec<f64> = description.joints.iter().map(rest_position).collect();
    let poses = placement.poses_of_links(&rest);
    let centers = centers(&bodies, &poses);
    let solid: Vec<usize> = (0..bodies.len()).filter(|&l| !bodies[l].solids.is_empty()).collect();
    // Also parent and child: MuJoCo does not exclude them if the parent is welded to the world.
    for (i, &a) in solid.iter().enumerate() {
        work.take_share((solid.len() - i) as u64, 0)?;
        for &b in &solid[i + 1..] {
            // No simulator collides a body with itself.
            if apart(&bodies, &centers, a, b) || welds.is_one(a, b) {
                continue;
            }
            if let Some(depth) =
                deepest(&bodies[a], &poses[a], &bodies[b], &poses[b], work)?.filter(|d| *d > REST_M)
            {
                let pair = format!("{} and {}", description.links[a].name, description.links[b].name);
                let message = format!(
                    "overlap by {:.2} mm at rest: MuJoCo throws them apart; cut or shrink the collision \
                     solids",
                    1e3 * depth
                );
                found.add_error(Rule::Overlap, &pair, message);
            }
        }
    }
    // Along the path of every leading joint; its followers move with it.
    let carrying = placement.nearest_above(|link| !solids[link].is_empty());
    for (j, joint) in description.joints.iter().enumerate().filter(|(j, _)| placement.leader[*j].is_none()) {
        sweep(
            &Swept { description, placement: &placement, bodies: &bodies, carrying: &carrying, rest: &rest },
            j,
            joint,
            work,
            found,
        )?;
    }
    Some(())
}

/// Centers of the bodies' spheres in the root's frame.
fn centers(bodies: &[Body], poses: &[Pose]) -> Vec<Point3<f64>> {
    bodies.iter().zip(poses).map(|(body, pose)| pose * body.center).collect()
}

/// Whether the spheres around two bodies are apart. A sphere of NaN never is.
fn apart(bodies: &[Body], centers: &[Point3<f64>], a: usize, b: usize) -> bool {
    (centers[a] - centers[b]).norm_squared()
        > (bodies[a].radius_m + bodies[b].radius_m).powi(2) * (1.0 + 1e-9)
}

/// Position 0, or the limit nearest to it.
fn rest_position(joint: &JointText) -> f64 {
    interval(joint).map_or(0.0, |[lower, upper]| 0f64.clamp(lower, upper))
}

fn interval(joint: &JointText) -> Option<[f64; 2]> {
    let limit = joint.limit.as_ref()?;
    let bounds = limit.range();
    (["revolute", "prismatic"].contains(&joint.kind.as_str()) && bounds[0] < bounds[1]).then_some(bounds)
}

/// How deep two bodies overlap, meters; the outer `None` means that the work exceeds the limit.
fn deepest(a: &Body, pose_a: &Pose, b: &Body, pose_b: &Pose, work: &mut Work) -> Option<Option<f64>> {
    // Only one body's solids are moved; boxes are tested first, as separating axes cost a product of faces
    // and corners.
    let a_from_b = pose_a.inverse() * pose_b;
    let mut worst: Option<f64> = None;
    for solid in b.solids {
        work.take_share(0, (solid.vertices.len() + a.solids.len()) as u64)?;
        let moved = solid.transformed(&a_from_b);
        let (lo, hi) = moved.bounds();
        for (other, (l, h)) in a.solids.iter().zip(&a.bounds) {
            if (0..3).all(|k| lo[k] <= h[k] && l[k] <= hi[k]) {
                let products =
                    moved.faces.len() * other.vertices.len() + other.faces.len() * moved.vertices.len();
                work.take_share(0, products as u64)?;
                worst = worst.into_iter().chain(moved.penetration_m(other)).max_by(f64::total_cmp);
            }
        }
    }
    Some(worst)
}

/// A description in its rest positions, for sweeps.
struct Swept<'a> {
    description: &'a Description,
    placement: &'a Placement<'a>,
    bodies: &'a [Body<'a>],
    /// For every link, the nearest link with solids above it.
    carrying: &'a [Option<usize>],
    rest: &'a [f64],
}

/// Moves one joint over its range, with the others at rest, and reports the link that is met deepest, a link
/// that carries the joint before others. `None` if the work exceeds the limit.
fn sweep(swept: &Swept, j: usize, joint: &JointText, work: &mut Work, found: &mut Findings) -> Option<()> {
    let Swept { description, placement, bodies, carrying, rest } = swept;
    let (Some([lower, upper]), Some(_)) = (interval(joint), placement.child_link(j)) else { return Some(()) };
    // A mimic moves with its leader, and so do all links below either.
    let followers = (0..description.joints.len()).filter(|&f| placement.leader[f] == Some(j));
    let carried: Vec<usize> =
        followers.filter_map(|f| placement.child_link(f)).chain(placement.child_link(j)).collect();
    let moved = placement.hanging_on(&carried);
    let (moving, resting): (Vec<usize>, Vec<usize>) =
        (0..bodies.len()).filter(|&l| !bodies[l].solids.is_empty()).partition(|&l| moved[l]);
    work.take_share(((STEPS + 1) * (POSE * bodies.len() + moving.len() * resting.len())) as u64, 0)?;
    let mut worst: Option<(bool, f64, f64, usize)> = None;
    for k in 0..=STEPS {
        let q = lower + (upper - lower) * k as f64 / STEPS as f64;
        let mut positions = rest.to_vec();
        positions[j] = q;
        let poses = placement.poses_of_links(&positions);
        let centers = centers(bodies, &poses);
        for &a in &moving {
            for &b in resting.iter().filter(|&&b| !apart(bodies, &centers, a, b)) {
                let depth = deepest(&bodies[b], &poses[b], &bodies[a], &poses[a], work)?;
                let met = depth.filter(|d| *d > SWEEP_M).map(|d| (carrying[a] == Some(b), d, q, b));
                worst = worst.into_iter().chain(met).max_by(|x, y| x.0.cmp(&y.0).then(x.1.total_cmp(&y.1)));
            }
        }
    }
    if let Some((carries, depth, q, link)) = worst {
        let other = &description.links[link].name;
        let message = format!(
            "at position {q:.4} it drives {:.2} mm into {other}: the joint jams; cut what is in the way",
            1e3 * depth
        );
        if joint.threaded {
            let advance = format!(
                "a screw without its advance: at position {q:.4} it drives {:.2} mm into {other}",
                1e3 * depth
            );
            found.add_warning(
                Rule::Sweep,
                &joint.name,
                format!("{advance}; a slide and a turn that mimics it would hold both"),
            );
        // Another link may truly be in the way, as a closed door is before a drawer, or the frame of a
        // folding door.
        } else if carries {
            found.add_error(Rule::Sweep, &joint.name, message);
        } else {
            found.add_warning(Rule::Sweep, &joint.name, message);
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::description::Description;

    /// Links in a chain, `apart` meters from each other, with a box each.
    fn chain(links: usize, apart: f64) -> (Description, Vec<Vec<ConvexSolid>>) {
        let link = |i: usize| format!("<link name='l{i}'/>");
        let joint = |i: usize| {
            format!(
                "<joint name='j{i}' type='prismatic'><origin xyz='{apart} 0 0'/><parent \
                 link='l{i}'/><child link='l{}'/><axis xyz='0 0 1'/>\
                 <limit lower='0' upper='0.1' effort='1' velocity='1'/></joint>",
                i + 1
            )
        };
        let links_text: String = (0..links).map(link).collect();
        let joints_text: String = (0..links - 1).rev().map(joint).collect();
        let description =
            Description::parse(&format!("<robot name='r'>{links_text}{joints_text}</robot>")).unwrap();
        let cube = ConvexSolid::cuboid(&Point3::origin(), &Point3::new(0.1, 0.1, 0.1));
        (description, vec![vec![cube]; links])
    }

    #[test]
    fn long_chains_and_heaps_are_looked_at_in_part() {
        let begun = std::time::Instant::now();
        for (links, apart, errors) in [(40, 0.2, 0), (4_000, 0.2, 0), (3_000, 0.0, 1_000)] {
            let (description, solids) = chain(links, apart);
            let mut found = Findings::of_file("");
            check_overlap(&description, &solids, &Welds::of_description(&description), &mut found);
            let words = ["only a part of them", "further ones are not listed"];
            let partly = found.all.iter().any(|f| words.iter().any(|w| f.message.contains(w)));
            assert_eq!(partly, links > 40, "{links}");
            assert!(
                found.all.len() >= errors && found.all.len() <= common::limits::FINDINGS + 1,
                "{}",
                found.all.len()
            );
        }
        // Took 25 s while two other programs ran on the two cores, 2026-11-26.
        assert!(begun.elapsed().as_secs() < 60, "{:?}", begun.elapsed());
    }
}
