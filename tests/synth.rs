//! Made objects: repeatable, true to their geometry, and good enough to be reconstructed.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

#[path = "common/opened.rs"]
mod opened;

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use capture::{CaptureConfig, RefinePoses, TrackCamera};
use evaluate::{EvaluateOptions, Truth, evaluate_runs, read_truth};
use geometry::{Intrinsics, Pose};
use io::{DatasetLayout, Place, inspect, write_synth, write_synth_bag, write_synth_dataset};
use nalgebra::{Point3, Vector3};
use opened::open;
use synth::{
    DepthCamera, DepthErrors, DepthSource, Effect, Family, HandheldSensor, HandleStyle, Light, Material,
    Object, Part, PoseSource, PoseSpread, Scene, Solid, SynthConfig, SynthState, View, generate, record,
};

fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::remove_dir_all(&folder).ok();
    folder
}

fn small(seed: u64) -> SynthConfig {
    SynthConfig { seed, parts: Some(3), views: 6, width: 96, height: 72, ..SynthConfig::default() }
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let files = [
        "state0/state0_0.mcap",
        "state1/state1_0.mcap",
        "state1/metadata.yaml",
        "truth.json",
        "truth/state0/seen.npy",
    ];
    let poses = PoseSource::Noisy(PoseSpread { translation_m: 0.005, rotation_rad: 0.01 });
    let config = SynthConfig { poses, ..small(3) };
    let outs = [folder("synth-a"), folder("synth-b"), folder("synth-c")];
    // One thread gives what many give.
    write_synth(&Place::at(&outs[0]), &config).unwrap();
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap()
        .install(|| write_synth(&Place::at(&outs[1]), &config))
        .unwrap();
    write_synth(&Place::at(&outs[2]), &SynthConfig { seed: 4, ..config }).unwrap();
    for file in files {
        let read = |k: usize| std::fs::read(outs[k].join(file)).unwrap();
        assert!(read(0) == read(1), "{file} differs between two runs with one seed");
        assert!(file.ends_with("yaml") || read(0) != read(2), "{file} is the same for two seeds");
    }
}

#[test]
fn the_truth_says_where_handles_are() {
    let outs = [folder("synth-plain"), folder("synth-handles")];
    let plain = SynthConfig { family: Some(Family::Cabinet), ..small(2) };
    let config = SynthConfig { handles: Some(HandleStyle::Mixed), ..plain.clone() };
    let truth = |out: &Path, config: &SynthConfig| -> serde_json::Value {
        write_synth(&Place::at(out), config).unwrap();
        serde_json::from_slice(&std::fs::read(out.join("truth.json")).unwrap()).unwrap()
    };
    assert!(truth(&outs[0], &plain).get("handles").is_none());
    let object = generate(&config).unwrap();
    let truth = truth(&outs[1], &config);
    let handles = truth["handles"].as_array().unwrap();
    assert_eq!(handles.len(), object.parts.iter().filter(|p| p.handle.is_some()).count());
    assert!(!handles.is_empty());
    for entry in handles {
        let part = entry["part"].as_u64().unwrap() as usize;
        let handle = object.parts[part].handle.unwrap();
        assert_eq!(entry["kind"], handle.kind.name());
        assert!(entry["size"].as_object().unwrap().values().all(|s| s.as_f64().unwrap() > 0.004));
        let frame = (object.world_from_parts(0)[part] * handle.part_from_handle).to_homogeneous();
        let read = |r: usize, c: usize| entry["frame"][r][c].as_f64().unwrap();
        assert!((0..16).all(|i| (read(i / 4, i % 4) - frame[(i / 4, i % 4)]).abs() < 1e-9));
    }
}

