//! What the parts of an object in a room are made of: paint, wood, brushed steel, a glass door.

use nalgebra::Vector3;
use rand_core::Rng;

use super::{Lacquer, Material, Object, Part, Shape, Solid};
use geometry::Pose;
use numeric::random::{self, stage_rng};

/// Shares of parts of wood and of steel; the others keep their paint. chosen: kitchens and offices
const WOOD: f64 = 0.25;
const STEEL: f64 = 0.12;
/// Share of objects in which one hinged plate has a pane of glass. chosen: some display cabinets
const GLAZED: f64 = 0.12;
/// Contrast of wood's grain. chosen: faint
const GRAIN: f64 = 0.15;
/// Longest wavelengths of the grain across and along the fibers, meters. chosen: oak
const GRAIN_M: [f64; 2] = [0.03, 0.4];
/// Reflectance of brushed steel and contrast of its streaks. chosen: kitchen fronts
const STEEL_TONE: f64 = 0.4;
const STREAKS: f64 = 0.06;
/// Width of the frame around a pane, share of the plate's shorter side, at least this many meters.
/// chosen: display cabinets
const FRAME_SHARE: f64 = 0.15;
const FRAME_M: f64 = 0.03;

/// The object with the finish of a seed on every part. Its shape stays as it is.
pub(super) fn finished_object(mut object: Object, seed: u64) -> Object {
    for (k, part) in object.parts.iter_mut().enumerate() {
        finish_part(part, &mut stage_rng(seed, "synth/finish", k as u64));
    }
    let rng = &mut stage_rng(seed, "synth/glass", 0);
    if random::is_chosen(rng, GLAZED) {
        let hinged: Vec<usize> = (1..object.parts.len()).filter(|k| is_plate(&object.parts[*k])).collect();
        if let Some(&k) = hinged.get(random::index_below(rng, hinged.len())) {
            let plate = object.parts[k].solids.remove(0);
            object.parts[k].solids.splice(0..0, glazed_plate(&plate));
        }
    }
    object
}

fn finish_part(part: &mut Part, rng: &mut impl Rng) {
    let kind = random::unit_uniform(rng);
    let along = random::index_below(rng, 3);
    let tone = random::uniform_in(rng, 0.2, 0.6);
    let seed = random::index_below(rng, 1 << 30) as u32;
    let mut wavelength_m = Vector3::repeat(GRAIN_M[0]);
    wavelength_m[along] = GRAIN_M[1];
    let streaks = Material { seed, wavelength_m: Some(wavelength_m), ..Material::plain(Vector3::zeros()) };
    let material = if kind < WOOD {
        let base = Vector3::new(tone, 0.75 * tone, 0.5 * tone);
        Material { base, second: base * (1.0 - GRAIN), ..streaks }
    } else if kind < WOOD + STEEL {
        let base = Vector3::repeat(STEEL_TONE);
        Material { base, second: base * (1.0 - STREAKS), sheen: 1.0, ..streaks }
    } else {
        return;
    };
    // Handles and fittings keep their material: the first solid is what the part mostly is.
    let own = part.solids.first().map(|s| s.material.clone());
    for solid in part.solids.iter_mut().filter(|s| Some(&s.material) == own.as_ref()) {
        solid.material = material.clone();
    }
}

/// Whether a part is hinged and its first solid a plate, wide enough for a pane in a frame.
fn is_plate(part: &Part) -> bool {
    let is_hinged = part.joint.is_some_and(|j| j.kind == geometry::AxisMotion::Revolute && j.parent == 0);
    let Some(Shape::Cuboid(half)) = part.solids.first().map(|s| s.shape) else { return false };
    let mut sides = [half.x, half.y, half.z];
    sides.sort_by(f64::total_cmp);
    is_hinged && sides[0] < FRAME_M && sides[1] > 3.0 * FRAME_M
}

/// A plate as four bars of a frame and a pane of glass, which fill the same box.
fn glazed_plate(plate: &Solid) -> Vec<Solid> {
    let half = plate.shape.half_sides();
    let thin = half.imin();
    let [a, b] = [(thin + 1) % 3, (thin + 2) % 3];
    let frame_m = (2.0 * FRAME_SHARE * half[a].min(half[b])).max(FRAME_M);
    let glass = Material { lacquer: Some(Lacquer::everywhere()), ..plate.material.clone() };
    let [inner_a, inner_b] = [half[a] - frame_m, half[b] - frame_m];
    let beside_a = 0.5 * (half[a] + inner_a);
    let beside_b = 0.5 * (half[b] + inner_b);
    // Middle and half sides along the two long axes.
    let pieces = [
        ([-beside_a, 0.0], [0.5 * frame_m, half[b]], &plate.material),
        ([beside_a, 0.0], [0.5 * frame_m, half[b]], &plate.material),
        ([0.0, -beside_b], [inner_a, 0.5 * frame_m], &plate.material),
        ([0.0, beside_b], [inner_a, 0.5 * frame_m], &plate.material),
        ([0.0, 0.0], [inner_a, inner_b], &glass),
    ];
    let pieces = pieces.into_iter().map(|(middle, sides, material)| {
        let mut at = Vector3::zeros();
        let mut size = half;
        (at[a], at[b]) = (middle[0], middle[1]);
        (size[a], size[b]) = (sides[0], sides[1]);
        let pose = plate.part_from_solid * Pose::translation(at.x, at.y, at.z);
        Solid { shape: Shape::Cuboid(size), part_from_solid: pose, material: material.clone() }
    });
    pieces.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Material;
    use nalgebra::Point3;

    #[test]
    fn a_glazed_plate_fills_the_same_box() {
        let plate = Solid::box_between([0.0, 0.0, 0.0], [0.4, 0.6, 0.02], &Material::plain(Vector3::x()));
        let pieces = glazed_plate(&plate);
        let volume: f64 = pieces.iter().map(|s| 8.0 * s.shape.half_sides().product()).sum();
        assert!((volume / (0.4 * 0.6 * 0.02) - 1.0).abs() < 1e-9);
        let is_glass = |x: f64, y: f64| {
            let point = Point3::new(x, y, 0.01);
            let at = pieces.iter().find(|s| crate::room::distance_to_box(s, &point) == 0.0).unwrap();
            at.material.is_lacquered(&point)
        };
        assert!(is_glass(0.2, 0.3) && is_glass(0.07, 0.53));
        assert!(!is_glass(0.05, 0.3) && !is_glass(0.2, 0.57));
    }
}
