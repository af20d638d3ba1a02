//! Generation of an object from a seed.

use std::f64::consts::TAU;

use nalgebra::{Unit, UnitQuaternion, Vector3};
use rand_core::Rng;

use super::{
    Family, Object, PartJoint, SynthConfig, cabinet, chain, clearance, finish::finished_object, fittings,
    lacquer::Lacquer, look::Look, observable, tabletop,
};
use geometry::{AxisMotion, Pose};
use numeric::random::{self, stage_rng};

/// Most shapes tried.
const SHAPES: u64 = 100;
/// Joint positions tried per shape.
const POSITIONS: usize = 60;
/// Size of a texture patch relative to the radius of the object.
/// chosen: patches of 5 to 15 cm on a cabinet, as a pane of an oven's door or a display
const PATCH: f64 = 0.3;
/// Largest offset of the object's base from the world origin along x and y, meters.
/// chosen: the world origin must not be the object's
const FOOT_M: f64 = 0.3;

/// No valid object of a family was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "no {family} of {parts} parts that keep clear of each other and can be seen in both states was found for \
     seed {seed}; give another seed"
)]
pub struct NoShape {
    family: &'static str,
    parts: usize,
    seed: u64,
}

/// Generates the object of a configuration accepted by [`SynthConfig::check`].
///
/// # Errors
/// [`NoShape`] if no shape has collision-free parts that are visible in both states.
pub fn generate(config: &SynthConfig) -> Result<Object, NoShape> {
    let rng = &mut stage_rng(config.seed, "synth/object", 0);
    let [fewest, most] = config.family.map_or([2, 6], Family::part_limits);
    let parts = config.parts.unwrap_or_else(|| fewest + random::index_below(rng, most - fewest + 1));
    let family = config.family.unwrap_or_else(|| any_family(parts, rng));
    // Things in rooms are plain, unless asked for.
    let textured = config.textured.unwrap_or_else(|| !config.room && random::is_chosen(rng, 0.75));
    // Rotated and translated, so that no program can rely on the world axes.
    let yaw = random::uniform_in(rng, 0.0, TAU);
    let foot =
        Vector3::new(random::uniform_in(rng, -FOOT_M, FOOT_M), random::uniform_in(rng, -FOOT_M, FOOT_M), 0.0);
    for shape in 0..SHAPES {
        // A separate stream, so that one shape's number of tries does not change the next.
        let rng = &mut stage_rng(config.seed, "synth/shape", shape);
        let mut look = Look { textured, scale_m: 1.0 };
        let mut parts = match family {
            Family::Cabinet => cabinet::cabinet(parts, &mut look, rng),
            Family::Lamp => chain::lamp_parts(parts, &mut look, rng),
            Family::FoldingDoor => chain::folding_door(parts, &mut look, rng),
            Family::CappedBox => tabletop::capped_box(parts, &mut look, rng),
            Family::Clamshell => tabletop::clamshell_parts(&mut look, rng),
        };
        if let (Family::Cabinet, Some(style)) = (family, config.handles) {
            fittings::fit_handles(&mut parts, style, &mut stage_rng(config.seed, "synth/handles", shape));
        }
        let mut object =
            Object { family: family.name(), parts, world_from_rest: Pose::new(foot, Vector3::z() * yaw) };
        for _ in 0..POSITIONS {
            for joint in object.parts.iter_mut().filter_map(|p| p.joint.as_mut()) {
                joint.positions = positions(joint, rng);
            }
            // Clearance is tested first, as visibility casts rays and is far slower.
            if clearance::is_free(&object) && observable::is_observable(&object, config, rng) {
                // After the tests, since lacquer, scale and skew do not change the shape.
                let has_finish = config.room && config.textured.is_none();
                let object = if has_finish { finished_object(object, config.seed) } else { object };
                let object = lacquered(object, config);
                return Ok(skewed(scaled(object, config.motion_scale), config));
            }
        }
    }
    Err(NoShape { family: family.name(), parts, seed: config.seed })
}

/// The object with a share of its joint motions; if the whole way is free, so is part of it.
fn scaled(mut object: Object, share: f64) -> Object {
    for [from, to] in object.parts.iter_mut().filter_map(|p| p.joint.as_mut()).map(|j| &mut j.positions) {
        *to = *from + share * (*to - *from);
    }
    object
}

/// The object with tilted joint axes.
fn skewed(mut object: Object, config: &SynthConfig) -> Object {
    let rng = &mut stage_rng(config.seed, "synth/skew", 0);
    for axis in object.parts.iter_mut().filter_map(|p| p.joint.as_mut()).map(|j| &mut j.axis) {
        let aside = Unit::new_normalize(random::random_direction(rng).cross(axis));
        *axis = UnitQuaternion::from_axis_angle(&aside, config.skew_deg.to_radians()) * *axis;
    }
    object
}

