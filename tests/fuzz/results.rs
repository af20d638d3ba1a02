//! Folders that the program wrote itself, or their likes: runs, diagnoses, truths, checkpoints, arrays.

use std::collections::BTreeMap;

use evaluate::{RunFiles, Truth};
use io::{read_gap_report, read_npy, read_run_summary};
use run::{Fingerprint, Monitor, StageStore};
use serde::{Serialize, Serializer, ser::SerializeTuple as _};

use super::engine::{BYTES, Scratch, Target, plain, whole};

const URDF: &str = r#"<robot name="unit"><link name="frame"><visual><geometry><mesh filename="a.ply"/></geometry></visual></link>
<link name="tray"><visual><geometry><mesh filename="a.ply"/></geometry></visual></link>
<joint name="slide" type="prismatic"><origin xyz="0.1 0 0" rpy="0 0 1"/><parent link="frame"/><child link="tray"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.2" effort="10" velocity="1"/></joint></robot>
"#;
const REPORT: &str = r#"{"name": "unit", "warnings": [], "states": [{"joints": {"slide": 0.0}}, {"joints": {"slide": 0.16}}],
 "joints": [{"name": "slide", "type": "prismatic", "pitch_m_per_rad": null, "axis_std_deg": 0.1, "origin_std_mm": null,
 "motion_std": {"value": 0.001, "unit": "m"}, "residual_rms_mm": 0.4}]}
"#;
const GAP: &str = r#"{"verdict": "named", "findings": [{"joint": "hinge", "effect": "viscous_friction", "weight": 0.9, "parameters":
 [{"name": "damping", "value": 0.4, "unit": "N m s/rad", "interval": [0.3, null]}]}],
 "gap": {"before": 0.1, "after": 0.01, "noise_floor": null, "unit": "rad"}}
"#;
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                   property float z\nelement face 1\n\
                   property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
const JSON: [&str; 16] = [
    "{",
    "[",
    "}",
    "]",
    "null",
    "true",
    "\"",
    "\\u0000",
    "\\ud800",
    "1e999",
    "-0",
    ",",
    ":",
    "\"../../etc/x\"",
    "\"slide\"",
    "\"unit\"",
];

/// `report.json` and URDF of a run, as the node and `evaluate` read them.
#[test]
fn run_folder() {
    let name = "results::run_folder";
    let scratch = Scratch::new(name);
    scratch.put("a.ply", PLY);
    let seeds = vec![vec![REPORT.into(), URDF.into()]];
    fn assemble(parts: &[Vec<u8>]) -> Vec<u8> {
        parts.join(&0)
    }
    let words =
        [&JSON[..], &["<joint ", "type=\"revolute\"", "parent link=\"tray\"", "<link name=\"x\"/>"]].concat();
    let target = Target { name, seeds, words: &words, assemble, bytes: BYTES };
    target.run(|input| {
        let (report, urdf) = input.split_at(input.iter().position(|b| *b == 0).unwrap_or(input.len()));
        scratch.put("report.json", report);
        scratch.put("unit.urdf", urdf.strip_prefix(b"\0").unwrap_or(urdf));
        let summary = read_run_summary(&scratch.0).ok();
        if let Some(summary) = &summary {
            let poses = summary.link_poses(&summary.positions(1));
            assert_eq!(poses.len(), summary.joints.len() + 1);
            let _ = (summary.urdf_with_uris(true), summary.urdf_with_uris(false));
        }
        if let Ok(run) = RunFiles::read(&scratch.0, Some(0.5)) {
            assert!(run.states.len() >= 2);
            for part in 0..run.parts.len() {
                let surface = run.surface(&run.parts[part], 1);
                assert!(surface.triangles.iter().flatten().all(|k| (*k as usize) < surface.vertices.len()));
                let _ = (run.motion(part, 1), run.axis(part), run.kind(part));
            }
        }
        summary.is_some()
    });
}

/// `report.json` of a diagnosis.
#[test]
fn gap_report() {
    let name = "results::gap_report";
    let scratch = Scratch::new(name);
    let target = Target { name, seeds: whole([GAP]), words: &JSON, assemble: plain, bytes: BYTES };
    target.run(|input| {
        scratch.put("report.json", input);
        read_gap_report(&scratch.0).is_ok()
    });
}

