//! Ground truth of a recording.

use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Matrix4, Point3, Rotation3, Unit, UnitQuaternion, Vector3};
use serde::Deserialize;

use super::EvaluateError;
use common::files;
use common::limits::{FileLimit, TRUTH};
use geometry::Pose;
use io::{read_mesh, read_npy};
use surface::TriangleMesh;

/// The joint between a part and its parent, in the world frame in state 0.
#[derive(Clone, Debug)]
pub struct TrueJoint {
    /// `revolute`, `prismatic` or `screw`.
    pub kind: String,
    /// Unit direction of the axis.
    pub axis: Unit<Vector3<f64>>,
    /// A point on the axis, meters; meaningless for a prismatic joint.
    pub origin: Point3<f64>,
    /// Motion of the part from state 0 to state 1, world frame.
    pub state1_from_state0: Pose,
    /// The same to each state after the first two, if there are any.
    pub further_from_state0: Vec<Pose>,
}

impl TrueJoint {
    /// Motion of the part from state 0 to each other state, world frame.
    pub fn motions(&self) -> impl Iterator<Item = &Pose> {
        std::iter::once(&self.state1_from_state0).chain(&self.further_from_state0)
    }
}

/// A rigid part of the true object.
#[derive(Clone, Debug)]
pub struct TruePart {
    /// Number of the part in the files.
    pub index: usize,
    /// Name.
    pub name: String,
    /// Its joint; `None` for the static part.
    pub joint: Option<TrueJoint>,
    /// Surface in states 0 and 1, world frame, meters.
    pub meshes: [TriangleMesh; 2],
}

/// A point of the true surface seen by some camera.
#[derive(Clone, Copy, Debug)]
pub struct SeenPoint {
    /// World point, meters.
    pub point: Point3<f64>,
    /// Number of its part.
    pub part: usize,
}

/// Ground truth of an object.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Parts, in the order of the file.
    pub parts: Vec<TruePart>,
    /// Whole surface in states 0 and 1, world frame, meters.
    pub whole: [TriangleMesh; 2],
    /// Points seen by some camera in states 0 and 1; empty if not recorded.
    pub seen: [Vec<SeenPoint>; 2],
}

#[derive(Deserialize)]
struct TruthFile {
    parts: Vec<PartEntry>,
}

#[derive(Deserialize)]
struct PartEntry {
    index: usize,
    name: String,
    #[serde(rename = "type")]
    kind: String,
    axis: Option<[f64; 3]>,
    origin: Option<[f64; 3]>,
    state1_from_state0: Option<[[f64; 4]; 4]>,
    #[serde(default)]
    further_from_state0: Vec<[[f64; 4]; 4]>,
}

impl Truth {
    /// Reads `truth.json`, `truth/state{0,1}/{part_<i>,whole}.ply` and, if present, `seen.npy` (rows x, y, z,
    /// part).
    ///
    /// # Errors
    /// If a file is missing or damaged; the error names it.
    pub fn read(folder: &Path) -> Result<Self, EvaluateError> {
        let path = folder.join("truth.json");
        let text = read_text(&path, TRUTH)?;
        let file: TruthFile = serde_json::from_str(&text)
            .map_err(|source| EvaluateError::Json { path: path.clone(), source })?;
        let state = |s: usize| folder.join(format!("truth/state{s}"));
        let mesh = |s: usize, name: &str| read_mesh(&state(s).join(format!("{name}.ply")));
        let mut parts = Vec::with_capacity(file.parts.len());
        for entry in &file.parts {
            let name = format!("part_{}", entry.index);
            parts.push(TruePart {
                index: entry.index,
                name: entry.name.clone(),
                joint: joint_of_entry(entry).map_err(|fault| EvaluateError::Invalid {
                    path: path.clone(),
                    problem: fault.to_string(),
                })?,
                meshes: [mesh(0, &name)?, mesh(1, &name)?],
            });
        }
        // Motions are given in the world, so exactly one part is static.
        if parts.iter().filter(|p| p.joint.is_none()).count() != 1 {
            return Err(EvaluateError::Invalid {
                path,
                problem: "exactly one part must be of type fixed".into(),
            });
        }
        Ok(Self {
            parts,
            whole: [mesh(0, "whole")?, mesh(1, "whole")?],
            seen: [read_seen(&state(0))?, read_seen(&state(1))?],
        })
    }
}

