//! The twin held against every view that it was made of. See docs/method.md 11.4.

use rayon::prelude::*;

use capture::{Capture, RgbdFrame};
use export::{Look, StateDifference, Tally};
use model::ArticulatedModel;
use surface::{Difference, Paint, RenderItem, Rendered, TriangleMesh, differences, render};

/// How the twin differs from what the cameras saw, of every state whose object pixels are known.
#[must_use]
pub fn compare(capture: &Capture, model: &ArticulatedModel, looks: &[Look]) -> Vec<StateDifference> {
    let shapes: Vec<(&TriangleMesh, Paint)> = looks.iter().map(|l| (&l.mesh, Paint::Vertices)).collect();
    let of_state = |(state, frames): (usize, &Vec<RgbdFrame>)| {
        let of_view = |frame: &RgbdFrame| {
            frame.mask.as_ref()?;
            let twin = draw(model, state, frame, &shapes);
            let mut view = Tally::default();
            let mut links = vec![Tally::default(); model.links.len()];
            for (difference, item) in differ(capture, state, frame, &twin).into_iter().zip(&twin.item) {
                view.count_reading(difference);
                if let Some(tally) = item.and_then(|i| links.get_mut(usize::from(i))) {
                    tally.count_reading(difference);
                }
            }
            Some(((frame.id.clone(), view), links))
        };
        let (views, of_links): (Vec<_>, Vec<_>) = frames.par_iter().filter_map(of_view).unzip();
        let mut links = vec![Tally::default(); model.links.len()];
        for of_view in of_links {
            links.iter_mut().zip(&of_view).for_each(|(all, own)| all.add_tally(own));
        }
        let links: Vec<_> = model.links.iter().map(|l| l.name.clone()).zip(links).collect();
        (!views.is_empty()).then(|| StateDifference::new(state, &views, &links))
    };
    capture.states.iter().enumerate().filter_map(of_state).collect()
}

/// The links in a state as a view saw them; tinted ones are shaded.
pub(super) fn draw(
    model: &ArticulatedModel,
    state: usize,
    frame: &RgbdFrame,
    painted: &[(&TriangleMesh, Paint)],
) -> Rendered {
    let positions = &model.states[state];
    let items: Vec<RenderItem> = painted
        .iter()
        .enumerate()
        .map(|(i, &(mesh, paint))| RenderItem {
            mesh,
            world_from_mesh: model.world_from_link(i, positions),
            paint,
        })
        .collect();
    let is_tinted = items.iter().any(|i| matches!(i.paint, Paint::Tint(_)));
    render(&items, &frame.intrinsics, &frame.world_from_camera, is_tinted)
}

/// What a frame of a state says of the twin as its camera would see it.
pub(super) fn differ(capture: &Capture, state: usize, frame: &RgbdFrame, twin: &Rendered) -> Vec<Difference> {
    // What two frames see of one surface lies so far apart, whatever the twin is: noise and errors of poses
    // and depth that are left.
    let found = capture.poses.states.get(state).and_then(Option::as_ref);
    let shared_m = found.map_or(0.0, |f| f.residual_m[usize::from(f.used)]);
    // docs/method.md (11.3).
    differences(frame, twin, |pixel| {
        (frame.sigma_m(pixel, &capture.noise).powi(2) + shared_m * shared_m).sqrt()
    })
}
