//! The burn engine against the equations in double precision, against Adam as published, and across devices.

use burn::tensor::Device;

use super::reference::{batch, check_gradients, field, loss_cases, with_losses};
use super::{
    ADAM_BETAS, ADAM_EPSILON, BurnEngine, CpuEngine, EngineError, EngineState, FieldConfig, FieldEngine,
    FieldParams, SampleBatch,
};

/// One dense level and two hashed ones, 16 hidden units.
fn small_field(seed: u64) -> FieldParams {
    field(
        &FieldConfig { levels: 3, base_resolution: 3, finest_resolution: 12, log2_table_size: 8, hidden: 16 },
        seed,
    )
}

fn fresh(params: &FieldParams) -> EngineState {
    EngineState::untrained(params.clone())
}

fn flex(state: EngineState) -> BurnEngine {
    BurnEngine::flex(state).unwrap_or_else(|e| panic!("{e}"))
}

/// Compares losses and gradients of all loss terms with the reference.
fn check_engine(make: impl Fn(EngineState) -> BurnEngine) {
    let params = small_field(1);
    check_gradients(&mut make(fresh(&params)), &params, &loss_cases(&batch(24, 10, 2)), 2e-5);
}

/// Adam as published, in double precision (Kingma and Ba 2015, algorithm 1).
struct PlainAdam {
    x: Vec<f64>,
    m: Vec<f64>,
    v: Vec<f64>,
    t: i32,
}

impl PlainAdam {
    fn step(&mut self, gradient: &[f32], rate: f64) {
        let b1 = f64::from(ADAM_BETAS.0);
        let b2 = f64::from(ADAM_BETAS.1);
        self.t += 1;
        for (i, &g) in gradient.iter().enumerate() {
            let g = f64::from(g);
            self.m[i] = b1 * self.m[i] + (1.0 - b1) * g;
            self.v[i] = b2 * self.v[i] + (1.0 - b2) * g * g;
            let m = self.m[i] / (1.0 - b1.powi(self.t));
            let v = self.v[i] / (1.0 - b2.powi(self.t));
            self.x[i] -= rate * m / (v.sqrt() + f64::from(ADAM_EPSILON));
        }
    }
}

fn check_adam(make: impl Fn(EngineState) -> BurnEngine) {
    let params = small_field(2);
    let batch = batch(16, 8, 3);
    let mut engine = make(fresh(&params));
    let flat: Vec<f64> = params.flatten().into_iter().map(f64::from).collect();
    let mut plain = PlainAdam { m: vec![0.0; flat.len()], v: vec![0.0; flat.len()], x: flat, t: 0 };
    let mut previous = f64::INFINITY;
    for k in 0..5u8 {
        let rate = 0.01 / f32::from(k + 1);
        let (before, gradient) = engine.loss_gradient(&batch);
        assert!(before.sdf + before.color < previous, "step {k}: the loss rises");
        previous = before.sdf + before.color;
        let losses = engine.train_step(&batch, rate);
        assert!(
            (losses.sdf - before.sdf).abs() < 1e-6 * before.sdf
                && (losses.color - before.color).abs() < 1e-6 * before.color
        );
        plain.step(&gradient, f64::from(rate));
    }
    let state = engine.training_state();
    assert_eq!(state.steps, 5);
    let close = |name: &str, ours: &[f32], expected: &[f64], tolerance: f64| {
        let worst = ours.iter().zip(expected).map(|(a, e)| (f64::from(*a) - e).abs()).fold(0.0, f64::max);
        assert!(worst < tolerance, "{name}: {worst}");
    };
    let scale = plain.m.iter().fold(0.0f64, |a, m| a.max(m.abs()));
    close("first moments", &state.first, &plain.m, 1e-5 * scale);
    close("second moments", &state.second, &plain.v, 1e-5 * scale * scale);
    close("parameters", &state.params.flatten(), &plain.x, 2e-5);
    assert!(state.params != params);
}

#[test]
fn gradients_agree_with_differences() {
    check_engine(flex);
}

#[test]
fn steps_are_those_of_adam() {
    check_adam(flex);
}