#[test]
fn depth_of_a_box_is_the_analytic_distance() {
    let material = Material::plain(Vector3::repeat(0.5));
    let solids = vec![Solid::box_between([-0.1, -0.2, 0.0], [0.1, 0.2, 0.3], &material)];
    let object = Object {
        family: "box",
        parts: vec![Part { name: "box".into(), joint: None, solids, handle: None }],
        world_from_rest: Pose::identity(),
    };
    let scene = Scene::new(&object, 0, &material, 1.0);
    let k = Intrinsics { width: 96, height: 72, fx: 80.0, fy: 80.0, cx: 47.3, cy: 36.1 };
    // The camera looks along -x at the front face, level, from x = 0.9.
    let camera =
        Pose::face_towards(&Point3::new(0.9, 0.03, 0.14), &Point3::new(0.0, 0.03, 0.14), &-Vector3::z());
    let view = View::cast_rays(&scene, &k, &camera, &Light::from_lamp(Vector3::z()));
    let perfect = DepthCamera::with_scaled_noise(0.0).depth_mm(
        &view,
        &scene,
        &k,
        &camera,
        &DepthErrors::default(),
        &mut numeric::random::stage_rng(0, "test", 0),
    );
    let noisy = DepthCamera::default().depth_mm(
        &view,
        &scene,
        &k,
        &camera,
        &DepthErrors::default(),
        &mut numeric::random::stage_rng(0, "test", 0),
    );
    let (mut on_box, mut squares) = (0, 0.0);
    for i in 0..k.width * k.height {
        let ray = camera.rotation * k.ray_at((i % k.width) as f64, (i / k.width) as f64);
        let front = (0.9 - 0.1) / -ray.x;
        let at = camera.translation.vector + ray * front;
        if at.y.abs() < 0.195 && (0.005..0.295).contains(&at.z) {
            assert_eq!(view.part[i], Some(0));
            assert!((view.depth_m[i] - 0.8).abs() < 1e-12, "the face stands square to the camera");
            assert_eq!(perfect[i], 800);
            if noisy[i] > 0 {
                on_box += 1;
                squares += (f64::from(noisy[i]) / 1000.0 - 0.8).powi(2);
            }
        } else if at.z < -0.005 && view.part[i].is_none() && view.depth_m[i] > 0.0 {
            assert!((view.depth_m[i] - 0.14 / -ray.z).abs() < 1e-9, "the floor");
        }
    }
    // Disparity noise of 0.073 pixels and its steps: z^2 / (f B) * sqrt(0.073^2 + (1/32)^2 / 12) meters.
    let expected = 0.8 * 0.8 / (80.0 * 0.05) * (0.073f64.powi(2) + (1.0f64 / 32.0).powi(2) / 12.0).sqrt();
    let sigma_m = (squares / f64::from(on_box)).sqrt();
    assert!(on_box > 500 && (sigma_m / expected - 1.0).abs() < 0.15, "{on_box} {sigma_m} {expected}");
}

#[test]
fn truth_meshes_and_views_agree() {
    let out = folder("synth-truth");
    for seed in 0..4 {
        let config = small(seed);
        write_synth(&Place::at(&out), &config).unwrap();
        let truth = Truth::read(&out).unwrap();
        for part in &truth.parts {
            let motion = part.joint.as_ref().map_or_else(Pose::identity, |j| j.state1_from_state0);
            let [before, after] = &part.meshes;
            for (p, q) in before.vertices.iter().zip(&after.vertices) {
                assert!((motion * p.cast::<f64>() - q.cast::<f64>()).norm() < 1e-5, "{}", part.name);
            }
        }
        for state in 0..2 {
            assert!(truth.seen[state].len() > 300);
            let surface = surface::MeshDistance::new(&truth.whole[state]).unwrap();
            let seen: Vec<Point3<f32>> =
                truth.seen[state].iter().step_by(50).map(|s| s.point.cast()).collect();
            assert!(surface.distances_m(&seen).iter().all(|d| *d < 1e-4));
        }
        std::fs::remove_dir_all(&out).unwrap();
    }
}

