//! Long arrays of numbers as pieces of raw bytes, for `#[serde(with = "bytes")]`: writing a volume number by
//! number would take longer than computing it again. Little-endian; a reader holds one piece in addition to
//! the array.

use std::{fmt, marker::PhantomData};

use nalgebra::{Point3, Scalar, Vector3};
use serde::{
    Deserialize, Deserializer, Serialize, Serializer,
    de::{Error as _, SeqAccess, Visitor},
    ser::SerializeSeq as _,
};
use serde_bytes::{ByteBuf, Bytes};

/// Most bytes of a piece.
pub const PIECE_BYTES: usize = 1 << 16;

/// A value of a fixed number of bytes; any bytes are a valid value.
pub trait Plain: Sized {
    /// Number of bytes.
    const BYTES: usize;
    /// Writes the value to a slice of this length.
    fn put(&self, slot: &mut [u8]);
    /// Reads a value from a slice of this length.
    fn get(slot: &[u8]) -> Self;
}

macro_rules! number {
    ($($t:ty),*) => {$(
        impl Plain for $t {
            const BYTES: usize = size_of::<$t>();
            fn put(&self, slot: &mut [u8]) {
                slot.copy_from_slice(&self.to_le_bytes());
            }
            fn get(slot: &[u8]) -> Self {
                let mut bytes = [0; Self::BYTES];
                bytes.copy_from_slice(slot);
                Self::from_le_bytes(bytes)
            }
        }
    )*};
}
number!(u8, u32, f32, f64);

impl Plain for bool {
    const BYTES: usize = 1;
    fn put(&self, slot: &mut [u8]) {
        slot[0] = u8::from(*self);
    }
    fn get(slot: &[u8]) -> Self {
        // Any byte is a valid bool, so a damaged file gives no invalid value.
        slot[0] != 0
    }
}

impl<T: Plain, const N: usize> Plain for [T; N] {
    const BYTES: usize = N * T::BYTES;
    fn put(&self, slot: &mut [u8]) {
        self.iter().zip(slot.chunks_exact_mut(T::BYTES)).for_each(|(value, slot)| value.put(slot));
    }
    fn get(slot: &[u8]) -> Self {
        std::array::from_fn(|k| T::get(&slot[k * T::BYTES..][..T::BYTES]))
    }
}

impl<T: Plain + Scalar> Plain for Vector3<T> {
    const BYTES: usize = 3 * T::BYTES;
    fn put(&self, slot: &mut [u8]) {
        self.iter().zip(slot.chunks_exact_mut(T::BYTES)).for_each(|(value, slot)| value.put(slot));
    }
    fn get(slot: &[u8]) -> Self {
        <[T; 3]>::get(slot).into()
    }
}

impl<T: Plain + Scalar> Plain for Point3<T> {
    const BYTES: usize = 3 * T::BYTES;
    fn put(&self, slot: &mut [u8]) {
        self.coords.put(slot);
    }
    fn get(slot: &[u8]) -> Self {
        <[T; 3]>::get(slot).into()
    }
}

/// Number of values in a piece.
const fn of_piece<T: Plain>() -> usize {
    PIECE_BYTES / T::BYTES
}

/// Writes an array.
///
/// # Errors
/// Those of the format.
pub fn serialize<T: Plain, S: Serializer>(values: &[T], serializer: S) -> Result<S::Ok, S::Error> {
    let pieces = values.chunks(of_piece::<T>());
    let mut seq = serializer.serialize_seq(Some(pieces.len()))?;
    let mut bytes = vec![0; PIECE_BYTES];
    for piece in pieces {
        let bytes = &mut bytes[..piece.len() * T::BYTES];
        bytes.chunks_exact_mut(T::BYTES).zip(piece).for_each(|(slot, value)| value.put(slot));
        seq.serialize_element(Bytes::new(bytes))?;
    }
    seq.end()
}

/// Reads an array.
///
/// # Errors
/// Those of the format, or a piece that ends within a value.
pub fn deserialize<'de, T: Plain, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    deserializer.deserialize_seq(Pieces(PhantomData))
}

