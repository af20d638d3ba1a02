//! A finished reconstruction, read from its files only.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use nalgebra::{Point3, Unit, Vector3};

use super::{EvaluateError, components::large_components, truth::read_text};
use common::limits::REPORT;
use export::ReadReport;
use geometry::Pose;
use io::read_urdf;
use model::{JointType, Tree};
use surface::{TriangleMesh, merged_mesh};

/// Files of a run for a simulator: a tree, and the joint positions of the observed states.
pub struct RunFiles {
    /// Links and joints; the frame of the root link is the world.
    pub tree: Tree,
    /// Joint positions by name, for each state (at least two); joints not named are at 0.
    pub states: Vec<BTreeMap<String, f64>>,
    /// Links of each rigid part; the first part holds the root.
    pub parts: Vec<Vec<usize>>,
}

impl RunFiles {
    /// Reads the only `.urdf` of a folder (`.ros.urdf` excluded) and the `report.json` beside it. Components
    /// smaller than `min_component` times the area of the largest one are dropped from each link's mesh.
    ///
    /// # Errors
    /// If a file is missing or damaged; the error names it.
    pub fn read(folder: &Path, min_component: Option<f64>) -> Result<Self, EvaluateError> {
        let mut tree = read_urdf(&the_urdf(folder)?)?;
        if let Some(share) = min_component {
            for link in &mut tree.links {
                link.visual = large_components(&link.visual, share);
            }
        }
        let path = folder.join("report.json");
        let text = read_text(&path, REPORT)?;
        let report: ReadReport = serde_json::from_str(&text)
            .map_err(|source| EvaluateError::Json { path: path.clone(), source })?;
        let states: Vec<BTreeMap<String, f64>> = report.states.into_iter().map(|s| s.joints).collect();
        if states.len() < 2 {
            return Err(EvaluateError::Invalid {
                path,
                problem: format!("{} states; two are needed", states.len()),
            });
        }
        let parts = tree.rigid_parts();
        Ok(Self { tree, states, parts })
    }

    /// Surface of some links in one state, world frame.
    pub fn surface(&self, links: &[usize], state: usize) -> TriangleMesh {
        let world_from = |link: usize| self.tree.world_from_link(link, &self.states[state]);
        let placed: Vec<TriangleMesh> =
            links.iter().map(|&l| self.tree.links[l].visual.transformed(&world_from(l))).collect();
        merged_mesh(&placed.iter().collect::<Vec<_>>())
    }

    /// Motion of a part from state 0 to another state, world frame.
    pub fn motion(&self, part: usize, state: usize) -> Pose {
        let head = self.parts[part][0];
        self.tree.world_from_link(head, &self.states[state])
            // In the world frame the placement of a link's frame in its part does not matter.
            * self.tree.world_from_link(head, &self.states[0]).inverse()
    }

    /// Axis of a part's joint in state 0, world frame: direction and a point; `None` for the root's part.
    pub fn axis(&self, part: usize) -> Option<(Unit<Vector3<f64>>, Point3<f64>)> {
        let joint = self.tree.joint_of(self.parts[part][0])?;
        let world_from_joint = self.tree.world_from_joint(joint, &self.states[0]);
        let direction = Unit::new_normalize(world_from_joint.rotation * joint.axis.into_inner());
        Some((direction, world_from_joint.translation.vector.into()))
    }

    /// `revolute`, `prismatic` or `screw` (a revolute and a prismatic joint with a link without a mesh
    /// between them, in either order); `fixed` for the root's part.
    pub fn kind(&self, part: usize) -> &'static str {
        let Some(joint) = self.tree.joint_of(self.parts[part][0]) else { return "fixed" };
        let kind = kind_name(joint.kind);
        // A screw may be written as a pair of joints, with a meshless link between them.
        let carrier =
            self.tree.joint_of(joint.parent).filter(|_| self.tree.links[joint.parent].visual.is_empty());
        match (kind, carrier.map(|c| kind_name(c.kind))) {
            ("revolute", Some("prismatic")) | ("prismatic", Some("revolute")) => "screw",
            _ => kind,
        }
    }
}

fn kind_name(kind: JointType) -> &'static str {
    match kind {
        JointType::Fixed => "fixed",
        JointType::Revolute | JointType::Continuous => "revolute",
        JointType::Prismatic => "prismatic",
    }
}

fn the_urdf(folder: &Path) -> Result<PathBuf, EvaluateError> {
    let entries =
        fs::read_dir(folder).map_err(|source| EvaluateError::Disk { path: folder.to_owned(), source })?;
    let name = |p: &PathBuf| p.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    // The `.ros.urdf` is the same twin with `package://` paths.
    let is_urdf = |p: &PathBuf| name(p).ends_with(".urdf") && !name(p).ends_with(".ros.urdf");
    let mut found: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(is_urdf).collect();
    match (found.pop(), found.len()) {
        (Some(path), 0) => Ok(path),
        // None or several: the right one is unknown.
        (last, rest) => {
            Err(EvaluateError::NotARun { path: folder.to_owned(), count: rest + usize::from(last.is_some()) })
        }
    }
}
