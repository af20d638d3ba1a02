//! Objects with known truth, as models and as truth folders.

#![allow(dead_code, reason = "every test uses some of these")]

use std::{collections::BTreeMap, fmt::Write as _, fs, path::Path};

use export::ExportConfig;
use geometry::Pose;
use io::{Place, ResultKind, RunDir, read_mesh};
use model::{
    ArticulatedModel, Inertial, Joint, JointDynamics, JointEvidence, JointKind, Limit, LimitSource, Link,
    ModelConfig, MovingPart, TypeScores, build_model, validate,
};
use nalgebra::{Matrix3, Point3, SMatrix, Unit, UnitQuaternion, Vector3};
use surface::TriangleMesh;

/// Axis-aligned box with outward triangles, meters; every side is cut into `cells * cells` squares.
pub fn box_mesh(lower: [f64; 3], upper: [f64; 3], color: [u8; 3], cells: u32) -> TriangleMesh {
    let (lower, side) = (Vector3::from(lower), Vector3::from(upper) - Vector3::from(lower));
    let mut mesh = TriangleMesh::default();
    for axis in 0..3 {
        for top in [0.0, 1.0] {
            let first = mesh.vertices.len() as u32;
            for i in 0..=cells {
                for j in 0..=cells {
                    let mut unit = Vector3::zeros();
                    (unit[axis], unit[(axis + 1) % 3], unit[(axis + 2) % 3]) =
                        (top, f64::from(i) / f64::from(cells), f64::from(j) / f64::from(cells));
                    mesh.vertices.push(Point3::from(lower + side.component_mul(&unit)).cast());
                }
            }
            let at = |i: u32, j: u32| first + i * (cells + 1) + j;
            for (i, j) in (0..cells).flat_map(|i| (0..cells).map(move |j| (i, j))) {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                mesh.triangles.extend(if top > 0.5 {
                    [[a, b, c], [a, c, d]]
                } else {
                    [[a, c, b], [a, d, c]]
                });
            }
        }
    }
    mesh.colors = vec![color; mesh.vertices.len()];
    mesh
}

/// A link with a box's mass properties.
pub fn link(name: &str, visual: TriangleMesh, mass_kg: f64) -> Link {
    let (lower, upper) = visual.bounds().expect("a mesh");
    let side = (upper - lower).cast::<f64>();
    let moment = |a: f64, b: f64| mass_kg / 12.0 * (a * a + b * b);
    let inertia = Matrix3::from_diagonal(&Vector3::new(
        moment(side.y, side.z),
        moment(side.x, side.z),
        moment(side.x, side.y),
    ));
    let inertial = Inertial {
        mass_kg,
        center_of_mass: nalgebra::center(&lower, &upper).cast(),
        inertia,
        assumption: "solid box".into(),
        mass_range_kg: [mass_kg; 2],
    };
    Link {
        name: name.into(),
        visual,
        assumed_m2: 0.0,
        assumed: TriangleMesh::default(),
        collision: vec![],
        inertial,
        grasps: vec![],
    }
}

/// A joint with evidence of no meaning.
pub fn joint(
    name: &str,
    kind: JointKind,
    parent: usize,
    child: usize,
    parent_from_joint: Pose,
    axis: [f64; 3],
    range: [f64; 2],
) -> Joint {
    let evidence = JointEvidence {
        covariance: SMatrix::identity() * 1e-8,
        state1_from_state0: Pose::identity(),
        inliers: 900,
        tried: 1000,
        residual_rms_m: 0.001,
        position_std: Vec::new(),
        pitch_std_m_per_rad: 0.0,
        dispersion: 1.0,
        type_scores: TypeScores::default(),
        parents: BTreeMap::new(),
        axis_alone: None,
        cautions: vec![],
        not_observable: Vec::new(),
    };
    let limit = Limit {
        lower: range[0],
        upper: range[1],
        effort: 20.0,
        velocity: 2.0,
        source: LimitSource::Observed,
        swept: None,
        closed: None,
    };
    Joint {
        name: name.into(),
        kind,
        parent,
        child,
        parent_from_joint,
        axis: Unit::new_normalize(axis.into()),
        limit,
        dynamics: JointDynamics::default(),
        evidence,
    }
}

