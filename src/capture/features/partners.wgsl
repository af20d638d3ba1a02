// The best partner of each feature and the best one at another place: matcher.rs for a GPU. A group
// compares 64 features of an image with all of another one, of which 16 at a time are shared.

// Features of two images, as ranges of all, that are compared, and where what is found of the first of them
// goes.
struct Task { first: u32, count: u32, partners: u32, partner_count: u32, found: u32 }

// Position, pixels, and descriptor, two numbers of 16 bits a word.
struct Feature { u: f32, v: f32, words: array<u32, 64> }

// Number of the best partner, its inner product, and that of the best one at another place.
struct Found { best: u32, top: i32, second: i32 }

const SHARED = 16u;
// Words of a descriptor in fours.
const QUARTER = 16u;
// Features closer than this are the same place, pixels.
const SAME_PLACE = 2.0;

@group(0) @binding(0) var<storage, read> tasks: array<Task>;
@group(0) @binding(1) var<storage, read> features: array<Feature>;
// Task of each group, and the first of its 64 features.
@group(0) @binding(2) var<storage, read> groups_of_tasks: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> found: array<Found>;

var<workgroup> shared_words: array<vec4<u32>, 256>;
var<workgroup> shared_places: array<vec2<f32>, 16>;

fn four_words(feature: u32, k: u32) -> vec4<u32> {
    let first = 4u * k;
    return vec4<u32>(
        features[feature].words[first], features[feature].words[first + 1u],
        features[feature].words[first + 2u], features[feature].words[first + 3u],
    );
}

// Inner product of eight numbers.
fn products(a: vec4<u32>, b: vec4<u32>) -> i32 {
    let p = bitcast<vec4<i32>>(a);
    let q = bitcast<vec4<i32>>(b);
    let low = extractBits(p, 0u, 16u) * extractBits(q, 0u, 16u);
    let sums = low + extractBits(p, 16u, 16u) * extractBits(q, 16u, 16u);
    return sums.x + sums.y + sums.z + sums.w;
}

// That of a descriptor with a shared one. Written out: some drivers end a thread's loops after 65,536
// rounds in all.
fn product(words: array<vec4<u32>, 16>, number: u32) -> i32 {
    let first = number * QUARTER;
    return products(words[0], shared_words[first + 0u])
        + products(words[1], shared_words[first + 1u])
        + products(words[2], shared_words[first + 2u])
        + products(words[3], shared_words[first + 3u])
        + products(words[4], shared_words[first + 4u])
        + products(words[5], shared_words[first + 5u])
        + products(words[6], shared_words[first + 6u])
        + products(words[7], shared_words[first + 7u])
        + products(words[8], shared_words[first + 8u])
        + products(words[9], shared_words[first + 9u])
        + products(words[10], shared_words[first + 10u])
        + products(words[11], shared_words[first + 11u])
        + products(words[12], shared_words[first + 12u])
        + products(words[13], shared_words[first + 13u])
        + products(words[14], shared_words[first + 14u])
        + products(words[15], shared_words[first + 15u]);
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let number = group.y * groups.x + group.x;
    // The same for all threads of a group, which meet at the barriers.
    if number >= arrayLength(&groups_of_tasks) {
        return;
    }
    let of_task = groups_of_tasks[number];
    let task = tasks[of_task.x];
    let i = of_task.y + local;
    let is_feature = i < task.count;
    let own = task.first + select(0u, i, is_feature);
    var words: array<vec4<u32>, 16>;
    for (var k = 0u; k < QUARTER; k++) {
        words[k] = four_words(own, k);
    }
    var best = Found(0u, -1, 0);
    var place = vec2<f32>(0.0);
    // Once for the best, once for the best at another place.
    for (var look = 0u; look < 2u; look++) {
        for (var begin = 0u; begin < task.partner_count; begin += SHARED) {
            let count = min(SHARED, task.partner_count - begin);
            workgroupBarrier();
            for (var k = local; k < count * QUARTER; k += 64u) {
                shared_words[k] = four_words(task.partners + begin + k / QUARTER, k % QUARTER);
            }
            if local < count {
                let partner = task.partners + begin + local;
                shared_places[local] = vec2<f32>(features[partner].u, features[partner].v);
            }
            workgroupBarrier();
            for (var j = 0u; j < count; j++) {
                let sum = product(words, j);
                if look == 0u {
                    if sum > best.top {
                        best = Found(begin + j, sum, 0);
                        place = shared_places[j];
                    }
                } else {
                    let away = abs(shared_places[j] - place);
                    if away.x > SAME_PLACE || away.y > SAME_PLACE {
                        best.second = max(best.second, sum);
                    }
                }
            }
        }
    }
    if is_feature {
        found[task.found + i] = best;
    }
}