/// The object with a share of each part lacquered, in separate patches.
fn lacquered(mut object: Object, config: &SynthConfig) -> Object {
    if config.lacquer > 0.0 {
        let patch_m = PATCH * object.bounding_sphere().radius_m;
        for (k, part) in object.parts.iter_mut().enumerate() {
            let rng = &mut stage_rng(config.seed, "synth/lacquer", k as u64);
            let lacquer = Lacquer::covering(config.lacquer, patch_m, rng);
            // A pane stays one.
            part.solids.iter_mut().for_each(|solid| {
                solid.material.lacquer.get_or_insert(lacquer);
            });
        }
    }
    object
}

/// A random family that can have this number of parts; cabinets get half of the choices.
fn any_family(parts: usize, rng: &mut impl Rng) -> Family {
    let mut others: Vec<Family> = Family::ALL.into_iter().filter(|f| *f != Family::Cabinet).collect();
    others.retain(|f| (f.part_limits()[0]..=f.part_limits()[1]).contains(&parts));
    if others.is_empty() || random::is_chosen(rng, 0.5) {
        Family::Cabinet
    } else {
        others[random::index_below(rng, others.len())]
    }
}

/// Two positions within the limits, far enough apart to be a motion.
fn positions(joint: &PartJoint, rng: &mut impl Rng) -> [f64; 2] {
    let [low, high] = joint.limits;
    let span = high - low;
    let [least, most] = match joint.kind {
        AxisMotion::Revolute => [0.35f64.min(0.5 * span), 1.4f64.min(0.9 * span)],
        AxisMotion::Prismatic => [0.3 * span, 0.9 * span],
        AxisMotion::Screw { .. } => [1.0f64.min(0.5 * span), 2.6f64.min(0.9 * span)],
    };
    let motion = random::uniform_in(rng, least, most);
    let near = random::uniform_in(rng, low, high - motion);
    // Either state may be the one that is open wider.
    if random::is_chosen(rng, 0.5) { [near, near + motion] } else { [near + motion, near] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_family_and_number_of_parts_can_be_made() {
        for family in Family::ALL {
            for parts in family.part_limits()[0]..=family.part_limits()[1] {
                for seed in 0..5 {
                    let config = SynthConfig {
                        seed,
                        parts: Some(parts),
                        family: Some(family),
                        ..SynthConfig::default()
                    };
                    let object = generate(&config).unwrap();
                    assert_eq!(object.parts.len(), parts);
                    assert!(object.parts[0].joint.is_none());
                    for (k, part) in object.parts.iter().enumerate().skip(1) {
                        let joint = part.joint.unwrap();
                        assert!(joint.parent < k);
                        let motion = (joint.positions[1] - joint.positions[0]).abs();
                        assert!(
                            motion > if joint.kind == AxisMotion::Prismatic { 0.015 } else { 0.2 },
                            "{} {motion}",
                            part.name
                        );
                        assert!(
                            joint.positions.iter().all(|q| (joint.limits[0]..=joint.limits[1]).contains(q))
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn a_smaller_motion_is_that_of_the_same_object() {
        let of = |motion_scale| {
            generate(&SynthConfig { seed: 4, motion_scale, ..SynthConfig::default() }).unwrap()
        };
        let whole = of(1.0);
        let half = of(0.5);
        for (a, b) in whole.parts.iter().zip(&half.parts).filter_map(|(a, b)| Some((a.joint?, b.joint?))) {
            let moved = |j: PartJoint| j.positions[1] - j.positions[0];
            assert!(a.positions[0] == b.positions[0] && (moved(b) - 0.5 * moved(a)).abs() < 1e-12);
        }
        assert!(whole.parts.iter().zip(&half.parts).all(|(a, b)| a.solids == b.solids));
    }

    #[test]
    fn skewed_axes_are_tilted_by_the_angle_and_nothing_else_changes() {
        let of = |skew_deg| generate(&SynthConfig { seed: 4, skew_deg, ..SynthConfig::default() }).unwrap();
        let square = of(0.0);
        let skewed = of(1.5);
        for (a, b) in square.parts.iter().zip(&skewed.parts).filter_map(|(a, b)| Some((a.joint?, b.joint?))) {
            assert!((a.axis.angle(&b.axis).to_degrees() - 1.5).abs() < 1e-6);
            assert!(a.origin == b.origin && a.positions == b.positions);
        }
        assert!(square.parts.iter().zip(&skewed.parts).all(|(a, b)| a.solids == b.solids));
    }

    #[test]
    fn a_seed_determines_the_object() {
        let of = |seed| generate(&SynthConfig { seed, ..SynthConfig::default() }).unwrap();
        assert_eq!(of(4), of(4));
        assert_ne!(of(4), of(5));
    }
}
