//! Limits how much a bag may unpack to.

use std::io::{self, Read};

use common::limits::{CHUNK_FREE, EXPANDED_FREE, EXPANSION};

/// A bag exceeds the limit of decompressed bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ExpansionError {
    /// One piece of it does.
    #[error("{packed} bytes would unpack to {unpacked}, more than the limit of {most}")]
    Piece {
        /// Its compressed size, bytes.
        packed: u64,
        /// Its stated decompressed size.
        unpacked: u64,
        /// The allowed decompressed size.
        most: u64,
    },
    /// All pieces together do.
    #[error(
        "the bag unpacks to more than {total} bytes, {EXPANSION} times its size; cut it with `ros2 bag \
         convert`"
    )]
    Bag {
        /// The allowed decompressed size of the bag.
        total: u64,
    },
}

/// How many decompressed bytes one reading of a bag may still produce.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Expansion {
    total: u64,
    left: u64,
}

impl Expansion {
    /// The budget for a bag of `bytes` bytes.
    #[must_use]
    pub const fn of(bytes: u64) -> Self {
        let total = EXPANDED_FREE.saturating_add(bytes.saturating_mul(EXPANSION));
        Self { total, left: total }
    }

    /// Takes the stated decompressed size of a piece from the budget.
    ///
    /// # Errors
    /// If it is far more than its bytes can hold, or all pieces together exceed the budget.
    pub fn take(&mut self, packed: u64, unpacked: u64) -> Result<(), ExpansionError> {
        // Each piece is limited by itself too: one chunk must not claim the budget of the whole bag.
        let most = CHUNK_FREE.saturating_add(packed.saturating_mul(EXPANSION));
        if unpacked > most {
            return Err(ExpansionError::Piece { packed, unpacked, most });
        }
        // The stated size is taken; the reader checks that the chunk unpacks to no more.
        self.left = self.left.checked_sub(unpacked).ok_or(self.exhausted())?;
        Ok(())
    }

    fn exhausted(&self) -> ExpansionError {
        ExpansionError::Bag { total: self.total }
    }
}

/// Unpacks a chunk of a stated size into `content`, which keeps what came before an error.
///
/// # Errors
/// Those of the decoder.
pub fn unpack<R: Read>(decoder: io::Result<R>, size: u64, content: &mut Vec<u8>) -> io::Result<()> {
    // One byte beyond the stated size shows that there is more, and no more than that is unpacked.
    decoder?.take(size + 1).read_to_end(content)?;
    Ok(())
}

/// A decompressed stream that fails when the budget is used up.
pub struct Within<'a, R> {
    /// The stream.
    pub source: R,
    /// The budget.
    pub expansion: &'a mut Expansion,
}

impl<R: Read> Read for Within<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // Counted as they come: a zstd stream need not state its size.
        let count = self.source.read(buffer)?;
        match self.expansion.left.checked_sub(count as u64) {
            Some(left) => self.expansion.left = left,
            None => return Err(io::Error::other(self.expansion.exhausted())),
        }
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bag_unpacks_to_so_much_and_no_more() {
        let mut expansion = Expansion::of(1 << 20);
        let why = expansion.take(20_000, 256 << 20).unwrap_err().to_string();
        assert!(why.contains("20000 bytes would unpack to 268435456"), "{why}");
        assert_eq!(expansion, Expansion::of(1 << 20));
        // 1 GiB and 256 MiB, in chunks of 16 MiB that hold next to nothing.
        for _ in 0..80 {
            expansion.take(0, 16 << 20).unwrap();
        }
        assert!(matches!(expansion.take(1, 1), Err(ExpansionError::Bag { .. })));
        let mut within =
            Within { source: io::repeat(0).take(10), expansion: &mut Expansion { total: 4, left: 4 } };
        assert!(within.read_exact(&mut [0; 4]).is_ok());
        assert!(within.read_exact(&mut [0; 1]).unwrap_err().to_string().contains("more than 4 bytes"));
    }
}
