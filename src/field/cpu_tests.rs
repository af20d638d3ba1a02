//! The CPU engine against the equations, against itself on other instruction sets and thread numbers.

use super::reference::{Reference, batch, field, losses, small_config};
use super::{
    CpuEngine, EngineState, FieldConfig, FieldEngine, FieldParams, InstructionSet, SampleBatch, SdfTarget,
};

fn engine(params: &FieldParams, isa: InstructionSet) -> CpuEngine {
    let n = params.parameter_count();
    CpuEngine::with_instructions(
        EngineState { params: params.clone(), first: vec![0.0; n], second: vec![0.0; n], steps: 0 },
        isa,
    )
}

/// Central difference of the loss by one parameter; `None` at a kink, where the two one-sided differences
/// disagree.
fn numeric(params: &FieldParams, batch: &SampleBatch, index: usize) -> Option<f64> {
    let mut field = Reference::new(params);
    let value = field.flat[index];
    let mut total = |delta: f64| {
        field.flat[index] = value + delta;
        let (sdf, color) = losses(&field, batch);
        sdf + color
    };
    let h = 1e-6;
    let up = total(h);
    let down = total(-h);
    let zero = total(0.0);
    let right = (up - zero) / h;
    let left = (zero - down) / h;
    ((right - left).abs() <= 1e-4 * (1e-3 + right.abs().max(left.abs()))).then_some((up - down) / (2.0 * h))
}

/// Compares gradients at indices of every tensor; returns how many were compared.
fn check_gradient(params: &FieldParams, batch: &SampleBatch, isa: InstructionSet) -> usize {
    let (loss, gradient) = engine(params, isa).loss_gradient(batch);
    let (sdf, color) = losses(&Reference::new(params), batch);
    assert!(
        (loss.sdf - sdf).abs() < 1e-5 * (1.0 + sdf) && (loss.color - color).abs() < 1e-5 * (1.0 + color),
        "{loss:?} {sdf} {color}"
    );
    let mut sizes: Vec<usize> = params.levels.iter().map(|l| l.entries * 2).collect();
    for l in params.geometry.iter().chain(&params.color) {
        sizes.extend([l.weights.len(), l.biases.len()]);
    }
    let mut offset = 0;
    let mut compared = 0;
    for (tensor, size) in sizes.into_iter().enumerate() {
        let norm = gradient[offset..offset + size].iter().fold(0.0f32, |a, g| a.max(g.abs()));
        assert!(norm > 0.0, "tensor {tensor} has no gradient");
        let mut here = 0;
        for k in 0..size.min(12) {
            let index = offset + (k * 7919 + 13) % size;
            let Some(expected) = numeric(params, batch, index) else { continue };
            let error = (f64::from(gradient[index]) - expected).abs();
            let tolerance = 1e-4 * expected.abs() + 1e-5 * f64::from(norm);
            assert!(
                error < tolerance,
                "tensor {tensor} entry {}: {} but {expected}",
                index - offset,
                gradient[index]
            );
            here += usize::from(expected != 0.0);
        }
        assert!(here > 0, "tensor {tensor}: nothing compared");
        compared += here;
        offset += size;
    }
    assert_eq!(offset, gradient.len());
    compared
}

#[test]
fn gradients_of_all_losses_agree_with_differences() {
    let params = field(&small_config(), 1);
    for isa in InstructionSet::available_sets() {
        assert!(check_gradient(&params, &batch(24, 10, 2), isa) > 80);
    }
}

#[test]
fn gradients_of_each_loss_alone_agree_with_differences() {
    let params = field(&small_config(), 3);
    let isa = InstructionSet::detect();
    let only = |keep: fn(&SdfTarget) -> bool, color: bool| {
        let mut b = batch(20, 10, 4);
        for (target, weight) in b.targets.iter_mut().zip(&mut b.color_weights) {
            if !keep(target) {
                *target = SdfTarget::Ignore;
            }
            *weight = if color { *weight } else { 0.0 };
        }
        b
    };
    let cases: [(fn(&SdfTarget) -> bool, bool); 4] = [
        (|t| matches!(t, SdfTarget::Empty { .. }), false),
        (|t| matches!(t, SdfTarget::Surface { .. }), false),
        (|t| matches!(t, SdfTarget::Background { .. }), false),
        (|_| false, true),
    ];
    for (keep, color) in cases {
        let b = only(keep, color);
        let (loss, gradient) = engine(&params, isa).loss_gradient(&b);
        let (sdf, rgb) = losses(&Reference::new(&params), &b);
        assert!((loss.sdf - sdf).abs() < 1e-5 * (1.0 + sdf) && (loss.color - rgb).abs() < 1e-5 * (1.0 + rgb));
        let table = params.table.len();
        let geometry: usize = params.geometry.iter().map(|l| l.weights.len() + l.biases.len()).sum();
        let probes = (0..geometry).step_by(53).map(|i| table + i).chain((0..table).step_by(97));
        let probes = probes.chain((table + geometry..gradient.len()).step_by(331));
        let mut compared = 0;
        for index in probes {
            let Some(expected) = numeric(&params, &b, index) else { continue };
            let norm = gradient.iter().fold(0.0f32, |a, g| a.max(g.abs()));
            assert!(
                (f64::from(gradient[index]) - expected).abs()
                    < 1e-4 * expected.abs() + 1e-5 * f64::from(norm)
            );
            compared += usize::from(expected != 0.0);
        }
        assert!(compared > 20);
    }
}

