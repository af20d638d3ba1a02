//! Engines that fail on purpose: the field must come out as the CPU engine alone would have made it.

use std::sync::{Arc, atomic::AtomicBool, mpsc};

use nalgebra::Point3;

use super::*;
use capture::RgbdFrame;
use field::{EngineError, FieldConfig, FieldLosses, Occupancy, SampleBatch};
use geometry::{Grid3, Intrinsics, Pose, SceneBox};

/// How an engine fails.
#[derive(Clone, Copy)]
enum Fault {
    /// Losses become NaN, and [`FieldEngine::failure`] says why.
    Explained,
    /// Losses become NaN, and nothing else.
    Silent,
    /// The parameters can no longer be read.
    Unreadable,
}

/// The CPU engine, until it has taken `steps` steps.
struct Failing {
    engine: CpuEngine,
    fault: Fault,
    left: usize,
    error: EngineError,
    first: EngineState,
}

impl FieldEngine for Failing {
    fn train_step(&mut self, batch: &SampleBatch, learning_rate: f32) -> FieldLosses {
        if self.left == 0 && !matches!(self.fault, Fault::Unreadable) {
            return FieldLosses { sdf: f64::NAN, color: 0.0 };
        }
        self.left = self.left.saturating_sub(1);
        self.engine.train_step(batch, learning_rate)
    }

    fn loss_gradient(&mut self, batch: &SampleBatch) -> (FieldLosses, Vec<f32>) {
        self.engine.loss_gradient(batch)
    }

    fn training_state(&self) -> EngineState {
        // What a lost device still knows is the state that it was given.
        if self.left == 0 { self.first.clone() } else { self.engine.training_state() }
    }

    fn failure(&self) -> Option<&EngineError> {
        (self.left == 0 && !matches!(self.fault, Fault::Silent)).then_some(&self.error)
    }
}

/// A wall with a texture, 0.6 m in front of two cameras.
fn wall() -> Vec<RgbdFrame> {
    let k = Intrinsics { width: 32, height: 24, fx: 30.0, fy: 30.0, cx: 15.5, cy: 11.5 };
    let frame = |i: usize| RgbdFrame {
        id: format!("0_{i:04}"),
        stamp_nanos: i as i64,
        intrinsics: k,
        world_from_camera: Pose::translation(0.05 * i as f64, 0.0, 0.0),
        rgb: (0..k.width * k.height).map(|p| [(p % 251) as u8, (p % 13 * 19) as u8, 90]).collect(),
        depth_m: vec![0.6; k.width * k.height],
        mask: None,
        readings: Vec::new(),
    };
    (0..2).map(frame).collect()
}

fn settings() -> TrainConfig {
    let field =
        FieldConfig { levels: 3, base_resolution: 4, finest_resolution: 16, log2_table_size: 9, hidden: 8 };
    TrainConfig { field, steps: 300, rays: 32, truncation_m: Some(0.03), ..TrainConfig::default() }
}

/// The field of the wall and the warnings; `None`: the CPU engine.
fn field(start: Option<Start>, settings: &TrainConfig) -> (Result<TrainedField, RunError>, Vec<String>) {
    let frames = wall();
    let scene = SceneBox::around_box(&Point3::new(-0.4, -0.3, 0.5), &Point3::new(0.4, 0.3, 0.7));
    let points: Vec<_> =
        frames.iter().flat_map(|f| (0..f.depth_m.len()).filter_map(|p| f.world_point(p))).collect();
    let occupancy = Occupancy::new(&scene, &points, 0.05, 2);
    let input = TrainInput { frames: &frames, scene, occupancy: &occupancy, fused: None };
    let (events, reported) = mpsc::channel();
    let monitor = Monitor::new(events, Arc::new(AtomicBool::new(false)));
    let training = Training {
        stage: "field/state0".to_owned(),
        start,
        checkpoint: None,
        monitor: &monitor,
        replaced: RefCell::default(),
    };
    let result = training.run(&input, settings, 7);
    let warning = |event| if let Event::Warning { message, .. } = event { Some(message) } else { None };
    (result, reported.try_iter().filter_map(warning).collect())
}

