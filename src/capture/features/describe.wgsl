// Histograms of the directions of gradients in the cells about places: `describe` of descriptor.rs, a thread
// a cell.

const CELLS = 4u;
const DIRECTIONS = 8u;

fn work(i: u32) {
    if i >= CELLS * CELLS * arrayLength(&places) {
        return;
    }
    let place = places[i / (CELLS * CELLS)];
    let cell = i % (CELLS * CELLS);
    let s = sin(place.angle);
    let c = cos(place.angle);
    // The middle of the cell from that of all, in cells, and as it lies in the image.
    let u = f32(cell % CELLS) - 0.5 * f32(CELLS - 1u);
    let v = f32(cell / CELLS) - 0.5 * f32(CELLS - 1u);
    let middle = vec2<f32>(place.x + (c * u - s * v) * place.reach, place.y + (s * u + c * v) * place.reach);
    // The bounds of the turned square that reaches to the middles of the cells beside it.
    let half = (abs(s) + abs(c)) * place.reach;
    let rows = near(middle.y, half, place.height);
    let columns = near(middle.x, half, place.width);
    // The last two are the first ones again.
    var turns: array<f32, 10>;
    for (var y = rows.x; y <= rows.y; y++) {
        for (var x = columns.x; x <= columns.y; x++) {
            let dx = f32(x) - place.x;
            let dy = f32(y) - place.y;
            let right = 1.0 - abs((c * dx + s * dy) / place.reach - u);
            let below = 1.0 - abs((c * dy - s * dx) / place.reach - v);
            if right <= 0.0 || below <= 0.0 {
                continue;
            }
            let g = gradient(place, u32(x), u32(y));
            let bin = in_circle(g.y - place.angle) * (f32(DIRECTIONS) / TURN);
            let low = min(u32(bin), DIRECTIONS);
            let fraction = bin - f32(low);
            let share = g.x * right * below;
            turns[low] += share * (1.0 - fraction);
            turns[low + 1u] += share * fraction;
        }
    }
    turns[0] += turns[DIRECTIONS];
    turns[1] += turns[DIRECTIONS + 1u];
    let first = (place.found * CELLS * CELLS + cell) * DIRECTIONS;
    for (var k = 0u; k < DIRECTIONS; k++) {
        found[first + k] = turns[k];
    }
}
