//! Flat patches of a surface: regions grown from its flattest places (Rabbani et al. 2006).

use std::collections::VecDeque;

use nalgebra::Vector3;

/// Index of the flat patch of every sample. `beside` gives a sample's neighbors on its surface, `in_plane`
/// says whether two neighbors lie in one plane. A patch takes a neighbor that lies in one plane with one of
/// its samples if the neighbor's normal is less than `bend` off the patch's mean normal. Without that mean,
/// patches would grow around every rounded edge.
pub(crate) fn flat_patches<I: Iterator<Item = usize>>(
    normals: &[Vector3<f64>],
    bend: f64,
    beside: impl Fn(usize) -> I,
    in_plane: impl Fn(usize, usize) -> bool,
) -> Vec<u32> {
    let bends: Vec<f64> = (0..normals.len()).map(|i| mean_bend(normals, i, beside(i))).collect();
    let mut seeds: Vec<usize> = (0..normals.len()).collect();
    seeds.sort_by(|a, b| bends[*a].total_cmp(&bends[*b]).then(a.cmp(b)));
    let mut patches: Vec<Option<u32>> = vec![None; normals.len()];
    let mut count = 0;
    for seed in seeds {
        if patches[seed].is_some() {
            continue;
        }
        patches[seed] = Some(count);
        let mut sum = normals[seed];
        let mut border = VecDeque::from([seed]);
        while let Some(i) = border.pop_front() {
            for j in beside(i) {
                if patches[j].is_none() && in_plane(i, j) && (normals[j] - sum.normalize()).norm() < bend {
                    patches[j] = Some(count);
                    sum += normals[j];
                    border.push_back(j);
                }
            }
        }
        count += 1;
    }
    patches.into_iter().flatten().collect()
}

/// Mean squared change of the normal from a sample to its neighbors; infinite without neighbors, so such
/// a sample comes last and is a patch of its own.
fn mean_bend(normals: &[Vector3<f64>], sample: usize, neighbors: impl Iterator<Item = usize>) -> f64 {
    let bends = neighbors.map(|j| (normals[j] - normals[sample]).norm_squared());
    let (sum, count) = bends.fold((0.0, 0), |(sum, count), b| (sum + b, count + 1));
    if count > 0 { sum / f64::from(count) } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip that is flat, bends by a right angle over `bent` samples, and is flat again.
    fn strip(flat: usize, bent: usize) -> Vec<u32> {
        let angle = |i: usize| {
            let share = (i as f64 - flat as f64 + 1.0) / (bent as f64 + 1.0);
            std::f64::consts::FRAC_PI_2 * share.clamp(0.0, 1.0)
        };
        let count = 2 * flat + bent;
        let normals: Vec<Vector3<f64>> =
            (0..count).map(|i| Vector3::new(angle(i).sin(), 0.0, angle(i).cos())).collect();
        let beside = |i: usize| [i.checked_sub(1), Some(i + 1).filter(|j| *j < count)].into_iter().flatten();
        flat_patches(&normals, 0.35, beside, |i, j| (normals[i] - normals[j]).norm() < 0.35)
    }

    #[test]
    fn faces_about_a_rounded_edge_are_patches_of_their_own() {
        for bent in [1, 5, 20] {
            let patches = strip(30, bent);
            let first = patches[0];
            let second = patches[patches.len() - 1];
            assert!(first != second, "{bent}: {patches:?}");
            assert!(patches[..29].iter().all(|p| *p == first), "{bent}: {patches:?}");
            assert!(patches[patches.len() - 29..].iter().all(|p| *p == second), "{bent}: {patches:?}");
        }
    }
}