/// A desk with a chain of two turning arms and a drawer: joint frames turned and off the world's origin.
pub fn desk() -> ArticulatedModel {
    let turned = |xyz: [f64; 3], rpy: [f64; 3]| {
        Pose::from_parts(Vector3::from(xyz).into(), UnitQuaternion::from_euler_angles(rpy[0], rpy[1], rpy[2]))
    };
    ArticulatedModel {
        name: "desk".into(),
        links: vec![
            link("body", box_mesh([-0.3, -0.5, 0.0], [0.3, 0.5, 0.5], [120, 110, 100], 4), 12.0),
            link("arm", box_mesh([-0.03, -0.03, 0.0], [0.03, 0.03, 0.4], [200, 70, 50], 4), 0.8),
            link("head", box_mesh([0.0, -0.06, -0.04], [0.2, 0.06, 0.04], [230, 190, 60], 4), 0.4),
            link("drawer", box_mesh([-0.15, -0.08, 0.02], [0.15, 0.08, 0.3], [60, 100, 190], 4), 2.0),
        ],
        joints: vec![
            joint(
                "arm_joint",
                JointKind::Revolute,
                0,
                1,
                turned([-0.2, 0.3, 0.5], [0.1, -0.2, 0.3]),
                [0.0, 1.0, 0.0],
                [-0.5, 1.1],
            ),
            joint(
                "head_joint",
                JointKind::Revolute,
                1,
                2,
                turned([0.0, 0.0, 0.4], [0.2, 0.1, -0.4]),
                [0.6, 0.0, 0.8],
                [-1.0, 1.2],
            ),
            joint(
                "drawer_joint",
                JointKind::Prismatic,
                0,
                3,
                turned([0.3, 0.0, 0.25], [0.0, std::f64::consts::FRAC_PI_2, 0.0]),
                [0.0, 0.0, 1.0],
                [0.0, 0.25],
            ),
        ],
        states: vec![vec![0.1, -0.4, 0.02], vec![0.8, 0.5, 0.2]],
    }
}

/// A model made of the true meshes of the small drawer in `bags/`, with its true joint.
pub fn true_drawer() -> ArticulatedModel {
    let truth = Path::new(env!("CARGO_MANIFEST_DIR")).join("bags/drawer/truth/state0");
    let mesh = |part: usize| read_mesh(&truth.join(format!("part_{part}.ply"))).expect("a true mesh");
    // The drawer slides along x; its frame is turned so that this is the joint's z axis.
    let world_from_joint = Pose::from_parts(
        Vector3::new(0.1, -0.2, 0.3).into(),
        UnitQuaternion::from_euler_angles(0.0, std::f64::consts::FRAC_PI_2, 0.0),
    );
    let mut model = ArticulatedModel {
        name: "drawer".into(),
        links: vec![link("carcass", mesh(0), 5.0), link("drawer", mesh(1), 1.0)],
        joints: vec![joint(
            "drawer_joint",
            JointKind::Prismatic,
            0,
            1,
            world_from_joint,
            [0.0, 0.0, 1.0],
            [0.03, 0.19],
        )],
        states: vec![vec![0.03], vec![0.19]],
    };
    let world_from_drawer = model.world_from_link(1, &model.states[0]);
    model.links[1].visual = mesh(1).transformed(&world_from_drawer.inverse());
    model
}

/// Boxes in one mesh: lower and upper corners, meters.
fn boards(boards: &[[[f64; 3]; 2]], color: [u8; 3]) -> TriangleMesh {
    let mut all = TriangleMesh::default();
    for [lower, upper] in boards {
        let mesh = box_mesh(*lower, *upper, color, 2);
        let first = all.vertices.len() as u32;
        all.vertices.extend(&mesh.vertices);
        all.triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| i + first)));
        all.colors.extend(&mesh.colors);
    }
    all
}

