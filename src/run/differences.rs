//! Compares the twin with its views. See docs/method.md 11.4.

use rayon::prelude::*;

use articulate::is_surface_seen_at;
use capture::{Capture, RgbdFrame};
use export::{Look, StateDifference, Tally};
use model::ArticulatedModel;
use surface::{Difference, Paint, RenderItem, Rendered, TriangleMesh, differences, render};

/// Differences between the twin and the views, of every state with known object pixels.
pub fn compare(capture: &Capture, model: &ArticulatedModel, looks: &[Look]) -> Vec<StateDifference> {
    let shapes: Vec<(&TriangleMesh, Paint)> = looks.iter().map(|l| (&l.mesh, Paint::Vertices)).collect();
    let states = 0..capture.states.len();
    states.filter_map(|state| state_difference(capture, model, state, &shapes)).collect()
}

/// How the twin differs from all masked views of a state; `None` if no view has a mask.
fn state_difference(
    capture: &Capture,
    model: &ArticulatedModel,
    state: usize,
    shapes: &[(&TriangleMesh, Paint)],
) -> Option<StateDifference> {
    let masked = capture.states[state].par_iter().filter(|frame| frame.mask.is_some());
    let (views, of_links): (Vec<_>, Vec<_>) =
        masked.map(|frame| view_tallies(capture, model, state, frame, shapes)).unzip();
    let mut links = vec![Tally::default(); model.links.len()];
    for of_view in of_links {
        links.iter_mut().zip(&of_view).for_each(|(all, own)| all.add_tally(own));
    }
    let links: Vec<_> = model.links.iter().map(|l| l.name.clone()).zip(links).collect();
    (!views.is_empty()).then(|| StateDifference::new(state, &views, &links))
}

/// Name of a view, counts of differences in it, and counts by link.
fn view_tallies(
    capture: &Capture,
    model: &ArticulatedModel,
    state: usize,
    frame: &RgbdFrame,
    shapes: &[(&TriangleMesh, Paint)],
) -> ((String, Tally), Vec<Tally>) {
    let twin = draw(model, state, frame, shapes);
    let mut view = Tally::default();
    let mut links = vec![Tally::default(); model.links.len()];
    for (difference, item) in differ(capture, state, frame, &twin).into_iter().zip(&twin.item) {
        view.count_reading(difference);
        if let Some(tally) = item.and_then(|i| links.get_mut(usize::from(i))) {
            tally.count_reading(difference);
        }
    }
    ((frame.id.clone(), view), links)
}

/// The links in a state, rendered as a view saw them; tinted ones are shaded.
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

/// Differences of a frame's pixels from the twin as its camera would see it.
pub(super) fn differ(capture: &Capture, state: usize, frame: &RgbdFrame, twin: &Rendered) -> Vec<Difference> {
    // For any twin, two frames of one surface differ by this much: by noise and by the remaining errors of
    // poses and depth.
    let found = capture.poses.states.get(state).and_then(Option::as_ref);
    let shared_m = found.map_or(0.0, |f| f.residual_m[usize::from(f.used)]);
    // docs/method.md (11.3).
    let mut found = differences(frame, twin, |pixel| {
        (frame.sigma_m(pixel, &capture.noise).powi(2) + shared_m * shared_m).sqrt()
    });
    for (pixel, difference) in found.iter_mut().enumerate() {
        if *difference == Difference::Lacks && is_stray(capture, state, frame, pixel) {
            *difference = Difference::Unread;
        }
    }
    found
}

/// Whether more views of the state see through a reading than see a surface there, as where a matcher puts
/// depth beside an outline.
fn is_stray(capture: &Capture, state: usize, frame: &RgbdFrame, pixel: usize) -> bool {
    let Some(point) = frame.world_point(pixel) else { return false };
    let depth_m = f64::from(frame.depth_m[pixel]);
    // Both readings have errors that their neighbors share.
    let shared_m = std::f64::consts::SQRT_2 * capture.shared_error * capture.noise.sigma_m(depth_m);
    let sigma_m = frame.sigma_m(pixel, &capture.noise).hypot(shared_m);
    is_surface_seen_at(&point, sigma_m, &capture.states[state], &capture.noise) == Some(false)
}
