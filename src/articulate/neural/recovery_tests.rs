//! The whole search on analytic scenes.

use nalgebra::Vector3;

use crate::neural::{
    config::ArticulationConfig,
    optimise::{ArticulationStart, ArticulationTrainer},
    test_scene::{Block, TestScene, two_blocks},
};
use geometry::Pose;

fn run(trainer: &mut ArticulationTrainer<'_>) {
    while !trainer.is_done() {
        trainer.step();
    }
}

/// Rotation error in degrees and error at the part's center in millimeters.
fn errors(found: &Pose, truth: &Pose, block: &Block) -> (f64, f64) {
    let center = nalgebra::Point3::from(block.pose.translation.vector);
    (found.rotation.angle_to(&truth.rotation).to_degrees(), (found * center - truth * center).norm() * 1e3)
}

/// Share of surface points with the right label.
fn agreement(trainer: &ArticulationTrainer<'_>, scene: &TestScene) -> f64 {
    let mut right = 0;
    let mut all = 0;
    for state in 0..2 {
        let (points, truth) = scene.labelled(state);
        let found = trainer.labels(state, &points);
        right += found.iter().zip(&truth).filter(|(a, b)| a == b).count();
        all += truth.len();
    }
    right as f64 / all as f64
}

fn check_recovery(scene: &TestScene, trainer: &mut ArticulationTrainer<'_>) {
    run(trainer);
    let found = trainer.motions();
    for (part, block) in scene.shapes[0].blocks.iter().enumerate() {
        let (deg, mm) = errors(&found[part], &scene.motions[part], block);
        assert!(deg < 0.1 && mm < 1.0, "part {part}: {deg} deg, {mm} mm");
    }
    assert!(agreement(trainer, scene) > 0.97);
}

fn quick() -> ArticulationConfig {
    ArticulationConfig {
        rays: 192,
        uniform_points: 2000,
        matches: 256,
        grid_nodes: 30,
        ..ArticulationConfig::default()
    }
}

#[test]
fn a_translation_is_found_from_the_identity() {
    let scene = two_blocks(Pose::translation(0.1, -0.06, 0.0), 81);
    let problem = scene.problem(&scene.matches);
    let config = ArticulationConfig { identity_steps: 800, ..quick() };
    check_recovery(
        &scene,
        &mut ArticulationTrainer::new(&problem, ArticulationStart::default(), &config, 1).unwrap(),
    );
}

#[test]
fn a_rotation_is_found_from_the_identity() {
    let scene = two_blocks(Pose::new(Vector3::new(0.02, 0.01, 0.0), Vector3::z() * 30f64.to_radians()), 81);
    let problem = scene.problem(&scene.matches);
    let config = ArticulationConfig { identity_steps: 800, ..quick() };
    check_recovery(
        &scene,
        &mut ArticulationTrainer::new(&problem, ArticulationStart::default(), &config, 1).unwrap(),
    );
}

/// True labels and a start some degrees and millimeters off.
fn refine(scene: &TestScene, config: &ArticulationConfig) {
    let off = Pose::new(Vector3::new(0.006, -0.005, 0.004), Vector3::new(0.03, -0.02, 0.04));
    let init: Vec<Pose> =
        scene.motions.iter().enumerate().map(|(i, m)| if i == 0 { *m } else { m * off }).collect();
    let labels = [scene.labelled(0), scene.labelled(1)];
    let start = ArticulationStart { motions: Some(&init), labels: Some([&labels[0], &labels[1]]) };
    let problem = scene.problem(&[]);
    check_recovery(scene, &mut ArticulationTrainer::new(&problem, start, config, 3).unwrap());
}

#[test]
fn a_rotation_is_refined_without_matches() {
    refine(&two_blocks(Pose::new(Vector3::new(0.02, 0.01, 0.02), Vector3::new(0.1, 0.2, 0.5)), 81), &quick());
}

#[test]
fn three_parts_are_refined_without_matches() {
    let base = Block { half: Vector3::new(0.2, 0.15, 0.05), pose: Pose::translation(-0.04, 0.0, -0.05) };
    let left = Block { half: Vector3::new(0.05, 0.08, 0.06), pose: Pose::translation(0.08, 0.02, 0.075) };
    let right = Block { half: Vector3::new(0.04, 0.06, 0.08), pose: Pose::translation(-0.15, -0.02, 0.095) };
    let motions = vec![
        Pose::identity(),
        Pose::new(Vector3::new(0.05, 0.02, 0.01), Vector3::z() * 0.4),
        Pose::translation(-0.02, 0.07, 0.03),
    ];
    refine(&TestScene::new(vec![base, left, right], motions, 81), &quick());
}

/// A few cheap steps with all losses, labels included.
fn short() -> ArticulationConfig {
    let steps = (12, 4);
    ArticulationConfig {
        refine_steps: steps.0,
        label_steps: steps.1,
        rays: 64,
        uniform_points: 700,
        matches: 64,
        label_points: 300,
        grid_nodes: 12,
        ..ArticulationConfig::default()
    }
}