/// A part as reconstruction gives it: a surface in the world and how it moves.
fn part(kind: JointKind, axis: [f64; 3], point: [f64; 3], motion: f64, surface: TriangleMesh) -> MovingPart {
    let evidence = joint("unused", kind, 0, 1, Pose::identity(), axis, [0.0, 1.0]).evidence;
    MovingPart {
        parent: 0,
        kind,
        axis: Unit::new_normalize(axis.into()),
        point: point.into(),
        positions: vec![motion],
        evidence,
        surface,
        field: None,
    }
}

/// A chest of five boards with a drawer of five that stands 2 cm open, built as reconstruction builds its
/// models. The drawer's front is wider than the opening: it overlaps the boards behind it by 2 mm, as noisy
/// surfaces do.
pub fn chest() -> ArticulatedModel {
    chest_with(&ModelConfig::default())
}

/// The chest under other assumptions.
pub fn chest_with(config: &ModelConfig) -> ArticulatedModel {
    let carcass = boards(
        &[
            [[-0.3, -0.22, 0.0], [0.1, -0.2, 0.3]],
            [[-0.3, 0.2, 0.0], [0.1, 0.22, 0.3]],
            [[-0.3, -0.2, 0.0], [0.1, 0.2, 0.02]],
            [[-0.3, -0.2, 0.28], [0.1, 0.2, 0.3]],
            [[-0.3, -0.2, 0.02], [-0.28, 0.2, 0.28]],
        ],
        [150, 120, 90],
    );
    let drawer = boards(
        &[
            [[0.098, -0.21, 0.03], [0.12, 0.21, 0.27]],
            [[-0.25, -0.19, 0.05], [0.098, -0.18, 0.2]],
            [[-0.25, 0.18, 0.05], [0.098, 0.19, 0.2]],
            [[-0.25, -0.18, 0.05], [0.098, 0.18, 0.06]],
            [[-0.26, -0.19, 0.05], [-0.25, 0.19, 0.2]],
        ],
        [200, 170, 120],
    );
    let drawer = part(JointKind::Prismatic, [1.0, 0.0, 0.0], [0.0, 0.0, 0.1], 0.2, drawer);
    build_model("chest", carcass, vec![drawer], config)
}

/// A foot with a board on a level hinge at its edge, seen at two angles that nothing but friction holds.
pub fn lamp() -> ArticulatedModel {
    let foot = boards(&[[[-0.1, -0.1, 0.0], [0.1, 0.1, 0.03]]], [90, 90, 100]);
    let arm = boards(&[[[0.0, -0.05, 0.045], [0.25, 0.05, 0.06]]], [220, 200, 80]);
    let arm = part(JointKind::Revolute, [0.0, -1.0, 0.0], [-0.02, 0.0, 0.06], 1.0, arm);
    build_model("lamp", foot, vec![arm], &ModelConfig::default())
}

/// A box with a plate on it that turns and rises by 12 mm a radian.
pub fn jar() -> ArticulatedModel {
    let body = boards(
        &[
            [[-0.04, -0.04, 0.0], [0.04, 0.04, 0.008]],
            [[-0.04, -0.04, 0.008], [-0.032, 0.04, 0.1]],
            [[0.032, -0.04, 0.008], [0.04, 0.04, 0.1]],
            [[-0.032, -0.04, 0.008], [0.032, -0.032, 0.1]],
            [[-0.032, 0.032, 0.008], [0.032, 0.04, 0.1]],
        ],
        [150, 170, 190],
    );
    let lid = boards(&[[[-0.045, -0.045, 0.104], [0.045, 0.045, 0.12]]], [200, 60, 50]);
    let kind = JointKind::Screw { pitch_m_per_rad: 0.012 };
    let lid = part(kind, [0.0, 0.0, 1.0], [0.0, 0.0, 0.11], 2.4, lid);
    build_model("jar", body, vec![lid], &ModelConfig::default())
}

