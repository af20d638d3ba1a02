//! Moving parts of an opening of a cabinet's front: doors, flaps, drawers, sliding panels.

use nalgebra::Vector3;
use rand_core::Rng;

use super::{
    Material, Part, Solid,
    carcass::{Carcass, Cell},
    look::Look,
};
use geometry::{AxisMotion, Pose};
use numeric::random::{index_below, is_chosen, uniform_in};

/// Gap around a moving part, meters. chosen: as in usual furniture
const GAP_M: f64 = 0.002;
/// Limits of the angle of a door or flap, radians. chosen: a slit, and 115 degrees
const HINGE_LIMITS_RAD: [f64; 2] = [0.02, 2.0];
/// Narrowest opening for a sliding panel, meters. chosen: narrower panels hardly move
const MIN_SLIDE_M: f64 = 0.2;
/// Thickness of a drawer's walls, meters. chosen: as in usual furniture
const WALL_M: f64 = 0.008;

/// A plate at the front of an opening, meters.
#[derive(Clone, Copy)]
struct Slab {
    x: [f64; 2],
    y: [f64; 2],
    z: [f64; 2],
}

impl Slab {
    fn as_solid(&self, material: &Material) -> Solid {
        Solid::box_between([self.x[0], self.y[0], self.z[0]], [self.x[1], self.y[1], self.z[1]], material)
    }
}

/// Edge of the plate along the hinge.
#[derive(Clone, Copy, PartialEq)]
enum Edge {
    Left,
    Right,
    Top,
    Bottom,
}

/// Creates the moving part of an opening; adds its fixed solids to `carcass_solids`.
pub(super) fn moving_part(
    c: &Carcass,
    cell: Cell,
    number: usize,
    look: &Look,
    trim: &Material,
    carcass_solids: &mut Vec<Solid>,
    rng: &mut impl Rng,
) -> Part {
    let material = look.drawn_material(rng);
    let inset = is_chosen(rng, 0.4);
    // An inset plate is flush with the frame; an overlay covers half of each adjacent board.
    let (x, reach) = if inset {
        ([c.front - 0.8 * c.board, c.front], -GAP_M)
    } else {
        ([c.front + GAP_M, c.front + GAP_M + 0.8 * c.board], 0.5 * c.board - 0.75 * GAP_M)
    };
    let slab =
        Slab { x, y: [cell.y[0] - reach, cell.y[1] + reach], z: [cell.z[0] - reach, cell.z[1] + reach] };
    let wide = cell.width() / cell.height();
    let kind = uniform_in(rng, 0.0, 1.0);
    // Drawers need low openings and flaps wide ones; all others get doors.
    if cell.width() > MIN_SLIDE_M && kind < 0.15 {
        sliding_part(c, cell, number, &material, trim, carcass_solids, rng)
    } else if wide > 0.7 && kind < 0.6 {
        drawer_part(c, cell, slab, number, &material, trim, rng)
    } else {
        let edge = match (wide, is_chosen(rng, 0.5)) {
            (w, first) if w > 1.3 => {
                if first {
                    Edge::Top
                } else {
                    Edge::Bottom
                }
            }
            (_, first) => {
                if first {
                    Edge::Left
                } else {
                    Edge::Right
                }
            }
        };
        hinged_part(slab, edge, number, &material, trim, rng)
    }
}

/// A door or flap that rotates about an edge of its outer face.
fn hinged_part(
    slab: Slab,
    edge: Edge,
    number: usize,
    material: &Material,
    trim: &Material,
    rng: &mut impl Rng,
) -> Part {
    let (axis, origin) = match edge {
        Edge::Left => ([0.0, 0.0, -1.0], [slab.x[1], slab.y[0], 0.0]),
        Edge::Right => ([0.0, 0.0, 1.0], [slab.x[1], slab.y[1], 0.0]),
        Edge::Top => ([0.0, -1.0, 0.0], [slab.x[1], 0.0, slab.z[1]]),
        Edge::Bottom => ([0.0, 1.0, 0.0], [slab.x[1], 0.0, slab.z[0]]),
    };
    let upright = matches!(edge, Edge::Left | Edge::Right);
    let [near, far] = if upright { slab.y } else { slab.z };
    // The handle is near the free edge, opposite the hinge.
    let inward = (0.12 * (far - near)).max(0.02);
    let free = if matches!(edge, Edge::Left | Edge::Bottom) { far - inward } else { near + inward };
    let middle = 0.5 * if upright { slab.z[0] + slab.z[1] } else { slab.y[0] + slab.y[1] };
    let at = if upright { [free, middle] } else { [middle, free] };
    let span = if upright { slab.z[1] - slab.z[0] } else { slab.y[1] - slab.y[0] };
    let handle = handle_solid(slab.x[1], at, upright, span, trim, rng);
    let name = if upright { format!("door_{number}") } else { format!("flap_{number}") };
    Part::moving_on(
        name,
        0,
        AxisMotion::Revolute,
        axis,
        origin,
        HINGE_LIMITS_RAD,
        vec![slab.as_solid(material), handle],
    )
}

