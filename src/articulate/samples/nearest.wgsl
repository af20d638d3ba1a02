// The sample nearest to each sample of another surface under a motion: SampleIndex::nearest for a GPU.
// Places are from the first corner of each surface's own index.

struct Params {
    // Rotation, row by row, and shift of the motion, from the queries' corner to that of the searched.
    rotation: array<f32, 9>,
    shift: array<f32, 3>,
    cell_m: f32,
    reach_m: f32,
    dims: array<u32, 3>,
    queries: u32,
}

struct Sample { point: array<f32, 3>, normal: array<f32, 3> }

const NONE = 0xffffffffu;

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> queries: array<Sample>;
@group(0) @binding(2) var<storage, read> samples: array<Sample>;
// Samples of each cell: where its list begins, and the lists.
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read> entries: array<u32>;
@group(0) @binding(5) var<storage, read_write> partners: array<u32>;

fn vector(v: array<f32, 3>) -> vec3<f32> {
    return vec3<f32>(v[0], v[1], v[2]);
}

fn turned(v: vec3<f32>) -> vec3<f32> {
    let r = params.rotation;
    return vec3<f32>(
        r[0] * v.x + r[1] * v.y + r[2] * v.z,
        r[3] * v.x + r[4] * v.y + r[5] * v.z,
        r[6] * v.x + r[7] * v.y + r[8] * v.z,
    );
}

fn work(i: u32) {
    if i >= params.queries {
        return;
    }
    let point = turned(vector(queries[i].point)) + vector(params.shift);
    let normal = turned(vector(queries[i].normal));
    let cell = vec3<i32>(floor(clamp(point / params.cell_m, vec3<f32>(-2.0), vec3<f32>(1e7))));
    let bend = 0.25 * params.reach_m * params.reach_m;
    let dims = vec3<i32>(i32(params.dims[0]), i32(params.dims[1]), i32(params.dims[2]));
    let low = max(cell - 1, vec3<i32>(0));
    let high = min(cell + 1, dims - 1);
    var best = NONE;
    var best_squared = params.reach_m * params.reach_m;
    if low.x <= high.x {
        for (var z = low.z; z <= high.z; z++) {
            for (var y = low.y; y <= high.y; y++) {
                let row = dims.x * (y + dims.y * z);
                // The samples of a row of cells lie side by side.
                for (var k = starts[row + low.x]; k < starts[row + high.x + 1]; k++) {
                    let j = entries[k];
                    let away = vector(samples[j].point) - point;
                    let squared = dot(away, away);
                    if squared < best_squared {
                        let change = vector(samples[j].normal) - normal;
                        let with_normal = squared + bend * dot(change, change);
                        if with_normal < best_squared {
                            best = j;
                            best_squared = with_normal;
                        }
                    }
                }
            }
        }
    }
    partners[i] = best;
}
