//! Small pictures of the twin: a thumbnail and a turntable on which the joints move.

use gif::{DisposalMethod, Encoder, EncodingError, Frame, Repeat};
use image::{ExtendedColorType, ImageEncoder as _, codecs::png::PngEncoder};
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use super::drawn::{Drawn, link_visuals};
use geometry::{Intrinsics, bounding_box, box_corners};
use model::ArticulatedModel;
use surface::TriangleMesh;
use surface::{Paint, RenderItem, render, simplify};

/// Sides of the thumbnail, pixels.
const THUMBNAIL_PX: [usize; 2] = [480, 360];
/// Sides of the turntable, pixels.
const TURNTABLE_PX: [usize; 2] = [320, 240];
/// Number of frames in a full turn.
const FRAMES: usize = 24;
/// Time between two frames, hundredths of a second.
const FRAME_DELAY: u16 = 11;
/// The fastest setting of the encoder, which samples fewer pixels for a palette.
const SPEED: i32 = 30;
/// Distance of the camera in radii of the object. chosen: for the eye
const DISTANCE: f64 = 3.0;
/// Height of the camera above the object's center, in radii. chosen: for the eye
const ELEVATION: f64 = 1.3;
/// Focal length in picture widths. chosen: for the eye
const FOCAL: f64 = 1.2;
/// Direction of the thumbnail's camera, radians about z from x. chosen: for the eye
const AZIMUTH_RAD: f64 = -0.9;
/// Largest number of triangles of a mesh in the turntable.
const TURNTABLE_FACES: usize = 8000;

/// A PNG of the model in its last observed state; world z is up.
pub(crate) fn thumbnail_png(model: &ArticulatedModel) -> Vec<u8> {
    let meshes: Vec<(usize, &TriangleMesh)> = model_meshes(model).collect();
    let none = Vec::new();
    let rgb = view_pixels(model, &meshes, model.states.last().unwrap_or(&none), AZIMUTH_RAD, THUMBNAIL_PX);
    let mut bytes = Vec::new();
    let [w, h] = THUMBNAIL_PX.map(|x| x as u32);
    // Writing to memory fails only if size and pixels disagree.
    PngEncoder::new(&mut bytes).write_image(rgb.as_flattened(), w, h, ExtendedColorType::Rgb8).ok();
    bytes
}

/// An animated GIF: one turn around the object while the joints go from the first observed state to the last
/// and back.
pub(crate) fn turntable_gif(model: &ArticulatedModel, drawn: &[Drawn]) -> Vec<u8> {
    // From the exported meshes, which have few triangles already.
    let small: Vec<(usize, TriangleMesh)> =
        drawn.par_iter().map(|d| (d.link, simplify(&d.look.mesh, TURNTABLE_FACES, f64::INFINITY))).collect();
    let meshes: Vec<(usize, &TriangleMesh)> = small.iter().map(|(link, mesh)| (*link, mesh)).collect();
    let (Some(first), Some(last)) = (model.states.first(), model.states.last()) else { return Vec::new() };
    let frames: Vec<Frame> =
        (0..FRAMES).into_par_iter().map(|k| turntable_frame(model, &meshes, [first, last], k)).collect();
    // Writing to memory fails only if size and pixels disagree.
    gif_of_frames(&frames).unwrap_or_default()
}

/// A compressed frame of the turntable; the joints go from the first positions to the last and back.
fn turntable_frame(
    model: &ArticulatedModel,
    meshes: &[(usize, &TriangleMesh)],
    [first, last]: [&[f64]; 2],
    number: usize,
) -> Frame<'static> {
    let turn = std::f64::consts::TAU * number as f64 / FRAMES as f64;
    // Once there and back in a full turn, slow at both ends, so the loop has no jump.
    let share = 0.5 - 0.5 * turn.cos();
    let positions: Vec<f64> = first.iter().zip(last).map(|(a, b)| a + (b - a) * share).collect();
    let rgb = view_pixels(model, meshes, &positions, AZIMUTH_RAD + turn, TURNTABLE_PX);
    let [w, h] = TURNTABLE_PX.map(|x| x as u16);
    let mut frame = Frame::from_rgb_speed(w, h, rgb.as_flattened(), SPEED);
    frame.delay = FRAME_DELAY;
    frame.dispose = DisposalMethod::Background;
    frame.make_lzw_pre_encoded();
    frame
}

