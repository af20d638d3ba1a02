// Pixels of an octave's differences above or below all around them, and the samples near which their extrema
// are: `extrema` and `refined` of feature.rs, a thread a pixel of a level.

struct Search {
    // Numbers of the crop and of its octave.
    crop: u32, octave: u32,
    // Where the images of the octave begin, and their size.
    start: u32, width: u32, height: u32,
    scales: u32,
    // Most samples on the way to an extremum.
    steps: u32,
    // Pixels of the crop per pixel of the octave.
    step: f32,
    weakest: f32,
    // Offset by which an extremum still belongs to a sample.
    farthest: f32,
}

// Levels, rows and columns come in this order, by which candidates are sorted.
struct Candidate {
    crop: u32, octave: u32,
    level: u32, y: u32, x: u32,
    // Column, row and level of the sample near which the extremum is.
    sample: array<u32, 3>,
    // Differences around the sample: by level, then row, then column.
    values: array<f32, 27>,
}

// More may be counted than there is room for.
struct Candidates { count: atomic<u32>, list: array<Candidate> }

@group(0) @binding(2) var<storage, read> search: Search;
@group(0) @binding(3) var<storage, read_write> candidates: Candidates;

fn difference(level: u32, pixel: u32) -> f32 {
    let plane = search.width * search.height;
    let i = search.start + level * plane + pixel;
    return images[i + plane] - images[i];
}

fn is_extremum(level: u32, pixel: u32, value: f32) -> bool {
    let way = sign(value);
    for (var l = level - 1u; l <= level + 1u; l++) {
        for (var y = 0u; y < 3u; y++) {
            let first = pixel + y * search.width - search.width - 1u;
            for (var x = 0u; x < 3u; x++) {
                if way * difference(l, first + x) > way * value {
                    return false;
                }
            }
        }
    }
    return true;
}

fn around(sample: vec3<u32>) -> array<f32, 27> {
    var values: array<f32, 27>;
    let first = (sample.y - 1u) * search.width + sample.x - 1u;
    for (var k = 0u; k < 27u; k++) {
        values[k] = difference(sample.z - 1u + k / 9u, first + k / 3u % 3u * search.width + k % 3u);
    }
    return values;
}

// Where the extremum of the quadratic through the values lies from the sample, as the offset times the last
// number, which is not negative: no division.
fn offset(values: array<f32, 27>) -> vec4<f32> {
    let v = values;
    let gradient = 0.5 * vec3<f32>(v[14] - v[12], v[16] - v[10], v[22] - v[4]);
    let xx = v[14] + v[12] - 2.0 * v[13];
    let yy = v[16] + v[10] - 2.0 * v[13];
    let ll = v[22] + v[4] - 2.0 * v[13];
    let xy = 0.25 * (v[17] - v[11] - v[15] + v[9]);
    let xl = 0.25 * (v[23] - v[5] - v[21] + v[3]);
    let yl = 0.25 * (v[25] - v[7] - v[19] + v[1]);
    let a = vec3<f32>(xx, xy, xl);
    let b = vec3<f32>(xy, yy, yl);
    let c = vec3<f32>(xl, yl, ll);
    let bc = cross(b, c);
    let determinant = dot(a, bc);
    let times = gradient.x * bc + gradient.y * cross(c, a) + gradient.z * cross(a, b);
    return vec4<f32>(select(times, -times, determinant > 0.0), abs(determinant));
}

fn append(level: u32, pixel: vec2<u32>, sample: vec3<u32>, values: array<f32, 27>) {
    let i = atomicAdd(&candidates.count, 1u);
    if i < arrayLength(&candidates.list) {
        let samples = array<u32, 3>(sample.x, sample.y, sample.z);
        candidates.list[i] =
            Candidate(search.crop, search.octave, level, pixel.y, pixel.x, samples, values);
    }
}

fn work(i: u32) {
    let plane = search.width * search.height;
    if i >= plane * search.scales {
        return;
    }
    let level = 1u + i / plane;
    let pixel = i % plane;
    let x = pixel % search.width;
    let y = pixel / search.width;
    if x == 0u || y == 0u || x + 1u == search.width || y + 1u == search.height {
        return;
    }
    let value = difference(level, pixel);
    if !(abs(value) > search.weakest) || !is_extremum(level, pixel, value)
        || object_at(x, y, search.step) != INNER {
        return;
    }
    let last = vec3<i32>(vec3<u32>(search.width - 2u, search.height - 2u, search.scales));
    var sample = vec3<u32>(x, y, level);
    for (var k = 0u; k < search.steps; k++) {
        let values = around(sample);
        let away = offset(values);
        let far = abs(away.xyz);
        if max(far.x, max(far.y, far.z)) <= search.farthest * away.w {
            // Flat values have no extremum.
            if away.w > 0.0 {
                append(level, vec2<u32>(x, y), sample, values);
            }
            return;
        }
        let moves = select(vec3<f32>(0.0), sign(away.xyz), far >= vec3<f32>(0.5 * away.w));
        let next = vec3<i32>(sample) + vec3<i32>(moves);
        if any(next < vec3<i32>(1)) || any(next > last) {
            return;
        }
        sample = vec3<u32>(next);
    }
}
