//! One optimiser step of 65,536 points (16 levels of 2^17 entries, both networks) on every engine, in turn,
//! so that the machine's noise hits all alike; and the processor's measured peak. One JSON object a line;
//! `benches/performance.py` makes a table of it.
//!
//! `cargo bench --bench step`; with `--features gpu` also on the GPU.

#![allow(clippy::print_stdout, reason = "a bench prints what it measured")]

mod machine;

use std::time::Instant;

use field::{
    BurnEngine, CpuEngine, EngineState, FieldConfig, FieldEngine, FieldParams, InstructionSet, SampleBatch,
    SdfTarget, StepPhase,
};
use numeric::random::stage_rng;
use rand_core::Rng as _;

const RAYS: usize = 4096;
const SAMPLES_PER_RAY: usize = 16;
/// Rounds over the engines; the fast ones also take this many steps in each.
const ROUNDS: usize = 5;

fn main() {
    let config = FieldConfig {
        levels: 16,
        base_resolution: 16,
        finest_resolution: 512,
        log2_table_size: 17,
        hidden: 64,
    };
    let params = FieldParams::random_params(&config, &mut stage_rng(1, "bench/step", 0));
    let layers = params.geometry.iter().chain(&params.color);
    let weights: usize = layers.map(|l| l.weights.len()).sum();
    // A weight takes a multiplication and an addition forward, for the gradient of its input and for its own.
    let network_flops = 6.0 * (weights * RAYS * SAMPLES_PER_RAY) as f64;
    let state = EngineState::untrained(params);
    let batch = batch();

    let mut cpu: Vec<(InstructionSet, CpuEngine, Vec<Step>)> = InstructionSet::available_sets()
        .into_iter()
        .map(|isa| (isa, CpuEngine::with_instructions(state.clone(), isa), Vec::new()))
        .collect();
    let burn =
        [("burn on the CPU", BurnEngine::flex(state.clone())), ("burn on the GPU", BurnEngine::wgpu(state))];
    let mut burn: Vec<(&str, BurnEngine, Vec<f64>)> =
        burn.into_iter().filter_map(|(name, engine)| Some((name, engine.ok()?, Vec::new()))).collect();
    let mut peaks: Vec<f64> = Vec::new();
    for _ in 0..ROUNDS {
        peaks.push(machine::peak_gflops());
        for (_, engine, steps) in &mut cpu {
            (0..ROUNDS).for_each(|_| steps.push(timed(engine, &batch)));
        }
        for (_, engine, seconds) in &mut burn {
            let begin = Instant::now();
            engine.train_step(&batch, 0.01);
            // Reading the losses waits for the forward pass only: the next step waits for this one's update.
            seconds.push(begin.elapsed().as_secs_f64());
        }
    }
    let peak = peaks.iter().copied().fold(0.0, f64::max);
    println!(
        "{}",
        serde_json::json!({"peak_gflops": peak, "threads": rayon::current_num_threads(),
                           "points": RAYS * SAMPLES_PER_RAY})
    );
    for (isa, _, steps) in &cpu {
        let best = |of: fn(&Step) -> f64| steps.iter().map(of).fold(f64::INFINITY, f64::min);
        let networks = best(|s| s.networks);
        println!(
            "{}",
            serde_json::json!({
                "engine": isa.name(), "step_ms": 1e3 * best(|s| s.all),
                "median_ms": 1e3 * median(steps.iter().map(|s| s.all).collect()),
                "encode_ms": 1e3 * best(|s| s.encode), "networks_ms": 1e3 * networks,
                "table_ms": 1e3 * best(|s| s.table),
                "networks_share_of_peak": network_flops / networks / 1e9 / peak,
            })
        );
    }
    for (name, _, seconds) in &burn {
        let best = seconds[1..].iter().copied().fold(f64::INFINITY, f64::min);
        println!(
            "{}",
            serde_json::json!({"engine": name, "step_ms": 1e3 * best,
                               "median_ms": 1e3 * median(seconds[1..].to_vec())})
        );
    }
}

/// Seconds of the phases of a step.
#[derive(Default)]
struct Step {
    all: f64,
    encode: f64,
    networks: f64,
    table: f64,
}

fn timed(engine: &mut CpuEngine, batch: &SampleBatch) -> Step {
    let mut step = Step::default();
    let begin = Instant::now();
    let mut last = begin;
    engine.step_by_phases(batch, 0.01, |phase| {
        let now = Instant::now();
        let seconds = (now - last).as_secs_f64();
        last = now;
        match phase {
            StepPhase::Encode => step.encode = seconds,
            StepPhase::Networks => step.networks = seconds,
            StepPhase::Table => step.table = seconds,
            StepPhase::Plan | StepPhase::Layers => {}
        }
    });
    step.all = begin.elapsed().as_secs_f64();
    step
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Points at random places (the worst case for the caches), all with TSDF and color loss.
fn batch() -> SampleBatch {
    let mut rng = stage_rng(1, "bench", 0);
    let mut uniform = || (rng.next_u32() >> 8) as f32 / (1u32 << 24) as f32;
    let n = RAYS * SAMPLES_PER_RAY;
    SampleBatch {
        rays: RAYS,
        samples_per_ray: SAMPLES_PER_RAY,
        points: (0..n).map(|_| std::array::from_fn(|_| uniform())).collect(),
        targets: (0..n).map(|_| SdfTarget::Surface { value: uniform(), weight: 1.0 }).collect(),
        color_weights: vec![1.0 / SAMPLES_PER_RAY as f32; n],
        directions: vec![[0.0, 0.6, 0.8]; RAYS],
        colors: (0..RAYS).map(|_| std::array::from_fn(|_| uniform())).collect(),
        ray_weights: vec![10.0; RAYS],
    }
}
