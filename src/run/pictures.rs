//! Pictures of a run for the report: photos beside the twin, parts with axes, kept pixels.

use rayon::prelude::*;

use super::differences::{compare, differ, draw};
use capture::{Capture, RgbdFrame};
use export::{
    Look, PhotoAndTwin, Picture, PictureKind, RecordedCamera, ReportPictures, Tally, Window, axis_arrows,
    cutout_png, part_color,
};
use model::ArticulatedModel;
use surface::{Difference, Paint, Rendered, TriangleMesh};

/// Number of views shown of each state.
const VIEWS: usize = 2;
/// Colors of the object where the twin has nothing, and of the twin where the camera saw through it.
const LACKS: [u8; 3] = [232, 98, 12];
const SURPLUS: [u8; 3] = [130, 40, 200];

/// All pictures of the report; `looks` in the order of the links.
pub(super) fn pictures(capture: &Capture, model: &ArticulatedModel, looks: &[Look]) -> ReportPictures {
    let mut out = ReportPictures { differences: compare(capture, model, looks), ..ReportPictures::default() };
    let unwelded: Vec<_> = looks.iter().map(Look::unwelded_mesh).collect();
    let seen: Vec<(&TriangleMesh, Paint)> = looks
        .iter()
        .zip(&unwelded)
        .map(|(look, (mesh, uv))| (mesh, Paint::Texture(look.texture_at(uv))))
        .collect();
    let tinted: Vec<(&TriangleMesh, Paint)> =
        model.links.iter().enumerate().map(|(i, l)| (&l.visual, Paint::Tint(part_color(i)))).collect();
    let shown: Vec<(usize, usize, &RgbdFrame)> = capture
        .states
        .iter()
        .enumerate()
        .flat_map(|(state, frames)| {
            best_views(frames).into_iter().enumerate().map(move |(v, f)| (state, v, f))
        })
        .collect();
    let pictures: Vec<_> = shown
        .par_iter()
        .map(|&(state, view, frame)| {
            let pair = photo_and_twin(capture, model, state, frame, &seen);
            // Parts are drawn once in each state.
            (pair, (view == 0).then(|| parts_and_kept(model, state, frame, &tinted)))
        })
        .collect();
    for (pair, of_state) in pictures {
        out.states.push(pair);
        if let Some([parts, kept]) = of_state {
            out.parts.push(parts);
            out.kept.push(kept);
        }
    }
    out
}

/// A view's tinted parts with joint axes, and its photo with pale surroundings.
fn parts_and_kept(
    model: &ArticulatedModel,
    state: usize,
    frame: &RgbdFrame,
    tinted: &[(&TriangleMesh, Paint)],
) -> [Picture; 2] {
    let drawn = draw(model, state, frame, tinted);
    let mut parts = picture(drawn, PictureKind::Drawing, caption(state, frame, "parts and axes"));
    parts.arrows = axis_arrows(model, state, &frame.intrinsics, &frame.world_from_camera);
    let ends: Vec<[f64; 2]> = parts.arrows.iter().flat_map(|a| [a.from, a.to]).collect();
    let kept = photo(frame, true, caption(state, frame, "kept as the object"));
    [parts.cropped_to(&window(frame, &ends)), kept]
}

fn caption(state: usize, frame: &RgbdFrame, what: &str) -> String {
    format!("state {state}, {what}, view {}", frame.id)
}

/// A view of a state beside the twin with its looks.
fn photo_and_twin(
    capture: &Capture,
    model: &ArticulatedModel,
    state: usize,
    frame: &RgbdFrame,
    seen: &[(&TriangleMesh, Paint)],
) -> PhotoAndTwin {
    let caption = |what: &str| caption(state, frame, what);
    // Cropped alike, so photo and twin can be compared pixel by pixel.
    let window = window(frame, &[]);
    let rendered = draw(model, state, frame, seen);
    let difference = frame.mask.is_some().then(|| {
        let found = differ(capture, state, frame, &rendered);
        marked(frame, &found, &caption("difference")).cropped_to(&window)
    });
    let mut twin = picture(rendered, PictureKind::Photo, caption("twin"));
    let psnr_db = psnr_db(frame, &twin.rgb);
    if let Some(db) = psnr_db {
        twin.caption = format!("{}, {db:.1} dB", twin.caption);
    }
    let recorded = photo(frame, false, caption("photo")).cropped_to(&window);
    let cutout = frame.mask.is_some().then(|| {
        let k = frame.intrinsics;
        (
            cutout_png(&frame.rgb, k.width, k.height, |i| frame.is_object(i)),
            RecordedCamera::new(k, &frame.world_from_camera),
        )
    });
    PhotoAndTwin {
        state,
        view: frame.id.clone(),
        psnr_db,
        photo: recorded,
        twin: twin.cropped_to(&window),
        difference,
        cutout,
    }
}

