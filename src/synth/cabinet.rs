//! Cabinets: a carcass of boards with a front of cells, each with a moving part.

use rand_core::Rng;

use super::{
    Material, Part, Solid, cabinet_front,
    carcass::{Carcass, Cell},
    look::Look,
};
use geometry::AxisMotion;
use numeric::random::{index_below, is_chosen, uniform_in};

/// Narrowest opening, meters. chosen: a narrow drawer of usual furniture
const MIN_CELL_M: f64 = 0.09;
/// Limits of a lid's angle, radians. chosen: a slit, and 100 degrees
const LID_LIMITS_RAD: [f64; 2] = [0.05, 1.75];

/// A cabinet of `parts` rigid parts.
pub(super) fn cabinet(parts: usize, look: &mut Look, rng: &mut impl Rng) -> Vec<Part> {
    let movers = parts - 1;
    // The area of the front grows with the number of openings.
    let grow = (movers as f64).sqrt();
    let board = uniform_in(rng, 0.014, 0.024);
    let height = (uniform_in(rng, 0.28, 0.5) * grow).min(1.4);
    let width = (uniform_in(rng, 0.28, 0.5) * grow).min(1.2);
    let bottom = if is_chosen(rng, 0.4) { uniform_in(rng, 0.03, 0.12) } else { 0.0 };
    let carcass = Carcass {
        front: 0.5 * uniform_in(rng, 0.25, 0.45),
        side: 0.5 * width,
        bottom,
        top: bottom + height,
        board,
    };
    look.scale_m = width.max(height);
    let wood = look.drawn_material(rng);
    let trim = look.drawn_trim(rng);
    let lid = height < 0.75 && is_chosen(rng, 0.3);
    // Some cabinets have an opening without a front.
    let open = usize::from(is_chosen(rng, 0.3));
    let mut cells = Vec::new();
    let mut solids = carcass_boards(&carcass, &wood);
    divide_opening(&carcass, (movers - usize::from(lid) + open).max(1), &wood, &mut cells, &mut solids, rng);
    if bottom > 0.0 {
        add_legs(&carcass, &trim, &mut solids);
    }
    let mut moved = Vec::new();
    if lid {
        moved.push(add_lid(&carcass, look, &wood, &mut solids, rng));
    }
    // Openings are chosen at random.
    while moved.len() < movers {
        let cell = cells.swap_remove(index_below(rng, cells.len()));
        let number = moved.len() + 1;
        moved.push(cabinet_front::moving_part(&carcass, cell, number, look, &trim, &mut solids, rng));
    }
    std::iter::once(Part::static_part("carcass", solids)).chain(moved).collect()
}

fn carcass_boards(c: &Carcass, wood: &Material) -> Vec<Solid> {
    let x = c.front;
    let y = c.side;
    let t = c.board;
    vec![
        Solid::box_between([-x, -y, c.bottom], [x, -y + t, c.top], wood),
        Solid::box_between([-x, y - t, c.bottom], [x, y, c.top], wood),
        Solid::box_between([-x, -y + t, c.bottom], [x, y - t, c.bottom + t], wood),
        Solid::box_between([-x, -y + t, c.top - t], [x, y - t, c.top], wood),
        Solid::box_between([-x, -y + t, c.bottom + t], [-x + 0.5 * t, y - t, c.top - t], wood),
    ]
}

/// Splits the largest opening until there are enough, with a board at each split.
fn divide_opening(
    c: &Carcass,
    count: usize,
    wood: &Material,
    cells: &mut Vec<Cell>,
    solids: &mut Vec<Solid>,
    rng: &mut impl Rng,
) {
    let t = c.board;
    cells.push(Cell { y: [-c.side + t, c.side - t], z: [c.bottom + t, c.top - t] });
    while cells.len() < count {
        let areas: Vec<f64> = cells.iter().map(|cell| cell.width() * cell.height()).collect();
        let largest = (0..cells.len()).max_by(|a, b| areas[*a].total_cmp(&areas[*b])).unwrap_or_default();
        let cell = cells.swap_remove(largest);
        let ratio = cell.width() / cell.height();
        // Long openings are split across their length and stay nearly square.
        let upright = if (0.7..1.4).contains(&ratio) { is_chosen(rng, 0.5) } else { ratio > 1.0 };
        let [low, high] = if upright { cell.y } else { cell.z };
        let margin = MIN_CELL_M.min(0.4 * (high - low));
        let at = (low + (high - low) * uniform_in(rng, 0.35, 0.65)).clamp(low + margin, high - margin);
        let [before, after] = [at - 0.5 * t, at + 0.5 * t];
        let x0 = -c.front + 0.5 * t;
        let x1 = c.front;
        if upright {
            solids.push(Solid::box_between([x0, before, cell.z[0]], [x1, after, cell.z[1]], wood));
            cells.extend([Cell { y: [low, before], ..cell }, Cell { y: [after, high], ..cell }]);
        } else {
            solids.push(Solid::box_between([x0, cell.y[0], before], [x1, cell.y[1], after], wood));
            cells.extend([Cell { z: [low, before], ..cell }, Cell { z: [after, high], ..cell }]);
        }
    }
}

fn add_legs(c: &Carcass, trim: &Material, solids: &mut Vec<Solid>) {
    let size = 2.0 * c.board;
    for (x, y) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
        let corner = [x * (c.front - size) - 0.5 * size, y * (c.side - size) - 0.5 * size];
        solids.push(Solid::box_between(
            [corner[0], corner[1], 0.0],
            [corner[0] + size, corner[1] + size, c.bottom],
            trim,
        ));
    }
}

/// A compartment on top with a lid hinged at the back.
fn add_lid(c: &Carcass, look: &Look, wood: &Material, solids: &mut Vec<Solid>, rng: &mut impl Rng) -> Part {
    let x = c.front;
    let y = c.side;
    let t = c.board;
    let rim = c.top + uniform_in(rng, 0.05, 0.15);
    solids.extend([
        Solid::box_between([-x, -y, c.top], [x, -y + t, rim], wood),
        Solid::box_between([-x, y - t, c.top], [x, y, rim], wood),
        Solid::box_between([-x, -y + t, c.top], [-x + t, y - t, rim], wood),
        Solid::box_between([x - t, -y + t, c.top], [x, y - t, rim], wood),
    ]);
    let gap = 0.001;
    let material = look.drawn_material(rng);
    let slab = Solid::box_between([-x, -y, rim + gap], [x, y, rim + gap + t], &material);
    let grip = Solid::box_between(
        [x, -0.05, rim + gap],
        [x + 0.02, 0.05, rim + gap + 0.6 * t],
        &look.drawn_trim(rng),
    );
    Part::moving_on(
        "lid".into(),
        0,
        AxisMotion::Revolute,
        [0.0, -1.0, 0.0],
        [-x, 0.0, rim + gap],
        LID_LIMITS_RAD,
        vec![slab, grip],
    )
}
