//! A fast 64-bit checksum against damage, not against malice.

use numeric::random::mix;

/// FNV-1a over words of 8 bytes, finished by SplitMix64. Splitting the input differently does not change the
/// value.
#[derive(Clone, Copy, Debug)]
pub struct Checksum {
    state: u64,
    pending: [u8; 8],
    length: u64,
}

impl Default for Checksum {
    fn default() -> Self {
        Self { state: 0xcbf2_9ce4_8422_2325, pending: [0; 8], length: 0 }
    }
}

impl Checksum {
    /// Adds bytes.
    pub fn update(&mut self, mut bytes: &[u8]) {
        let filled = (self.length % 8) as usize;
        self.length += bytes.len() as u64;
        if filled > 0 {
            let taken = bytes.len().min(8 - filled);
            self.pending[filled..filled + taken].copy_from_slice(&bytes[..taken]);
            bytes = &bytes[taken..];
            if filled + taken < 8 {
                return;
            }
            self.word(self.pending);
        }
        let (words, rest) = bytes.as_chunks::<8>();
        words.iter().for_each(|w| self.word(*w));
        self.pending = [0; 8];
        self.pending[..rest.len()].copy_from_slice(rest);
    }

    /// The checksum of everything added so far.
    #[must_use]
    pub fn value(&self) -> u64 {
        let mut last = *self;
        last.word(self.pending);
        // `pending` is filled up with zeros: the length distinguishes them from zeros that were added.
        mix(last.state ^ self.length)
    }

    fn word(&mut self, word: [u8; 8]) {
        // The rotation lets high bits reach low ones, which a product alone never does.
        self.state =
            (self.state ^ u64::from_le_bytes(word)).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(29);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(pieces: &[&[u8]]) -> u64 {
        let mut sum = Checksum::default();
        pieces.iter().for_each(|p| sum.update(p));
        sum.value()
    }

    #[test]
    fn pieces_do_not_matter_and_every_bit_does() {
        let bytes: Vec<u8> = (0..100u8).collect();
        let whole = of(&[&bytes]);
        for cut in 0..bytes.len() {
            assert_eq!(of(&[&bytes[..cut], &bytes[cut..]]), whole);
            assert_ne!(of(&[&bytes[..cut]]), whole);
            for bit in 0..8 {
                let mut flipped = bytes.clone();
                flipped[cut] ^= 1 << bit;
                assert_ne!(of(&[&flipped]), whole, "byte {cut} bit {bit}");
            }
        }
        assert_ne!(of(&[&[0; 8]]), of(&[&[0; 16]]));
        assert_ne!(of(&[&[]]), of(&[&[0]]));
    }
}
