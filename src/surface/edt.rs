//! Exact nearest-seed transform of a grid: for every node the closest seed node, one axis after the other by
//! lower envelopes of parabolas (Felzenszwalb and Huttenlocher 2012).

use rayon::prelude::*;

/// No seed.
pub(super) const NO_SEED: u32 = u32::MAX;

/// Index of the seed node nearest to each node (x fastest, then y, then z), [`NO_SEED`] where there is no
/// seed at all. Linear time; the result does not depend on the number of threads.
pub(super) fn nearest_seed(dims: [usize; 3], seeds: &[bool]) -> Vec<u32> {
    let [nx, ny, nz] = dims;
    let plane = nx * ny;
    let mut nearest = vec![NO_SEED; plane * nz];
    nearest.par_chunks_mut(plane.max(1)).enumerate().for_each(|(z, nearest)| {
        // Along x: the nearest seed of each row, before or behind a node.
        for y in 0..ny {
            let row = y * nx..(y + 1) * nx;
            nearest_in_row(
                &seeds[z * plane + row.start..][..nx],
                (z * plane + row.start) as u32,
                &mut nearest[row],
            );
        }
        // Along y, within the layer. Squares are whole numbers, exact in single precision.
        let mut envelope = Envelope::new(ny);
        for x in 0..nx {
            let seeds = (0..ny).map(|y| nearest[y * nx + x]);
            envelope.merge(seeds, |seed| ((seed as usize % nx) as f32 - x as f32).powi(2));
            envelope.read(|y, seed| nearest[y * nx + x] = seed);
        }
    });
    // Along z every xz plane is independent; each is computed on its own and put in place afterwards.
    let sides: Vec<Vec<u32>> = (0..ny)
        .into_par_iter()
        .map(|y| {
            let mut side = vec![NO_SEED; nx * nz];
            let mut envelope = Envelope::new(nz);
            for x in 0..nx {
                let seeds = (0..nz).map(|z| nearest[z * plane + y * nx + x]);
                envelope.merge(seeds, |seed| {
                    let s = seed as usize;
                    ((s % nx) as f32 - x as f32).powi(2) + ((s / nx % ny) as f32 - y as f32).powi(2)
                });
                envelope.read(|z, seed| side[z * nx + x] = seed);
            }
            side
        })
        .collect();
    nearest.par_chunks_mut(plane.max(1)).enumerate().for_each(|(z, nearest)| {
        for (y, side) in sides.iter().enumerate() {
            nearest[y * nx..(y + 1) * nx].copy_from_slice(&side[z * nx..(z + 1) * nx]);
        }
    });
    nearest
}

/// Nearest seed within one row; its first node has index `first`.
fn nearest_in_row(seeds: &[bool], first: u32, nearest: &mut [u32]) {
    let mut last = NO_SEED;
    for (x, seed) in seeds.iter().enumerate() {
        if *seed {
            last = first + x as u32;
        }
        nearest[x] = last;
    }
    let mut next = NO_SEED;
    for x in (0..seeds.len()).rev() {
        if seeds[x] {
            next = first + x as u32;
        }
        let at = first + x as u32;
        if next != NO_SEED && (nearest[x] == NO_SEED || next - at < at - nearest[x]) {
            nearest[x] = next;
        }
    }
}

/// The lower envelope along one line of nodes.
struct Envelope {
    length: usize,
    parabolas: Vec<Parabola>,
}

/// A parabola of an envelope.
struct Parabola {
    position: f32,
    height: f32,
    seed: u32,
    /// Position where it begins to be the lowest.
    begins: f32,
}

impl Envelope {
    fn new(length: usize) -> Self {
        Self { length, parabolas: Vec::with_capacity(length) }
    }

    /// Builds the envelope of parabolas at each position with the given heights.
    fn merge(&mut self, seeds: impl Iterator<Item = u32>, height: impl Fn(u32) -> f32) {
        self.parabolas.clear();
        for (position, seed) in seeds.enumerate() {
            if seed == NO_SEED {
                continue;
            }
            let q = position as f32;
            let f = height(seed);
            let mut begins = f32::NEG_INFINITY;
            while let Some(&Parabola { position: p, height: g, begins: other, .. }) = self.parabolas.last() {
                // A parabola that the new one undercuts before it becomes the lowest is never the lowest.
                let crossing = ((f + q * q) - (g + p * p)) / (2.0 * (q - p));
                if crossing > other {
                    begins = crossing;
                    break;
                }
                self.parabolas.pop();
            }
            self.parabolas.push(Parabola { position: q, height: f, seed, begins });
        }
    }

    /// Passes the seed of the lowest parabola at each position to `put`.
    fn read(&self, mut put: impl FnMut(usize, u32)) {
        if self.parabolas.is_empty() {
            return;
        }
        let mut k = 0;
        for position in 0..self.length {
            while k + 1 < self.parabolas.len() && self.parabolas[k + 1].begins < position as f32 {
                k += 1;
            }
            put(position, self.parabolas[k].seed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn squared(dims: [usize; 3], a: usize, b: usize) -> i64 {
        let c = |i: usize| [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])];
        (0..3).map(|k| (c(a)[k] as i64 - c(b)[k] as i64).pow(2)).sum()
    }

    proptest! {
        #[test]
        fn equals_brute_force(
            nx in 1..9usize,
            ny in 1..9usize,
            nz in 1..9usize,
            picks in prop::collection::vec(0..729usize, 1..12),
        ) {
            let dims = [nx, ny, nz];
            let count = nx * ny * nz;
            let mut seeds = vec![false; count];
            for p in picks {
                seeds[p % count] = true;
            }
            let nearest = nearest_seed(dims, &seeds);
            for i in 0..count {
                prop_assert!(seeds[nearest[i] as usize]);
                let least = (0..count).filter(|&s| seeds[s]).map(|s| squared(dims, i, s)).min().unwrap();
                prop_assert_eq!(squared(dims, i, nearest[i] as usize), least);
            }
        }
    }

    #[test]
    fn without_seeds_there_is_no_nearest() {
        assert!(nearest_seed([3, 4, 5], &[false; 60]).iter().all(|&s| s == NO_SEED));
    }
}
