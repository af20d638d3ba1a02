//! Recordings of a camera alone: what keeps it from being tracked, and what keeps the object from being
//! found, is said with the remedy.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

mod common;
#[path = "common/program.rs"]
mod program;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    process::Command,
    sync::OnceLock,
};

use geometry::{Intrinsics, Pose};
use image::{DynamicImage, ImageFormat, Rgb};
use nalgebra::{Isometry3, Matrix4, Point3, Rotation3, Vector3};
use program::{Ended, Message, change_picture, end, rewrite};

const COLOR: &str = "/color/image_raw/compressed";
const DEPTH: &str = "/aligned_depth_to_color/image_raw/compressedDepth";
/// Bytes before the picture of a depth image.
const DEPTH_FRONT: usize = 12;

fn artitwin(arguments: &[&str], paths: &[&Path]) -> Ended {
    end(Command::new(env!("CARGO_BIN_EXE_artitwin")).args(arguments).args(paths))
}

/// A door, filmed five times a second by a camera in a hand; once for all tests.
fn door() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(made)
}

fn made() -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("plain_camera");
    std::fs::remove_dir_all(&folder).ok();
    let options = ["synth", "--seed", "9141", "--family", "cabinet", "--parts", "2", "--rate", "5"];
    let size = ["--width", "320", "--height", "240", "--sensor", "handheld", "--out"];
    let ended = artitwin(&[&options[..], &size].concat(), &[&folder]);
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    folder
}

fn change_color(message: &mut Message, change: impl FnOnce(&mut image::RgbImage)) {
    change_picture(message, 0, ImageFormat::Png, |picture| {
        let mut rgb = picture.to_rgb8();
        change(&mut rgb);
        *picture = DynamicImage::ImageRgb8(rgb);
    });
}

fn change_depth(
    message: &mut Message,
    change: impl FnOnce(&mut image::ImageBuffer<image::Luma<u16>, Vec<u16>>),
) {
    change_picture(message, DEPTH_FRONT, ImageFormat::Png, |picture| {
        let mut depth = picture.to_luma16();
        change(&mut depth);
        *picture = DynamicImage::ImageLuma16(depth);
    });
}

fn darken(message: &mut Message) {
    change_color(message, |rgb| rgb.pixels_mut().for_each(|p| *p = Rgb(p.0.map(|v| v / 120))));
}

/// Stamps of the poses that `track` prints.
fn tracked(ended: &Ended) -> Vec<f64> {
    let line = |l: &str| l.split(' ').next().and_then(|t| t.parse().ok());
    ended.stdout.lines().filter_map(line).collect()
}

#[test]
fn views_that_have_no_place_are_left_out_with_the_reason() {
    let spoilt = [22..27, 34..39, 46..51];
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("door");
    rewrite(&door().join("state0"), &bag, |m| {
        let Some(kind) = spoilt.iter().position(|s| s.contains(&m.ordinal)) else { return true };
        match (kind, m.is(COLOR), m.is(DEPTH)) {
            // A hand on the lens.
            (0, true, _) => change_color(m, |rgb| rgb.fill(3)),
            (0 | 1, _, true) => change_depth(m, |depth| depth.fill(0)),
            // A plain wall, a meter away.
            (2, true, _) => change_color(m, |rgb| rgb.fill(140)),
            (2, _, true) => change_depth(m, |depth| depth.fill(1000)),
            _ => {}
        }
        true
    });
    let ended = artitwin(&["track"], &[&bag]);
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    let said: Vec<&str> = ended.stderr.lines().filter(|l| l.contains("the camera was lost from")).collect();
    let remedies = ["keep the lens free", "hardly a pixel has depth", "keep corners and texture in view"];
    for remedy in remedies {
        let lines: Vec<&&str> = said.iter().filter(|l| l.contains(remedy)).collect();
        assert!(matches!(lines[..], [line] if line.contains("(5 views)")), "`{remedy}`: {said:#?}");
    }
    // A view or two behind a stretch may be lost, too; none in it has a place.
    let all = tracked(&artitwin(&["track"], &[&door().join("state0")]));
    let found = tracked(&ended);
    let is_spoilt = |k: usize| spoilt.iter().any(|s| s.contains(&k));
    assert!((0..all.len()).filter(|k| is_spoilt(*k)).all(|k| !found.contains(&all[k])));
    assert!(found.len() + 15 + 4 >= all.len(), "{} of {}", found.len(), all.len());
}

#[test]
fn a_camera_that_jumps_is_asked_to_move_slower() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("door");
    // One view in four seconds: half a circle in four steps.
    rewrite(&door().join("state0"), &bag, |m| !(m.is(COLOR) || m.is(DEPTH)) || m.ordinal % 20 == 0);
    let ended = artitwin(&["track"], &[&bag]);
    assert!(ended.code == 1 || ended.code == 3, "{}", ended.stderr);
    assert!(ended.stderr.contains("slower"), "{}", ended.stderr);
}

