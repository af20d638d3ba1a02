//! From joints and part surfaces to links in a tree.

use nalgebra::Translation3;
use serde::{Deserialize, Serialize};

use super::{ArticulatedModel, Inertial, Joint, JointEvidence, JointKind, Limit, LimitSource, Link};
use crate::{
    geometry::Pose,
    surface::{ShellInertia, TriangleMesh, shell_inertia},
};

/// Assumptions that no camera measures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelConfig {
    /// Density of the walls, kg/m^3 (600: wood).
    pub density_kg_m3: f64,
    /// Thickness of the walls, metres.
    pub wall_thickness_m: f64,
    /// Largest joint effort, N m or N.
    pub effort: f64,
    /// Largest joint speed, rad/s or m/s.
    pub velocity: f64,
}

impl Default for ModelConfig {
    fn default() -> Self {
        Self { density_kg_m3: 600.0, wall_thickness_m: 0.008, effort: 100.0, velocity: 2.0 }
    }
}

/// One moving part: its joint as it stands in state 0 (world frame) and its surface there.
pub struct MovingPart {
    /// What the joint does.
    pub kind: JointKind,
    /// Unit axis, world.
    pub axis: nalgebra::Unit<nalgebra::Vector3<f64>>,
    /// Point of the axis, world, metres; becomes the link's origin.
    pub point: nalgebra::Point3<f64>,
    /// Motion from state 0 to state 1, positive, radians or metres.
    pub motion: f64,
    /// What it rests on.
    pub evidence: JointEvidence,
    /// Surface in the world in state 0.
    pub surface: TriangleMesh,
}

/// Builds the model: a star of moving parts around the static one. Position 0 is state 0; the limits are the observed
/// interval.
#[must_use]
pub fn build(name: &str, base: TriangleMesh, parts: Vec<MovingPart>, config: &ModelConfig) -> ArticulatedModel {
    let mut links = vec![link("base".to_owned(), base, config)];
    let mut joints = Vec::new();
    let positions: Vec<f64> = parts.iter().map(|p| p.motion).collect();
    for (i, part) in parts.into_iter().enumerate() {
        let parent_from_joint = Pose::from_parts(Translation3::from(part.point.coords), nalgebra::UnitQuaternion::identity());
        links.push(link(format!("part_{}", i + 1), part.surface.transformed(&parent_from_joint.inverse()), config));
        joints.push(Joint {
            name: format!("joint_{}", i + 1),
            kind: part.kind,
            parent: 0,
            child: i + 1,
            parent_from_joint,
            axis: part.axis,
            limit: Limit {
                lower: 0.0,
                upper: part.motion,
                effort: config.effort,
                velocity: config.velocity,
                source: LimitSource::Observed,
            },
            evidence: part.evidence,
        });
    }
    let states = vec![vec![0.0; positions.len()], positions];
    ArticulatedModel { name: name.to_owned(), links, joints, states }
}

fn link(name: String, visual: TriangleMesh, config: &ModelConfig) -> Link {
    // A surface without area (which validation refuses) gets a small solid's mass, never zero.
    let shell = shell_inertia(&visual, config.wall_thickness_m, config.density_kg_m3);
    let ShellInertia { mass_kg, center_of_mass, inertia } = shell.unwrap_or(ShellInertia {
        mass_kg: 1e-3,
        center_of_mass: nalgebra::Point3::origin(),
        inertia: nalgebra::Matrix3::identity() * 1e-6,
    });
    let assumption = format!(
        "shell of the seen surface, {} mm thick, {} kg/m^3 (assumed, not measured)",
        1e3 * config.wall_thickness_m,
        config.density_kg_m3
    );
    Link { name, visual, inertial: Inertial { mass_kg, center_of_mass, inertia, assumption } }
}
