//! A small hand-made model for tests.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, SMatrix, Unit, UnitQuaternion, Vector3};

use super::{
    ArticulatedModel, Inertial, Joint, JointDynamics, JointEvidence, JointFamily, JointKind, Limit,
    LimitSource, Link,
};
use geometry::Pose;
use surface::{ConvexSolid, TriangleMesh};

/// Axis-aligned box with outward triangles, meters.
pub fn box_mesh(lower: [f32; 3], upper: [f32; 3], color: [u8; 3]) -> TriangleMesh {
    TriangleMesh { colors: vec![color; 8], ..TriangleMesh::cuboid(&lower.into(), &upper.into()) }
}

/// A cabinet: a body at the world's origin, a door on a tilted hinge and a drawer behind a turned joint
/// frame.
pub fn cabinet() -> ArticulatedModel {
    let hinge = Pose::from_parts(
        Vector3::new(0.2, -0.25, 0.3).into(),
        UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3),
    );
    let rail = Pose::from_parts(
        Vector3::new(0.2, 0.1, 0.1).into(),
        UnitQuaternion::from_euler_angles(0.0, std::f64::consts::FRAC_PI_2, 0.4),
    );
    ArticulatedModel {
        name: "cabinet".into(),
        links: vec![
            link("body", box_mesh([-0.2, -0.25, 0.0], [0.2, 0.25, 0.6], [150, 120, 90]), 8.0),
            link("door", box_mesh([0.0, 0.0, -0.2], [0.02, 0.3, 0.2], [200, 60, 50]), 1.5),
            link("drawer", box_mesh([-0.05, -0.1, 0.0], [0.05, 0.1, 0.3], [60, 90, 200]), 1.0),
        ],
        joints: vec![
            joint("door_hinge", JointKind::Revolute, 1, hinge, Vector3::z_axis(), [0.0, 1.25]),
            joint("drawer_slide", JointKind::Prismatic, 2, rail, Vector3::z_axis(), [0.0, 0.18]),
        ],
        states: vec![vec![0.0, 0.18], vec![1.25, 0.0]],
    }
}

fn link(name: &str, visual: TriangleMesh, mass_kg: f64) -> Link {
    let (lower, upper) = visual.bounds().unwrap_or((Point3::origin(), Point3::origin()));
    let micrometers = |x: f32| (f64::from(x) * 1e6).round() * 1e-6;
    // The corners were rounded to single precision; this gives the intended numbers.
    let lower = lower.map(micrometers);
    let upper = upper.map(micrometers);
    let side = upper - lower;
    let moment = |a: f64, b: f64| mass_kg / 12.0 * (a * a + b * b);
    let moments = Vector3::new(moment(side.y, side.z), moment(side.x, side.z), moment(side.x, side.y));
    let inertial = Inertial {
        mass_kg,
        center_of_mass: nalgebra::center(&lower, &upper),
        inertia: Matrix3::from_diagonal(&moments),
        assumption: "solid box".into(),
        mass_range_kg: [0.5 * mass_kg, 2.0 * mass_kg],
    };
    let collision = vec![ConvexSolid::cuboid(&lower, &upper)];
    Link {
        name: name.into(),
        visual,
        assumed_m2: 0.0,
        assumed: TriangleMesh::default(),
        collision,
        inertial,
        grasps: Vec::new(),
    }
}

fn joint(
    name: &str,
    kind: JointKind,
    child: usize,
    parent_from_joint: Pose,
    axis: Unit<Vector3<f64>>,
    range: [f64; 2],
) -> Joint {
    let limit = Limit {
        lower: range[0],
        upper: range[1],
        effort: 50.0,
        velocity: 2.0,
        source: LimitSource::Observed,
        swept: None,
        closed: None,
    };
    let evidence = JointEvidence {
        covariance: SMatrix::identity() * 1e-8,
        state1_from_state0: Pose::identity(),
        inliers: 900,
        tried: 1000,
        residual_rms_m: 0.0012,
        position_std: Vec::new(),
        pitch_std_m_per_rad: 0.0,
        dispersion: 1.0,
        type_scores: [(JointFamily::Prismatic, 120.0), (JointFamily::Revolute, 10.0)].into_iter().collect(),
        parents: BTreeMap::new(),
        axis_alone: None,
        cautions: vec![],
        not_observable: Vec::new(),
    };
    Joint {
        name: name.into(),
        kind,
        parent: 0,
        child,
        parent_from_joint,
        axis,
        limit,
        dynamics: JointDynamics::default(),
        evidence,
    }
}
