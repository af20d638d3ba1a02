// Convolves an image with half of an even kernel along rows or columns; the border pixel repeats outside:
// `convolve` of scale_space.rs.

struct Blur {
    width: u32, height: u32,
    // Where the image begins in its buffer, and what it becomes in its own.
    start: u32, blurred_start: u32,
    // Where the kernel begins among all, and its radius.
    weights_start: u32, radius: u32,
    // 1 along rows, 0 along columns.
    along_rows: u32,
}

@group(0) @binding(0) var<storage, read> blur: Blur;
@group(0) @binding(1) var<storage, read> weights: array<f32>;
@group(0) @binding(2) var<storage, read> image: array<f32>;
@group(0) @binding(3) var<storage, read_write> blurred: array<f32>;

fn work(i: u32) {
    if i >= blur.width * blur.height {
        return;
    }
    let rows = blur.along_rows == 1u;
    // Pixels before and after this one, and how far each is from the next in the buffer.
    let before = select(i / blur.width, i % blur.width, rows);
    let after = select(blur.height, blur.width, rows) - 1u - before;
    let apart = select(blur.width, 1u, rows);
    let middle = blur.start + i;
    var sum = weights[blur.weights_start] * image[middle];
    for (var j = 1u; j <= blur.radius; j++) {
        let both = image[middle - min(j, before) * apart] + image[middle + min(j, after) * apart];
        sum += weights[blur.weights_start + j] * both;
    }
    blurred[blur.blurred_start + i] = sum;
}
