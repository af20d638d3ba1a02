//! One user seed, one independent random stream per stage and step.

use rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// The stream of a step of a stage. Streams of other stages and steps are unrelated, so a resumed run draws what an
/// uninterrupted one would, and adding a stage leaves the others as they were.
#[must_use]
pub fn stage_rng(seed: u64, stage: &str, step: u64) -> Pcg64Mcg {
    let name = stage.bytes().fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
    let mut bytes = [0; 16];
    bytes[..8].copy_from_slice(&mix(seed ^ mix(name)).to_le_bytes());
    bytes[8..].copy_from_slice(&mix(name ^ mix(step)).to_le_bytes());
    Pcg64Mcg::from_seed(bytes)
}

/// SplitMix64's finaliser.
pub(super) fn mix(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::Rng;

    #[test]
    fn streams_are_repeatable_and_distinct() {
        let first = |s, n, k| stage_rng(s, n, k).next_u64();
        assert_eq!(first(7, "field/state0", 3), first(7, "field/state0", 3));
        for other in
            [first(8, "field/state0", 3), first(7, "field/state1", 3), first(7, "field/state0", 4), first(7 + (1 << 40), "field/state0", 3)]
        {
            assert_ne!(first(7, "field/state0", 3), other);
        }
    }
}