/// The bytes of an animated GIF that repeats forever.
fn gif_of_frames(frames: &[Frame]) -> Result<Vec<u8>, EncodingError> {
    let [w, h] = TURNTABLE_PX.map(|x| x as u16);
    let mut encoder = Encoder::new(Vec::new(), w, h, &[])?;
    encoder.set_repeat(Repeat::Infinite)?;
    frames.iter().try_for_each(|frame| encoder.write_lzw_pre_encoded_frame(frame))?;
    encoder.into_inner()
}

/// The visual meshes of a model, each with its link.
fn model_meshes(model: &ArticulatedModel) -> impl Iterator<Item = (usize, &TriangleMesh)> {
    model.links.iter().enumerate().flat_map(|(link, own)| link_visuals(own).map(move |v| (link, v.mesh)))
}

/// The pixels seen by a camera at an azimuth, aimed at the center of the model.
fn view_pixels(
    model: &ArticulatedModel,
    meshes: &[(usize, &TriangleMesh)],
    positions: &[f64],
    azimuth_rad: f64,
    [width, height]: [usize; 2],
) -> Vec<[u8; 3]> {
    // A sphere around all boxes in all states, so the camera stays still while the joints move.
    let mut corners: Vec<Point3<f64>> = Vec::new();
    for (link, mesh) in meshes {
        let Some((lo, hi)) = mesh.bounds() else { continue };
        for state in &model.states {
            let pose = model.world_from_link(*link, state);
            corners.extend(box_corners(&lo.cast(), &hi.cast()).map(|p| pose * p));
        }
    }
    let Some((lo, hi)) = bounding_box(corners.iter().copied()) else { return vec![[255; 3]; width * height] };
    let middle = nalgebra::center(&lo, &hi);
    let radius = 0.5 * (hi - lo).norm();
    let (s, c) = azimuth_rad.sin_cos();
    let eye = middle + Vector3::new(DISTANCE * c, DISTANCE * s, ELEVATION) * radius;
    // Optical frames look along z with y down.
    let world_from_camera = Isometry3::face_towards(&eye, &middle, &-Vector3::z());
    let focal = FOCAL * width as f64;
    let intrinsics = Intrinsics {
        width,
        height,
        fx: focal,
        fy: focal,
        cx: 0.5 * (width as f64 - 1.0),
        cy: 0.5 * (height as f64 - 1.0),
    };
    let mut items = Vec::with_capacity(meshes.len());
    for &(link, mesh) in meshes {
        let world_from_mesh = model.world_from_link(link, positions);
        items.push(RenderItem { mesh, world_from_mesh, paint: Paint::Vertices });
    }
    render(&items, &intrinsics, &world_from_camera, true).rgb
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drawn::{drawn_meshes, plain_looks};
    use model::example::cabinet;

    #[test]
    fn pictures_show_the_object_and_the_turntable_turns() {
        let png = image::load_from_memory(&thumbnail_png(&cabinet())).unwrap().to_rgb8();
        let shown = png.pixels().filter(|p| p.0 != [255; 3]).count() as f64 / png.pixels().len() as f64;
        assert!((0.05..0.8).contains(&shown), "{shown}");
        let model = cabinet();
        let looks = plain_looks(&cabinet());
        let bytes = turntable_gif(&model, &drawn_meshes(&model, &looks));
        let gif = image::codecs::gif::GifDecoder::new(std::io::Cursor::new(bytes)).unwrap();
        let frames = image::AnimationDecoder::into_frames(gif).collect_frames().unwrap();
        assert_eq!(frames.len(), FRAMES);
        assert!(frames[0].buffer() != frames[6].buffer());
    }
}
