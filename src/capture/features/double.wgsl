// Twice the size by linear interpolation: Plane::doubled.

struct Size { width: u32, height: u32 }

@group(0) @binding(0) var<storage, read> size: Size;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read_write> doubled: array<f32>;

fn work(i: u32) {
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
