// Gradients about places of blurred images: Gradients of descriptor.rs for a GPU.

struct Place {
    // Where the image begins, and its size.
    start: u32, width: u32, height: u32,
    // Where what is found goes.
    found: u32,
    // Pixels of the crop per pixel of the image.
    step: f32,
    x: f32, y: f32,
    // Standard deviation of the Gaussian about the place.
    sigma: f32,
    // Half side of the window, or length of a cell.
    reach: f32,
    angle: f32,
}

@group(0) @binding(2) var<storage, read> places: array<Place>;
@group(0) @binding(3) var<storage, read_write> found: array<f32>;

const HALF_TURN = 3.14159265;
const TURN = 6.28318531;

// An angle brought to [0, 2 pi).
fn in_circle(angle: f32) -> f32 {
    let positive = select(angle, angle + TURN, angle < 0.0);
    return select(positive, positive - TURN, positive >= TURN);
}

// The angle of a vector in [0, 2 pi), by the polynomial of descriptor.rs.
fn direction(dx: f32, dy: f32) -> f32 {
    let x = abs(dx);
    let y = abs(dy);
    let t = min(x, y) / max(max(x, y), 1.17549435e-38);
    let s = t * t;
    var p = 0.0028662257 * s - 0.016165737;
    p = (p * s + 0.042909614) * s - 0.07528964;
    p = (p * s + 0.10656264) * s - 0.142089;
    p = (p * s + 0.19993551) * s - 0.33333145;
    let first = t + t * s * p;
    let upright = select(first, 0.5 * HALF_TURN - first, y > x);
    let upper = select(upright, HALF_TURN - upright, dx < 0.0);
    return in_circle(select(upper, -upper, dy < 0.0));
}

// First and last inner pixel of so many within a distance of a coordinate; none where the last is smaller.
fn near(middle: f32, distance: f32, count: u32) -> vec2<i32> {
    let last = min(floor(middle + distance), f32(count) - 2.0);
    return vec2<i32>(i32(max(ceil(middle - distance), 1.0)), i32(last));
}

// Magnitude of the gradient of an inner pixel of a place's image, less by the Gaussian, and its direction.
fn gradient(place: Place, x: u32, y: u32) -> vec2<f32> {
    if object_at(x, y, place.step) < ON_OBJECT {
        return vec2<f32>(0.0);
    }
    let i = place.start + y * place.width + x;
    let dx = images[i + 1u] - images[i - 1u];
    let dy = images[i + place.width] - images[i - place.width];
    let right = f32(x) - place.x;
    let below = f32(y) - place.y;
    let share = exp(-(right * right + below * below) / (2.0 * place.sigma * place.sigma));
    return vec2<f32>(sqrt(dx * dx + dy * dy) * share, direction(dx, dy));
}
