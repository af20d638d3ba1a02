//! Matchers from ONNX files: models with known output, one that ONNX Runtime has run too, and files that are
//! none.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

use std::{path::Path, process::Command};

fn reconstruct(out: &str, options: &[&str]) -> (i32, String, std::path::PathBuf) {
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join(out);
    std::fs::remove_dir_all(&out).ok();
    let output = Command::new(env!("CARGO_BIN_EXE_artitwin"))
        .args(["reconstruct", "bags/drawer", "--preset", "preview", "--parts", "2", "--out"])
        .arg(&out)
        .args(options)
        .output()
        .unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap(), out)
}

#[cfg(not(feature = "onnx"))]
#[test]
fn a_build_without_onnx_refuses_a_matcher_and_says_how_to_build_one() {
    let (code, told, out) = reconstruct("onnx-absent", &["--matcher", "tests/golden/matcher_corners.onnx"]);
    assert_eq!(code, 2, "{told}");
    assert!(
        told.contains("matching.onnx") && told.contains("cargo build --release --features onnx"),
        "{told}"
    );
    assert!(!out.join("drawer").exists());
}

#[cfg(feature = "onnx")]
mod models {
    use super::*;
    use capture::{Correspondence, RgbdFrame};
    use evaluate::{EvaluateOptions, evaluate_runs};
    use geometry::{Intrinsics, Pose};
    use io::{MAX_MODEL_BYTES, OnnxError, OnnxMatcher};