#[test]
fn a_resumed_engine_goes_on_as_if_it_had_not_stopped() {
    let params = small_field(4);
    let batches: Vec<SampleBatch> = (0..6).map(|k| batch(12, 6, k)).collect();
    let mut whole = BurnEngine::new(params.clone(), Device::flex()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(whole.training_state(), fresh(&params));
    let mut parts = flex(fresh(&params));
    for (k, b) in batches.iter().enumerate() {
        if k == 3 {
            parts = flex(parts.training_state());
        }
        assert_eq!(whole.train_step(b, 0.01), parts.train_step(b, 0.01));
    }
    assert_eq!(whole.training_state(), parts.training_state());
}

#[test]
fn gradients_of_the_pieces_of_a_batch_add_up() {
    let params = small_field(5);
    let rays = 3;
    let per_ray = 1 << 16;
    let big = batch(rays, per_ray, 6);
    let mut engine = flex(fresh(&params));
    let (loss, gradient) = engine.loss_gradient(&big);
    let mut sum = vec![0.0f64; gradient.len()];
    let mut sdf = 0.0;
    let mut color = 0.0;
    for ray in 0..rays {
        let range = ray * per_ray..(ray + 1) * per_ray;
        let one = SampleBatch {
            rays: 1,
            samples_per_ray: per_ray,
            points: big.points[range.clone()].to_vec(),
            targets: big.targets[range.clone()].to_vec(),
            color_weights: big.color_weights[range].to_vec(),
            directions: vec![big.directions[ray]],
            colors: vec![big.colors[ray]],
            ray_weights: vec![big.ray_weights[ray]],
        };
        let (l, g) = engine.loss_gradient(&one);
        (sdf, color) = (sdf + l.sdf / 3.0, color + l.color / 3.0);
        sum.iter_mut().zip(g).for_each(|(s, g)| *s += f64::from(g) / 3.0);
    }
    assert!(
        (loss.sdf - sdf).abs() < 1e-5 * sdf && (loss.color - color).abs() < 1e-5 * color,
        "{loss:?} {sdf} {color}"
    );
    let largest = sum.iter().fold(0.0f64, |a, g| a.max(g.abs()));
    let worst = sum.iter().zip(&gradient).map(|(s, g)| (s - f64::from(*g)).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-4 * largest, "{worst} of {largest}");
}

#[test]
fn a_batch_without_losses_moves_nothing() {
    let params = small_field(6);
    let mut engine = flex(fresh(&params));
    let idle = with_losses(&batch(4, 4, 7), |_| false, false);
    for b in [idle, SampleBatch::default()] {
        let losses = engine.train_step(&b, 0.01);
        assert_eq!((losses.sdf, losses.color), (0.0, 0.0));
    }
    assert_eq!(engine.training_state().params, params);
}

#[test]
fn damaged_states_are_refused() {
    let refused = |damage: fn(&mut EngineState)| {
        let mut state = fresh(&small_field(7));
        damage(&mut state);
        match BurnEngine::flex(state) {
            Err(EngineError::Shape(text)) => text,
            Err(other) => panic!("{other}"),
            Ok(_) => panic!("accepted"),
        }
    };
    assert!(refused(|s| s.first.truncate(5)).contains("5 and"));
    assert!(refused(|s| s.params.table.truncate(5)).contains("the table holds 5"));
    assert!(refused(|s| s.params.levels[2].entries = 200).contains("level 2"));
    assert!(refused(|s| s.params.levels[1].offset += 2).contains("level 1"));
    assert!(refused(|s| s.params.levels[0].resolution += 1).contains("level 0"));
    assert!(refused(|s| s.params.color[1].inputs = 3).contains("color layer"));
    assert!(refused(|s| drop(s.params.color.pop())).contains("color network"));
}

#[test]
fn a_failing_engine_keeps_its_last_state() {
    let params = small_field(8);
    let good = batch(4, 4, 7);
    let mut engine = flex(fresh(&params));
    engine.train_step(&good, 0.01);
    let before = engine.training_state();
    engine.train_step(&good, 0.01);
    let mut broken = good.clone();
    broken.directions.clear();
    assert!(engine.train_step(&broken, 0.01).sdf.is_nan());
    assert!(matches!(engine.failure(), Some(EngineError::Failed { doing: "took a training step", .. })));
    assert!(engine.train_step(&good, 0.01).color.is_nan() && engine.loss_gradient(&good).1[0].is_nan());
    assert_eq!(engine.training_state(), before);
}

#[test]
fn the_trial_of_a_device_passes_where_the_device_works() {
    let mut state = fresh(&small_field(11));
    flex(state.clone()).check(state.clone()).unwrap_or_else(|e| panic!("{e}"));
    let engine = &mut flex(state.clone());
    state.params.color[2].biases[0] += 1.0;
    assert!(matches!(engine.check(state), Err(EngineError::Unavailable { .. })));
}

/// A checkpoint moves between the engines: they take the same steps up to rounding.
#[test]
fn the_engines_agree() {
    let params = small_field(10);
    let n = params.parameter_count();
    let mut ours = flex(fresh(&params));
    let mut cpu = CpuEngine::new(params);
    for k in 0..8 {
        let b = batch(20, 8, 20 + k);
        if k == 4 {
            let swapped = flex(cpu.training_state());
            cpu = CpuEngine::resume(ours.training_state());
            ours = swapped;
        }
        let (la, ga) = ours.loss_gradient(&b);
        let (lb, gb) = cpu.loss_gradient(&b);
        assert!(
            (la.sdf - lb.sdf).abs() < 1e-3 * lb.sdf && (la.color - lb.color).abs() < 1e-3 * lb.color,
            "step {k}: {la:?} {lb:?}"
        );
        let largest = gb.iter().fold(0.0f32, |a, g| a.max(g.abs()));
        let apart = ga.iter().zip(&gb).filter(|(a, b)| (*a - *b).abs() > 1e-3 * largest).count();
        assert!(apart * 1000 < n, "step {k}: {apart} of {n} gradients differ");
        ours.train_step(&b, 0.01);
        cpu.train_step(&b, 0.01);
    }
    assert_eq!((ours.training_state().steps, cpu.training_state().steps), (8, 8));
}

#[cfg(not(feature = "gpu"))]
#[test]
fn a_build_without_gpu_says_so() {
    assert_eq!(BurnEngine::wgpu(fresh(&small_field(9))).err(), Some(EngineError::NotBuilt));
}

/// The checks above on the default adapter.
#[cfg(feature = "gpu")]
#[test]
#[ignore = "needs an adapter of a GPU: apt-get install mesa-vulkan-drivers"]
fn the_gpu_agrees_with_the_equations() {
    let wgpu = |s| BurnEngine::wgpu(s).unwrap_or_else(|e| panic!("{e}"));
    check_engine(wgpu);
    check_adam(wgpu);
}

/// Milliseconds of the parts of a step of 65,536 points on a GPU, each waited for: `cargo test --release
/// --features gpu --lib -- --ignored --nocapture where_a_step_goes`.
#[cfg(feature = "gpu")]
#[test]
#[ignore = "a measurement"]
fn where_a_step_goes() {
    use super::burn_batch::batch_pieces;
    use super::burn_hash::hash_encode;
    use super::burn_model::{FieldShape, piece_losses as losses_of, upload_tensors};
    use std::time::Instant;

    let config = FieldConfig {
        levels: 16,
        base_resolution: 16,
        finest_resolution: 512,
        log2_table_size: 17,
        hidden: 64,
    };
    let params = field(&config, 1);
    let shape = FieldShape::of_params(&params);
    let batch = batch(4096, 16, 3);
    let device = super::burn_device::wgpu_device().unwrap_or_else(|e| panic!("{e}"));
    let tensors = upload_tensors(&shape, &params.flatten(), &device);
    let waits = || device.sync().unwrap_or_else(|e| panic!("{e}"));
    let timed = |name: &str, work: &mut dyn FnMut()| {
        let mut times: Vec<f64> = (0..12)
            .map(|_| {
                waits();
                let begin = Instant::now();
                work();
                waits();
                1e3 * begin.elapsed().as_secs_f64()
            })
            .collect();
        let first = times[0];
        times.sort_by(f64::total_cmp);
        eprintln!("{name}: {:.2} ms, first {first:.0}", times[times.len() / 2]);
    };
    let tracked = || -> Vec<_> { tensors.iter().map(|p| p.clone().autodiff().require_grad()).collect() };
    timed("cut into pieces", &mut || drop(batch_pieces(&batch)));
    let piece = batch_pieces(&batch).remove(0);
    let points = burn::tensor::Tensor::<2>::from_data(
        burn::tensor::TensorData::new(piece.points.clone(), [piece.samples, 3]),
        &device,
    );
    let levels = shape.levels.len();
    timed("encode", &mut || drop(hash_encode(&points, &tensors[..levels], &shape.levels)));
    timed("encode and scatter", &mut || {
        let own = tracked();
        let found = hash_encode(&points.clone().autodiff(), &own[..levels], &shape.levels).sum().backward();
        drop(own.iter().map(|p| p.grad(&found)).collect::<Vec<_>>());
    });
    timed("forward", &mut || drop(losses_of(&shape, &tensors, &batch, &piece)));
    timed("forward and backward", &mut || {
        let own = tracked();
        let (sdf, color) = losses_of(&shape, &own, &batch, &piece);
        let found = (sdf + color).backward();
        drop(own.iter().map(|p| p.grad(&found)).collect::<Vec<_>>());
    });
    let mut engine = BurnEngine::wgpu(fresh(&params)).unwrap_or_else(|e| panic!("{e}"));
    timed("step", &mut || {
        engine.train_step(&batch, 0.01);
    });
}
