//! Summary of the twin in a finished run folder: URDF, joints, observed states, uncertainty.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use nalgebra::{Unit, Vector3};

use common::files;
use common::limits::{FileLimit, REPORT, URDF};
use export::{Description, JointText, LimitText, ReadReport, SINGLE_JOINT};
use geometry::Pose;
use model::{JointKind, escape_xml};

/// Why a run folder could not be read.
#[derive(Debug, thiserror::Error)]
#[error("`{}`: {reason}; reconstruct again", path.display())]
pub struct RunSummaryError {
    path: PathBuf,
    reason: String,
}

/// A finished twin.
#[derive(Clone, Debug, PartialEq)]
pub struct RunSummary {
    /// The run folder.
    pub folder: PathBuf,
    /// Name of the twin.
    pub name: String,
    /// The URDF in which every joint is a single joint, with paths relative to its folder.
    pub urdf: String,
    /// Name of the root link; its frame is the world frame of the recording.
    pub root: String,
    /// Joints, parents before children.
    pub joints: Vec<SummaryJoint>,
    /// Bounding box of the object over all states, lower and upper corner in the root's frame, meters.
    pub object_box_m: Option<[[f64; 3]; 2]>,
}

/// A joint of a finished twin.
#[derive(Clone, Debug, PartialEq)]
pub struct SummaryJoint {
    /// Its name.
    pub name: String,
    /// Parent link.
    pub parent: String,
    /// Child link.
    pub child: String,
    /// Kind of the joint.
    pub kind: JointKind,
    /// Joint frame in the parent's frame at position 0.
    pub parent_from_joint: Pose,
    /// Axis in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// Lowest and highest position, radians or meters.
    pub limits: [f64; 2],
    /// Positions in the observed states.
    pub states: Vec<f64>,
    /// Standard deviation of the axis' direction, radians.
    pub axis_std_rad: f64,
    /// Standard deviation of the axis line's place, meters.
    pub origin_std_m: f64,
    /// Standard deviation of the motion between the states, radians or meters.
    pub motion_std: f64,
    /// Root mean square distance between the surfaces of its child in different states, meters.
    pub residual_rms_m: f64,
}

impl SummaryJoint {
    /// The child link's frame in its parent's at a position.
    #[must_use]
    pub fn parent_from_child(&self, position: f64) -> Pose {
        self.parent_from_joint * self.kind.motion_to(&self.axis, position)
    }
}

impl RunSummary {
    /// World pose of every link at the positions of a state: (link, pose), the root first.
    #[must_use]
    pub fn link_poses(&self, positions: &[f64]) -> Vec<(String, Pose)> {
        let mut poses = BTreeMap::from([(self.root.clone(), Pose::identity())]);
        let mut list = vec![(self.root.clone(), Pose::identity())];
        for (joint, position) in self.joints.iter().zip(positions) {
            // The parent's pose is there always: joints stand in the order of the tree.
            if let Some(parent) = poses.get(&joint.parent).copied() {
                let pose = parent * joint.parent_from_child(*position);
                poses.insert(joint.child.clone(), pose);
                list.push((joint.child.clone(), pose));
            }
        }
        list
    }

    /// Positions of all joints in an observed state.
    #[must_use]
    pub fn positions(&self, state: usize) -> Vec<f64> {
        self.joints.iter().map(|j| j.states.get(state).copied().unwrap_or_default()).collect()
    }

    /// Path of the URDF in which every joint is a single joint.
    #[must_use]
    pub fn urdf_path(&self) -> PathBuf {
        single_joint_urdf(&self.folder, &self.name)
    }

    /// The URDF with its meshes given by `file://` and the folder's absolute path, or by `package://` and the
    /// twin's name.
    #[must_use]
    pub fn urdf_with_uris(&self, package: bool) -> String {
        // A URDF on a topic has no folder, and RViz accepts only `file://` and `package://`.
        let folder = fs::canonicalize(&self.folder).unwrap_or_else(|_| self.folder.clone());
        let base =
            if package { format!("package://{}", self.name) } else { format!("file://{}", folder.display()) };
        // A folder's name may hold `&` or a quote.
        let base = escape_xml(&base);
        let absolute = format!("filename=\"{base}/meshes/");
        ["filename=\"meshes/", "filename=\"../meshes/"]
            .into_iter()
            .fold(self.urdf.clone(), |urdf, relative| urdf.replace(relative, &absolute))
    }
}

/// Path of the URDF in which every joint is a single joint: in a folder of its own if screws are pairs.
fn single_joint_urdf(folder: &Path, name: &str) -> PathBuf {
    let file = format!("{name}.urdf");
    let single = folder.join(SINGLE_JOINT).join(&file);
    if single.is_file() { single } else { folder.join(file) }
}

/// The fingerprint of a result's run, empty if its report has none; `None` if there is no result.
#[must_use]
pub fn read_result_fingerprint(folder: &Path) -> Option<String> {
    let report = files::read_text(&folder.join("report.json"), REPORT).ok()?;
    Some(serde_json::from_str::<ReadReport>(&report).unwrap_or_default().fingerprint)
}

