//! A synthetic object on disk: its recordings and their ground truth.

use std::{collections::BTreeMap, path::Path};

use nalgebra::Point3;
use serde::Serialize;

use super::{
    Committed, Place, ResultKind, RunDir, RunDirError, synth_bag::synth_bag, synth_error::SynthError,
    synth_matrix::rows, synth_sensor::SensorEntry, synth_twin::put_twin,
};
use geometry::{AxisMotion, Pose};
use surface::{TriangleMesh, merged_mesh};
use synth::{
    Board, HandleKind, Object, PoseSource, SeenSample, SynthConfig, SynthState, film_take, further_states,
    generate, imu_bias, record, workspace,
};

/// Least number of recording bytes per pixel of every view. Measured: 1.4 to 1.6 without noise and texture at
/// 640 x 480, more otherwise.
const LEAST_BYTES_A_PIXEL: u64 = 1;

#[derive(Serialize)]
struct TruthFile<'a> {
    unit: &'a str,
    made_by: String,
    family: &'a str,
    seed: u64,
    /// Pose of the true world in the world of each recording.
    recorded_from_world: [[[f64; 4]; 4]; 2],
    parts: Vec<PartEntry<'a>>,
    /// Handles, for the parts that have one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    handles: Vec<HandleEntry>,
    /// Positions of the parts' joints in the states after the first two, null for the static part.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    further: Vec<Vec<Option<f64>>>,
    /// Bias of the accelerometer, m/s², in its own axes.
    #[serde(skip_serializing_if = "Option::is_none")]
    imu_bias: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    board: Option<BoardEntry>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sensor: Option<SensorEntry>,
}

#[derive(Serialize)]
struct BoardEntry {
    paper: &'static str,
    world_from_board: [[f64; 4]; 4],
}

#[derive(Serialize)]
struct PartEntry<'a> {
    index: usize,
    name: &'a str,
    parent: i64,
    #[serde(rename = "type")]
    kind: &'a str,
    /// Rows of its points in `seen.npy`, in each state.
    seen_points: [usize; 2],
    #[serde(flatten)]
    joint: Option<JointEntry>,
}

#[derive(Serialize)]
struct HandleEntry {
    /// Index of its part.
    part: usize,
    kind: &'static str,
    /// Its frame in the world in state 0: x along it, z out of the plate.
    frame: [[f64; 4]; 4],
    size: BTreeMap<&'static str, f64>,
}

#[derive(Serialize)]
struct JointEntry {
    axis: [f64; 3],
    origin: [f64; 3],
    q0: f64,
    q1: f64,
    motion: f64,
    limits: [f64; 2],
    pitch_m_per_rad: f64,
    state1_from_state0: [[f64; 4]; 4],
    /// The same for the states after the first two.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    further_from_state0: Vec<[[f64; 4]; 4]>,
}

/// Writes the true twin of an object, `truth/twin.urdf` and its meshes.
///
/// # Errors
/// A place with contents that may not be replaced; an error of the disk.
pub fn write_true_twin(place: &Place, object: &Object) -> Result<Committed, SynthError> {
    let folder = RunDir::open(place, ResultKind::Synth)?;
    put_twin(&folder, object)?;
    Ok(folder.commit()?)
}

/// Writes the bag of a state into a new folder.
///
/// # Errors
/// If an image cannot be compressed or the disk refuses.
pub fn write_synth_bag(folder: &Path, state: usize, recording: &SynthState) -> Result<(), SynthError> {
    synth_bag(folder, state, recording)
}

