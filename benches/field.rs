//! Time of an optimiser step of the CPU field engine and of field queries, per instruction set.
//!
//! `cargo bench --bench field`. The speed target is stated for 65,536 points on 16 levels of 2^17 entries.

use divan::Bencher;
use field::{
    CpuEngine, EngineState, FieldConfig, FieldEngine, FieldParams, InstructionSet, SampleBatch, SdfTarget,
};
use numeric::random::stage_rng;
use rand_core::Rng;

fn main() {
    divan::main();
}

fn uniform(rng: &mut impl Rng) -> f32 {
    (rng.next_u32() >> 8) as f32 / (1u32 << 24) as f32
}

/// Points at random places (the worst case for the caches), all with TSDF and color loss.
fn batch(rays: usize, samples_per_ray: usize) -> SampleBatch {
    let mut rng = stage_rng(1, "bench", 0);
    let n = rays * samples_per_ray;
    SampleBatch {
        rays,
        samples_per_ray,
        points: (0..n).map(|_| std::array::from_fn(|_| uniform(&mut rng))).collect(),
        targets: (0..n).map(|_| SdfTarget::Surface { value: uniform(&mut rng), weight: 1.0 }).collect(),
        color_weights: vec![1.0 / samples_per_ray as f32; n],
        directions: vec![[0.0, 0.6, 0.8]; rays],
        colors: (0..rays).map(|_| std::array::from_fn(|_| uniform(&mut rng))).collect(),
        ray_weights: vec![10.0; rays],
    }
}

fn engine(config: &FieldConfig, isa: InstructionSet) -> CpuEngine {
    let params = FieldParams::random_params(config, &mut stage_rng(1, "bench/field", 0));
    CpuEngine::with_instructions(EngineState::untrained(params), isa)
}

fn steps(bencher: Bencher<'_, '_>, config: &FieldConfig, isa: InstructionSet) {
    let (mut engine, batch) = (engine(config, isa), batch(4096, 16));
    for _ in 0..3 {
        engine.train_step(&batch, 0.01);
    }
    let counter = divan::counter::ItemsCount::new(batch.points.len());
    bencher.counter(counter).bench_local(|| engine.train_step(&batch, 0.01));
}

/// 65,536 points, 16 levels of 2^17.
#[divan::bench(args = InstructionSet::available_sets().into_iter().map(InstructionSet::name))]
fn step_16_levels_of_2_17(bencher: Bencher<'_, '_>, isa: &str) {
    let config = FieldConfig {
        levels: 16,
        base_resolution: 16,
        finest_resolution: 512,
        log2_table_size: 17,
        hidden: 64,
    };
    steps(bencher, &config, named(isa));
}

/// 65,536 points, the default field.
#[divan::bench(args = InstructionSet::available_sets().into_iter().map(InstructionSet::name))]
fn step_default_field(bencher: Bencher<'_, '_>, isa: &str) {
    steps(bencher, &FieldConfig::default(), named(isa));
}

fn named(name: &str) -> InstructionSet {
    let sets = InstructionSet::available_sets();
    sets.iter().copied().find(|i| i.name() == name).unwrap_or(sets[0])
}
