//! Small islands of disparity are dropped.

/// Largest difference of neighbors on one island, pixels. chosen: a slanted surface stays whole
const STEP_PX: f32 = 1.0;

/// Sets islands of fewer than `least` pixels to `NAN`.
pub(super) fn drop_speckles(disparity: &mut [f32], width: usize, least: usize) {
    let mut is_visited = vec![false; disparity.len()];
    let mut island: Vec<usize> = Vec::new();
    for start in 0..disparity.len() {
        if is_visited[start] || disparity[start].is_nan() {
            continue;
        }
        island.clear();
        island.push(start);
        is_visited[start] = true;
        let mut next = 0;
        while next < island.len() {
            let i = island[next];
            next += 1;
            let x = i % width;
            let beside = [
                (x > 0).then(|| i - 1),
                (x + 1 < width).then_some(i + 1),
                i.checked_sub(width),
                Some(i + width).filter(|n| *n < disparity.len()),
            ];
            for n in beside.into_iter().flatten() {
                // A comparison with NAN is false.
                if !is_visited[n] && (disparity[n] - disparity[i]).abs() <= STEP_PX {
                    is_visited[n] = true;
                    island.push(n);
                }
            }
        }
        if island.len() < least {
            island.iter().for_each(|i| disparity[*i] = f32::NAN);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn islands_go_and_slopes_stay() {
        let width = 20;
        let mut disparity: Vec<f32> = (0..400).map(|i| 10.0 + 0.5 * (i % width) as f32).collect();
        for i in [105, 106, 125, 126] {
            disparity[i] = 40.0;
        }
        let whole = disparity.clone();
        drop_speckles(&mut disparity, width, 5);
        for i in 0..400 {
            let is_island = [105, 106, 125, 126].contains(&i);
            assert!(if is_island { disparity[i].is_nan() } else { disparity[i] == whole[i] });
        }
    }
}
