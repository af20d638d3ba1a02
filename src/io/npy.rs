//! NumPy `.npy` files with a two-dimensional array of numbers.

use std::path::Path;

use common::files;
use common::limits::NPY;

/// A two-dimensional array, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct NpyArray {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// `rows * columns` values.
    pub values: Vec<f64>,
}

impl NpyArray {
    /// One row.
    #[must_use]
    pub fn row(&self, row: usize) -> &[f64] {
        &self.values[row * self.columns..(row + 1) * self.columns]
    }
}

/// Why an array could not be read.
#[derive(Debug, thiserror::Error)]
pub enum NpyError {
    /// The disk refused.
    #[error("cannot read {path}: {source}")]
    Disk {
        /// The file.
        path: std::path::PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The contents are malformed.
    #[error("{path}: {problem}")]
    Format {
        /// The file.
        path: std::path::PathBuf,
        /// The fault.
        problem: NpyFault,
    },
}

/// A fault in the bytes of an array.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NpyFault {
    /// Another kind of file.
    #[error("this is no .npy file")]
    NoNpy,
    /// An unknown version of the format.
    #[error(".npy version {0} is not known; 1 to 3 are")]
    Version(u8),
    /// The file ends within its header.
    #[error("the header is cut off")]
    Cut,
    /// The header holds other bytes than text.
    #[error("the header is not text: {0}")]
    NotText(#[from] std::str::Utf8Error),
    /// The header names no type.
    #[error("the header has no descr")]
    NoType,
    /// Column-major.
    #[error("the array is not in C order; save numpy.ascontiguousarray(x)")]
    Order,
    /// Other than two axes.
    #[error("the header has no two-dimensional shape")]
    Shape,
    /// More values than can be counted.
    #[error("the shape is too large")]
    Large,
    /// An unsupported type.
    #[error("values of type '{0}' are not read; '<f4', '<f8', '<i4' and '|u1' are")]
    Type(String),
    /// Fewer bytes than the shape needs.
    #[error("{has} bytes of values, {needed} are needed")]
    Short {
        /// Bytes behind the header.
        has: usize,
        /// Bytes of the shape.
        needed: usize,
    },
}

/// Reads a two-dimensional little-endian `f4`, `f8`, `i4` or `u1` array in C order.
///
/// # Errors
/// An unreadable file, one that is larger than 1 GiB, holds another kind of array or ends early.
pub fn read_npy(path: &Path) -> Result<NpyArray, NpyError> {
    let disk = |source| NpyError::Disk { path: path.to_owned(), source };
    let format = |problem| NpyError::Format { path: path.to_owned(), problem };
    parse_npy(&files::read_limited(path, NPY).map_err(disk)?).map_err(format)
}

/// Type, header and values of a `.npy` file. The header is a Python dictionary in text.
///
/// # Errors
/// Where it is no such file.
pub fn npy_parts(bytes: &[u8]) -> Result<(&str, &str, &[u8]), NpyFault> {
    if bytes.len() < 12 || &bytes[..6] != b"\x93NUMPY" {
        return Err(NpyFault::NoNpy);
    }
    // Version 1 has a length of 16 bits, 2 and 3 one of 32.
    let (start, length): (usize, usize) = match bytes[6] {
        1 => (10, usize::from(u16::from_le_bytes([bytes[8], bytes[9]]))),
        2 | 3 => (12, u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]) as usize),
        v => return Err(NpyFault::Version(v)),
    };
    let end = start.checked_add(length).filter(|&e| e <= bytes.len()).ok_or(NpyFault::Cut)?;
    let header = std::str::from_utf8(&bytes[start..end])?;
    let descr = field(header, "descr").ok_or(NpyFault::NoType)?;
    Ok((descr.trim_matches(|c| c == '\'' || c == '"'), header, &bytes[end..]))
}

/// Reads an array from the bytes of a `.npy` file.
fn parse_npy(bytes: &[u8]) -> Result<NpyArray, NpyFault> {
    let (descr, header, data) = npy_parts(bytes)?;
    if field(header, "fortran_order") != Some("False") {
        return Err(NpyFault::Order);
    }
    let (rows, columns) = shape(header)?;
    // The shape is claimed by the header: nothing is allocated before the bytes are known to be there.
    let count = rows.checked_mul(columns).ok_or(NpyFault::Large)?;
    let values = decode(descr, data, count)?;
    Ok(NpyArray { rows, columns, values })
}

