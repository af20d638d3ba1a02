//! RVL, a run-length and variable-length code for depth images.
//!
//! A. D. Wilson, "Fast Lossless Depth Image Compression", ISS 2017. Pixels alternate between runs of zeros
//! and of nonzero values; a run is stored as its length, nonzero values as zigzag differences; every number
//! is a sequence of nibbles with three bits each, low bits first, and a continuation bit; nibbles fill 32-bit
//! little-endian words from the top.

/// Why a code does not fit the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RvlError {
    /// More zeros than the image has pixels left.
    #[error("a run of zeros leaves the image")]
    Zeros,
    /// More values than the image has pixels left.
    #[error("a run of values leaves the image")]
    Values,
    /// Neither zeros nor values.
    #[error("an empty run")]
    Empty,
    /// Beyond 0 to 65535.
    #[error("a value leaves 16 bits ({0})")]
    Range(#[from] std::num::TryFromIntError),
    /// Fewer pixels than the image has.
    #[error("the code ends before the image does")]
    Cut,
    /// Too many nibbles.
    #[error("a number is longer than 32 bits")]
    Long,
}

/// Decodes `count` pixels.
///
/// # Errors
/// [`RvlError`].
pub fn decode(data: &[u8], count: usize) -> Result<Vec<u16>, RvlError> {
    let mut nibbles = Nibbles { data, next: 0 };
    // Limited by the bytes at hand, as `count` is claimed by the message.
    let mut pixels = Vec::with_capacity(count.min(data.len().saturating_mul(8)));
    let mut previous = 0i32;
    while pixels.len() < count {
        let zeros = nibbles.number()? as usize;
        if zeros > count - pixels.len() {
            return Err(RvlError::Zeros);
        }
        pixels.resize(pixels.len() + zeros, 0);
        let values = nibbles.number()? as usize;
        if values > count - pixels.len() {
            return Err(RvlError::Values);
        }
        if zeros == 0 && values == 0 && pixels.len() < count {
            return Err(RvlError::Empty);
        }
        for _ in 0..values {
            // Zigzag puts 0, -1, 1, -2, ... on 0, 1, 2, 3, ...: small differences of both signs take one
            // nibble. `previous` goes on across zeros, so a surface behind a hole costs little.
            let zigzag = nibbles.number()?;
            let delta = (zigzag >> 1) as i32 ^ -((zigzag & 1) as i32);
            previous = previous.wrapping_add(delta);
            pixels.push(u16::try_from(previous)?);
        }
    }
    Ok(pixels)
}

/// Encodes pixels; the inverse of [`decode`].
#[must_use]
pub fn encode(pixels: &[u16]) -> Vec<u8> {
    let mut nibbles = Vec::new();
    let mut previous = 0i32;
    let mut rest = pixels;
    while !rest.is_empty() {
        let zeros = rest.iter().take_while(|p| **p == 0).count();
        let values = rest[zeros..].iter().take_while(|p| **p != 0).count();
        push_number(&mut nibbles, zeros as u32);
        push_number(&mut nibbles, values as u32);
        for pixel in &rest[zeros..zeros + values] {
            let delta = i32::from(*pixel) - previous;
            push_number(&mut nibbles, (delta << 1 ^ delta >> 31) as u32);
            previous = i32::from(*pixel);
        }
        rest = &rest[zeros + values..];
    }
    let word =
        |chunk: &[u8]| chunk.iter().enumerate().fold(0u32, |w, (i, n)| w | u32::from(*n) << (28 - 4 * i));
    nibbles.chunks(8).flat_map(|chunk| word(chunk).to_le_bytes()).collect()
}

fn push_number(nibbles: &mut Vec<u8>, mut number: u32) {
    loop {
        let more = if number > 7 { 8 } else { 0 };
        nibbles.push((number & 7) as u8 | more);
        number >>= 3;
        if more == 0 {
            return;
        }
    }
}

struct Nibbles<'a> {
    data: &'a [u8],
    next: usize,
}

impl Nibbles<'_> {
    fn nibble(&mut self) -> Result<u8, RvlError> {
        // The first nibble of a word lies in the top half of its last byte.
        let word = self.next / 8;
        let place = self.next % 8;
        let byte = self.data.get(word * 4 + 3 - place / 2).ok_or(RvlError::Cut)?;
        self.next += 1;
        Ok(if place % 2 == 0 { byte >> 4 } else { byte & 15 })
    }

    fn number(&mut self) -> Result<u32, RvlError> {
        let mut number = 0;
        for shift in (0..32).step_by(3) {
            let nibble = self.nibble()?;
            number |= u32::from(nibble & 7) << shift;
            if nibble & 8 == 0 {
                return Ok(number);
            }
        }
        Err(RvlError::Long)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// By hand: 2 zeros, 3 values 5 7 6 (differences +5 +2 -1, zigzag 10 4 1), 1 zero, 0 values: the numbers
    /// 2 3 10 4 1 1 0 are the nibbles 2 3 a1 4 1 1 0, the word 0x23a14110.
    #[test]
    fn a_known_code() {
        let pixels = [0, 0, 5, 7, 6, 0];
        let code = [0x10, 0x41, 0xa1, 0x23];
        assert_eq!(encode(&pixels), code);
        assert_eq!(decode(&code, 6).unwrap(), pixels);
    }

    proptest! {
        #[test]
        fn decoding_inverts_encoding(
            pixels in prop::collection::vec(
                prop_oneof![Just(0u16), Just(65535), 500..520u16, any::<u16>()],
                1..400,
            ),
        ) {
            prop_assert_eq!(decode(&encode(&pixels), pixels.len()).unwrap(), pixels);
        }

        #[test]
        fn nonsense_is_an_error_or_an_image(
            data in prop::collection::vec(any::<u8>(), 0..64),
            count in 1..200usize,
        ) {
            if let Ok(pixels) = decode(&data, count) {
                prop_assert_eq!(pixels.len(), count);
            }
        }
    }

    #[test]
    fn a_code_that_ends_early_is_refused() {
        let code = encode(&[1000; 50]);
        assert!(decode(&code[..8], 50).is_err());
        assert!(decode(&code, 40).is_err());
    }
}