/// Path in the run folder of the picture of the object as a view saw it.
pub(super) fn photo_path(pair: &PhotoAndTwin) -> String {
    let mut view = String::new();
    for c in pair.view.chars() {
        view.push(if c.is_ascii_alphanumeric() || c == '_' || c == '-' { c } else { '_' });
    }
    format!("preview/photo_state{}_{view}.png", pair.state)
}

/// Peak signal-to-noise ratio, dB, of a rendered picture relative to the photo over the object's pixels,
/// including background of the picture there; `None` if there is no mask.
fn psnr_db(frame: &RgbdFrame, rgb: &[u8]) -> Option<f64> {
    // Without a mask the background would count as an error of the twin.
    frame.mask.as_ref()?;
    let mut sum = 0.0;
    let mut count = 0;
    for (i, p) in frame.rgb.iter().enumerate().filter(|(i, _)| frame.is_object(*i)) {
        let channels = p.iter().zip(&rgb[3 * i..]);
        sum += channels.map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum::<f64>();
        count += 1;
    }
    // The floor keeps the ratio finite where both are the same.
    (count > 0).then(|| 10.0 * (255.0 * 255.0 / (sum / f64::from(3 * count)).max(1e-9)).log10())
}

/// The window of a frame around the object and some points, pixels; points outside the frame do not count.
fn window(frame: &RgbdFrame, points: &[[f64; 2]]) -> Window {
    let width = frame.intrinsics.width;
    let height = frame.intrinsics.height;
    let mut shown: Vec<bool> =
        (0..width * height).map(|i| frame.mask.is_some() && frame.is_object(i)).collect();
    for [u, v] in points {
        if *u >= 0.0 && *v >= 0.0 && *u < width as f64 && *v < height as f64 {
            shown[*v as usize * width + *u as usize] = true;
        }
    }
    Window::around_marks(&[&shown], width, height)
}

/// The frames that show most of the object, no two of them neighbors in time.
fn best_views(frames: &[RgbdFrame]) -> Vec<&RgbdFrame> {
    let size =
        |f: &RgbdFrame| f.depth_m.iter().enumerate().filter(|(i, d)| **d > 0.0 && f.is_object(*i)).count();
    let mut order: Vec<(usize, usize)> = frames.iter().enumerate().map(|(i, f)| (size(f), i)).collect();
    order.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
    // Neighbors in time show the same side.
    let apart = frames.len() / 6;
    let mut chosen: Vec<usize> = Vec::new();
    for (_, i) in order {
        if chosen.len() < VIEWS && chosen.iter().all(|c| c.abs_diff(i) > apart) {
            chosen.push(i);
        }
    }
    chosen.into_iter().map(|i| &frames[i]).collect()
}

fn photo(frame: &RgbdFrame, only_object: bool, caption: String) -> Picture {
    let mut rgb = Vec::with_capacity(3 * frame.rgb.len());
    for (i, color) in frame.rgb.iter().enumerate() {
        let is_pale = only_object && !frame.is_object(i);
        rgb.extend(if is_pale { color.map(|x| 200 + x / 8) } else { *color });
    }
    Picture {
        width: frame.intrinsics.width,
        height: frame.intrinsics.height,
        rgb,
        caption,
        ..Picture::default()
    }
}

fn picture(drawn: Rendered, kind: PictureKind, caption: String) -> Picture {
    let Rendered { intrinsics, rgb, .. } = drawn;
    let width = intrinsics.width;
    let height = intrinsics.height;
    Picture { width, height, rgb: rgb.into_iter().flatten().collect(), kind, caption, ..Picture::default() }
}

/// The photo in pale gray, with colors where the twin differs from the reading.
fn marked(frame: &RgbdFrame, found: &[Difference], caption: &str) -> Picture {
    let mut tally = Tally::default();
    found.iter().for_each(|d| tally.count_reading(*d));
    let caption = format!("{caption}, {:.1} % of what was read", 100.0 * tally.unexplained_share());
    let mut marked = photo(frame, false, caption);
    for (pixel, difference) in marked.rgb.chunks_exact_mut(3).zip(found) {
        let gray = (pixel.iter().map(|c| usize::from(*c)).sum::<usize>() / 3) as u8;
        pixel.copy_from_slice(&match difference {
            Difference::Unread => [215 + gray / 8; 3],
            Difference::Same => [120 + gray / 2; 3],
            Difference::Lacks => LACKS,
            Difference::Surplus => SURPLUS,
        });
    }
    marked
}
