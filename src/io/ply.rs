//! PLY meshes, ASCII or binary little-endian.

use super::mesh_faces::{FaceError, MAX_ELEMENTS, fan};
use surface::TriangleMesh;

/// Most corners of a face and most entries of any other list.
const MAX_LIST: usize = 1024;

/// Why bytes are not a PLY mesh.
#[derive(Debug, thiserror::Error)]
pub enum PlyError {
    /// It is another kind of file.
    #[error("this is no PLY file")]
    NoPly,
    /// The header does not end.
    #[error("the header has no end")]
    NoEnd,
    /// The header is not text.
    #[error("the header is not text: {0}")]
    HeaderNotText(std::str::Utf8Error),
    /// The values of an ASCII file are not text.
    #[error("the contents are not text: {0}")]
    NotText(std::str::Utf8Error),
    /// The format is not supported.
    #[error("PLY of format '{0}' is not read; ascii and binary_little_endian are")]
    Format(String),
    /// A property has an unknown type.
    #[error("properties of type '{0}' are not known")]
    Type(String),
    /// A property precedes all elements.
    #[error("a property stands before any element")]
    Lost,
    /// A line does not describe a property.
    #[error("'{0}' is no property")]
    Property(String),
    /// The number of elements is invalid.
    #[error("element {name}: {source}")]
    Count {
        /// Name of the element.
        name: String,
        /// Why it is not a number.
        source: std::num::ParseIntError,
    },
    /// There are more elements than the limit.
    #[error("{count} elements {name}; {MAX_ELEMENTS} are the limit")]
    Large {
        /// Name of the element.
        name: String,
        /// How many there are.
        count: usize,
    },
    /// There are two lists of vertices.
    #[error("the file names its vertices twice")]
    Twice,
    /// There are no vertices, or they lack a coordinate.
    #[error("the file has no vertices with x, y and z")]
    NoVertices,
    /// The file has fewer bytes than the elements need.
    #[error("{count} elements {name}: the file ends early")]
    Short {
        /// Name of the element.
        name: String,
        /// How many there should be.
        count: usize,
    },
    /// An element cannot be read.
    #[error("{name} {index}: {fault}")]
    Element {
        /// Its name.
        name: String,
        /// Its index.
        index: usize,
        /// What is wrong.
        fault: PlyFault,
    },
}

