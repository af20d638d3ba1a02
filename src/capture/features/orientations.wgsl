// Histograms of the directions of gradients about places: `orientations` of descriptor.rs, a thread a place.

const BINS = 36u;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = (group.y * groups.x + group.x) * 64u + local;
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