fn decode(descr: &str, data: &[u8], count: usize) -> Result<Vec<f64>, NpyFault> {
    let width = match descr {
        "<f4" | "<i4" => 4,
        "<f8" => 8,
        "|u1" => 1,
        _ => return Err(NpyFault::Type(descr.to_owned())),
    };
    let needed = count.checked_mul(width).ok_or(NpyFault::Large)?;
    let data = data.get(..needed).ok_or(NpyFault::Short { has: data.len(), needed })?;
    Ok(match descr {
        "<f4" => data.as_chunks::<4>().0.iter().map(|&b| f64::from(f32::from_le_bytes(b))).collect(),
        "<i4" => data.as_chunks::<4>().0.iter().map(|&b| f64::from(i32::from_le_bytes(b))).collect(),
        "<f8" => data.as_chunks::<8>().0.iter().map(|&b| f64::from_le_bytes(b)).collect(),
        _ => data.iter().map(|&b| f64::from(b)).collect(),
    })
}

/// Text of a value of the header's dictionary up to the next comma.
fn field<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let after = header.split_once(&format!("'{key}':"))?.1;
    // Good for `descr` and `fortran_order`; the shape has commas of its own.
    Some(after.split([',', '}']).next()?.trim())
}

fn shape(header: &str) -> Result<(usize, usize), NpyFault> {
    let after = header.split_once("'shape':").ok_or(NpyFault::Shape)?.1;
    let inside = after.split_once('(').and_then(|(_, rest)| rest.split_once(')')).ok_or(NpyFault::Shape)?.0;
    let sizes: Result<Vec<usize>, _> =
        inside.split(',').map(str::trim).filter(|s| !s.is_empty()).map(str::parse).collect();
    match sizes.as_deref() {
        Ok([rows, columns]) => Ok((*rows, *columns)),
        _ => Err(NpyFault::Shape),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(descr: &str, order: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn reads_every_supported_type() {
        let f4: Vec<u8> = [1.0f32, -2.5, 3.0, 4.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        let read = parse_npy(&file("<f4", "False", "(2, 2)", &f4)).unwrap();
        assert_eq!(
            (read.rows, read.columns, read.row(0), read.row(1)),
            (2, 2, &[1.0, -2.5][..], &[3.0, 4.0][..])
        );
        let f8: Vec<u8> = [0.1f64, 7.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        assert_eq!(parse_npy(&file("<f8", "False", "(1, 2)", &f8)).unwrap().values, [0.1, 7.0]);
        let i4: Vec<u8> = [-3i32, 9].iter().flat_map(|x| x.to_le_bytes()).collect();
        assert_eq!(parse_npy(&file("<i4", "False", "(2, 1)", &i4)).unwrap().values, [-3.0, 9.0]);
    }

    #[test]
    fn refuses_what_it_cannot_read() {
        for (bytes, message) in [
            (b"PK\x03\x04 something else".to_vec(), "no .npy"),
            (file("<f4", "True", "(1, 1)", &[0; 4]), "C order"),
            (file("<c8", "False", "(1, 1)", &[0; 8]), "'<c8'"),
            (file("<f4", "False", "(1,)", &[0; 4]), "two-dimensional"),
            (file("<f4", "False", "(3, 2)", &[0; 4]), "24 are needed"),
            (file("<f8", "False", "(4611686018427387904, 9)", &[0; 4]), "too large"),
        ] {
            let error = parse_npy(&bytes).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
        let mut cut = file("<f4", "False", "(1, 1)", &[0; 4]);
        cut.truncate(30);
        assert!(parse_npy(&cut) == Err(NpyFault::Cut));
    }

    #[test]
    fn reads_the_seen_points_of_a_recording() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bags/drawer/truth/state0/seen.npy");
        let seen = read_npy(&path).unwrap();
        assert_eq!((seen.rows, seen.columns), (13593, 4));
        assert!((0..seen.rows).all(|i| [0.0, 1.0].contains(&seen.row(i)[3])));
    }
}
