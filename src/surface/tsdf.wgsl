// Weighted distances and colors of a volume's nodes: TsdfVolume::integrate.

@group(0) @binding(4) var<storage, read_write> nodes: array<Node>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = (group.y * groups.x + group.x) * 64u + local;
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
