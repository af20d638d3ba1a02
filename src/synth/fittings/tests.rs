//! Handles are closed, of their sizes, on their plates, and in nobody's way.

use nalgebra::Point3;

use super::*;
use crate::{Family, Object, SynthConfig, generate};
use numeric::random::stage_rng;
use surface::{is_watertight, sample_surface};

fn made(seed: u64, handles: Option<HandleStyle>) -> Object {
    let family = Some(Family::Cabinet);
    generate(&SynthConfig { seed, family, handles, ..SynthConfig::default() }).unwrap()
}

const STYLES: [HandleStyle; 3] = [HandleStyle::Bar, HandleStyle::Knob, HandleStyle::Recess];

#[test]
fn handles_are_closed_and_of_the_sizes_that_are_sold() {
    let mut count = 0;
    let mut whole = 0;
    for (seed, style) in (0..10).flat_map(|seed| STYLES.map(|style| (seed, style))) {
        let object = made(seed, Some(style));
        for (k, part) in object.parts.iter().enumerate() {
            assert!(is_watertight(&object.mesh_of_part(k)), "seed {seed}: {}", part.name);
            let Some(handle) = part.handle else { continue };
            count += 1;
            // The factor of a small plate is that of all sizes.
            let (sizes, ranges) = match handle.kind {
                HandleKind::Bar { length_m, thickness_m, clearance_m } => (
                    vec![length_m, thickness_m, clearance_m],
                    vec![[0.096, 0.16], [0.008, 0.012], [0.025, 0.035]],
                ),
                HandleKind::Knob { diameter_m, height_m } => {
                    assert!((height_m - 0.9 * diameter_m).abs() < 1e-12);
                    (vec![diameter_m], vec![[0.025, 0.035]])
                }
                HandleKind::Recess { length_m, width_m, depth_m } => (
                    vec![length_m, width_m, depth_m],
                    vec![[0.1, 0.1 + 1e-9], [0.025, 0.025 + 1e-9], [0.012, 0.018]],
                ),
            };
            let within =
                sizes.iter().zip(&ranges).filter(|(s, [low, high])| (*low..*high).contains(*s)).count();
            let below = sizes.iter().zip(&ranges).filter(|(s, [_, high])| *s < high).count();
            assert_eq!(below, sizes.len(), "{handle:?}");
            whole += usize::from(within == sizes.len());
        }
    }
    assert!(count > 40 && whole > count / 2, "{whole} of {count} have their full size");
}

#[test]
fn handles_are_where_the_truth_says() {
    for (seed, style) in (0..10).flat_map(|seed| STYLES.map(|style| (seed, style))) {
        let object = made(seed, Some(style));
        for part in &object.parts {
            let Some(handle) = part.handle else { continue };
            let frame = handle.part_from_handle;
            // From 5 cm before it down its z: at which z the ray of a place meets the part.
            let z = |x: f64, y: f64| {
                let from = frame * Point3::new(x, y, 0.05);
                let ray = frame * -Vector3::z();
                let hit = |s: &Solid| {
                    let to = s.part_from_solid.inverse();
                    s.shape.hit_by(&(to * from), &(to * ray), 0.0).map(|h| h.at)
                };
                0.05 - part.solids.iter().filter_map(hit).fold(f64::INFINITY, f64::min)
            };
            let near = |z: f64, expected: f64| (z - expected).abs() < 1e-9;
            let (inner, outer) = match handle.kind {
                HandleKind::Bar { length_m: l, thickness_m: t, clearance_m: c } => {
                    let plate = -c - 0.5 * t;
                    ([z(0.0, 0.0), z(0.49 * l, 0.0)].map(|z| near(z, 0.5 * t)), near(z(0.0, 0.51 * t), plate))
                }
                HandleKind::Knob { diameter_m: d, height_m } => {
                    let top = 0.2 * d;
                    (
                        [z(0.0, 0.0), z(0.0, 0.49 * d)].map(|z| near(z, top)),
                        near(z(0.0, 0.51 * d), top - height_m),
                    )
                }
                HandleKind::Recess { length_m: l, width_m: w, depth_m: d } => (
                    [z(0.0, 0.0), z(0.49 * l, -0.49 * w)].map(|z| near(z, -d)),
                    near(z(0.51 * l, 0.0), 0.0) && near(z(0.0, 0.51 * w), 0.0),
                ),
            };
            assert!(inner == [true; 2] && outer, "seed {seed}: {} {handle:?}", part.name);
        }
    }
}

