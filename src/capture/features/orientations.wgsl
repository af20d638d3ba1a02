// Histograms of the directions of gradients about places: `orientations` of descriptor.rs, a thread a place.

const BINS = 36u;

fn work(i: u32) {
    if i >= arrayLength(&places) {
        return;
    }
    let place = places[i];
    let rows = near(place.y, place.reach, place.height);
    let columns = near(place.x, place.reach, place.width);
    // The last two are the first ones again.
    var turns: array<f32, 38>;
    for (var y = rows.x; y <= rows.y; y++) {
        for (var x = columns.x; x <= columns.y; x++) {
            let g = gradient(place, u32(x), u32(y));
            let bin = g.y * (f32(BINS) / TURN);
            let low = min(u32(bin), BINS);
            let fraction = bin - f32(low);
            turns[low] += g.x * (1.0 - fraction);
            turns[low + 1u] += g.x * fraction;
        }
    }
    turns[0] += turns[BINS];
    turns[1] += turns[BINS + 1u];
    for (var k = 0u; k < BINS; k++) {
        found[place.found * BINS + k] = turns[k];
    }
}