/// `truth.json` of a recording.
#[test]
fn truth() {
    let name = "results::truth";
    let scratch = Scratch::new(name);
    for file in ["part_0", "part_1", "whole"] {
        scratch.put(&format!("truth/state0/{file}.ply"), PLY);
        scratch.put(&format!("truth/state1/{file}.ply"), PLY);
    }
    let seeds = whole([include_str!("../../bags/drawer/truth.json")]);
    let target = Target { name, seeds, words: &JSON, assemble: plain, bytes: BYTES };
    target.run(|input| {
        scratch.put("truth.json", input);
        let Ok(truth) = Truth::read(&scratch.0) else { return false };
        for joint in truth.parts.iter().filter_map(|p| p.joint.as_ref()) {
            assert!((joint.axis.norm() - 1.0).abs() < 1e-6 && joint.origin.iter().all(|x| x.is_finite()));
            assert!(joint.motions().all(|m| m.to_homogeneous().iter().all(|x| x.is_finite())));
        }
        true
    });
}

/// Arrays.
#[test]
fn npy() {
    let name = "results::npy";
    let scratch = Scratch::new(name);
    let array = |descr: &str, shape: &str, data: &[u8]| {
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
        [b"\x93NUMPY\x01\0", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), data].concat()
    };
    let reals: Vec<u8> = (0..8).flat_map(|k| f64::from(k).to_le_bytes()).collect();
    let seeds = whole([
        array("<f8", "(2, 4)", &reals),
        array("<f4", "(4, 4)", &reals),
        array("<i4", "(2, 2)", &reals[..16]),
        array("|u1", "(16, 1)", &reals[..16]),
    ]);
    let words =
        ["'shape': ", "(0, 4)", "(4294967296, 4294967296)", "'<f8'", "'descr': ", "True", ")", "(", ","];
    let target = Target { name, seeds, words: &words, assemble: plain, bytes: BYTES };
    target.run(|input| {
        let Ok(array) = read_npy(&scratch.put("a.npy", input)) else { return false };
        assert_eq!(array.values.len(), array.rows * array.columns);
        true
    });
}

/// Bytes that are written as they are.
struct Raw<'a>(&'a [u8]);

impl Serialize for Raw<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut tuple = serializer.serialize_tuple(self.0.len())?;
        self.0.iter().try_for_each(|byte| tuple.serialize_element(byte))?;
        tuple.end()
    }
}

/// What a stage may have left.
type Stage = (Vec<f32>, BTreeMap<String, Vec<[f64; 3]>>, Option<(u64, i32, bool)>, Vec<u8>);

/// Results of stages, with the right checksum, and files that are damaged anywhere.
#[test]
fn store() {
    let name = "results::store";
    let scratch = Scratch::new(name);
    let store = StageStore::open(&scratch.0.join("c"), Fingerprint::default().with("seed", 1)).unwrap();
    let stage: Stage = (
        vec![1.0, 2.5],
        [("hinge".to_owned(), vec![[1.0, 2.0, 3.0]])].into(),
        Some((7, -3, true)),
        vec![1, 2, 3],
    );
    store.save("stage", &stage).unwrap();
    let file = std::fs::read_dir(scratch.0.join("c")).unwrap().next().unwrap().unwrap().path();
    let whole_file = std::fs::read(&file).unwrap();
    let payload = whole_file[whole_file.len() - postcard::to_stdvec(&stage).unwrap().len()..].to_vec();
    let seeds = vec![vec![vec![0], payload], vec![vec![1], whole_file]];
    let target = Target { name, seeds, words: &["\u{ff}\u{ff}\u{ff}\u{ff}"], assemble: plain, bytes: BYTES };
    target.run(|input| {
        match input.split_first() {
            Some((kind, payload)) if kind % 2 == 0 => store.save("stage", &Raw(payload)).unwrap(),
            Some((_, bytes)) => std::fs::write(&file, bytes).unwrap(),
            None => return false,
        }
        store.load::<Stage>("stage", &Monitor::silent()).is_some()
    });
}
