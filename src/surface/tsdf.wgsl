// Weighted distances and colors of a volume's nodes: TsdfVolume::integrate.

@group(0) @binding(4) var<storage, read_write> nodes: array<Node>;

fn work(i: u32) {
    if i >= params.nx * params.ny * params.layers {
        return;
    }
    let x = i % params.nx;
    let y = i / params.nx % params.ny;
    let z = params.first + i / (params.nx * params.ny);
    var node = Node(0.0, 0.0, array<f32, 4>(0.0, 0.0, 0.0, 0.0));
    for (var view = 0u; view < params.views; view++) {
        add_said(&node, said(view, seen_from(view, x, y, z)), 1.0);
    }
    nodes[i] = node;
}
