//! Pictures of a run for the report: photos beside the twin, parts with axes, what was kept.

use crate::{
    capture::{Capture, RgbdFrame},
    export::{PhotoAndTwin, Picture, PictureKind, ReportPictures, axis_arrows, part_color},
    model::{ArticulatedModel, Link},
    surface::{RenderItem, render},
};

/// Views shown of each state.
const VIEWS: usize = 2;

/// All pictures of the report.
pub(super) fn pictures(capture: &Capture, model: &ArticulatedModel) -> ReportPictures {
    let mut out = ReportPictures::default();
    for (state, frames) in capture.states.iter().enumerate() {
        for (view, frame) in best_views(frames).into_iter().enumerate() {
            let caption = |what: &str| format!("state {state}, {what}, view {}", frame.id);
            let twin = draw(model, state, frame, false, caption("twin"));
            out.states.push(PhotoAndTwin { photo: photo(frame, false, caption("photo")), twin });
            if view == 0 {
                let mut parts = draw(model, state, frame, true, caption("parts and axes"));
                parts.arrows = axis_arrows(model, state, &frame.intrinsics, &frame.world_from_camera);
                out.parts.push(parts);
                out.kept.push(photo(frame, true, caption("kept as the object")));
            }
        }
    }
    out
}

/// The frames that show most of the object, no two of them neighbors in time.
fn best_views(frames: &[RgbdFrame]) -> Vec<&RgbdFrame> {
    let size = |f: &RgbdFrame| f.depth_m.iter().enumerate().filter(|(i, d)| **d > 0.0 && f.is_object(*i)).count();
    let mut order: Vec<(usize, usize)> = frames.iter().enumerate().map(|(i, f)| (size(f), i)).collect();
    order.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
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
    let shade = |(i, c): (usize, &[u8; 3])| if only_object && !frame.is_object(i) { c.map(|x| 200 + x / 8) } else { *c };
    let rgb = frame.rgb.iter().enumerate().flat_map(shade).collect();
    Picture { width: frame.intrinsics.width, height: frame.intrinsics.height, rgb, caption, ..Picture::default() }
}

fn draw<'a>(model: &'a ArticulatedModel, state: usize, frame: &RgbdFrame, tinted: bool, caption: String) -> Picture {
    let positions = &model.states[state];
    let item = |(i, link): (usize, &'a Link)| RenderItem {
        mesh: &link.visual,
        world_from_mesh: model.world_from_link(i, positions),
        tint: tinted.then(|| part_color(i)),
    };
    let items: Vec<RenderItem> = model.links.iter().enumerate().map(item).collect();
    let view = render(&items, &frame.intrinsics, &frame.world_from_camera, tinted);
    let rgb = view.rgb.into_iter().flatten().collect();
    let kind = if tinted { PictureKind::Drawing } else { PictureKind::Photo };
    Picture { width: frame.intrinsics.width, height: frame.intrinsics.height, rgb, kind, caption, ..Picture::default() }
}