/// One object in all layouts: the frames and the truth are the same, so that a run scores the same.
#[test]
fn an_object_is_the_same_in_every_layout() {
    let config = SynthConfig { family: Family::by_name("cabinet"), ..small(11) };
    let bags = folder("synth-bags");
    write_synth(&Place::at(&bags), &config).unwrap();
    let expected = read_truth(&bags).unwrap();
    // Poses as they were recorded: a correction would differ with the compression of colors.
    let as_recorded = CaptureConfig { refine_poses: RefinePoses::Never, ..CaptureConfig::default() };
    let read = |path: &Path| open(&[path.to_owned()], &as_recorded, 0).unwrap();
    let frames = read(&bags).states;
    for layout in DatasetLayout::NAMES {
        let out = folder(&format!("synth-{layout}"));
        write_synth_dataset(&Place::at(&out), &config, DatasetLayout::named(layout).unwrap()).unwrap();
        let truth = read_truth(&out).unwrap();
        assert_eq!((truth.parts.len(), &truth.whole), (expected.parts.len(), &expected.whole));
        for (a, b) in truth.parts.iter().zip(&expected.parts) {
            assert_eq!(a.meshes, b.meshes, "{layout} {}", b.name);
            let (Some(a), Some(b)) = (&a.joint, &b.joint) else { continue };
            assert_eq!(a.kind, b.kind);
            let apart = a.state1_from_state0.inverse() * b.state1_from_state0;
            assert!(apart.translation.vector.norm() < 1e-9 && apart.rotation.angle() < 1e-9, "{layout}");
            assert!((a.axis.dot(&b.axis) - 1.0).abs() < 1e-12 && (a.origin - b.origin).norm() < 1e-12);
        }
        for (state, (a, b)) in read(&out).states.iter().zip(&frames).enumerate() {
            assert_eq!(a.len(), b.len());
            for (a, b) in a.iter().zip(b) {
                assert_eq!((&a.depth_m, &a.mask), (&b.depth_m, &b.mask), "{layout} state {state}");
                let apart = a.world_from_camera.inverse() * b.world_from_camera;
                let off = (apart.translation.vector.norm(), apart.rotation.angle());
                // A bag has poses of the link beside the view, and the optical frame swings about it.
                assert!(off.0 < 1e-6 && off.1 < 1e-7, "{off:?}");
                let (k, l) = (a.intrinsics, b.intrinsics);
                assert!(
                    (k.fx - l.fx).abs() + (k.cx - l.cx).abs() + (k.cy - l.cy).abs() < 1e-9,
                    "{k:?} {l:?}"
                );
            }
        }
        std::fs::remove_dir_all(&out).unwrap();
    }
    // A joint on a moving part, or a thread, has no place in these layouts.
    let chain = SynthConfig { family: Family::by_name("lamp"), ..small(3) };
    let out = folder("synth-chain");
    let refused = write_synth_dataset(&Place::at(&out), &chain, DatasetLayout::Keyframes).unwrap_err();
    assert!(refused.to_string().contains("hangs on a part that moves"), "{refused}");
    assert!(!out.exists(), "nothing is left of what was refused");
}

#[test]
fn drift_moves_the_told_poses_by_what_was_asked() {
    let drift = PoseSpread { translation_m: 0.05, rotation_rad: 0.09 };
    let config = small(2);
    let object = generate(&config).unwrap();
    let still = record(&object, 1, &config);
    let drifted = record(&object, 1, &SynthConfig { drift, ..config });
    let moved = drifted.recorded_from_world;
    assert!(
        (moved.translation.vector.norm() - 0.05).abs() < 1e-12
            && (moved.rotation.angle() - 0.09).abs() < 1e-12
    );
    for (a, b) in still.frames.iter().zip(&drifted.frames) {
        assert_eq!((&a.rgb, &a.depth_mm, a.world_from_camera), (&b.rgb, &b.depth_mm, b.world_from_camera));
        assert!(((moved * a.reported[0]).inverse() * b.reported[0]).translation.vector.norm() < 1e-12);
    }
}

#[test]
fn a_made_recording_is_accepted_and_its_joint_found() {
    let out = folder("synth-drawer");
    let options = [
        "--seed",
        "5",
        "--parts",
        "2",
        "--family",
        "clamshell",
        "--textured",
        "--views",
        "16",
        "--width",
        "320",
        "--height",
        "240",
    ];
    let program = || Command::new(env!("CARGO_BIN_EXE_artitwin"));
    let made = program().args(["synth", "--out"]).arg(&out).args(options).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let found = inspect(&out).unwrap();
    assert!(found.is_usable(), "{}", found.to_text());
    let runs = folder("synth-runs");
    let run_it = program()
        .arg("reconstruct")
        .arg(&out)
        .args(["--parts", "2", "--preset", "preview", "--name", "made", "--out"])
        .arg(&runs)
        .output();
    let run_it = run_it.unwrap();
    assert!([0, 3].contains(&run_it.status.code().unwrap()), "{}", String::from_utf8_lossy(&run_it.stderr));
    let report = evaluate_runs(&[runs.join("made")], Path::new(&out), &EvaluateOptions::default()).unwrap();
    let joint = &report.trials[0].joints[0];
    assert_eq!(joint.type_right, Some(true), "{joint:?}");
    assert!(
        joint.axis_deg.unwrap() < 1.0 && joint.motion_deg.unwrap() < 1.0 && joint.axis_mm.unwrap() < 5.0,
        "{joint:?}"
    );
}

