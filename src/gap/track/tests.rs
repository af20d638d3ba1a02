//! Tracks with a known answer.

use nalgebra::{Unit, UnitQuaternion, Vector3};

use crate::track::{
    joint::{TracedJoint, joint_of_traces},
    trace::PointTrack,
};
use numeric::random::{stage_rng, unit_uniform};

/// Noise of a made track: white, wandering, both in meters, and the share of outliers.
#[derive(Clone, Copy)]
struct Made {
    white: f64,
    wander: f64,
    outliers: f64,
    poses: bool,
    stamps: bool,
    mirrored: bool,
}

const CLEAN: Made =
    Made { white: 3e-4, wander: 2e-3, outliers: 0.0, poses: false, stamps: false, mirrored: false };

/// A track of `path`, a pose for every share of the way, there and a third of it back.
fn made(seed: u64, made: Made, path: &dyn Fn(f64) -> (Vector3<f64>, UnitQuaternion<f64>)) -> PointTrack {
    let mut rng = stage_rng(seed, "made track", 0);
    let mut normal = move || (0..12).map(|_| unit_uniform(&mut rng)).sum::<f64>() - 6.0;
    let mut trace = PointTrack { name: format!("made_{seed}"), ..PointTrack::default() };
    let mut drift = Vector3::zeros();
    let mut turned = Vector3::zeros();
    for k in 0..240 {
        let share = f64::from(k) / 180.0;
        let (place, rotation) = path(if share < 1.0 { share } else { 2.0 - share });
        let kept: f64 = 0.97;
        let fresh = (1.0 - kept * kept).sqrt();
        drift = drift * kept + Vector3::from_fn(|_, _| normal()) * (made.wander * fresh);
        turned = turned * kept + Vector3::from_fn(|_, _| normal()) * (0.01 * fresh);
        let mut position = place + drift + Vector3::from_fn(|_, _| normal()) * made.white;
        if (normal() / 12.0 + 0.5) < made.outliers {
            position += Vector3::from_fn(|_, _| normal()) * 0.2;
        }
        if made.mirrored {
            position.x = -position.x;
        }
        trace.position.push(position);
        if made.poses {
            trace.rotation.push(geometry::exp_so3(&turned) * rotation);
        }
        if made.stamps {
            trace.time_s.push(0.05 * f64::from(k));
        }
    }
    trace
}

/// A hinge about the z axis through (1, 2, 3).
fn hinge(radius: f64, angle: f64) -> impl Fn(f64) -> (Vector3<f64>, UnitQuaternion<f64>) {
    move |share| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle * share);
        (Vector3::new(1.0, 2.0, 3.0) + turn * Vector3::new(radius, 0.0, 0.0), turn)
    }
}

/// A slide by a length, which sags in its middle.
fn slide(length: f64, sag: f64) -> impl Fn(f64) -> (Vector3<f64>, UnitQuaternion<f64>) {
    let direction = Unit::new_normalize(Vector3::new(1.0, 0.2, 0.1));
    move |share| {
        let down = Vector3::new(0.0, 0.0, -4.0 * sag * share * (1.0 - share));
        (direction.into_inner() * (length * share) + down, UnitQuaternion::identity())
    }
}

fn found(trace: PointTrack) -> TracedJoint {
    joint_of_traces(&[trace]).unwrap()
}

#[test]
fn no_type_is_false_over_radii_noises_and_forms() {
    let mut right = 0;
    let mut wrong = Vec::new();
    let mut all = 0;
    for seed in 0..6 {
        for (radius, angle) in [(0.1, 1.0), (0.3, 0.5), (0.4, 1.4), (0.8, 0.6), (1.5, 0.5), (0.4, 0.12)] {
            for form in [
                CLEAN,
                Made { poses: true, stamps: true, ..CLEAN },
                Made { white: 3e-3, mirrored: true, ..CLEAN },
                Made { outliers: 0.05, ..CLEAN },
            ] {
                let joint = found(made(seed, form, &hinge(radius, angle)));
                all += 1;
                right += usize::from(joint.kind.name() == "revolute");
                if joint.kind.name() == "prismatic" {
                    wrong.push(format!("hinge {radius} {angle} {seed} {}", joint.log_odds));
                }
            }
        }
        for (length, sag) in [(0.3, 0.0), (0.5, 0.0), (0.5, 0.01), (0.8, 0.01), (0.1, 0.0)] {
            for form in [CLEAN, Made { poses: true, ..CLEAN }, Made { outliers: 0.05, wander: 4e-3, ..CLEAN }]
            {
                let joint = found(made(seed, form, &slide(length, sag)));
                all += 1;
                right += usize::from(joint.kind.name() == "prismatic");
                if joint.kind.name() == "revolute" {
                    wrong.push(format!("slide {length} {sag} {seed} {}", joint.log_odds));
                }
            }
        }
    }
    println!("{right} of {all} right, {} wrong: {wrong:?}", wrong.len());
    // One in fifty: odds of three are named.
    assert!(wrong.len() * 50 <= all && right * 5 >= all * 4, "{right} of {all}, {wrong:?}");
}

