//! Small objects: boxes with screw caps, clamshells.

use nalgebra::Vector3;
use rand_core::Rng;

use super::{Part, Solid, look::Look};
use geometry::{AxisMotion, Pose};
use numeric::random::uniform_in;

/// A box with a row of `parts - 1` screw caps on top. A bar across each cap shows its rotation.
pub(super) fn capped_box(parts: usize, look: &mut Look, rng: &mut impl Rng) -> Vec<Part> {
    let caps = parts - 1;
    let radius: Vec<f64> = (0..caps).map(|_| uniform_in(rng, 0.03, 0.05)).collect();
    let half_y = radius.iter().sum::<f64>() + 0.015 * (caps + 1) as f64;
    let half_x = uniform_in(rng, 0.06, 0.1);
    let height = uniform_in(rng, 0.08, 0.16);
    look.scale_m = 2.0 * height;
    let body = look.drawn_material(rng);
    let mut base = vec![Solid::box_between([-half_x, -half_y, 0.0], [half_x, half_y, height], &body)];
    let mut moved = Vec::new();
    let mut y = -half_y + 0.03;
    for (i, &radius_m) in radius.iter().enumerate() {
        let center = [uniform_in(rng, -0.02, 0.02), y + radius_m];
        y += 2.0 * radius_m + 0.015;
        let at = |z: f64| Pose::translation(center[0], center[1], z);
        let neck = look.drawn_trim(rng);
        let tall = uniform_in(rng, 0.02, 0.032);
        // The closed cap covers the whole neck.
        let half_neck = 0.5 * (tall - 0.002);
        base.push(Solid::cylinder(0.8 * radius_m, half_neck, at(height + half_neck), &neck));
        let material = look.drawn_material(rng);
        let top = height + 0.001 + tall;
        let grip = look.drawn_material(rng);
        // Off center, since a symmetric bar looks the same after half a turn.
        let bar = Vector3::new(0.95 * radius_m, 0.22 * radius_m, 0.5 * uniform_in(rng, 0.008, 0.016));
        let solids = vec![
            Solid::cylinder(radius_m, 0.5 * tall, at(height + 0.001 + 0.5 * tall), &material),
            Solid::box_between(
                [center[0] - 0.4 * bar.x, center[1] - bar.y, top],
                [center[0] + bar.x, center[1] + bar.y, top + 2.0 * bar.z],
                &grip,
            ),
        ];
        let kind = AxisMotion::Screw { pitch_m_per_rad: uniform_in(rng, 0.004, 0.012) };
        moved.push(Part::moving_on(
            format!("cap_{}", i + 1),
            0,
            kind,
            [0.0, 0.0, 1.0],
            [center[0], center[1], height],
            [0.0, 3.0],
            solids,
        ));
    }
    std::iter::once(Part::static_part("body", base)).chain(moved).collect()
}

/// Two flat shells hinged at the back of the lower one, which has keys.
pub(super) fn clamshell_parts(look: &mut Look, rng: &mut impl Rng) -> Vec<Part> {
    let half_x = 0.5 * uniform_in(rng, 0.18, 0.28);
    let half_y = 0.5 * uniform_in(rng, 0.25, 0.4);
    let thick = uniform_in(rng, 0.015, 0.03);
    look.scale_m = 2.0 * half_y;
    let lower = look.drawn_material(rng);
    let upper = look.drawn_material(rng);
    let mut base = vec![Solid::box_between([-half_x, -half_y, 0.0], [half_x, half_y, thick], &lower)];
    let keys = look.drawn_trim(rng);
    let rows = 4;
    let columns = 9;
    for k in 0..rows * columns {
        let row = f64::from(k / columns);
        let column = f64::from(k % columns);
        let x = -0.7 * half_x + row * 0.25 * half_x;
        let y = (-0.8 + 0.18 * column) * half_y;
        base.push(Solid::box_between(
            [x, y, thick],
            [x + 0.2 * half_x, y + 0.14 * half_y, thick + 0.002],
            &keys,
        ));
    }
    let lid_thick = uniform_in(rng, 0.006, 0.014);
    // The gap leaves room for the keys and the screen.
    let bottom = thick + 0.004;
    let screen = look.drawn_material(rng);
    let lid = vec![
        Solid::box_between([-half_x, -half_y, bottom], [half_x, half_y, bottom + lid_thick], &upper),
        Solid::box_between(
            [-0.85 * half_x, -0.9 * half_y, bottom - 0.001],
            [0.9 * half_x, 0.9 * half_y, bottom],
            &screen,
        ),
    ];
    let origin = [-half_x, 0.0, bottom];
    vec![
        Part::static_part("base", base),
        Part::moving_on("lid".into(), 0, AxisMotion::Revolute, [0.0, -1.0, 0.0], origin, [0.15, 2.3], lid),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Family, Shape, SynthConfig, generate};

    #[test]
    fn closed_caps_hold_their_necks() {
        for seed in 0..20 {
            let object =
                generate(&SynthConfig { seed, family: Some(Family::CappedBox), ..SynthConfig::default() })
                    .unwrap();
            let top_m = |s: &Solid| s.part_from_solid.translation.z + s.shape.half_sides().z;
            let necks = object.parts[0].solids.iter().filter(|s| matches!(s.shape, Shape::Cylinder { .. }));
            for (neck, cap) in necks.zip(&object.parts[1..]) {
                assert!(top_m(neck) < top_m(&cap.solids[0]) - 0.001, "seed {seed}: {}", cap.name);
            }
        }
    }
}