#[test]
fn a_level_of_zero_is_the_clean_recording_but_for_what_stands_around() {
    let clean = small(6);
    let object = generate(&clean).unwrap();
    let with = |sensor| record(&object, 1, &SynthConfig { sensor: Some(sensor), ..clean.clone() });
    let zero = HandheldSensor::new(0.0);
    let [bare, among_things] = [zero.without(&[Effect::Clutter]), zero].map(with);
    for (a, b) in record(&object, 1, &clean).frames.iter().zip(&bare.frames) {
        assert_eq!((&a.rgb, &a.depth_mm), (&b.rgb, &b.depth_mm));
        assert!(a.mask.is_some() && b.mask.is_none());
        // A hand is slower, so that less happens in the millisecond to the reported pose.
        let [a, b] = [a, b].map(|f| f.reported[0].lerp_slerp(&f.reported[1], 0.5));
        assert!((a.inverse() * b).translation.vector.norm() < 1e-4, "{a} {b}");
    }
    let differs =
        |a: &SynthState, b: &SynthState| a.frames.iter().zip(&b.frames).any(|(a, b)| a.rgb != b.rgb);
    assert!(differs(&bare, &among_things));
}

#[test]
fn an_effect_spoils_what_it_is_about_and_nothing_else() {
    let clean = small(6);
    let object = generate(&clean).unwrap();
    let with = |sensor| record(&object, 1, &SynthConfig { sensor: Some(sensor), ..clean.clone() });
    let before = with(HandheldSensor::clean());
    for effect in Effect::ALL {
        let after = with(HandheldSensor::new(2.0).only(&[effect]));
        let pairs = || before.frames.iter().zip(&after.frames);
        let changed = [
            pairs().any(|(a, b)| a.depth_mm != b.depth_mm),
            pairs().any(|(a, b)| a.rgb != b.rgb),
            pairs().any(|(a, b)| a.reported != b.reported),
        ];
        let expected = match effect {
            Effect::DepthScale
            | Effect::DepthWarp
            | Effect::DepthNoise
            | Effect::FlyingPixels
            | Effect::DepthLoss => [true, false, false],
            Effect::PoseLag | Effect::PoseDrift | Effect::PoseJitter | Effect::Relocalization => {
                [false, false, true]
            }
            Effect::Clutter => [true, true, false],
            // A draw may leave the few views of this recording without one.
            Effect::Hand => {
                let is_there = after.frames.iter().any(|f| f.has_hand);
                [is_there, is_there, false]
            }
            _ => [false, true, false],
        };
        assert_eq!(changed, expected, "{}", effect.name());
        assert!(pairs().all(|(a, b)| a.world_from_camera == b.world_from_camera));
    }
}