/// Generates an object, films it in both states and any requested beyond, and writes `state0/`, `state1/`,
/// ..., `truth.json` and `truth/` into a folder, visible when it is complete; also `workspace.txt` if there
/// are no masks. Returns the folder and the object.
///
/// # Errors
/// Unusable settings; a place with contents that may not be replaced, or a full disk,
/// found before the work; an error of the disk.
pub fn write_synth(place: &Place, config: &SynthConfig) -> Result<(Committed, Object), SynthError> {
    config.check()?;
    // Checked before an object is filmed for minutes.
    place.check(ResultKind::Synth, least_bytes(config))?;
    let folder = RunDir::open(place, ResultKind::Synth)?;
    let object = generate(config)?;
    let mut recorded_from_world = [Pose::identity(); 2];
    let mut seen_points = vec![[0; 2]; object.parts.len()];
    let mut sensor = SensorEntry::of(config);
    for (state, slot) in recorded_from_world.iter_mut().enumerate() {
        let recording = record(&object, state, config);
        *slot = recording.recorded_from_world;
        sensor.iter_mut().for_each(|s| s.add(&recording));
        // Counted here, as the points are written away and not kept.
        recording.seen.iter().for_each(|s| seen_points[s.part][state] += 1);
        synth_bag(&folder.working().join(format!("state{state}")), state, &recording)?;
        put_truth(&folder, &object, state, &recording)?;
    }
    put_twin(&folder, &object)?;
    let further = further_states(&object, config.further, config)?;
    for (k, state) in further.iter().enumerate() {
        // Each further state is an object of its own: its state 1 is filmed.
        let recording = film_take(state, 1, k + 2, config);
        sensor.iter_mut().for_each(|s| s.add(&recording));
        synth_bag(&folder.working().join(format!("state{}", k + 2)), k + 2, &recording)?;
    }
    // A recording without poses has no world to place a box in.
    if !config.has_masks() && config.poses != PoseSource::Nobody {
        put_workspace(&folder, &object, &further)?;
    }
    let truth = TruthFile {
        unit: "meter, radian; true world frame, which is that of state 0; axes and origins as they stand \
            in state 0",
        made_by: format!("artitwin {} synth", env!("CARGO_PKG_VERSION")),
        family: object.family,
        seed: config.seed,
        recorded_from_world: recorded_from_world.map(|p| rows(&p)),
        parts: seen_points.iter().enumerate().map(|(k, seen)| entry(&object, &further, k, *seen)).collect(),
        handles: handles(&object),
        further: further
            .iter()
            .map(|o| o.parts.iter().map(|p| p.joint.map(|j| j.positions[1])).collect())
            .collect(),
        imu_bias: config.imu.then(|| imu_bias(config).into()),
        board: Board::of_config(&object, config).map(|board| BoardEntry {
            paper: board.layout.paper.name(),
            world_from_board: rows(&board.world_from_board),
        }),
        sensor,
    };
    folder.put("truth.json", &serde_json::to_vec_pretty(&truth)?)?;
    Ok((folder.commit()?, object))
}

/// The handles as they stand in state 0.
fn handles(object: &Object) -> Vec<HandleEntry> {
    let poses = object.world_from_parts(0);
    poses.iter().enumerate().filter_map(|(part, pose)| handle_entry(object, part, pose)).collect()
}

fn handle_entry(object: &Object, part: usize, pose: &Pose) -> Option<HandleEntry> {
    let handle = object.parts[part].handle?;
    let size = match handle.kind {
        HandleKind::Bar { length_m, thickness_m, clearance_m } => BTreeMap::from([
            ("length_m", length_m),
            ("thickness_m", thickness_m),
            ("clearance_m", clearance_m),
        ]),
        HandleKind::Knob { diameter_m, height_m } => {
            BTreeMap::from([("diameter_m", diameter_m), ("height_m", height_m)])
        }
        HandleKind::Recess { length_m, width_m, depth_m } => {
            BTreeMap::from([("length_m", length_m), ("width_m", width_m), ("depth_m", depth_m)])
        }
    };
    let frame = rows(&(pose * handle.part_from_handle));
    Some(HandleEntry { part, kind: handle.kind.name(), frame, size })
}

