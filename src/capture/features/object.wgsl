// The blurred images of a crop, and which of its pixels lie on the object: Crop and Plan for a GPU.

// All octaves, of each all images, row by row.
@group(0) @binding(0) var<storage, read> images: array<f32>;
// Width and height of the crop; then four pixels a word: 0 beside the object, 1 on it, 2 where features may
// be.
@group(0) @binding(1) var<storage, read> object: array<u32>;

const ON_OBJECT = 1u;
const INNER = 2u;

// What the pixel of the crop is that is nearest to a pixel of an octave.
fn object_at(x: u32, y: u32, step: f32) -> u32 {
    let u = u32(f32(x) * step + 0.5);
    let v = u32(f32(y) * step + 0.5);
    if u >= object[0] || v >= object[1] {
        return 0u;
    }
    let pixel = v * object[0] + u;
    return object[2u + pixel / 4u] >> (8u * (pixel % 4u)) & 255u;
}
