// The nearest among the triangles of a node and of its six neighbors: Nearest::refined.

@group(0) @binding(5) var<storage, read> band: array<u32>;
@group(0) @binding(6) var<storage, read> triangles: array<u32>;
@group(0) @binding(7) var<storage, read_write> refined: array<u32>;

fn work(i: u32) {
    if i >= params.nx * params.ny * params.nz {
        return;
    }
    let own = triangles[i];
    refined[i] = own;
    if band[i] != NONE || own == FAR {
        return;
    }
    let at = place(i);
    let p = vec3<f32>(at);
    let layer = params.nx * params.ny;
    // A node at the border is its own neighbor.
    let around = array<u32, 6>(
        select(i, i - 1u, at.x > 0u), select(i, i + 1u, at.x + 1u < params.nx),
        select(i, i - params.nx, at.y > 0u), select(i, i + params.nx, at.y + 1u < params.ny),
        select(i, i - layer, at.z > 0u), select(i, i + layer, at.z + 1u < params.nz),
    );
    var best = Closest(1e30, own, 0u);
    for (var k = 0u; k < 6u; k++) {
        let t = triangles[around[k]];
        if t == own || t == FAR || t == best.triangle
            || squared(corner(t, 0u) - corner(own, 0u)) <= SAME_PIECE_SQUARED {
            continue;
        }
        if best.squared == 1e30 {
            best.squared = measure(p, own).squared;
        }
        let other = measure(p, t);
        if other.squared < best.squared {
            best = other;
        }
    }
    if best.triangle != own {
        refined[i] = descend(p, best);
    }
}
