// The triangle that each node outside the band walks to from that of its nearest seed.

@group(0) @binding(5) var<storage, read> band: array<u32>;
@group(0) @binding(6) var<storage, read> seeds: array<u32>;
@group(0) @binding(7) var<storage, read_write> triangles: array<u32>;

fn work(i: u32) {
    if i >= params.nx * params.ny * params.nz {
        return;
    }
    let own = band[i];
    if own != NONE {
        triangles[i] = own;
        return;
    }
    let at = place(i);
    let apart = vec3<i32>(at) - vec3<i32>(place(seeds[i]));
    if u32(apart.x * apart.x + apart.y * apart.y + apart.z * apart.z) > params.near_squared {
        triangles[i] = FAR;
        return;
    }
    let p = vec3<f32>(at);
    var start = measure(p, band[seeds[i]]);
    // The seeds of the nodes before may see another piece of surface.
    start = closer(p, start, band[seeds[select(i, i - 1u, at.x > 0u)]]);
    start = closer(p, start, band[seeds[select(i, i - params.nx, at.y > 0u)]]);
    start = closer(p, start, band[seeds[select(i, i - params.nx * params.ny, at.z > 0u)]]);
    triangles[i] = descend(p, start);
}