/// Writes a model as a run: URDF, meshes and the states of the report.
pub fn write_run(model: &ArticulatedModel, out: &Path) -> std::path::PathBuf {
    write_run_as(model, &ExportConfig::default(), out)
}

/// The same, with the files written as asked for.
pub fn write_run_as(model: &ArticulatedModel, config: &ExportConfig, out: &Path) -> std::path::PathBuf {
    assert_eq!(validate(model), []);
    let run =
        RunDir::open(&Place::named(out, &model.name), ResultKind::Reconstruct).expect("an output folder");
    for file in export::urdf_package(model, config) {
        run.put(&file.path, &file.bytes).expect("a written file");
    }
    let state = |q: &Vec<f64>| {
        let mut joints = BTreeMap::new();
        for (joint, &q) in model.joints.iter().zip(q) {
            joints.insert(joint.name.clone(), q);
            // As the report has it.
            joints.extend(joint.kind.thread_m_per_rad().map(|pitch| (joint.advance_name(), pitch * q)));
        }
        serde_json::json!({ "joints": joints })
    };
    let report = serde_json::json!({ "states": model.states.iter().map(state).collect::<Vec<_>>() });
    run.put("report.json", report.to_string().as_bytes()).expect("a written file");
    run.commit().expect("a finished folder").folder
}

/// Writes a model as ground truth, without seen points.
pub fn write_truth(model: &ArticulatedModel, folder: &Path) {
    let mut parts =
        vec![serde_json::json!({ "index": 0, "name": model.links[0].name, "parent": -1, "type": "fixed" })];
    for joint in &model.joints {
        let [q0, q1] = [&model.states[0], &model.states[1]];
        let motion =
            model.world_from_link(joint.child, q1) * model.world_from_link(joint.child, q0).inverse();
        let world_from_joint = model.world_from_link(joint.parent, q0) * joint.parent_from_joint;
        let rows: Vec<Vec<f64>> =
            motion.to_homogeneous().row_iter().map(|r| r.iter().copied().collect()).collect();
        parts.push(serde_json::json!({
            "index": joint.child, "name": model.links[joint.child].name, "parent": joint.parent,
            "type": if joint.kind == JointKind::Revolute { "revolute" } else { "prismatic" },
            "axis": (world_from_joint.rotation * joint.axis.into_inner()).as_slice(),
            "origin": world_from_joint.translation.vector.as_slice(), "state1_from_state0": rows,
        }));
    }
    fs::create_dir_all(folder).expect("a folder");
    fs::write(folder.join("truth.json"), serde_json::json!({ "parts": parts }).to_string())
        .expect("a written file");
    for (s, positions) in model.states.iter().enumerate() {
        let state = folder.join(format!("truth/state{s}"));
        fs::create_dir_all(&state).expect("a folder");
        let placed: Vec<TriangleMesh> = (0..model.links.len())
            .map(|l| model.links[l].visual.transformed(&model.world_from_link(l, positions)))
            .collect();
        for (l, mesh) in placed.iter().enumerate() {
            fs::write(state.join(format!("part_{l}.ply")), ply(mesh)).expect("a written file");
        }
        let whole = surface::merged_mesh(&placed.iter().collect::<Vec<_>>());
        fs::write(state.join("whole.ply"), ply(&whole)).expect("a written file");
    }
}

fn ply(mesh: &TriangleMesh) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.vertices.len(),
        mesh.triangles.len()
    );
    for p in &mesh.vertices {
        writeln!(text, "{} {} {}", p.x, p.y, p.z).expect("text");
    }
    for [a, b, c] in &mesh.triangles {
        writeln!(text, "3 {a} {b} {c}").expect("text");
    }
    text
}
