// Every second pixel of every second row of an image: Plane::halved.

struct Halving {
    // Width of the image, and where it begins.
    width: u32, start: u32,
    // Size of the half, and where it begins.
    half_width: u32, half_height: u32, half_start: u32,
}

@group(0) @binding(0) var<storage, read> halving: Halving;
@group(0) @binding(1) var<storage, read_write> images: array<f32>;

fn work(i: u32) {
    if i >= halving.half_width * halving.half_height {
        return;
    }
    let x = i % halving.half_width;
    let y = i / halving.half_width;
    images[halving.half_start + i] = images[halving.start + 2u * y * halving.width + 2u * x];
}