struct Pieces<T>(PhantomData<T>);

impl<'de, T: Plain> Visitor<'de> for Pieces<T> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "pieces of values of {} bytes each", T::BYTES)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Vec<T>, A::Error> {
        // Grows with the bytes read, never by a claimed length.
        let mut values = Vec::new();
        while let Some(bytes) = seq.next_element::<ByteBuf>()? {
            let whole = bytes.chunks_exact(T::BYTES);
            if !whole.remainder().is_empty() {
                return Err(A::Error::custom("a value is cut"));
            }
            values.extend(whole.map(T::get));
        }
        // Excess memory reserved while growing would stay for the whole run.
        values.shrink_to_fit();
        Ok(values)
    }
}

/// The same for an optional array.
pub mod option {
    use super::{Deserialize, Deserializer, Plain, Serialize, Serializer};

    struct Whole<'a, T>(&'a [T]);

    impl<T: Plain> Serialize for Whole<'_, T> {
        fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
            super::serialize(self.0, serializer)
        }
    }

    #[derive(Deserialize)]
    #[serde(bound(deserialize = "T: Plain"))]
    struct Owned<T>(#[serde(with = "super")] Vec<T>);

    /// Writes an array or its absence.
    ///
    /// # Errors
    /// Those of the format.
    pub fn serialize<T: Plain, S: Serializer>(
        values: &Option<Vec<T>>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        values.as_deref().map(Whole).serialize(serializer)
    }

    /// Reads an array or its absence.
    ///
    /// # Errors
    /// Those of [`super::deserialize`].
    pub fn deserialize<'de, T: Plain, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<Vec<T>>, D::Error> {
        Ok(Option::<Owned<T>>::deserialize(deserializer)?.map(|owned| owned.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct All {
        #[serde(with = "super")]
        numbers: Vec<f32>,
        #[serde(with = "super")]
        points: Vec<Point3<f64>>,
        #[serde(with = "super")]
        colors: Vec<[u8; 3]>,
        #[serde(with = "super::option")]
        mask: Option<Vec<bool>>,
        #[serde(with = "super::option")]
        none: Option<Vec<u32>>,
    }

    fn all(count: usize) -> All {
        All {
            numbers: (0..count).map(|i| 0.1 * i as f32).collect(),
            points: (0..count).map(|i| Point3::new(i as f64, -0.3, f64::MAX)).collect(),
            colors: (0..count).map(|i| [i as u8, 1, 255]).collect(),
            mask: Some((0..count).map(|i| i % 3 == 0).collect()),
            none: None,
        }
    }

    #[test]
    fn arrays_come_back_whatever_their_length() {
        // 21845 colors of three bytes fill a piece but for one byte.
        for count in [0, 1, 21_845, 21_846, 100_000] {
            let bytes = postcard::to_stdvec(&all(count)).unwrap();
            assert_eq!(postcard::from_bytes::<All>(&bytes).unwrap(), all(count), "{count}");
            assert!(
                bytes.len() <= count * (4 + 24 + 3 + 1) + 200 * (1 + count / 100_000),
                "{count}: {} bytes",
                bytes.len()
            );
        }
    }

    #[test]
    fn bits_are_kept() {
        let values = vec![f32::NAN, -f32::NAN, -0.0, f32::INFINITY, f32::from_bits(1)];
        let bytes = postcard::to_stdvec(&All { numbers: values.clone(), ..all(0) }).unwrap();
        let bits = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&postcard::from_bytes::<All>(&bytes).unwrap().numbers), bits(&values));
    }

    #[test]
    fn a_length_that_is_not_there_reserves_nothing() {
        // 2^62 pieces, then nothing; a piece of three bytes for numbers of four.
        for bytes in
            [&[0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x40][..], &[1, 3, 1, 2, 3], &[1, 200, 1]]
        {
            assert!(postcard::from_bytes::<All>(bytes).is_err(), "{bytes:?}");
        }
    }
}
