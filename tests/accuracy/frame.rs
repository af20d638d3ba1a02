//! A twin in the world of the truth, where its own frame is off as a whole: the static part of the truth is
//! moved onto the static part of the twin, as in `eval/sensor/in_frame.py`.

use std::path::{Path, PathBuf};

use capture::CaptureConfig;
use evaluate::{RunFiles, Truth, read_truth};
use geometry::Pose;
use nalgebra::{Matrix4, Matrix6, Point3, Rotation3, SymmetricEigen, UnitQuaternion, Vector3, Vector6};
use serde_json::Value;
use surface::MeshDistance;

use super::{measure::json, opened::open, runs::Frame, twin_files::TwinFiles};

/// Distances within which a point counts, in turn, meters.
const REACHES_M: [f64; 4] = [0.06, 0.03, 0.012, 0.006];
/// Steps with each of them.
const STEPS: usize = 15;
/// Mean change of distances, squared, by a unit twist (turn in radii of the points) below which the points
/// slide within the surface; such a twist is not taken. Measured: `eval/sensor/in_frame.py`.
const SLIDES: f64 = 0.12 * 0.12;
/// Every so many of the seen points are used.
const STRIDE: usize = 4;

/// A copy of a twin that stands in the world of the truth.
pub fn placed(twin: &Path, recording: &Path, frame: Frame) -> PathBuf {
    let truth = read_truth(recording).unwrap();
    let start = if frame == Frame::OfTrackedTwin { by_cameras(twin, recording) } else { Pose::identity() };
    let twin_from_truth = align(&RunFiles::read(twin, None).unwrap(), &truth, start);
    let place = twin_from_truth.inverse();
    let (x, (roll, pitch, yaw)) = (place.translation.vector, place.rotation.euler_angles());
    let mut files = TwinFiles::read(twin);
    // A new root, on which the old one is fixed.
    let root = format!(
        "<link name=\"true_world\"/><joint name=\"place\" type=\"fixed\"><parent link=\"true_world\"/>\
         <child link=\"base\"/><origin xyz=\"{} {} {}\" rpy=\"{roll} {pitch} {yaw}\"/></joint>\n</robot>",
        x.x, x.y, x.z
    );
    files.urdf = files.urdf.replace("</robot>", &root);
    let folder = twin.with_file_name("placed");
    files.write(&folder, twin);
    folder
}

/// The motion near `start` that moves the points of the true static part that were seen in state 0 onto the
/// static part of the twin, point to plane.
fn align(twin: &RunFiles, truth: &Truth, start: Pose) -> Pose {
    let surface = twin.surface(&twin.parts[0], 0);
    let distance = MeshDistance::new(&surface).unwrap();
    let base = truth.parts.iter().find(|part| part.joint.is_none()).unwrap().index;
    let seen = truth.seen[0].iter().step_by(STRIDE).filter(|point| point.part == base);
    let points: Vec<Point3<f64>> = seen.map(|point| point.point).collect();
    let mut motion = start;
    for reach_m in REACHES_M {
        for _ in 0..STEPS {
            let mut pairs = Vec::new();
            for point in points.iter().map(|point| motion * point) {
                let closest = distance.closest_point(&point.cast());
                if f64::from(closest.distance_m) < reach_m {
                    let normal = surface.area_normal(closest.triangle as usize).cast::<f64>().normalize();
                    pairs.push((point, normal, normal.dot(&(closest.point.cast::<f64>() - point))));
                }
            }
            assert!(pairs.len() >= 100, "{} points within {reach_m} m", pairs.len());
            motion = step(&pairs) * motion;
        }
    }
    motion
}

/// The motion that brings points nearest to planes: each point with the normal of its plane and the distance
/// to go along it.
fn step(pairs: &[(Point3<f64>, Vector3<f64>, f64)]) -> Pose {
    let count = pairs.len() as f64;
    let middle = pairs.iter().map(|pair| pair.0.coords).sum::<Vector3<f64>>() / count;
    let spread = pairs.iter().map(|pair| (pair.0.coords - middle).norm_squared()).sum::<f64>();
    let radius_m = (spread / count).sqrt();
    let mut information = Matrix6::zeros();
    let mut gradient = Vector6::zeros();
    for (point, normal, gap_m) in pairs {
        let turn = ((point.coords - middle) / radius_m).cross(normal);
        let row = Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z);
        information += row * row.transpose() / count;
        gradient += row * *gap_m / count;
    }
    let eigen = SymmetricEigen::new(information);
    let mut twist = Vector6::zeros();
    for (change, direction) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *change > SLIDES {
            twist += direction * (direction.dot(&gradient) / change);
        }
    }
    let turn = UnitQuaternion::from_scaled_axis(twist.fixed_rows::<3>(0) / radius_m);
    let shift = twist.fixed_rows::<3>(3);
    Pose::from_parts((middle + shift - turn * middle).into(), turn)
}

/// Twin from truth by a camera whose pose both hold: the one of the report's first photo. The recording's own
/// poses are true.
fn by_cameras(twin: &Path, recording: &Path) -> Pose {
    let report = json(&twin.join("report.json"));
    let photo = &report["renderings"][0];
    let twin_from_camera = pose(&photo["camera"]["world_from_camera"]);
    let capture = open(&[recording.to_owned()], &CaptureConfig::default(), 0).unwrap();
    let frames = capture.states.iter().flatten();
    let frame = frames.into_iter().find(|frame| photo["view"] == frame.id.as_str()).unwrap();
    twin_from_camera * frame.world_from_camera.inverse()
}

/// A pose from a row-major 4x4 matrix.
fn pose(rows: &Value) -> Pose {
    let matrix = Matrix4::from_fn(|r, c| rows[r][c].as_f64().unwrap());
    let rotation = Rotation3::from_matrix(&matrix.fixed_view::<3, 3>(0, 0).into_owned());
    let translation: Vector3<f64> = matrix.fixed_view::<3, 1>(0, 3).into_owned();
    Pose::from_parts(translation.into(), UnitQuaternion::from_rotation_matrix(&rotation))
}