#[test]
fn handles_stay_on_their_plates() {
    for (seed, style) in (0..10).flat_map(|seed| STYLES.map(|style| (seed, style))) {
        let object = made(seed, Some(style));
        let plain = made(seed, Some(HandleStyle::Bare));
        assert!(plain.parts.iter().all(|p| p.handle.is_none()));
        for part in object.parts.iter().filter(|p| p.handle.is_some()) {
            let handle = part.handle.unwrap();
            let (half_x, half_y) = match handle.kind {
                HandleKind::Bar { length_m, thickness_m, .. } => (0.5 * length_m, 0.5 * thickness_m),
                HandleKind::Knob { diameter_m, .. } => (0.5 * diameter_m, 0.5 * diameter_m),
                HandleKind::Recess { length_m, width_m, .. } => (0.5 * length_m, 0.5 * width_m),
            };
            // The plate's own boxes reach farther on all sides.
            let reach = |along: Vector3<f64>| {
                part.solids.iter().map(move |s| {
                    let pose = handle.part_from_handle.inverse() * s.part_from_solid;
                    let half = (pose.rotation.inverse() * along).abs().dot(&s.shape.half_sides());
                    pose.translation.vector.dot(&along) + half
                })
            };
            for (along, half) in [(Vector3::x(), half_x), (-Vector3::x(), half_x), (Vector3::y(), half_y)] {
                let farthest = reach(along).fold(f64::NEG_INFINITY, f64::max);
                assert!(farthest > half + 0.01, "seed {seed}: {} {handle:?} {farthest}", part.name);
            }
        }
    }
}

#[test]
fn handles_meet_nothing_on_their_way() {
    let mut looked_at = 0;
    for seed in 0..12 {
        let object = made(seed, Some(HandleStyle::Mixed));
        let joints = object.parts.iter().filter_map(|p| p.joint);
        assert!(
            joints.flat_map(|j| j.positions.map(|q| (j.limits, q))).all(|([l, h], q)| (l..=h).contains(&q))
        );
        let rng = &mut stage_rng(seed, "way", 0);
        let points: Vec<_> = (0..object.parts.len())
            .map(|k| sample_surface(&object.mesh_of_part(k), 600, rng).points)
            .collect();
        for share in (0..=60).map(|step| f64::from(step) / 60.0) {
            let poses = object.rest_from_parts(share);
            for (a, b) in (0..points.len()).flat_map(|a| (0..points.len()).map(move |b| (a, b))) {
                // What has a handle meets nothing, and nothing meets it.
                if a == b || [a, b].iter().all(|k| object.parts[*k].handle.is_none()) {
                    continue;
                }
                let b_from_a = poses[b].inverse() * poses[a];
                for (p, solid) in
                    points[a].iter().flat_map(|p| object.parts[b].solids.iter().map(move |s| (p, s)))
                {
                    let inner = solid.part_from_solid.inverse() * b_from_a * p.cast::<f64>();
                    let depth = (solid.shape.half_sides() - inner.coords.abs()).min();
                    assert!(
                        depth < 0.001,
                        "seed {seed}: {} in {}",
                        object.parts[a].name,
                        object.parts[b].name
                    );
                    looked_at += 1;
                }
            }
        }
    }
    assert!(looked_at > 1_000_000);
}

/// Seed, parts, surface in square meters and sum of all positions of a cabinet; measured: `truth/` of the
/// program before handles could be chosen.
const FORMER: [(u64, usize, f64, f64); 6] = [
    (0, 3, 3.455384, 2.676806789),
    (1, 6, 10.834064, 11.708988046),
    (2, 6, 8.240255, 2.640370700),
    (3, 6, 9.495778, 3.924630453),
    (4, 4, 3.403227, 1.777423601),
    (5, 4, 5.365619, 7.605114614),
];

#[test]
fn seeds_make_what_they_made_before() {
    for (seed, parts, area_m2, positions) in FORMER {
        let object = made(seed, None);
        let area: f64 = (0..object.parts.len()).map(|k| object.mesh_of_part(k).area_m2()).sum();
        let sum: f64 = object.parts.iter().filter_map(|p| p.joint).flat_map(|j| j.positions).sum();
        assert_eq!(object.parts.len(), parts);
        assert!((area - area_m2).abs() < 1e-5 && (sum - positions).abs() < 1e-8, "{seed}: {area} {sum}");
    }
}

#[test]
fn without_the_option_nothing_changes_and_without_handles_nothing_stands_out() {
    for seed in 0..5 {
        let today = made(seed, None);
        let bare = made(seed, Some(HandleStyle::Bare));
        assert!(today.parts.iter().all(|p| p.handle.is_none()));
        let fronts = |o: &Object| {
            let named = |p: &&Part| ["door_", "flap_", "drawer_"].iter().any(|n| p.name.starts_with(n));
            o.parts.iter().filter(named).map(|p| p.solids.len()).collect::<Vec<_>>()
        };
        assert!(fronts(&bare).iter().all(|n| [1, 5].contains(n)), "{:?}", fronts(&bare));
        assert!(fronts(&today).iter().all(|n| [2, 6].contains(n)), "{:?}", fronts(&today));
    }
    assert_eq!(HandleStyle::by_name("mixed"), Some(HandleStyle::Mixed));
    assert_eq!(HandleStyle::by_name("rope"), None);
}
