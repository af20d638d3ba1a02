//! The CPU engine against the equations, against itself on other instruction sets and thread numbers.

use super::reference::{Reference, batch, check_gradients, field, loss_cases, small_config};
use super::{CpuEngine, EngineState, FieldConfig, FieldEngine, FieldParams, InstructionSet, SdfTarget};

fn engine(params: &FieldParams, isa: InstructionSet) -> CpuEngine {
    CpuEngine::with_instructions(EngineState::untrained(params.clone()), isa)
}

#[test]
fn gradients_of_all_losses_agree_with_differences() {
    let params = field(&small_config(), 1);
    for isa in InstructionSet::available_sets() {
        check_gradients(&mut engine(&params, isa), &params, &[("all", batch(24, 10, 2), true)], 1e-5);
    }
}

#[test]
fn gradients_of_each_loss_alone_agree_with_differences() {
    let params = field(&small_config(), 3);
    let mut engine = engine(&params, InstructionSet::detect());
    check_gradients(&mut engine, &params, &loss_cases(&batch(20, 10, 4)), 1e-5);
}

#[test]
fn odd_shapes_have_right_gradients() {
    let config =
        FieldConfig { levels: 3, base_resolution: 5, finest_resolution: 11, log2_table_size: 9, hidden: 13 };
    let params = field(&config, 5);
    let mut engine = engine(&params, InstructionSet::detect());
    check_gradients(&mut engine, &params, &[("all", batch(7, 33, 6), true)], 1e-5);
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
    assert!(e.training_state().params == params);
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
