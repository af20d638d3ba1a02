//! Ground truth in the form of the published datasets: `trans.json` with the joints between start and end
//! state, and meshes of the whole, the static and the moving parts in both states, in the cameras' world
//! frame.

use std::path::{Path, PathBuf};

use nalgebra::{Point3, Unit, Vector3};

use super::{
    EvaluateError,
    truth::{TrueJoint, TruePart, Truth, read_text},
};
use common::limits::TRUTH;
use geometry::{Pose, Screw};
use io::{JointTransform, JointTransforms, MeshFileError, STATES, read_mesh};
use surface::TriangleMesh;

/// Path of a folder's `trans.json`: in the folder itself, in `gt` or in `textured_objs`.
pub(super) fn find_transforms(folder: &Path) -> Option<PathBuf> {
    let places = ["gt", "", "textured_objs"].map(|place| folder.join(place).join("trans.json"));
    places.into_iter().find(|path| path.is_file())
}

/// Reads a `trans.json`, and the meshes in its folder or in the folder above.
///
/// # Errors
/// If a file is missing or damaged, or a joint is impossible.
pub(super) fn read_transforms(path: &Path) -> Result<Truth, EvaluateError> {
    let text = read_text(path, TRUTH)?;
    let file: JointTransforms = serde_json::from_str(&text)
        .map_err(|source| EvaluateError::Json { path: path.to_owned(), source })?;
    let transforms = file.joints();
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut folders = [Some(folder), folder.parent()].into_iter().flatten();
    let with_meshes = folders.find(|folder| folder.join("start/start_static_rotate.ply").is_file());
    let meshes = with_meshes.unwrap_or(folder);
    let static_meshes = read_both(meshes, "_static")?;
    let mut parts = vec![TruePart { index: 0, name: "static".into(), joint: None, meshes: static_meshes }];
    for (k, transform) in transforms.iter().enumerate() {
        let name = if transforms.len() == 1 { "dynamic".to_owned() } else { format!("dynamic_{k}") };
        let joint = joint_of_transform(transform).map_err(|problem| EvaluateError::Invalid {
            path: path.to_owned(),
            problem: format!("{name}: {problem}"),
        })?;
        let meshes = read_both(meshes, &format!("_{name}"))?;
        parts.push(TruePart { index: k + 1, name, joint: Some(joint), meshes });
    }
    Ok(Truth { parts, whole: read_both(meshes, "")?, seen: [Vec::new(), Vec::new()] })
}

/// Meshes of a part in the start and the end state; `part` is its part of the file names.
fn read_both(folder: &Path, part: &str) -> Result<[TriangleMesh; 2], MeshFileError> {
    let [start, end] =
        STATES.map(|state| read_mesh(&folder.join(state).join(format!("{state}{part}_rotate.ply"))));
    Ok([start?, end?])
}

/// The joint of a transform: about or along its axis, from position `l` to `r`.
fn joint_of_transform(transform: &JointTransform) -> Result<TrueJoint, &'static str> {
    let direction = Unit::try_new(Vector3::from(transform.axis.d), 1e-9).filter(|d| d.norm() > 0.5);
    let axis = direction.ok_or("its axis has no length")?;
    let origin = Point3::from(transform.axis.o);
    let (kind, motion) = match (transform.kind.as_str(), transform.rotate, transform.translate) {
        ("rotate", Some(ends), _) => {
            let turn = Screw {
                direction: axis,
                point: origin,
                angle_rad: ends.motion().to_radians(),
                advance_m: 0.0,
            };
            ("revolute", turn.to_motion())
        }
        ("translate", _, Some(ends)) => {
            let shift = axis.into_inner() * ends.motion();
            ("prismatic", Pose::translation(shift.x, shift.y, shift.z))
        }
        _ => return Err("`rotate` with its angles or `translate` with its lengths is needed"),
    };
    if !motion.to_homogeneous().iter().all(|x| x.is_finite()) {
        return Err("its numbers are not finite");
    }
    Ok(TrueJoint {
        kind: kind.into(),
        axis,
        origin,
        state1_from_state0: motion,
        further_from_state0: Vec::new(),
    })
}
