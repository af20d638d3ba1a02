//! A made scene of two boxes, one of which slides, ray cast by the test, is recovered from a near start.

use nalgebra::{Point3, Rotation3, UnitQuaternion, Vector3};

use super::{HalfMotion, RadianceConfig, RadianceInput, RadianceTrainer};
use crate::{FieldConfig, FieldError};
use capture::RgbdFrame;
use geometry::{Intrinsics, Pose, SceneBox};

const SIDE: usize = 48;
/// The shift of the second box from state 0 to state 1, meters.
const SHIFT_M: [f64; 3] = [0.0, 0.12, 0.0];

/// Box by center and half sides, meters.
type Cuboid = (Vector3<f64>, Vector3<f64>);

/// The scene of a state.
fn boxes(state: usize) -> [Cuboid; 2] {
    let shift = Vector3::from(SHIFT_M) * state as f64;
    [
        (Vector3::new(-0.12, 0.0, 0.0), Vector3::new(0.08, 0.2, 0.12)),
        (Vector3::new(0.1, -0.06, 0.0) + shift, Vector3::new(0.1, 0.08, 0.08)),
    ]
}

/// z-depth and color of the nearest face that a ray (parameter z-depth) meets.
fn hit(origin: &Point3<f64>, direction: &Vector3<f64>, state: usize) -> Option<(f64, [u8; 3])> {
    let mut nearest: Option<(f64, [u8; 3])> = None;
    for (k, (center, half)) in boxes(state).into_iter().enumerate() {
        let mut enter = 0.0;
        let mut leave = f64::INFINITY;
        let mut axis = 0;
        for a in 0..3 {
            let [p, q] = [-1.0, 1.0].map(|s| (center[a] + s * half[a] - origin[a]) / direction[a]);
            if p.min(q) > enter {
                (enter, axis) = (p.min(q), a);
            }
            leave = leave.min(p.max(q));
        }
        if enter < leave && enter > 0.0 && nearest.is_none_or(|n| enter < n.0) {
            let face = [60u8, 120, 180][axis];
            // Stripes on the faces show how the box slides.
            let at = origin + direction * enter - center;
            let stripe = if ((at.x + at.y + at.z) / 0.05).floor() as i64 % 2 == 0 { 60 } else { 0 };
            nearest = Some((enter, if k == 0 { [face + stripe, 40, 30] } else { [30, face + stripe, 200] }));
        }
    }
    nearest
}

/// Eight views of a state, from two heights.
fn frames(state: usize) -> Vec<RgbdFrame> {
    let intrinsics = Intrinsics { width: SIDE, height: SIDE, fx: 60.0, fy: 60.0, cx: 23.5, cy: 23.5 };
    let view = |i: usize| {
        let turn = std::f64::consts::TAU * (i as f64 + 0.3 * state as f64) / 8.0;
        let up = 0.35 + 0.3 * (i % 2) as f64;
        let eye = Point3::new(turn.cos(), turn.sin(), up);
        let forward = -eye.coords.normalize();
        let right = forward.cross(&Vector3::z()).normalize();
        let axes = nalgebra::Matrix3::from_columns(&[right, forward.cross(&right), forward]);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let world_from_camera = Pose::from_parts(eye.coords.into(), rotation);
        let hits: Vec<_> = (0..SIDE * SIDE)
            .map(|p| {
                let ray = intrinsics.ray_at((p % SIDE) as f64, (p / SIDE) as f64);
                hit(&eye, &(world_from_camera * ray), state)
            })
            .collect();
        RgbdFrame {
            id: format!("{state}_{i:04}"),
            stamp_nanos: 0,
            intrinsics,
            world_from_camera,
            rgb: hits.iter().map(|h| h.map_or([90; 3], |h| h.1)).collect(),
            depth_m: hits.iter().map(|h| h.map_or(0.0, |h| h.0 as f32)).collect(),
            mask: Some(hits.iter().map(Option::is_some).collect()),
            readings: Vec::new(),
        }
    };
    (0..8).map(view).collect()
}

fn scene() -> SceneBox {
    SceneBox::around_box(&Point3::new(-0.2, -0.2, -0.12), &Point3::new(0.2, 0.2, 0.12))
}

