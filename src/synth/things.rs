//! Things in a room: boxes, cans, a shelf; all of plain paint.

use nalgebra::{Point3, Vector3};
use rand_core::Rng;

use super::{Material, Solid, reach::Extent};
use geometry::Pose;
use numeric::random;

/// Number of things on the floor, and on a table.
pub(super) const ON_FLOOR: usize = 3;
pub(super) const ON_TABLE: usize = 2;
/// Places tried for a thing.
const TRIES: usize = 40;
/// Least gap between a thing and all else, meters. chosen: nothing touches
const GAP_M: f64 = 0.015;
/// Share of cans. chosen: fewer than boxes
const CANS: f64 = 0.35;
/// Depth and thickness of a shelf, meters, and its least height above the object's reach.
/// chosen: usual shelves
const SHELF_DEPTH_M: f64 = 0.2;
const SHELF_THICK_M: f64 = 0.02;
const SHELF_ABOVE_M: f64 = 0.15;
/// Range of half the length of a shelf, meters. chosen: usual shelves
const SHELF_HALF_M: [f64; 2] = [0.25, 0.5];
/// Range of half sides of what stands on it, meters. chosen: books, boxes, cups
const SHELF_THING_M: [f64; 2] = [0.03, 0.07];
/// Number of things on a shelf.
const ON_SHELF: usize = 3;
/// Least share of a hue's channels. chosen: pale paint
const PALE: f64 = 0.8;

/// A matt paint, pale, with a tone from a range.
pub(super) fn drawn_paint([low, high]: [f64; 2], rng: &mut impl Rng) -> Material {
    let tone = random::uniform_in(rng, low, high);
    Material::plain(Vector3::from_fn(|_, _| tone * random::uniform_in(rng, PALE, 1.0)))
}

/// A box or a can that stands on the floor of a place, clear of what is there; `None` if there is no room.
pub(super) fn thing_on(
    place: &Extent,
    [least_m, most_m]: [f64; 2],
    taken: &[Extent],
    rng: &mut impl Rng,
) -> Option<Solid> {
    let half = Vector3::from_fn(|_, _| random::uniform_in(rng, least_m, most_m));
    let hue = Vector3::from_fn(|_, _| random::uniform_in(rng, 0.15, 0.8));
    let is_can = random::is_chosen(rng, CANS);
    let yaw = random::uniform_in(rng, 0.0, std::f64::consts::TAU);
    let material = Material::plain(hue);
    (0..TRIES).find_map(|_| {
        let x = random::uniform_in(rng, place.lower.x, place.upper.x);
        let y = random::uniform_in(rng, place.lower.y, place.upper.y);
        let stands = Pose::new(Vector3::new(x, y, place.lower.z + half.z), Vector3::z() * yaw);
        let thing = if is_can {
            Solid::cylinder(half.x, half.z, stands, &material)
        } else {
            Solid { part_from_solid: stands, ..Solid::box_between((-half).into(), half.into(), &material) }
        };
        let extent = Extent::of_solid(&thing);
        let is_inside = (0..2).all(|k| extent.lower[k] > place.lower[k] && extent.upper[k] < place.upper[k]);
        // What it stands on touches it from below.
        let above = Extent { lower: extent.lower + Vector3::z() * GAP_M, ..extent };
        (is_inside && !taken.iter().any(|t| t.meets(&above, 0.999 * GAP_M))).then_some(thing)
    })
}

/// A board on the wall behind an object, above its reach, with things on it.
pub(super) fn shelf_with_things(reach: &Extent, back_m: f64, rng: &mut impl Rng) -> Vec<Solid> {
    let half_m = random::uniform_in(rng, SHELF_HALF_M[0], SHELF_HALF_M[1]);
    let aside_m = random::uniform_in(rng, reach.center().y, reach.upper.y + half_m);
    let low_m = reach.upper.z + SHELF_ABOVE_M + random::uniform_in(rng, 0.0, SHELF_ABOVE_M);
    let lower = Point3::new(back_m, aside_m - half_m, low_m);
    let upper = Point3::new(back_m + SHELF_DEPTH_M, aside_m + half_m, low_m + SHELF_THICK_M);
    let mut solids = vec![Solid::box_between(lower.into(), upper.into(), &drawn_paint([0.2, 0.7], rng))];
    let place = Extent { lower: Point3::new(lower.x, lower.y, upper.z), upper };
    let mut taken = Vec::new();
    for _ in 0..ON_SHELF {
        let Some(thing) = thing_on(&place, SHELF_THING_M, &taken, rng) else { continue };
        taken.push(Extent::of_solid(&thing));
        solids.push(thing);
    }
    solids
}