#[test]
fn the_result_depends_on_neither_threads_nor_interruption() {
    let scene = two_blocks(Pose::new(Vector3::new(0.03, 0.0, 0.02), Vector3::z() * 0.3), 41);
    let problem = scene.problem(&scene.matches);
    let labels = [scene.labelled(0), scene.labelled(1)];
    let start = ArticulationStart { motions: Some(&scene.motions), labels: Some([&labels[0], &labels[1]]) };
    let whole = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut trainer = ArticulationTrainer::new(&problem, start, &short(), seed).unwrap();
            run(&mut trainer);
            trainer.checkpoint().clone()
        })
    };
    let one = whole(1, 7);
    assert!(one == whole(2, 7), "two threads give what one gives");
    assert!(one != whole(2, 8), "the seed counts");
    for interrupted_after in [2, 4, 9] {
        let mut first = ArticulationTrainer::new(&problem, start, &short(), 7).unwrap();
        while first.steps() < interrupted_after {
            first.step();
        }
        let bytes = postcard::to_stdvec(first.checkpoint()).unwrap();
        let mut second = ArticulationTrainer::new(&problem, start, &short(), 7).unwrap();
        second.restore(postcard::from_bytes(&bytes).unwrap()).unwrap();
        run(&mut second);
        assert!(one == *second.checkpoint(), "stopping after {interrupted_after} steps changes nothing");
    }
    let mut other = ArticulationTrainer::new(&problem, start, &short(), 8).unwrap();
    assert!(other.restore(one).is_err(), "a checkpoint of another seed is refused");
}

#[test]
fn swapped_states_give_the_inverse_motion() {
    let motion = Pose::new(Vector3::new(0.02, 0.01, 0.02), Vector3::new(0.1, 0.2, 0.5));
    let scene = two_blocks(motion, 81);
    let off = Pose::new(Vector3::new(0.004, -0.005, 0.004), Vector3::new(0.03, -0.02, 0.02));
    let labels = [scene.labelled(0), scene.labelled(1)];
    let config = ArticulationConfig { refine_steps: 250, label_steps: 100, ..quick() };
    let solve = |swap: bool| {
        let mut problem = scene.problem(&[]);
        let mut init = vec![Pose::identity(), motion * off];
        let mut sets = [&labels[0], &labels[1]];
        if swap {
            problem.states.swap(0, 1);
            sets.swap(0, 1);
            init[1] = init[1].inverse();
        }
        let start = ArticulationStart { motions: Some(&init), labels: Some(sets) };
        let mut trainer = ArticulationTrainer::new(&problem, start, &config, 4).unwrap();
        run(&mut trainer);
        trainer.motions()[1]
    };
    let round = solve(true) * solve(false);
    assert!(round.rotation.angle().to_degrees() < 0.02, "{round:?}");
    assert!(
        (round * nalgebra::Point3::new(0.05, 0.02, 0.07) - nalgebra::Point3::new(0.05, 0.02, 0.07)).norm()
            < 2e-4,
        "{round:?}"
    );
}

#[test]
fn what_cannot_work_is_refused() {
    let scene = two_blocks(Pose::translation(0.05, 0.0, 0.0), 21);
    let refused = |change: &dyn Fn(&mut crate::neural::optimise::ArticulationProblem<'_>),
                   start,
                   config: &ArticulationConfig| {
        let mut problem = scene.problem(&scene.matches);
        change(&mut problem);
        ArticulationTrainer::new(&problem, start, config, 0).err().map(|e| e.to_string()).unwrap_or_default()
    };
    let start = ArticulationStart::default();
    let fine = short();
    let one = [Pose::identity()];
    assert_eq!(refused(&|_| (), start, &fine), "");
    assert!(refused(&|p| p.parts = 1, start, &fine).contains("1 parts"));
    assert!(refused(&|p| p.states[1].rays = &[], start, &fine).contains("state 1 has no surface ray"));
    assert!(refused(&|p| p.states[0].cameras = &[], start, &fine).contains("match 0"));
    assert!(
        refused(&|_| (), ArticulationStart { motions: Some(&one), labels: None }, &fine)
            .contains("1 initial motions")
    );
    let labels = (vec![nalgebra::Point3::origin()], vec![2]);
    assert!(
        refused(&|_| (), ArticulationStart { motions: None, labels: Some([&labels, &labels]) }, &fine)
            .contains("below 2")
    );
    assert!(
        refused(&|_| (), start, &ArticulationConfig { rays: 0, ..short() }).contains("articulation.rays = 0")
    );
}

/// `cargo test --release --lib step_time -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement, not a check"]
fn step_time() {
    let scene = two_blocks(Pose::new(Vector3::new(0.02, 0.01, 0.02), Vector3::new(0.1, 0.2, 0.5)), 201);
    let problem = scene.problem(&scene.matches);
    let labels = [scene.labelled(0), scene.labelled(1)];
    let start = ArticulationStart { motions: Some(&scene.motions), labels: Some([&labels[0], &labels[1]]) };
    let config = ArticulationConfig { refine_steps: 200, label_steps: 50, ..ArticulationConfig::default() };
    // Processor time of all threads, from the kernel's 10 ms ticks: other work on the machine does not count.
    let processor_ms = || -> f64 {
        let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
        let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
        (fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap()) * 10.0
    };
    let mut trainer = ArticulationTrainer::new(&problem, start, &config, 3).unwrap();
    let mut last = processor_ms();
    while !trainer.is_done() {
        trainer.step();
        if trainer.steps().is_multiple_of(50) {
            eprintln!(
                "{} steps: {} ms of processor time a step",
                trainer.steps(),
                (processor_ms() - last) / 50.0
            );
            last = processor_ms();
        }
    }
}