#[test]
fn a_room_by_a_stereo_camera_is_repeatable_and_has_no_masks() {
    let depth = DepthSource::Stereo { level: 1.0 };
    let unposed =
        SynthConfig { depth, room: true, poses: PoseSource::Nobody, width: 160, height: 120, ..small(3) };
    let outs = [folder("synth-room-a"), folder("synth-room-b"), folder("synth-room-c")];
    write_synth(&Place::at(&outs[0]), &unposed).unwrap();
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    alone.install(|| write_synth(&Place::at(&outs[1]), &unposed)).unwrap();
    for file in ["state0/state0_0.mcap", "state1/state1_0.mcap", "truth.json"] {
        let read = |k: usize| std::fs::read(outs[k].join(file)).unwrap();
        assert!(read(0) == read(1), "{file} differs between two runs with one seed");
    }
    let topics = |k: usize| std::fs::read_to_string(outs[k].join("state0/metadata.yaml")).unwrap();
    assert!(!topics(0).contains("/tf") && !topics(0).contains("object_mask"), "{}", topics(0));
    assert!(!outs[0].join("workspace.txt").exists());

    let robot = SynthConfig { poses: PoseSource::Robot, ..unposed };
    write_synth(&Place::at(&outs[2]), &robot).unwrap();
    assert!(topics(2).contains("/tf_static") && outs[2].join("workspace.txt").exists());
    let found = inspect(&outs[2]).unwrap();
    assert!(found.is_usable() && !found.to_text().contains("object_mask"), "{}", found.to_text());
    let truth: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(outs[2].join("truth.json")).unwrap()).unwrap();
    let sensor = &truth["sensor"];
    assert!((sensor["stereo"]["baseline_m"].as_f64().unwrap() - 0.05).abs() < 1e-12);
    let hand: Vec<f64> =
        sensor["hand_error"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    assert!((Vector3::from_row_slice(&hand[..3]).norm() - 0.002).abs() < 1e-9);
    // The same error in every view of both states, but for jitter.
    let object = generate(&robot).unwrap();
    for state in 0..2 {
        let recording = record(&object, state, &robot);
        for frame in &recording.frames {
            let reported = frame.reported[0].lerp_slerp(&frame.reported[1], 0.5);
            let off = frame.world_from_camera.inverse() * reported;
            let away = off.translation.vector - Vector3::from_row_slice(&hand[..3]);
            let turned = off.rotation.scaled_axis() - Vector3::from_row_slice(&hand[3..]);
            assert!(away.norm() < 8e-4 && turned.norm() < 6e-4, "{away} {turned}");
            let deep = frame.depth_mm.iter().filter(|d| **d > 0).count();
            assert!(frame.mask.is_none() && 2 * deep > frame.depth_mm.len(), "{deep}");
        }
    }
}

#[test]
fn a_recording_by_hand_is_repeatable_has_no_masks_and_is_read() {
    let config = SynthConfig { sensor: Some(HandheldSensor::new(1.0)), further: 1, ..small(3) };
    let outs = [folder("synth-hand-a"), folder("synth-hand-b")];
    write_synth(&Place::at(&outs[0]), &config).unwrap();
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap()
        .install(|| write_synth(&Place::at(&outs[1]), &config))
        .unwrap();
    for file in ["state0/state0_0.mcap", "state2/state2_0.mcap", "truth.json", "workspace.txt"] {
        let read = |k: usize| std::fs::read(outs[k].join(file)).unwrap();
        assert!(read(0) == read(1), "{file} differs between two runs with one seed");
    }
    let found = inspect(&outs[0]).unwrap();
    assert!(found.is_usable() && !found.to_text().contains("object_mask"), "{}", found.to_text());
    let text = |file: &str| std::fs::read_to_string(outs[0].join(file)).unwrap();
    let corners: Vec<f64> = text("workspace.txt").split(',').map(|n| n.parse().unwrap()).collect();
    assert!(corners.len() == 6 && (0..3).all(|k| corners[k] < corners[k + 3]), "{corners:?}");

    // Reported poses follow from the truth.
    let truth: serde_json::Value = serde_json::from_str(&text("truth.json")).unwrap();
    let sensor = &truth["sensor"];
    assert_eq!(sensor["effects"].as_array().unwrap().len(), Effect::ALL.len());
    assert_eq!(sensor["states"].as_array().unwrap().len(), 3);
    let object = generate(&config).unwrap();
    let recording = record(&object, 1, &config);
    let pose = |value: &serde_json::Value| {
        let n: Vec<f64> = value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
        Pose::new(Vector3::new(n[0], n[1], n[2]), Vector3::new(n[3], n[4], n[5]))
    };
    let lag_s = sensor["pose_lag_s"].as_f64().unwrap();
    for (frame, told) in recording.frames.iter().zip(sensor["states"][1]["views"].as_array().unwrap()) {
        let [drift, jitter] = ["drift", "jitter"].map(|k| pose(&told[k]));
        let reported = frame.reported[0].lerp_slerp(&frame.reported[1], 0.5);
        let seen = (recording.recorded_from_world * drift).inverse() * reported * jitter.inverse();
        // At the lag before the image, the camera stood as far back as it is fast.
        let step = frame.world_from_camera.inverse() * seen;
        assert!((step.translation.vector + frame.velocity[0] * lag_s).norm() < 2e-4, "{step}");
    }
}