/// A drawer: front plate, bottom, two sides and a back.
fn drawer_part(
    c: &Carcass,
    cell: Cell,
    slab: Slab,
    number: usize,
    material: &Material,
    trim: &Material,
    rng: &mut impl Rng,
) -> Part {
    let length = uniform_in(rng, 0.6, 0.85) * (2.0 * c.front - c.board);
    let x0 = slab.x[0] - length;
    let x1 = slab.x[0];
    let y0 = cell.y[0] + 2.0 * GAP_M;
    let y1 = cell.y[1] - 2.0 * GAP_M;
    let z0 = cell.z[0] + 2.0 * GAP_M;
    let z1 = cell.z[0] + uniform_in(rng, 0.5, 0.85) * cell.height();
    let solids = vec![
        slab.as_solid(material),
        Solid::box_between([x0, y0, z0], [x1, y1, z0 + WALL_M], material),
        Solid::box_between([x0, y0, z0 + WALL_M], [x1, y0 + WALL_M, z1], material),
        Solid::box_between([x0, y1 - WALL_M, z0 + WALL_M], [x1, y1, z1], material),
        Solid::box_between([x0, y0 + WALL_M, z0 + WALL_M], [x0 + WALL_M, y1 - WALL_M, z1], material),
        handle_solid(
            slab.x[1],
            [0.5 * (cell.y[0] + cell.y[1]), 0.5 * (cell.z[0] + cell.z[1])],
            false,
            cell.width(),
            trim,
            rng,
        ),
    ];
    // A quarter of the length always stays inside, so that drawers do not fall out.
    let limits = [0.0, 0.75 * length];
    Part::moving_on(
        format!("drawer_{number}"),
        0,
        AxisMotion::Prismatic,
        [1.0, 0.0, 0.0],
        [slab.x[1], 0.0, z0],
        limits,
        solids,
    )
}

/// A panel, flush with the frame, that slides across its opening; in half of the cases there is a fixed panel
/// behind it.
fn sliding_part(
    c: &Carcass,
    cell: Cell,
    number: usize,
    material: &Material,
    trim: &Material,
    carcass_solids: &mut Vec<Solid>,
    rng: &mut impl Rng,
) -> Part {
    let thick = 0.5 * c.board;
    let width = uniform_in(rng, 0.4, 0.6) * cell.width();
    let z = [cell.z[0] + GAP_M, cell.z[1] - GAP_M];
    let y = [cell.y[0] + GAP_M, cell.y[0] + GAP_M + width];
    let slab = Slab { x: [c.front - thick, c.front], y, z };
    if is_chosen(rng, 0.5) {
        let back = c.front - thick - 2.0 * GAP_M;
        let lower = [back - thick, cell.y[1] - 0.55 * cell.width(), cell.z[0]];
        carcass_solids.push(Solid::box_between(lower, [back, cell.y[1], cell.z[1]], trim));
    }
    let at = [y[0] + 0.15 * width, 0.5 * (z[0] + z[1])];
    // A recessed grip would be invisible; this one protrudes by 4 mm.
    let grip = Solid::box_between(
        [c.front, at[0] - 0.008, at[1] - 0.03],
        [c.front + 0.004, at[0] + 0.008, at[1] + 0.03],
        trim,
    );
    let limits = [0.0, cell.width() - width - 2.0 * GAP_M];
    let solids = vec![slab.as_solid(material), grip];
    Part::moving_on(
        format!("panel_{number}"),
        0,
        AxisMotion::Prismatic,
        [0.0, 1.0, 0.0],
        [c.front, y[0], z[0]],
        limits,
        solids,
    )
}

/// A bar or knob on a plate with outer face at `x`; `at` is its (y, z), meters.
fn handle_solid(
    x: f64,
    at: [f64; 2],
    upright: bool,
    span: f64,
    trim: &Material,
    rng: &mut impl Rng,
) -> Solid {
    let out = uniform_in(rng, 0.018, 0.03);
    if index_below(rng, 3) == 0 {
        let radius_m = uniform_in(rng, 0.01, 0.018);
        let pose =
            Pose::new(Vector3::new(x + 0.5 * out, at[0], at[1]), Vector3::y() * std::f64::consts::FRAC_PI_2);
        return Solid::cylinder(radius_m, 0.5 * out, pose, trim);
    }
    let half = (0.5 * uniform_in(rng, 0.2, 0.5) * span).min(0.09);
    let (y, z) = if upright { (0.006, half) } else { (half, 0.006) };
    Solid::box_between([x, at[0] - y, at[1] - z], [x + out, at[0] + y, at[1] + z], trim)
}