/// Reads a finished run folder.
///
/// # Errors
/// If a file is missing, too large or damaged.
pub fn read_run_summary(folder: &Path) -> Result<RunSummary, RunSummaryError> {
    let fail = |path: &Path, reason: String| RunSummaryError { path: path.to_owned(), reason };
    let read =
        |path: &Path, limit: FileLimit| files::read_text(path, limit).map_err(|e| fail(path, e.to_string()));
    let path = folder.join("report.json");
    let report: ReadReport =
        serde_json::from_str(&read(&path, REPORT)?).map_err(|e| fail(&path, e.to_string()))?;
    if report.name.is_empty() || report.states.is_empty() {
        return Err(fail(&path, "it is no report of a twin".into()));
    }
    let path = single_joint_urdf(folder, &report.name);
    let urdf = read(&path, URDF)?;
    let robot = Description::parse(&urdf).and_then(Description::require_numbers);
    let robot = robot.map_err(|e| fail(&path, e.to_string()))?;
    let children: Vec<&str> = robot.joints.iter().map(|j| j.child.as_str()).collect();
    let root = robot.links.iter().find(|l| !children.contains(&l.name.as_str())).map(|l| l.name.clone());
    let root = root.ok_or_else(|| fail(&path, "it has no root link".into()))?;
    let joints: Option<Vec<SummaryJoint>> = robot.joints.iter().map(|j| joint(j, &report)).collect();
    let joints = joints.ok_or_else(|| {
        fail(
            &path,
            "a joint is neither revolute nor prismatic, holds no finite numbers, or is not in report.json"
                .into(),
        )
    })?;
    let joints = sorted(joints, &root).ok_or_else(|| fail(&path, "its links are no tree".into()))?;
    let ReadReport { name, object_box_m, .. } = report;
    Ok(RunSummary { folder: folder.to_owned(), name, urdf, root, joints, object_box_m })
}

fn joint(j: &JointText, report: &ReadReport) -> Option<SummaryJoint> {
    let reported = report.joints.iter().find(|r| r.name == j.name)?;
    // The URDF of a screw holds the nearest joint; the report holds its pitch.
    let kind = match (j.kind.as_str(), reported.pitch_m_per_rad) {
        ("revolute", None) => JointKind::Revolute,
        ("revolute", Some(pitch_m_per_rad)) => JointKind::Screw { pitch_m_per_rad },
        ("prismatic", _) => JointKind::Prismatic,
        _ => return None,
    };
    let states: Option<Vec<f64>> = report.states.iter().map(|s| s.joints.get(&j.name).copied()).collect();
    Some(SummaryJoint {
        name: j.name.clone(),
        parent: j.parent.clone(),
        child: j.child.clone(),
        kind,
        parent_from_joint: j.parent_from_joint,
        axis: Unit::try_new(j.axis.unwrap_or_else(Vector3::x), 1e-9)?,
        limits: j.limit.as_ref().map_or([0.0; 2], LimitText::range),
        states: states?,
        // `null` in the report means not determined; NaN keeps this apart from a deviation of 0.
        axis_std_rad: reported.axis_std_deg.unwrap_or(f64::NAN).to_radians(),
        origin_std_m: reported.origin_std_mm.unwrap_or(f64::NAN) * 1e-3,
        motion_std: reported.motion_std.as_ref().and_then(|q| q.value).unwrap_or(f64::NAN),
        residual_rms_m: reported.residual_rms_mm.unwrap_or(f64::NAN) * 1e-3,
    })
}

/// Parents before children; `None` where the links are no tree.
fn sorted(mut joints: Vec<SummaryJoint>, root: &str) -> Option<Vec<SummaryJoint>> {
    let mut reached = BTreeSet::from([root.to_owned()]);
    let mut list = Vec::with_capacity(joints.len());
    while !joints.is_empty() {
        // If no further joint is below the reached links, there is a loop, or links are apart from the root.
        let at = joints.iter().position(|j| reached.contains(&j.parent))?;
        let joint = joints.remove(at);
        reached.insert(joint.child.clone());
        list.push(joint);
    }
    Some(list)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Place, ResultKind, RunDir, read_urdf};
    use export::{ExportConfig, Report, RunFacts, urdf_package};
    use model::example::cabinet;

    #[test]
    fn a_screw_that_is_a_pair_in_the_urdf_is_one_joint_here() {
        let mut model = cabinet();
        let temp = tempfile::tempdir().unwrap();
        model.joints[1].kind = JointKind::Screw { pitch_m_per_rad: 0.05 };
        let run = RunDir::open(&Place::named(temp.path(), &model.name), ResultKind::Reconstruct).unwrap();
        for file in urdf_package(&model, &ExportConfig::default()) {
            run.put(&file.path, &file.bytes).unwrap();
        }
        run.put("report.json", Report::new(&model, &[], RunFacts::default()).to_json().as_bytes()).unwrap();
        let folder = run.commit().unwrap().folder;
        let summary = read_run_summary(&folder).unwrap();
        assert_eq!(summary.joints.len(), 2);
        assert!(summary.urdf_path().ends_with("single_joint/cabinet.urdf"));
        assert!(summary.urdf_with_uris(true).contains("\"package://cabinet/meshes/visual/door.obj\""));
        // Either way in, the links are where the model has them; the pair by the positions of the report.
        let tree = read_urdf(&folder.join("cabinet.urdf")).unwrap();
        let text = fs::read_to_string(folder.join("report.json")).unwrap();
        let report: ReadReport = serde_json::from_str(&text).unwrap();
        for (k, state) in model.states.iter().enumerate() {
            let poses = summary.link_poses(&summary.positions(k));
            for (i, link) in model.links.iter().enumerate() {
                let expected = model.world_from_link(i, state);
                let l = tree.links.iter().position(|l| l.name == link.name).unwrap();
                let by_name = poses.iter().find(|(name, _)| *name == link.name).unwrap().1;
                for pose in [by_name, tree.world_from_link(l, &report.states[k].joints)] {
                    let off = (pose.inverse() * expected).to_homogeneous() - nalgebra::Matrix4::identity();
                    assert!(off.norm() < 1e-6, "{}: {off}", link.name);
                }
            }
        }
    }
}
