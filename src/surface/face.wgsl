// Nodes near the surface by the views alone that see their side: TsdfVolume::face.

@group(0) @binding(4) var<storage, read> before: array<Node>;
@group(0) @binding(5) var<storage, read_write> nodes: array<Node>;

// Farther than any distance: not known.
const UNKNOWN = 1e30;

// Distance at a node of the layers at hand, meters.
fn distance_at(x: u32, y: u32, layer: u32) -> f32 {
    let i = (layer * params.ny + y) * params.nx + x;
    let weight = before[i].weight;
    if weight > 0.0 {
        return before[i].sum / weight * params.truncation_m;
    }
    return UNKNOWN;
}

fn slope(low: f32, high: f32) -> f32 {
    if low == UNKNOWN || high == UNKNOWN {
        return 0.0;
    }
    return high - low;
}

fn work(i: u32) {
    if i >= params.nx * params.ny * params.layers {
        return;
    }
    let x = i % params.nx;
    let y = i / params.nx % params.ny;
    let layer = i / (params.nx * params.ny);
    nodes[i] = before[i];
    let own = distance_at(x, y, layer);
    if own == UNKNOWN || abs(own) >= 0.999 * params.truncation_m {
        return;
    }
    let across = vec3<f32>(
        slope(distance_at(max(x, 1u) - 1u, y, layer), distance_at(min(x + 1u, params.nx - 1u), y, layer)),
        slope(distance_at(x, max(y, 1u) - 1u, layer), distance_at(x, min(y + 1u, params.ny - 1u), layer)),
        slope(distance_at(x, y, max(layer, 1u) - 1u), distance_at(x, y, min(layer + 1u, params.layers - 1u))),
    );
    let z = params.first + layer;
    let place = vector(params.origin) + params.spacing_m * vec3<f32>(f32(x), f32(y), f32(z));
    var node = Node(0.0, 0.0, array<f32, 4>(0.0, 0.0, 0.0, 0.0));
    for (var view = 0u; view < params.views; view++) {
        let what = said(view, seen_from(view, x, y, z));
        if what.kind == FREE || dot(across, vector(cameras[view].eye) - place) >= 0.0 {
            add_said(&node, what, 2.0);
        }
    }
    if node.weight > 0.0 {
        nodes[i] = node;
    }
}