/// Reads a text file of limited size.
pub(super) fn read_text(path: &Path, limit: FileLimit) -> Result<String, EvaluateError> {
    files::read_text(path, limit).map_err(|source| EvaluateError::Disk { path: path.to_owned(), source })
}

/// Why a part is invalid.
#[derive(Debug, thiserror::Error)]
enum PartFault {
    #[error("part '{part}' is of type '{kind}'; fixed, revolute, prismatic and screw are known")]
    Type { part: String, kind: String },
    #[error("part '{0}' needs axis, origin and state1_from_state0")]
    Incomplete(String),
    #[error("part '{0}' has an axis of no length")]
    NoAxis(String),
    #[error("state1_from_state0 of part '{0}' is not rigid")]
    NotRigid(String),
    #[error("a further_from_state0 of part '{0}' is not rigid")]
    FurtherNotRigid(String),
}

fn joint_of_entry(entry: &PartEntry) -> Result<Option<TrueJoint>, PartFault> {
    let name = || entry.name.clone();
    if entry.kind == "fixed" {
        return Ok(None);
    }
    if !["revolute", "prismatic", "screw"].contains(&entry.kind.as_str()) {
        return Err(PartFault::Type { part: name(), kind: entry.kind.clone() });
    }
    let (Some(axis), Some(origin), Some(motion)) = (entry.axis, entry.origin, entry.state1_from_state0)
    else {
        return Err(PartFault::Incomplete(name()));
    };
    // The norm of very large numbers overflows and is refused.
    let direction = Unit::try_new(Vector3::from(axis), 1e-9).filter(|a| a.norm() > 0.5);
    let axis = direction.ok_or_else(|| PartFault::NoAxis(name()))?;
    let motion = rigid_pose(&motion).ok_or_else(|| PartFault::NotRigid(name()))?;
    let further: Option<Vec<Pose>> = entry.further_from_state0.iter().map(rigid_pose).collect();
    let further_from_state0 = further.ok_or_else(|| PartFault::FurtherNotRigid(name()))?;
    Ok(Some(TrueJoint {
        kind: entry.kind.clone(),
        axis,
        origin: Point3::from(origin),
        state1_from_state0: motion,
        further_from_state0,
    }))
}

/// A pose from a row-major 4x4 matrix; `None` if it is not rigid.
fn rigid_pose(rows: &[[f64; 4]; 4]) -> Option<Pose> {
    let m = Matrix4::from_fn(|r, c| rows[r][c]);
    let r: Matrix3<f64> = m.fixed_view::<3, 3>(0, 0).into();
    // The truth has full precision: a larger error is not rounding.
    let straight = (r.transpose() * r - Matrix3::identity()).norm() < 1e-6 && r.determinant() > 0.0;
    let translation: Vector3<f64> = m.fixed_view::<3, 1>(0, 3).into();
    straight.then(|| {
        Pose::from_parts(
            translation.into(),
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r)),
        )
    })
}

fn read_seen(folder: &Path) -> Result<Vec<SeenPoint>, EvaluateError> {
    let path: PathBuf = folder.join("seen.npy");
    // Not every truth has the points seen by cameras; without them completeness is left out.
    if !path.exists() {
        return Ok(Vec::new());
    }
    let array = read_npy(&path)?;
    if array.columns != 4 {
        return Err(EvaluateError::Invalid {
            path,
            problem: format!("{} columns; x, y, z and part are needed", array.columns),
        });
    }
    let rows = (0..array.rows).map(|i| array.row(i));
    Ok(rows
        .map(|r| SeenPoint { point: Point3::new(r[0], r[1], r[2]), part: r[3].max(0.0) as usize })
        .collect())
}