#[test]
fn deviations_are_those_of_the_errors() {
    for poses in [false, true] {
        let mut squares = [0.0; 3];
        let count = 40;
        for seed in 0..count {
            let form = Made { poses, white: 1e-3, ..CLEAN };
            let joint = found(made(100 + seed, form, &hinge(0.4, 1.4)));
            let axis = joint.axis.unwrap();
            let own = joint.openings[0].2.as_ref().unwrap();
            let tilt = axis.axis.xy().norm_squared() / axis.axis_covariance.trace();
            let line = (axis.origin - Vector3::new(1.0, 2.0, 3.0)).xy().norm_squared();
            let [radius, std] = own.radius_m.unwrap();
            squares[0] += tilt / count as f64;
            squares[1] += line / axis.origin_covariance.trace() / count as f64;
            squares[2] += ((radius - 0.4) / std).powi(2) / count as f64;
        }
        let ratios = squares.map(f64::sqrt);
        println!("poses {poses}: {ratios:?}");
        assert!(ratios.iter().all(|r| (1.0 / 1.6..1.6).contains(r)), "poses {poses}: {ratios:?}");
    }
}

#[test]
fn openings_at_other_handles_are_one_joint() {
    // Each with errors of its own: errors that all share would count as the mechanism's.
    let handles = [(7, 0.3), (8, 0.5), (9, 0.7)];
    let traces: Vec<PointTrack> = handles.map(|(seed, r)| made(seed, CLEAN, &hinge(r, 1.0))).into();
    let joint = joint_of_traces(&traces).unwrap();
    let axis = joint.axis.unwrap();
    assert_eq!(joint.kind.name(), "revolute");
    let tilt = axis.axis.xy().norm() / axis.axis_covariance.trace().sqrt();
    let off = (axis.origin - Vector3::new(1.0, 2.0, 3.0)).xy().norm() / axis.origin_covariance.trace().sqrt();
    assert!(axis.axis.z > 0.99 && tilt < 3.0 && off < 3.0, "{tilt} {off} {axis:?}");
    assert!(axis.axis_covariance.trace().sqrt() < 0.03 && axis.origin_covariance.trace().sqrt() < 0.02);
    let late = (joint.limits[1] - 1.0) / joint.limit_deviations[1];
    assert!(late.abs() < 3.0 && joint.limits[0].abs() < 0.02, "{:?}", joint.limits);
}

#[test]
fn what_stands_is_fixed_and_what_turns_in_place_is_a_hinge() {
    let still = found(made(1, CLEAN, &|_| (Vector3::new(1.0, 0.0, 0.0), UnitQuaternion::identity())));
    assert_eq!((still.kind.name(), still.axis), ("fixed", None));
    let knob = found(made(2, Made { poses: true, ..CLEAN }, &hinge(0.0, 1.2)));
    assert_eq!(knob.kind.name(), "revolute");
    assert!(knob.axis.unwrap().axis.z > 0.99 && (knob.limits[1] - 1.2).abs() < 0.1);
}

#[test]
fn a_short_arc_of_positions_is_undecided() {
    let short = found(made(3, Made { wander: 5e-3, ..CLEAN }, &hinge(0.5, 0.15)));
    assert_eq!(short.kind.name(), "undecided", "{}", short.log_odds);
    assert!(short.axis.is_none() && !short.notes.is_empty());
}

#[test]
fn too_few_samples_are_refused() {
    let trace =
        PointTrack { name: "few".into(), position: vec![Vector3::zeros(); 4], ..PointTrack::default() };
    assert!(joint_of_traces(&[trace]).unwrap_err().to_string().contains("4 samples"));
}