    fn golden(name: &str) -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
    }

    fn open(name: &str) -> OnnxMatcher {
        OnnxMatcher::open(&golden(name), 640).unwrap_or_else(|e| panic!("{e}"))
    }

    fn frame(width: usize, height: usize, rgb: impl Fn(usize, usize) -> [u8; 3]) -> RgbdFrame {
        RgbdFrame {
            id: "0_0000".to_owned(),
            stamp_nanos: 0,
            intrinsics: Intrinsics { width, height, fx: 60.0, fy: 60.0, cx: 30.0, cy: 20.0 },
            world_from_camera: Pose::identity(),
            rgb: (0..width * height).map(|i| rgb(i % width, i / width)).collect(),
            depth_m: vec![1.0; width * height],
            mask: None,
            readings: Vec::new(),
        }
    }

    /// Squares of `side` pixels on gray, the first the brightest.
    fn beacons(width: usize, height: usize, side: usize, at: [[usize; 2]; 4]) -> RgbdFrame {
        let value = |u: usize, v: usize| {
            at.iter()
                .position(|[a, b]| u / side == *a && v / side == *b)
                .map_or(20, |rank| 250 - 50 * rank as u8)
        };
        frame(width, height, |u, v| if side == 1 { [value(u, v); 3] } else { [value(u, v), 255, 255] })
    }

    const AT: [[[usize; 2]; 4]; 2] =
        [[[3, 4], [30, 2], [11, 20], [40, 25]], [[5, 5], [29, 3], [8, 22], [1, 27]]];

    #[test]
    fn a_model_of_any_size_gets_the_frames_pixels() {
        let matcher = open("matcher_beacons.onnx");
        // Twice with other sizes: a plan is made for each.
        for (width, height) in [(70, 50), (45, 33), (70, 50)] {
            let frames = AT.map(|at| beacons(width, height, 1, at));
            let found = matcher.correspondences([&frames[0], &frames[1]]).unwrap();
            let pixels = |k: usize, rank: usize| AT[k][rank].map(|x| x as f32);
            let expected: Vec<_> = (0..4)
                .map(|r| Correspondence { pixels: [pixels(0, r), pixels(1, r)], confidence: 1.0 })
                .collect();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn a_model_of_one_size_gets_scaled_frames_and_its_pixels_are_scaled_back() {
        let matcher = open("matcher_beacons_fixed.onnx");
        // 96 x 60 to 48 x 30, below which the border is repeated: 48 x 32.
        let frames = AT.map(|at| beacons(96, 60, 2, at));
        let found = matcher.correspondences([&frames[0], &frames[1]]).unwrap();
        assert_eq!(found.len(), 4);
        for (rank, c) in found.iter().enumerate() {
            for k in [0, 1] {
                let expected = AT[k][rank].map(|x| 2.0 * x as f32 + 0.5);
                assert_eq!((c.pixels[k], c.confidence), (expected, 1.0), "{rank}");
            }
        }
    }

    #[test]
    fn the_runtime_agrees_with_onnx_runtime() {
        let text = std::fs::read_to_string(golden("matcher_corners.json")).unwrap();
        let example: serde_json::Value = serde_json::from_str(&text).unwrap();
        let number = |v: &serde_json::Value| v.as_f64().unwrap();
        let size = [0, 1].map(|k| number(&example["cut_size"][k]) as usize);
        let frames = [0, 1].map(|cut| {
            let corner = [0, 1].map(|k| number(&example["cut_corners"][cut][k]) as usize);
            frame(size[0], size[1], |u, v| {
                [number(&example["squares"][(v + corner[1]) / 4][(u + corner[0]) / 4]) as u8; 3]
            })
        });
        // The reference ran on the bare cut, which needs no filling up along u; along v its border is
        // repeated here.
        let found = open("matcher_corners.onnx").correspondences([&frames[0], &frames[1]]).unwrap();
        let expected = example["matches"].as_array().unwrap();
        assert!(expected.len() > 20);
        let away = |pixel: [f32; 2]| (10.0..38.0).contains(&pixel[1]);
        let reference =
            |m: &serde_json::Value| [0, 2].map(|k| [number(&m[k]) as f32, number(&m[k + 1]) as f32]);
        let mut compared = 0;
        for m in expected.iter().filter(|m| number(&m[4]) > 0.9 && reference(m).iter().all(|p| away(*p))) {
            let same = found.iter().find(|c| c.pixels == reference(m));
            let same = same.unwrap_or_else(|| panic!("{m} is not among {found:?}"));
            assert!((f64::from(same.confidence) - number(&m[4])).abs() < 1e-3, "{m} {same:?}");
            compared += 1;
        }
        assert!(compared >= 8, "{compared}");
    }

    /// The error of a file with these bytes.
    fn refused(name: &str, bytes: &[u8]) -> (OnnxError, String) {
        let path = std::env::temp_dir().join(format!("artitwin-{name}-{}.onnx", std::process::id()));
        std::fs::write(&path, bytes).unwrap();
        let error = OnnxMatcher::open(&path, 640).unwrap_err();
        std::fs::remove_file(&path).unwrap();
        let text = error.to_string();
        (error, text)
    }

    fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
        assert_eq!(from.len(), to.len());
        let mut bytes = bytes.to_vec();
        for at in 0..=bytes.len() - from.len() {
            if bytes[at..].starts_with(from.as_bytes()) {
                bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
            }
        }
        bytes
    }

    #[test]
    fn other_models_are_refused_with_what_they_have_and_what_is_needed() {
        let model = std::fs::read(golden("matcher_beacons.onnx")).unwrap();
        for (name, from, to, has) in [
            ("input", "image1", "right1", "inputs image0 f32 [1, 1, ?, ?], right1 f32 [1, 1, ?, ?]"),
            ("output", "keypoints1", "mkpts_1_xy", "outputs keypoints0, mkpts_1_xy, confidence"),
        ] {
            let (error, text) = refused(name, &replaced(&model, from, to));
            assert!(matches!(error, OnnxError::Contract { .. }), "{text}");
            assert!(
                text.contains(has)
                    && text.contains("image0 and image1")
                    && text.contains("keypoints0 and keypoints1"),
                "{text}"
            );
        }
    }

    #[test]
    fn files_that_are_no_models_are_refused() {
        let model = std::fs::read(golden("matcher_beacons.onnx")).unwrap();
        for (name, bytes) in
            [("empty", &b""[..]), ("text", b"not a model"), ("cut", &model[..model.len() / 2])]
        {
            let (error, text) = refused(name, bytes);
            assert!(matches!(error, OnnxError::Model { .. } | OnnxError::Contract { .. }), "{text}");
        }
        let missing = OnnxMatcher::open(Path::new("missing.onnx"), 640).unwrap_err();
        assert!(matches!(missing, OnnxError::Read { .. }) && missing.to_string().contains("missing.onnx"));
        let path = std::env::temp_dir().join(format!("artitwin-large-{}.onnx", std::process::id()));
        std::fs::File::create(&path).unwrap().set_len(MAX_MODEL_BYTES + 1).unwrap();
        let large = OnnxMatcher::open(&path, 640).unwrap_err();
        std::fs::remove_file(&path).unwrap();
        assert!(large.to_string().contains("larger than 512 MiB"), "{large}");
    }

    #[test]
    fn damaged_models_are_refused_or_fail_without_a_panic() {
        let model = std::fs::read(golden("matcher_beacons.onnx")).unwrap();
        let frames = AT.map(|at| beacons(48, 32, 1, at));
        let path = std::env::temp_dir().join(format!("artitwin-damaged-{}.onnx", std::process::id()));
        for at in (0..model.len()).step_by(7) {
            let mut bytes = model.clone();
            bytes[at] ^= 0x15;
            std::fs::write(&path, bytes).unwrap();
            if let Ok(matcher) = OnnxMatcher::open(&path, 640) {
                matcher.correspondences([&frames[0], &frames[1]]).ok();
            }
        }
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn the_drawer_is_reconstructed_from_the_matches_of_a_model() {
        let (code, told, out) =
            reconstruct("onnx-drawer", &["-v", "--matcher", "tests/golden/matcher_corners.onnx"]);
        assert!(code == 0 || code == 3, "{told}");
        assert!(told.contains("pixel matches on the object in"), "{told}");
        let report =
            evaluate_runs(&[out.join("drawer")], Path::new("bags/drawer"), &EvaluateOptions::default())
                .unwrap();
        let joint = &report.trials[0].joints[0];
        assert_eq!(joint.type_right, Some(true), "{joint:?}");
        assert!(joint.error_mm.is_some_and(|e| e < 5.0), "{joint:?}");
    }

    #[test]
    fn a_matcher_that_is_missing_ends_the_run_before_the_recording_is_read() {
        let (code, told, out) = reconstruct("onnx-missing", &["--matcher", "missing.onnx"]);
        assert_eq!(code, 1, "{told}");
        assert!(told.contains("cannot read the matcher missing.onnx") && !told.contains("capture"), "{told}");
        assert!(!out.join("drawer").exists());
    }
}
