// What views say about the nodes of a volume: tsdf_view.rs and rows.rs for a GPU.

struct Params {
    nx: u32, ny: u32,
    // Layers of the grid that are filled: all of these, of which the nodes' sums are the first.
    first: u32, layers: u32,
    views: u32,
    // Layers of the grid: sides at the grid's border have no neighbor.
    nz: u32,
    truncation_m: f32,
    free_weight: f32,
    near_m: f32,
    spacing_m: f32,
    origin: array<f32, 3>,
}

// A camera before the grid: node (0, 0, 0) and the steps along x, y, z in the optical frame, meters.
struct Camera {
    origin: array<f32, 3>,
    step_x: array<f32, 3>, step_y: array<f32, 3>, step_z: array<f32, 3>,
    fx: f32, fy: f32,
    // Half a pixel more than the principal point.
    cx: f32, cy: f32,
    width: u32, height: u32,
    // Its first pixel among those of all views.
    pixel: u32,
    // Its place in the volume.
    eye: array<f32, 3>,
}

struct Reading { depth_m: f32, signed_weight: f32 }

struct Node { sum: f32, weight: f32, color: array<f32, 4> }

struct Said { kind: u32, s: f32, weight: f32, pixel: u32 }
const NOTHING = 0u;
const FREE = 1u;
const NEAR = 2u;

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> cameras: array<Camera>;
@group(0) @binding(2) var<storage, read> readings: array<Reading>;
@group(0) @binding(3) var<storage, read> colors: array<u32>;

fn vector(v: array<f32, 3>) -> vec3<f32> {
    return vec3<f32>(v[0], v[1], v[2]);
}

// A node's place in a view's optical frame.
fn seen_from(view: u32, x: u32, y: u32, z: u32) -> vec3<f32> {
    let c = &cameras[view];
    let start = vector((*c).origin) + vector((*c).step_y) * f32(y) + vector((*c).step_z) * f32(z);
    return start + vector((*c).step_x) * f32(x);
}

// Depth between four pixels of one surface, linear in inverse depth; 0 at its edges.
fn interpolated_depth(view: u32, u: f32, v: f32) -> f32 {
    let c = &cameras[view];
    if u < 0.0 || v < 0.0 || u >= f32((*c).width - 1u) || v >= f32((*c).height - 1u) {
        return 0.0;
    }
    let x = u32(u);
    let y = u32(v);
    let a = u - f32(x);
    let b = v - f32(y);
    let first = (*c).pixel + y * (*c).width + x;
    let four = array<u32, 4>(first, first + 1u, first + (*c).width, first + (*c).width + 1u);
    let shares = array<f32, 4>((1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b);
    var low = 1e30;
    var high = 0.0;
    var inverse = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let r = readings[four[k]];
        if r.signed_weight <= 0.0 {
            return 0.0;
        }
        low = min(low, r.depth_m);
        high = max(high, r.depth_m);
        inverse += shares[k] / r.depth_m;
    }
    if high - low < params.truncation_m {
        return 1.0 / inverse;
    }
    return 0.0;
}

// What a view says of a node at a place in its optical frame.
fn said(view: u32, p: vec3<f32>) -> Said {
    let c = &cameras[view];
    let nothing = Said(NOTHING, 0.0, 0.0, 0u);
    if p.z < params.near_m {
        return nothing;
    }
    let inverse = 1.0 / p.z;
    let u = (*c).fx * p.x * inverse + (*c).cx;
    let v = (*c).fy * p.y * inverse + (*c).cy;
    if u < 0.0 || v < 0.0 || u > f32((*c).width) || v > f32((*c).height) {
        return nothing;
    }
    let pixel = (*c).pixel + min(u32(v), (*c).height - 1u) * (*c).width + min(u32(u), (*c).width - 1u);
    let reading = readings[pixel];
    let weight = abs(reading.signed_weight);
    let ahead_m = reading.depth_m - p.z;
    if weight <= 0.0 || ahead_m <= -params.truncation_m {
        return nothing;
    }
    if ahead_m >= params.truncation_m {
        return Said(FREE, 0.0, weight, pixel);
    }
    if reading.signed_weight <= 0.0 {
        return nothing;
    }
    var depth_m = interpolated_depth(view, u - 0.5, v - 0.5);
    if depth_m <= 0.0 {
        depth_m = reading.depth_m;
    }
    let s = (depth_m - p.z) / params.truncation_m;
    if s > -1.0 {
        return Said(NEAR, s, weight, pixel);
    }
    return nothing;
}

// Adds what a view says to the sums of a node.
fn add_said(node: ptr<function, Node>, what: Said, steepness: f32) {
    if what.kind == FREE {
        (*node).sum += params.free_weight * what.weight;
        (*node).weight += params.free_weight * what.weight;
    } else if what.kind == NEAR {
        let w = what.weight * min(steepness * (1.0 + what.s), 1.0);
        (*node).sum += w * min(what.s, 1.0);
        (*node).weight += w;
        let share = w * max(1.0 - abs(what.s), 0.0);
        let color = colors[what.pixel];
        (*node).color[0] += f32(color & 255u) * share;
        (*node).color[1] += f32(color >> 8u & 255u) * share;
        (*node).color[2] += f32(color >> 16u & 255u) * share;
        (*node).color[3] += share;
    }
}