fn config(steps: usize) -> RadianceConfig {
    RadianceConfig {
        field: FieldConfig {
            levels: 8,
            base_resolution: 8,
            finest_resolution: 96,
            log2_table_size: 14,
            hidden: 32,
        },
        steps,
        rays: 192,
        samples: 48,
        half_side: 1.3,
        ray_half_side: 0.95,
        // 0.01 a step in 400 steps.
        learning_rate: 0.01 / 75f64.sqrt(),
        motion_rate_scale: 1.0 / 75f64.sqrt(),
        depth_weight: 0.05,
        ..RadianceConfig::default()
    }
}

#[test]
fn a_sliding_box_is_recovered_from_a_near_start() {
    let states = [frames(0), frames(1)];
    let input = RadianceInput { states: [&states[0], &states[1]], scene: scene() };
    let config = config(400);
    // Off by a fifth of the length and 10 degrees of direction.
    let half = 0.5 * scene().scale * 0.12;
    let start = HalfMotion::Prismatic {
        direction: nalgebra::Unit::new_normalize(Vector3::new(0.15, 1.0, -0.1)),
        distance: 0.8 * half,
    };
    let mut trainer = RadianceTrainer::from_motions(&input, &config, vec![start], 5, "test").unwrap();
    let mut losses = Vec::new();
    for _ in 0..trainer.total_steps() {
        losses.push(trainer.train_step());
    }
    let model = trainer.trained_model();
    let shift = model.motions_to_state1()[0].translation.vector;
    let mean = |l: &[super::RadianceLosses]| l.iter().map(|l| l.color).sum::<f64>() / l.len() as f64;
    let first = mean(&losses[..20]);
    let last = mean(&losses[380..]);
    let distance_m = shift.norm();
    let angle = shift.normalize().dot(&Vector3::y()).acos().to_degrees();
    println!("color {first:.5} -> {last:.5}; {distance_m:.4} m at {angle:.2} degrees");
    assert!(matches!(model.motions[0], HalfMotion::Prismatic { .. }));
    assert!(last < 0.1 * first, "color loss {first} to {last}");
    assert!((distance_m - 0.12).abs() < 0.05 * 0.12, "{distance_m}");
    assert!(angle < 4.0, "{angle} degrees");
}

#[test]
fn a_resumed_training_continues_bit_by_bit() {
    let states = [frames(0), frames(1)];
    let input = RadianceInput { states: [&states[0], &states[1]], scene: scene() };
    let config = RadianceConfig { parts: 3, ..config(12) };
    let trainer = || RadianceTrainer::free(&input, &config, 9, "test").unwrap();
    let mut whole = trainer();
    for _ in 0..4 {
        whole.train_step();
    }
    let mut resumed = trainer();
    resumed.restore(whole.checkpoint()).unwrap();
    for _ in 0..4 {
        assert_eq!(whole.train_step(), resumed.train_step());
    }
    assert!(whole.checkpoint() == resumed.checkpoint());
    // Another seed is another run.
    let mut other = RadianceTrainer::free(&input, &config, 10, "test").unwrap();
    assert!(other.train_step() != trainer().train_step());

    let mut fewer =
        RadianceTrainer::free(&input, &RadianceConfig { parts: 2, ..config.clone() }, 9, "test").unwrap();
    let refused = fewer.restore(whole.checkpoint());
    assert!(matches!(refused, Err(FieldError::Checkpoint { what: "fields", found: 3, expected: 2 })));
}

#[test]
fn the_second_phase_starts_from_the_motions_that_the_first_found() {
    let states = [frames(0), frames(1)];
    let input = RadianceInput { states: [&states[0], &states[1]], scene: scene() };
    let config = config(10);
    let mut free = RadianceTrainer::free(&input, &config, 3, "free").unwrap();
    for _ in 0..3 {
        free.train_step();
    }
    let model = free.trained_model();
    let fresh = RadianceTrainer::typed(&input, &config, &model, 3, "typed").unwrap();
    assert_eq!(fresh.trained_model().motions, [model.motions[0].typed_joint()]);
    assert!(fresh.trained_model().fields != model.fields);
    // A state without a view is refused.
    let none = RadianceInput { states: [&states[0], &[]], scene: scene() };
    assert!(matches!(RadianceTrainer::free(&none, &config, 3, "x"), Err(FieldError::NoViews { state: 1 })));
}