/// A fault in an element of a PLY file.
#[derive(Debug, thiserror::Error)]
pub enum PlyFault {
    /// The file ends within it.
    #[error("the file ends early")]
    Cut,
    /// A word is not a number.
    #[error("'{word}': {source}")]
    Number {
        /// The word.
        word: String,
        /// Why it is not.
        source: std::num::ParseFloatError,
    },
    /// A number is not an index.
    #[error("{0} is no index")]
    Index(f64),
    /// A list has more values than the limit.
    #[error("a list of {0} values; {MAX_LIST} are the limit")]
    List(usize),
    /// A face has too few corners.
    #[error(transparent)]
    Face(#[from] FaceError),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &str) -> Result<Self, PlyError> {
        Ok(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return Err(PlyError::Type(name.to_owned())),
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

struct Property {
    name: String,
    /// Type of the length, for a list.
    length: Option<Scalar>,
    value: Scalar,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// Values one after the other, whatever their encoding.
enum Values<'a> {
    /// Words of a text, with the length of the whole text.
    Ascii(std::str::SplitAsciiWhitespace<'a>, usize),
    Binary(&'a [u8]),
}

impl Element {
    /// Least number of bytes in a row: in text, a digit and a space per value.
    fn least_bytes(&self, values: &Values) -> usize {
        match values {
            Values::Ascii(..) => 2 * self.properties.len(),
            Values::Binary(_) => self.properties.iter().map(|p| p.length.unwrap_or(p.value).bytes()).sum(),
        }
    }
}

impl Values<'_> {
    /// Upper bound of the remaining bytes; one more in text, where the last value needs no space behind it.
    fn left(&self) -> usize {
        match self {
            Self::Ascii(_, length) => length + 1,
            Self::Binary(bytes) => bytes.len(),
        }
    }

    fn next(&mut self, kind: Scalar) -> Result<f64, PlyFault> {
        match self {
            Self::Ascii(words, _) => {
                let word = words.next().ok_or(PlyFault::Cut)?;
                word.parse().map_err(|source| PlyFault::Number { word: word.to_owned(), source })
            }
            Self::Binary(bytes) => {
                fn take<const N: usize>(bytes: &mut &[u8]) -> Result<[u8; N], PlyFault> {
                    let (head, tail) = bytes.split_first_chunk::<N>().ok_or(PlyFault::Cut)?;
                    *bytes = tail;
                    Ok(*head)
                }
                Ok(match kind {
                    Scalar::I8 => f64::from(i8::from_le_bytes(take(bytes)?)),
                    Scalar::U8 => f64::from(u8::from_le_bytes(take(bytes)?)),
                    Scalar::I16 => f64::from(i16::from_le_bytes(take(bytes)?)),
                    Scalar::U16 => f64::from(u16::from_le_bytes(take(bytes)?)),
                    Scalar::I32 => f64::from(i32::from_le_bytes(take(bytes)?)),
                    Scalar::U32 => f64::from(u32::from_le_bytes(take(bytes)?)),
                    Scalar::F32 => f64::from(f32::from_le_bytes(take(bytes)?)),
                    Scalar::F64 => f64::from_le_bytes(take(bytes)?),
                })
            }
        }
    }

    fn next_index(&mut self, kind: Scalar) -> Result<u32, PlyFault> {
        // Through f64, which can represent every u32.
        let x = self.next(kind)?;
        if x >= 0.0 && x <= f64::from(u32::MAX) && x.fract() == 0.0 {
            Ok(x as u32)
        } else {
            Err(PlyFault::Index(x))
        }
    }
}

/// Reads a mesh from the bytes of a PLY file. Colors are read where vertices have 8-bit `red green blue`.
pub(super) fn parse_ply(bytes: &[u8]) -> Result<TriangleMesh, PlyError> {
    const END: &[u8] = b"end_header";
    if !bytes.starts_with(b"ply") {
        return Err(PlyError::NoPly);
    }
    // Searched only in the first MiB: no header is longer.
    let end = bytes.windows(END.len()).take(1 << 20).position(|w| w == END).ok_or(PlyError::NoEnd)?;
    // After the line's end, LF or CR LF; binary values follow immediately.
    let body = bytes[end..].iter().position(|&b| b == b'\n').ok_or(PlyError::NoEnd)? + end + 1;
    let header = std::str::from_utf8(&bytes[..end]).map_err(PlyError::HeaderNotText)?;
    let (format, elements) = parse_header(header)?;
    let mut values = match format {
        "ascii" => {
            let text = std::str::from_utf8(&bytes[body..]).map_err(PlyError::NotText)?;
            Values::Ascii(text.split_ascii_whitespace(), text.len())
        }
        "binary_little_endian" => Values::Binary(&bytes[body..]),
        other => return Err(PlyError::Format(other.to_owned())),
    };
    let mut mesh = TriangleMesh::default();
    // Elements without properties have no bytes: their rows would only take time.
    for element in elements.iter().filter(|e| !e.properties.is_empty()) {
        // Checked before the loop, as the count is claimed by the header.
        let least = element.least_bytes(&values);
        if element.count.saturating_mul(least) > values.left() {
            return Err(PlyError::Short { name: element.name.clone(), count: element.count });
        }
        for index in 0..element.count {
            read_row(element, &mut values, &mut mesh).map_err(|fault| PlyError::Element {
                name: element.name.clone(),
                index,
                fault,
            })?;
        }
    }
    Ok(mesh)
}

fn parse_header(header: &str) -> Result<(&str, Vec<Element>), PlyError> {
    let mut format = "";
    let mut elements = Vec::<Element>::new();
    for line in header.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["format", kind, ..] => format = kind,
            ["element", name, count] => {
                let name = (*name).to_owned();
                let count = match count.parse() {
                    Ok(count) if count > MAX_ELEMENTS => return Err(PlyError::Large { name, count }),
                    Ok(count) => count,
                    Err(source) => return Err(PlyError::Count { name, source }),
                };
                elements.push(Element { name, count, properties: Vec::new() });
            }
            // A property belongs to the last named element.
            ["property", kind @ .., name] => {
                let element = elements.last_mut().ok_or(PlyError::Lost)?;
                let (length, value) = match kind {
                    ["list", length, value] => (Some(Scalar::named(length)?), Scalar::named(value)?),
                    [value] => (None, Scalar::named(value)?),
                    _ => return Err(PlyError::Property(line.to_owned())),
                };
                element.properties.push(Property { name: (*name).to_owned(), length, value });
            }
            _ => {}
        }
    }
    // Faces could mean either list.
    if elements.iter().filter(|e| e.name == "vertex").count() > 1 {
        return Err(PlyError::Twice);
    }
    let vertex = elements.iter().find(|e| e.name == "vertex");
    let has = |axis: &str| vertex.is_some_and(|v| v.properties.iter().any(|p| p.name == axis));
    if !["x", "y", "z"].into_iter().all(has) {
        return Err(PlyError::NoVertices);
    }
    Ok((format, elements))
}

fn read_row(element: &Element, values: &mut Values, mesh: &mut TriangleMesh) -> Result<(), PlyFault> {
    let mut position = [0.0; 3];
    let mut color = [0u8; 3];
    let mut channels = 0;
    for property in &element.properties {
        if let Some(length) = property.length {
            let count = values.next_index(length)? as usize;
            if count > MAX_LIST {
                return Err(PlyFault::List(count));
            }
            if element.name == "face" && matches!(property.name.as_str(), "vertex_indices" | "vertex_index") {
                let corners: Vec<u32> =
                    (0..count).map(|_| values.next_index(property.value)).collect::<Result<_, _>>()?;
                fan(&corners, &mut mesh.triangles)?;
            } else {
                // Read to skip them: a row does not state its length.
                for _ in 0..count {
                    values.next(property.value)?;
                }
            }
            continue;
        }
        let value = values.next(property.value)?;
        match property.name.as_str() {
            "x" => position[0] = value as f32,
            "y" => position[1] = value as f32,
            "z" => position[2] = value as f32,
            // Only 8 bits: writers of floats do not agree whether white is 1 or 255.
            "red" | "green" | "blue" if property.value == Scalar::U8 => {
                let channel =
                    ["red", "green", "blue"].iter().position(|c| *c == property.name).unwrap_or_default();
                color[channel] = value.clamp(0.0, 255.0) as u8;
                channels += 1;
            }
            _ => {}
        }
    }
    if element.name == "vertex" {
        mesh.vertices.push(position.into());
        if channels == 3 {
            mesh.colors.push(color);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const ASCII: &str = "ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty \
        double y\nproperty float z\n\
        property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\nelement face 1\n\
        property uchar flags\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 1 2 3 255\n1 0 0 4 5 6 255\n1 1 0 7 8 9 255\n0 1 0.5 10 11 12 255\n9 4 0 1 2 3\n";

    #[test]
    fn ascii_and_binary_give_the_same_mesh() {
        let ascii = parse_ply(ASCII.as_bytes()).unwrap();
        assert_eq!(ascii.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(ascii.colors[3], [10, 11, 12]);
        assert_eq!(ascii.vertices[3], nalgebra::Point3::new(0.0, 1.0, 0.5));
        let header = ASCII.split_once("end_header\n").unwrap().0;
        let mut binary = header.replace("ascii", "binary_little_endian").into_bytes();
        binary.extend(b"end_header\n");
        for (p, c) in ascii.vertices.iter().zip(&ascii.colors) {
            binary.extend(p.x.to_le_bytes());
            binary.extend(f64::from(p.y).to_le_bytes());
            binary.extend(p.z.to_le_bytes());
            binary.extend(c);
            binary.push(255);
        }
        binary.extend([9, 4]);
        binary.extend([0i32, 1, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
        assert_eq!(parse_ply(&binary).unwrap(), ascii);
        for cut in [binary.len() - 1, binary.len() - 20, binary.len() - 60] {
            assert!(parse_ply(&binary[..cut]).unwrap_err().to_string().contains("ends early"));
        }
    }

    #[test]
    fn other_files_are_refused() {
        for (text, message) in [
            ("solid x", "no PLY"),
            ("ply\nformat ascii 1.0\n", "no end"),
            (&ASCII.replace("ascii", "binary_big_endian"), "binary_big_endian"),
            (&ASCII.replace("vertex 4", "vertex 99999999999"), "limit"),
            (&ASCII.replace("float z", "float w"), "x, y and z"),
            (&ASCII.replace("9 4 0 1", "9 4 -1 1"), "face 0: -1 is no index"),
            (&ASCII.replace("9 4 0 1", "9 9999 0 1"), "a list of 9999"),
            (&ASCII.replace("double y", "quad y"), "'quad'"),
            (
                &ASCII.replace("element face", "element vertex 2\nproperty float x\nelement face"),
                "vertices twice",
            ),
        ] {
            let error = parse_ply(text.as_bytes()).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }
}
