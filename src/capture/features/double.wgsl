// Twice the size by linear interpolation: Plane::doubled.

struct Size { width: u32, height: u32 }

@group(0) @binding(0) var<storage, read> size: Size;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read_write> doubled: array<f32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = (group.y * groups.x + group.x) * 64u + local;
    if i >= 4u * size.width * size.height {
        return;
    }
    let x = i % (2u * size.width);
    let y = i / (2u * size.width);
    let left = x / 2u;
    let right = min((x + 1u) / 2u, size.width - 1u);
    let above = y / 2u * size.width;
    let below = min((y + 1u) / 2u, size.height - 1u) * size.width;
    let upper = image[above + left] + image[above + right];
    doubled[i] = 0.25 * (upper + image[below + left] + image[below + right]);
}