#[test]
fn the_cpu_engine_goes_on_where_another_one_fails() {
    let settings = settings();
    let expected = field(None, &settings).0.unwrap();
    assert_eq!(expected.replaced, None);
    let error = EngineError::Failed { doing: "took a training step", message: "device lost".to_owned() };
    // Outliers are judged after 150 steps: failures before and after, and at a read of the parameters.
    for (fault, after, kept) in [
        (Fault::Explained, 0, 0),
        (Fault::Explained, 170, 0),
        (Fault::Explained, 230, 200),
        (Fault::Silent, 250, 200),
        (Fault::Unreadable, 140, 0),
        (Fault::Unreadable, 290, 200),
    ] {
        let start = |state: EngineState| -> Result<Box<dyn FieldEngine>, EngineError> {
            let engine = CpuEngine::resume(state.clone());
            Ok(Box::new(Failing { engine, fault, left: after, error: error.clone(), first: state }))
        };
        let (result, warnings) = field(Some(&start), &settings);
        let trained = result.unwrap();
        assert_eq!(trained.field, expected.field, "{after}");
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        assert!(warnings[0].contains("the cpu engine is used instead"), "{}", warnings[0]);
        assert!(warnings[0].contains(&format!("{kept} of 300 steps are kept")), "{after}: {}", warnings[0]);
        let why = if matches!(fault, Fault::Silent) {
            "not a finite number after 251 steps"
        } else {
            "device lost"
        };
        assert!(trained.replaced.is_some_and(|r| r.contains(why)), "{}", warnings[0]);
    }
}

#[test]
fn an_engine_that_does_not_start_is_replaced_before_the_first_step() {
    let settings = TrainConfig { steps: 20, ..settings() };
    let refused =
        |_: EngineState| -> Result<Box<dyn FieldEngine>, EngineError> { Err(EngineError::NotBuilt) };
    let (result, warnings) = field(Some(&refused), &settings);
    let trained = result.unwrap();
    assert_eq!(trained.field, field(None, &settings).0.unwrap().field);
    let why = EngineError::NotBuilt.to_string();
    assert_eq!(warnings, [format!("field/state0: {why}; the cpu engine is used instead")]);
    assert_eq!(trained.replaced, Some(why));
}

#[test]
fn losses_that_are_no_numbers_on_the_cpu_end_the_run_with_a_message() {
    let mut settings = TrainConfig { steps: 20, ..settings() };
    settings.noise.constant_m = f64::NAN;
    let (result, _) = field(None, &settings);
    let Err(RunError::Stage { stage, source }) = result else { panic!("trained") };
    assert_eq!(stage, "field/state0");
    assert!(source.to_string().contains("not a finite number after 1 steps"), "{source}");
}

#[test]
fn a_residual_starts_as_the_fused_distances_and_keeps_to_the_side_that_was_seen() {
    let frames = wall();
    let scene = SceneBox::around_box(&Point3::new(-0.4, -0.3, 0.5), &Point3::new(0.4, 0.3, 0.7));
    let points: Vec<_> =
        frames.iter().flat_map(|f| (0..f.depth_m.len()).filter_map(|p| f.world_point(p))).collect();
    let occupancy = Occupancy::new(&scene, &points, 0.05, 2);
    // A wall of 1 cm at 0.6 m, known from both sides; the cameras see one.
    let mut fused = Grid3::over_scene(&scene, 81, 0.0f32);
    for i in 0..fused.values.len() {
        let z = fused.position_of_index(i).z;
        fused.values[i] = f64::max(0.6 - z, z - 0.61).min(0.03) as f32;
    }
    let input = TrainInput { frames: &frames, scene, occupancy: &occupancy, fused: Some(&fused) };
    // Fine enough for the wall.
    let field = FieldConfig {
        levels: 6,
        base_resolution: 8,
        finest_resolution: 128,
        log2_table_size: 15,
        hidden: 16,
    };
    let settings = TrainConfig { field, steps: 200, rays: 256, ..settings() };
    let trained = |settings: &TrainConfig, steps: usize| {
        let mut trainer = FieldTrainer::new(&input, settings, 7, "field/state0").unwrap();
        (0..steps).for_each(|_| {
            trainer.train_step();
        });
        trainer.trained_field()
    };
    let about: Vec<Point3<f64>> = (0..60)
        .map(|k| Point3::new(0.004 * f64::from(k % 10) - 0.02, 0.01, 0.58 + 0.001 * f64::from(k)))
        .collect();
    let off = |settings: &TrainConfig, steps: usize, near: fn(f64) -> bool| {
        let found = trained(settings, steps).signed_distances_m(&about);
        let errors = about.iter().zip(found).filter(|(p, _)| near(p.z));
        errors.map(|(p, d)| (d - fused.value_at(p)).abs()).fold(0.0, f32::max)
    };
    assert!(off(&settings, 0, |_| true) < 1e-7, "{}", off(&settings, 0, |_| true));
    // Behind the middle of the wall the cameras know nothing: their readings would go on into it.
    let behind = |z: f64| (0.607..0.62).contains(&z);
    let with = off(&settings, 200, behind);
    let without = {
        let all = TrainConfig { side_test: false, ..settings };
        off(&all, 200, behind)
    };
    assert!(without > 0.003 && with < 0.5 * without, "{with} {without}");
}