#[test]
fn odd_shapes_have_right_gradients() {
    let config =
        FieldConfig { levels: 3, base_resolution: 5, finest_resolution: 11, log2_table_size: 9, hidden: 13 };
    check_gradient(&field(&config, 5), &batch(7, 33, 6), InstructionSet::detect());
}

#[test]
fn instruction_sets_agree() {
    let config = FieldConfig {
        levels: 12,
        base_resolution: 16,
        finest_resolution: 128,
        log2_table_size: 12,
        hidden: 64,
    };
    let params = field(&config, 7);
    let b = batch(200, 20, 8);
    let sets = InstructionSet::available_sets();
    let results: Vec<_> = sets.iter().map(|&isa| engine(&params, isa).loss_gradient(&b)).collect();
    let norm = results[0].1.iter().fold(0.0f32, |a, g| a.max(g.abs()));
    for ((losses, gradient), isa) in results.iter().zip(&sets) {
        assert!((losses.sdf - results[0].0.sdf).abs() < 1e-5 * losses.sdf, "{}", isa.name());
        assert!((losses.color - results[0].0.color).abs() < 1e-5 * losses.color, "{}", isa.name());
        let worst = gradient.iter().zip(&results[0].1).fold(0.0f32, |a, (x, y)| a.max((x - y).abs()));
        assert!(worst <= 1e-5 * norm, "{}: {worst} of {norm}", isa.name());
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let config =
        FieldConfig { levels: 8, base_resolution: 8, finest_resolution: 64, log2_table_size: 14, hidden: 64 };
    let train = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut e = engine(&field(&config, 9), InstructionSet::detect());
            let losses: Vec<_> = (0..5).map(|k| e.train_step(&batch(150, 24, 100 + k), 0.01)).collect();
            (losses, e.training_state())
        })
    };
    let one = train(1);
    let two = train(2);
    assert_eq!(one.0, two.0);
    assert!(one.1 == two.1, "parameters differ between one and two threads");
    assert!(train(3) == two);
}

#[test]
fn a_resumed_engine_continues_bit_by_bit() {
    let mut whole = engine(&field(&small_config(), 11), InstructionSet::detect());
    for k in 0..4 {
        whole.train_step(&batch(60, 16, k), 0.01);
    }
    let mut resumed = CpuEngine::resume(whole.training_state());
    for k in 4..8 {
        whole.train_step(&batch(60, 16, k), 0.005);
        resumed.train_step(&batch(60, 16, k), 0.005);
    }
    assert!(whole.training_state() == resumed.training_state());
}

/// Adam as its paper writes it, dense, in double precision.
#[test]
fn updates_are_dense_adam() {
    let params = field(&small_config(), 13);
    let mut e = engine(&params, InstructionSet::detect());
    let mut expected: Vec<f64> = params.flatten().into_iter().map(f64::from).collect();
    let mut m = vec![0.0; expected.len()];
    let mut v = vec![0.0; expected.len()];
    for t in 1..=6i32 {
        // Few points, so that many entries that moved before have no gradient now.
        let b = batch(3, 5, t as u64);
        let g = e.loss_gradient(&b).1;
        let rate = 0.01 / f64::from(t);
        e.train_step(&b, rate as f32);
        for i in 0..expected.len() {
            let g = f64::from(g[i]);
            m[i] = 0.9 * m[i] + 0.1 * g;
            v[i] = 0.999 * v[i] + 0.001 * g * g;
            let mh = m[i] / (1.0 - 0.9f64.powi(t));
            let vh = v[i] / (1.0 - 0.999f64.powi(t));
            expected[i] -= rate * mh / (vh.sqrt() + 1e-15);
        }
    }
    let flat = e.training_state().params.flatten();
    let moved = params.flatten().iter().zip(&flat).filter(|(a, b)| a != b).count();
    assert!(moved > 100 && moved < flat.len(), "{moved} of {} moved", flat.len());
    let worst = flat.iter().zip(&expected).fold(0.0f64, |a, (&x, y)| a.max((f64::from(x) - y).abs()));
    assert!(worst < 2e-6, "{worst}");
}

#[test]
fn a_batch_without_losses_changes_nothing_at_first() {
    let params = field(&small_config(), 15);
    let mut b = batch(10, 10, 16);
    b.targets.fill(SdfTarget::Ignore);
    b.color_weights.fill(0.0);
    let mut e = engine(&params, InstructionSet::detect());
    let losses = e.train_step(&b, 0.01);
    assert_eq!((losses.sdf, losses.color), (0.0, 0.0));
    assert!(e.current_params() == &params);
}

#[test]
fn the_encoding_is_continuous() {
    let params = field(&small_config(), 17);
    let encode = |unit| Reference::new(&params).encode(unit);
    for level in &params.levels {
        // Across a cell border along x the interpolant must not jump.
        let border = (5.0 - 0.5) / f64::from(level.scale);
        if border < 1.0 {
            let a = encode([border - 1e-9, 0.31, 0.62]);
            let b = encode([border + 1e-9, 0.31, 0.62]);
            assert!(a.iter().zip(&b).all(|(x, y)| (x - y).abs() < 1e-6));
        }
    }
}