/// Writes the box that a user would give instead of masks, in the form of `reconstruct --workspace`.
fn put_workspace(folder: &RunDir, object: &Object, further: &[Object]) -> Result<(), RunDirError> {
    let [lower, upper] = workspace(&std::iter::once(object).chain(further).collect::<Vec<_>>());
    let numbers: Vec<String> = lower.iter().chain(upper.iter()).map(|x| format!("{x:.3}")).collect();
    folder.put("workspace.txt", numbers.join(",").as_bytes())
}

/// Least size of a made object on the disk, bytes.
pub(super) fn least_bytes(config: &SynthConfig) -> u64 {
    let views = (2 + config.further) * config.views;
    [views, config.width, config.height]
        .iter()
        .fold(LEAST_BYTES_A_PIXEL, |product, n| product.saturating_mul(*n as u64))
}

/// Ground truth of part `k`; the objects in `further` are in their state 1.
fn entry<'a>(object: &'a Object, further: &[Object], k: usize, seen_points: [usize; 2]) -> PartEntry<'a> {
    let part = &object.parts[k];
    let joint = part.joint.as_ref().zip(object.axis_in_world(k)).map(|(joint, (axis, origin))| {
        let [q0, q1] = joint.positions;
        let [before, after] = [0, 1].map(|state| object.world_from_parts(state)[k]);
        JointEntry {
            axis: axis.into_inner().into(),
            origin: origin.coords.into(),
            q0,
            q1,
            motion: q1 - q0,
            limits: joint.limits,
            pitch_m_per_rad: if let AxisMotion::Screw { pitch_m_per_rad } = joint.kind {
                pitch_m_per_rad
            } else {
                0.0
            },
            state1_from_state0: rows(&(after * before.inverse())),
            further_from_state0: further
                .iter()
                .map(|o| rows(&(o.world_from_parts(1)[k] * before.inverse())))
                .collect(),
        }
    });
    let parent = part.joint.map_or(-1, |j| j.parent as i64);
    PartEntry {
        index: k,
        name: &part.name,
        parent,
        kind: part.joint.as_ref().map_or("fixed", |j| j.kind.name()),
        seen_points,
        joint,
    }
}

/// Meshes of the parts and of the whole as they stand in a state, and the points seen by the cameras.
fn put_truth(
    folder: &RunDir,
    object: &Object,
    state: usize,
    recording: &SynthState,
) -> Result<(), RunDirError> {
    let meshes = object.meshes_in_world(state);
    for (k, mesh) in meshes.iter().enumerate() {
        folder.put(&format!("truth/state{state}/part_{k}.ply"), &ply(mesh))?;
    }
    folder.put(
        &format!("truth/state{state}/whole.ply"),
        &ply(&merged_mesh(&meshes.iter().collect::<Vec<_>>())),
    )?;
    folder.put(&format!("truth/state{state}/seen.npy"), &npy(&recording.seen))
}

/// Binary little-endian PLY.
pub(super) fn ply(mesh: &TriangleMesh) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float \
         y\nproperty float z\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        mesh.vertices.len(),
        mesh.triangles.len()
    )
    .into_bytes();
    bytes.extend(mesh.vertices.iter().flat_map(|p| [p.x, p.y, p.z]).flat_map(f32::to_le_bytes));
    for triangle in &mesh.triangles {
        bytes.push(3);
        // As `int`, which every reader knows; indices stay below 2^31.
        bytes.extend(triangle.iter().flat_map(|i| i.to_le_bytes()));
    }
    bytes
}

/// NumPy array of rows x, y, z, part.
fn npy(seen: &[SeenSample]) -> Vec<u8> {
    // NumPy evaluates the text as a Python dictionary: its spelling is fixed.
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, 4), }}", seen.len());
    // Magic, version and length take 10 bytes; the header is filled up to a multiple of 64.
    let filled = (header.len() + 1 + 10).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((filled as u16).to_le_bytes());
    bytes.extend(format!("{header:<width$}\n", width = filled - 1).into_bytes());
    for SeenSample { point: Point3 { coords }, part } in seen {
        let row = [coords.x as f32, coords.y as f32, coords.z as f32, *part as f32];
        bytes.extend(row.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes
}
