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
const LENGTH = 64u;
// Features closer than this are the same place, pixels.
const SAME_PLACE = 2.0;

@group(0) @binding(0) var<storage, read> tasks: array<Task>;
@group(0) @binding(1) var<storage, read> features: array<Feature>;
// Task of each group, and the first of its 64 features.
@group(0) @binding(2) var<storage, read> groups_of_tasks: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> found: array<Found>;

var<workgroup> shared_words: array<u32, 1024>;
var<workgroup> shared_places: array<vec2<f32>, 16>;

fn product(a: u32, b: u32) -> i32 {
    return extractBits(bitcast<i32>(a), 0u, 16u) * extractBits(bitcast<i32>(b), 0u, 16u)
        + extractBits(bitcast<i32>(a), 16u, 16u) * extractBits(bitcast<i32>(b), 16u, 16u);
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
    var words: array<u32, 64>;
    for (var k = 0u; k < LENGTH; k++) {
        words[k] = features[own].words[k];
    }
    var best = Found(0u, -1, 0);
    var place = vec2<f32>(0.0);
    // Once for the best, once for the best at another place.
    for (var look = 0u; look < 2u; look++) {
        for (var begin = 0u; begin < task.partner_count; begin += SHARED) {
            let count = min(SHARED, task.partner_count - begin);
            workgroupBarrier();
            for (var k = local; k < count * LENGTH; k += 64u) {
                shared_words[k] = features[task.partners + begin + k / LENGTH].words[k % LENGTH];
            }
            if local < count {
                let partner = task.partners + begin + local;
                shared_places[local] = vec2<f32>(features[partner].u, features[partner].v);
            }
            workgroupBarrier();
            for (var j = 0u; j < count; j++) {
                var sum = 0;
                for (var k = 0u; k < LENGTH; k++) {
                    sum += product(words[k], shared_words[j * LENGTH + k]);
                }
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
