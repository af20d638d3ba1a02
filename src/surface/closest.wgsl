// Nearest triangles of the nodes of a distance field: triangle.rs and pseudonormal.rs for a GPU. Lengths
// are in spacings.

struct Params {
    nx: u32, ny: u32, nz: u32,
    // Nodes whose nearest seed is farther than the root of this look for no triangle.
    near_squared: u32,
}

const NONE = 0xffffffffu;
const FAR = 0xfffffffeu;
// Longest walk over the mesh.
const MAX_STEPS = 64;
// Triangles this close belong to the piece of surface that a walk has searched, squared.
const SAME_PIECE_SQUARED = 1.0;

// Corners of a triangle.
struct Corners { at: array<array<f32, 3>, 3> }
// Vertices of a triangle and the triangles across its sides.
struct Links { vertices: array<u32, 3>, across: array<u32, 3> }

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> corners: array<Corners>;
@group(0) @binding(2) var<storage, read> links: array<Links>;
// Triangles around each vertex: where its list begins, and the lists.
@group(0) @binding(3) var<storage, read> ring_starts: array<u32>;
@group(0) @binding(4) var<storage, read> rings: array<u32>;

// Where a closest point lies: 0 in the interior, 1 + i on side i, 4 + i at corner i.
struct Closest { squared: f32, triangle: u32, feature: u32 }

fn corner(t: u32, k: u32) -> vec3<f32> {
    let c = corners[t].at[k];
    return vec3<f32>(c[0], c[1], c[2]);
}

fn squared(v: vec3<f32>) -> f32 {
    return dot(v, v);
}

// Closest point of the three sides.
fn measure_sides(p: vec3<f32>, t: u32) -> Closest {
    var best = Closest(1e30, t, 4u);
    for (var i = 0u; i < 3u; i++) {
        let start = corner(t, i);
        let along = corner(t, (i + 1u) % 3u) - start;
        let length2 = squared(along);
        var share = 0.0;
        if length2 > 0.0 {
            share = clamp(dot(p - start, along) / length2, 0.0, 1.0);
        }
        let d = squared(p - (start + along * share));
        if d < best.squared {
            var feature = 1u + i;
            if share <= 0.0 {
                feature = 4u + i;
            } else if share >= 1.0 {
                feature = 4u + (i + 1u) % 3u;
            }
            best = Closest(d, t, feature);
        }
    }
    return best;
}

// The point of a triangle closest to a point (Ericson, Real-Time Collision Detection, 5.1.5).
fn measure(p: vec3<f32>, t: u32) -> Closest {
    let a = corner(t, 0u);
    let b = corner(t, 1u);
    let c = corner(t, 2u);
    let ab = b - a;
    let ac = c - a;
    let ap = p - a;
    let d1 = dot(ab, ap);
    let d2 = dot(ac, ap);
    if d1 <= 0.0 && d2 <= 0.0 {
        return Closest(squared(ap), t, 4u);
    }
    let bp = p - b;
    let d3 = dot(ab, bp);
    let d4 = dot(ac, bp);
    if d3 >= 0.0 && d4 <= d3 {
        return Closest(squared(bp), t, 5u);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return Closest(squared(ap - ab * (d1 / (d1 - d3))), t, 1u);
    }
    let cp = p - c;
    let d5 = dot(ab, cp);
    let d6 = dot(ac, cp);
    if d6 >= 0.0 && d5 <= d6 {
        return Closest(squared(cp), t, 6u);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return Closest(squared(ap - ac * (d2 / (d2 - d6))), t, 3u);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return Closest(squared(bp - (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)))), t, 2u);
    }
    let sum = va + vb + vc;
    if sum > 0.0 && squared(cross(ab, ac)) > 1e-12 * squared(ab) * squared(ac) {
        return Closest(squared(ap - ab * (vb / sum) - ac * (vc / sum)), t, 0u);
    }
    return measure_sides(p, t);
}

// The closest of the triangles around a corner that lead closer than the corner itself.
fn measure_ring(p: vec3<f32>, best: Closest, k: u32) -> Closest {
    var found = best;
    let middle = corner(best.triangle, k);
    let away = p - middle;
    let vertex = links[best.triangle].vertices[k];
    for (var i = ring_starts[vertex]; i < ring_starts[vertex + 1u]; i++) {
        let next = rings[i];
        let leads = dot(away, corner(next, 0u) - middle) > 0.0 || dot(away, corner(next, 1u) - middle) > 0.0
            || dot(away, corner(next, 2u) - middle) > 0.0;
        if leads {
            let other = measure(p, next);
            if other.squared < found.squared {
                found = other;
            }
        }
    }
    return found;
}

// The closer of what was found and another triangle.
fn closer(p: vec3<f32>, found: Closest, other: u32) -> Closest {
    if other != found.triangle {
        let measured = measure(p, other);
        if measured.squared < found.squared {
            return measured;
        }
    }
    return found;
}

// Walks over the mesh to neighbors that are closer to the point, until none is.
fn descend(p: vec3<f32>, start: Closest) -> u32 {
    var best = start;
    for (var step = 0; step < MAX_STEPS; step++) {
        let before = best.squared;
        if best.feature == 0u {
            break;
        }
        if best.feature < 4u {
            let next = links[best.triangle].across[best.feature - 1u];
            if next != NONE {
                let other = measure(p, next);
                if other.squared < best.squared {
                    best = other;
                }
            }
        } else {
            best = measure_ring(p, best, best.feature - 4u);
        }
        if best.squared >= before {
            break;
        }
    }
    return best.triangle;
}

fn place(i: u32) -> vec3<u32> {
    return vec3<u32>(i % params.nx, i / params.nx % params.ny, i / (params.nx * params.ny));
}
