//! Kinematic chains: lamp arms and folding doors.

use nalgebra::Vector3;
use rand_core::Rng;

use super::{Part, Solid, look::Look};
use geometry::{AxisMotion, Pose};
use numeric::random::{is_chosen, uniform_in};

/// A lamp: a foot, a post and `parts - 1` rotating links. At rest the links stand upright, side by side.
pub(super) fn lamp_parts(parts: usize, look: &mut Look, rng: &mut impl Rng) -> Vec<Part> {
    let links = parts - 1;
    look.scale_m = 0.35;
    let thick = uniform_in(rng, 0.024, 0.036);
    let post = uniform_in(rng, 0.08, 0.16);
    let foot = look.drawn_material(rng);
    let base = vec![
        Solid::cylinder(uniform_in(rng, 0.1, 0.15), 0.012, Pose::translation(0.0, 0.0, 0.012), &foot),
        Solid::box_between([-0.6 * thick, -thick, 0.02], [0.6 * thick, 0.0, post], &foot),
    ];
    let mut all = vec![Part::static_part("foot", base)];
    // The axis of a turntable, the first link, is vertical; all others are horizontal.
    let turntable = links > 1 && is_chosen(rng, 0.4);
    let mut x = 0.0;
    let mut z = post - 0.5 * thick;
    for link in 1..=links {
        let material = look.drawn_material(rng);
        let length = uniform_in(rng, 0.14, 0.26);
        let name = format!("arm_{link}");
        if link == 1 && turntable {
            let solids = vec![
                Solid::box_between(
                    [-thick, -1.2 * thick, post + 0.001],
                    [length + 0.5 * thick, 0.0, post + thick],
                    &material,
                ),
                Solid::box_between(
                    [-2.2 * thick, -1.5 * thick, post + 0.001],
                    [-thick, 0.3 * thick, post + 1.4 * thick],
                    &material,
                ),
            ];
            let origin = [0.0, -0.5 * thick, post];
            all.push(Part::moving_on(
                name,
                0,
                AxisMotion::Revolute,
                [0.0, 0.0, 1.0],
                origin,
                [-1.5, 1.5],
                solids,
            ));
            (x, z) = (length, post + 0.5 * thick);
            continue;
        }
        // Neighboring links are on opposite sides of y = 0; the post and a turntable are below.
        let y = if (link % 2 == 1) == turntable { [-thick, -0.001] } else { [0.001, thick] };
        // Links extend half a thickness beyond their pins.
        let reach = 0.5 * thick;
        let mut solids = vec![Solid::box_between(
            [x - reach, y[0], z - reach],
            [x + reach, y[1], z + length + reach],
            &material,
        )];
        let tip = z + length;
        // The last link carries the lamp's head.
        if link == links {
            let wide = uniform_in(rng, 0.03, 0.05);
            let tall = uniform_in(rng, 0.03, 0.05);
            let middle = 0.5 * (y[0] + y[1]);
            solids.push(Solid::box_between(
                [x - wide, middle - wide, tip],
                [x + 1.6 * wide, middle + wide, tip + tall],
                &look.drawn_material(rng),
            ));
        }
        let limits = if link == 1 { [-0.9, 1.1] } else { [-2.0, 2.0] };
        all.push(Part::moving_on(
            name,
            link - 1,
            AxisMotion::Revolute,
            [0.0, 1.0, 0.0],
            [x, 0.0, z],
            limits,
            solids,
        ));
        z = tip;
    }
    all
}

/// A folding door: a post on a plate and `parts - 1` panels, hinged alternately at front and back; straight
/// at rest.
pub(super) fn folding_door(parts: usize, look: &mut Look, rng: &mut impl Rng) -> Vec<Part> {
    let panels = parts - 1;
    let width = uniform_in(rng, 0.14, 0.26);
    let bottom = 0.035;
    let top = uniform_in(rng, 0.3, 0.55);
    let thick = uniform_in(rng, 0.014, 0.022);
    look.scale_m = top;
    let frame = look.drawn_material(rng);
    let half = 0.5 * width * panels as f64;
    let gap = 0.001;
    let base = vec![
        Solid::box_between([-0.14, -half - 0.05, 0.0], [0.14, half + 0.05, 0.025], &frame),
        Solid::box_between([-0.04, -half - 0.05, 0.025], [0.5 * thick, -half, top + 0.03], &frame),
    ];
    let mut all = vec![Part::static_part("frame", base)];
    let trim = look.drawn_trim(rng);
    for panel in 1..=panels {
        let material = look.drawn_material(rng);
        let y0 = -half + width * (panel - 1) as f64 + gap;
        let y1 = y0 + width - gap;
        let mut solids =
            vec![Solid::box_between([-0.5 * thick, y0, bottom], [0.5 * thick, y1, top], &material)];
        let forward = panel % 2 == 1;
        // The last panel has a handle.
        if panel == panels {
            let out =
                if forward { [0.5 * thick, 0.5 * thick + 0.02] } else { [-0.5 * thick - 0.02, -0.5 * thick] };
            let middle = 0.5 * (bottom + top);
            solids.push(Solid::box_between(
                [out[0], y1 - 0.03, middle - 0.04],
                [out[1], y1 - 0.02, middle + 0.04],
                &trim,
            ));
        }
        // Panels fold alternately forward and back, each about an edge on that side.
        let (axis, x) = if forward { (-1.0, 0.5 * thick) } else { (1.0, -0.5 * thick) };
        let limits = if panel == 1 { [0.02, 1.6] } else { [0.05, 2.6] };
        let origin = Vector3::new(x, y0 - 0.5 * gap, 0.0);
        all.push(Part::moving_on(
            format!("panel_{panel}"),
            panel - 1,
            AxisMotion::Revolute,
            [0.0, 0.0, axis],
            origin.into(),
            limits,
            solids,
        ));
    }
    all
}