#[test]
fn an_accelerometer_shows_a_tracked_recording_which_way_is_up() {
    let config = SynthConfig {
        seed: 12,
        parts: Some(2),
        textured: Some(true),
        rate_hz: Some(8.0),
        width: 320,
        height: 240,
        sensor: Some(HandheldSensor::new(1.0)),
        imu: true,
        ..SynthConfig::default()
    };
    let out = folder("synth-imu");
    std::fs::create_dir_all(&out).unwrap();
    let object = generate(&config).unwrap();
    let states = [0, 1].map(|s| record(&object, s, &config));
    let bags = [0, 1].map(|s| out.join(format!("state{s}")));
    for (state, (bag, recording)) in bags.iter().zip(&states).enumerate() {
        write_synth_bag(bag, state, recording).unwrap();
    }
    let always = CaptureConfig { tracking: TrackCamera::Always, ..CaptureConfig::default() };
    let (ways, [notes, warnings]) =
        run::capture::track_camera(&bags, &always, 0, &run::Monitor::silent()).unwrap();
    let text = |code: &str| {
        let all = notes.iter().chain(&warnings).filter(|n| n.code.word() == code);
        all.map(|n| n.text.clone()).collect::<Vec<_>>()
    };
    assert_eq!((text("imu_unusable").len(), text("upright_contradicted").len()), (0, 0), "{warnings:?}");
    let said = text("gravity_measured");
    assert!(said.iter().any(|t| t.contains("up is by") && t.contains("deg apart")), "{said:?}");
    let (way, recording) = (&ways[0], &states[0]);
    assert!(2 * way.len() > recording.frames.len(), "{} of {}", way.len(), recording.frames.len());
    let mut off = Vec::new();
    for (stamp, pose) in way {
        let frame = ((stamp - 1_760_000_000_000_000_000) / recording.period_nanos) as usize;
        let truth = recording.frames[frame].world_from_camera.rotation.inverse() * Vector3::z();
        off.push((pose.rotation.inverse() * Vector3::z()).angle(&truth));
    }
    let mean = off.iter().sum::<f64>() / off.len() as f64;
    // Its axes are square in this recording; with a bias of 70 mg up would be off by 0.07.
    assert!(mean < 0.012, "{mean} rad");
    // Nothing of it without tracking; and `inspect` says where up will come from.
    let found = io::inspect(&out).unwrap().to_text();
    assert!(found.contains("/camera/camera/accel/sample") && !found.contains("which way is up"), "{found}");
    let found = io::inspect_with(&bags, &always).unwrap().to_text();
    assert!(found.contains("which way is up comes from the accelerations on /camera/camera/accel/sample"));
}

#[test]
fn wrong_options_are_told() {
    let out = folder("synth-none");
    let told = |options: &[&str]| {
        let ended = Command::new(env!("CARGO_BIN_EXE_artitwin"))
            .args(["synth", "--out"])
            .arg(&out)
            .args(options)
            .output()
            .unwrap();
        assert!(!out.exists());
        (ended.status.code().unwrap(), String::from_utf8(ended.stderr).unwrap())
    };
    let (code, text) = told(&["--parts", "9"]);
    assert!(code == 2 && text.contains("2 to 7 parts"), "{text}");
    let (code, text) = told(&["--drift", "5"]);
    assert!(code == 2 && text.contains("MM,DEG"), "{text}");
    let (code, text) = told(&["--sensor", "handheld:1:depth_wrap"]);
    assert!(code == 2 && Effect::ALL.iter().all(|e| text.contains(e.name())), "{text}");
    let (code, text) = told(&["--sensor", "kinect"]);
    assert!(code == 2 && text.contains("handheld:LEVEL"), "{text}");
    assert_eq!(Family::by_name("ship"), None);
}