#[test]
fn of_a_dark_room_depth_alone_is_used_and_light_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("door");
    rewrite(&door().join("state0"), &bag, |m| {
        if m.is(COLOR) {
            darken(m);
        }
        true
    });
    let ended = artitwin(&["track"], &[&bag]);
    // Surfaces alone show some of the way.
    assert!(ended.code == 1 || ended.code == 3, "{}", ended.stderr);
    assert!(ended.stderr.contains("too dark; give more light"), "{}", ended.stderr);
}

/// A ball in the true world.
struct Ball {
    at: Point3<f64>,
    radius_m: f64,
}

impl Ball {
    /// Distance along the optical axis at which a pixel shows it.
    fn depth_m(&self, k: &Intrinsics, camera_from_world: &Pose, [u, v]: [u32; 2]) -> Option<f64> {
        let center = (camera_from_world * self.at).coords;
        let ray = k.ray_at(f64::from(u), f64::from(v));
        let (square, along) = (ray.norm_squared(), ray.dot(&center));
        let root = along * along - square * (center.norm_squared() - self.radius_m.powi(2));
        (root > 0.0).then(|| (along - root.sqrt()) / square)
    }

    /// A copy of a state that shows it, too: `cameras` are the true poses of its views.
    fn paint(&self, k: &Intrinsics, cameras: &[Pose], from: &Path, to: &Path) {
        let seen = |view: usize, at: [u32; 2]| self.depth_m(k, &cameras[view].inverse(), at);
        // What hides it is found by depth, which comes before or after color.
        let mut shown = BTreeMap::new();
        rewrite(from, &to.with_extension("depth"), |m| {
            let view = m.ordinal;
            if m.is(DEPTH) {
                change_depth(m, |depth| {
                    for (x, y, pixel) in depth.enumerate_pixels_mut() {
                        let mm = seen(view, [x, y]).map(|d| (1e3 * d).round() as u16);
                        if let Some(mm) = mm.filter(|mm| pixel.0[0] == 0 || *mm < pixel.0[0]) {
                            pixel.0[0] = mm;
                            shown.insert((view, x, y), mm);
                        }
                    }
                });
            }
            true
        });
        rewrite(&to.with_extension("depth"), to, |m| {
            let view = m.ordinal;
            if m.is(COLOR) {
                change_color(m, |rgb| {
                    for (x, y, pixel) in rgb.enumerate_pixels_mut() {
                        if shown.contains_key(&(view, x, y)) {
                            *pixel = Rgb([200, 60, 40]);
                        }
                    }
                });
            }
            true
        });
    }
}

fn pose(rows: &serde_json::Value) -> Pose {
    let m = Matrix4::from_fn(|r, c| rows[r][c].as_f64().unwrap());
    let turn = Rotation3::from_matrix_unchecked(m.fixed_view::<3, 3>(0, 0).into_owned());
    Isometry3::from_parts(m.fixed_view::<3, 1>(0, 3).into_owned().into(), turn.into())
}

#[test]
fn two_things_that_changed_are_asked_about() {
    let folder = tempfile::tempdir().unwrap();
    let truth: serde_json::Value =
        serde_json::from_slice(&std::fs::read(door().join("truth.json")).unwrap()).unwrap();
    let workspace = std::fs::read_to_string(door().join("workspace.txt")).unwrap();
    let b: Vec<f64> = workspace.trim().split(',').map(|x| x.parse().unwrap()).collect();
    let intrinsics = Intrinsics { width: 320, height: 240, fx: 288.6, fy: 288.6, cx: 159.5, cy: 119.5 };
    // On the floor, on one side of the object and then on the other.
    let radius_m = 0.2;
    let bags = [0, 1].map(|state: usize| {
        let views = truth["sensor"]["states"][state]["views"].as_array().unwrap();
        let cameras: Vec<Pose> = views.iter().map(|v| pose(&v["world_from_camera"])).collect();
        let y_m = [b[4] + 0.35, b[1] - 0.35][state];
        let at = Point3::new(0.5 * (b[0] + b[3]), y_m, b[2] + radius_m);
        let bag = folder.path().join(format!("state{state}"));
        Ball { at, radius_m }.paint(&intrinsics, &cameras, &door().join(format!("state{state}")), &bag);
        bag
    });
    let bags = [bags[0].as_path(), bags[1].as_path()];
    let picture = folder.path().join("look.png");
    let ended = artitwin(&["inspect", "--picture", picture.to_str().unwrap()], &bags);
    assert_ne!(ended.code, 0, "{}", ended.stdout);
    let said = format!("{}{}", ended.stdout, ended.stderr);
    assert!(said.contains("changed") && said.contains("--at"), "{said}");
    // The middle of the box that holds the object in all its states.
    let middle = Vector3::new(b[0] + b[3], b[1] + b[4], b[2] + b[5]) * 0.5;
    let at = format!("{:.3},{:.3},{:.3}", middle.x, middle.y, middle.z);
    let ended = artitwin(&["inspect", "--picture", picture.to_str().unwrap(), "--at", &at], &bags);
    assert!(ended.code == 0 || ended.code == 3, "{}", ended.stdout);
    assert!(picture.is_file() && !ended.stdout.contains("--at"), "{}", ended.stdout);
}
