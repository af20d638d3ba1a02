//! Messages of ROS 1 as those of ROS 2: their fields are written anew as CDR, by the definition that a bag
//! carries.
//!
//! ROS 1 packs the fields of a message without gaps, little-endian; CDR aligns each number to its size and
//! ends a string with NUL. The messages that are read here have the same fields in both, but for `seq` in
//! the header, which ROS 2 dropped (`sensor_msgs`, `geometry_msgs`, `nav_msgs`, `tf2_msgs` of ROS Noetic
//! and of ROS 2).

use std::{borrow::Cow, collections::BTreeMap};

/// Deepest nesting of messages in a definition.
const MAX_DEPTH: usize = 16;
/// Most fields of a type and the types in it; `sensor_msgs/CameraInfo` has 21.
const MAX_FIELDS: usize = 10_000;
/// The CDR header of a little-endian message without options.
const CDR_LE: [u8; 4] = [0, 1, 0, 0];

/// Encoding of ROS 1 messages in MCAP.
pub const ROS1: &str = "ros1";
/// What stands in place of the encoding of a ROS 1 message that cannot be read.
pub const ROS1_BROKEN: &str = "ros1, but the message does not fit its definition";

/// Why a ROS 1 message is not read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Ros1Error {
    /// A definition without one of its types.
    #[error("its definition does not hold the type `{0}`")]
    Type(String),
    /// A line of a definition that is no field.
    #[error("its definition has the line `{0}`")]
    Line(String),
    /// A definition that nests too deep or has too many fields.
    #[error("its definition nests deeper than {MAX_DEPTH} types or has more than {MAX_FIELDS} fields")]
    Large,
    /// A message that ends before its last field.
    #[error("it is shorter than its definition")]
    Short,
}

/// The name of a message type in ROS 2: `sensor_msgs/msg/Image` for the `sensor_msgs/Image` of ROS 1 and of
/// some writers of ROS 2, and for the names of DDS and C++ (`sensor_msgs::msg::dds_::Image_`,
/// `sensor_msgs::msg::Image`).
#[must_use]
pub fn ros2_type_name(name: &str) -> Cow<'_, str> {
    let slashed = name.replace("::", "/");
    let parts: Vec<&str> = slashed.split('/').collect();
    match parts[..] {
        // The type of /tf before tf2.
        ["tf", "tfMessage"] => Cow::Borrowed("tf2_msgs/msg/TFMessage"),
        [package, "msg", "dds_", message] => {
            Cow::Owned(format!("{package}/msg/{}", message.strip_suffix('_').unwrap_or(message)))
        }
        [package, message] if is_word(package) && is_word(message) => {
            Cow::Owned(format!("{package}/msg/{message}"))
        }
        [package, "msg", message] if name.contains("::") => Cow::Owned(format!("{package}/msg/{message}")),
        _ => Cow::Borrowed(name),
    }
}

fn is_word(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
}

/// What a field holds.
#[derive(Clone, Debug, PartialEq, Eq)]
enum FieldKind {
    /// A number of so many bytes.
    Number(usize),
    Text,
    Message(Vec<Ros1Field>),
    /// Values of one kind; `None` where the message holds their count.
    Array(Box<FieldKind>, Option<usize>),
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Ros1Field {
    kind: FieldKind,
    /// Whether ROS 2 dropped it.
    is_dropped: bool,
}

/// How the bytes of a ROS 1 type are laid out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ros1Layout {
    fields: Vec<Ros1Field>,
}

impl Ros1Layout {
    /// The layout of `type_name` (`pkg/Type` or `pkg/msg/Type`) by its definition: its own fields, and
    /// after lines of `=` those of the types in it, each after `MSG: pkg/Type`.
    ///
    /// # Errors
    /// [`Ros1Error`] where the definition is not whole.
    pub fn parse(type_name: &str, definition: &str) -> Result<Self, Ros1Error> {
        let own = type_name.replace("/msg/", "/");
        let mut lines_of: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        let mut name = own.as_str();
        for line in definition.lines().map(str::trim) {
            if let Some(next) = line.strip_prefix("MSG:") {
                name = next.trim();
            } else if !line.is_empty() && !line.bytes().all(|b| b == b'=') {
                lines_of.entry(name).or_default().push(line);
            }
        }
        let mut types = Definitions { lines_of, fields: 0 };
        let fields =
            if types.lines_of.contains_key(own.as_str()) { types.fields(&own, 0)? } else { Vec::new() };
        Ok(Self { fields })
    }

    /// A message as CDR with its header.
    ///
    /// # Errors
    /// [`Ros1Error::Short`].
    pub fn cdr(&self, message: &[u8]) -> Result<Vec<u8>, Ros1Error> {
        // Grows with what is read: a length in the message reserves nothing.
        let mut copy = CdrCopy { left: message, cdr: CDR_LE.to_vec() };
        copy.fields(&self.fields, true)?;
        Ok(copy.cdr)
    }
}

/// The types of a definition.
struct Definitions<'a> {
    lines_of: BTreeMap<&'a str, Vec<&'a str>>,
    /// Fields so far.
    fields: usize,
}

impl Definitions<'_> {
    fn fields(&mut self, type_name: &str, depth: usize) -> Result<Vec<Ros1Field>, Ros1Error> {
        let Some(lines) = self.lines_of.get(type_name).cloned() else {
            return Err(Ros1Error::Type(printed(type_name)));
        };
        let is_header = type_name == "std_msgs/Header";
        let mut fields = Vec::new();
        for line in lines {
            let code = line.split('#').next().unwrap_or_default();
            let mut words = code.split_whitespace();
            let Some(kind) = words.next() else { continue };
            let Some(name) = words.next() else { return Err(Ros1Error::Line(printed(line))) };
            // A constant: `uint8 DEBUG=1`. The value of a string constant may hold `#`.
            if code.contains('=') {
                continue;
            }
            self.fields += 1;
            if self.fields > MAX_FIELDS || depth >= MAX_DEPTH {
                return Err(Ros1Error::Large);
            }
            let kind = self.kind(kind, type_name, depth)?;
            fields.push(Ros1Field { kind, is_dropped: is_header && name == "seq" });
        }
        Ok(fields)
    }

    /// The kind of a field, in a message of type `within`.
    fn kind(&mut self, name: &str, within: &str, depth: usize) -> Result<FieldKind, Ros1Error> {
        if let Some((item, count)) = name.strip_suffix(']').and_then(|n| n.split_once('[')) {
            let count = match count {
                "" => None,
                digits => match digits.parse() {
                    Ok(count) => Some(count),
                    Err(_) => return Err(Ros1Error::Line(printed(name))),
                },
            };
            return Ok(FieldKind::Array(Box::new(self.kind(item, within, depth)?), count));
        }
        Ok(match name {
            "bool" | "int8" | "uint8" | "byte" | "char" => FieldKind::Number(1),
            "int16" | "uint16" => FieldKind::Number(2),
            "int32" | "uint32" | "float32" => FieldKind::Number(4),
            "int64" | "uint64" | "float64" => FieldKind::Number(8),
            "string" => FieldKind::Text,
            // Seconds and nanoseconds; seconds are signed in ROS 2, which are the same bytes until 2038.
            "time" | "duration" => FieldKind::Array(Box::new(FieldKind::Number(4)), Some(2)),
            "Header" => FieldKind::Message(self.fields("std_msgs/Header", depth + 1)?),
            other if other.contains('/') => FieldKind::Message(self.fields(other, depth + 1)?),
            // A type of the same package.
            other => {
                let package = within.split('/').next().unwrap_or_default();
                FieldKind::Message(self.fields(&format!("{package}/{other}"), depth + 1)?)
            }
        })
    }
}

fn printed(text: &str) -> String {
    text.escape_debug().take(64).collect()
}

/// The bytes of a message that are left, and its CDR so far.
struct CdrCopy<'a> {
    left: &'a [u8],
    cdr: Vec<u8>,
}

impl<'a> CdrCopy<'a> {
    fn take(&mut self, bytes: usize) -> Result<&'a [u8], Ros1Error> {
        let (front, rest) = self.left.split_at_checked(bytes).ok_or(Ros1Error::Short)?;
        self.left = rest;
        Ok(front)
    }

    fn count(&mut self) -> Result<usize, Ros1Error> {
        Ok(self.take(4)?.iter().rev().fold(0, |n, b| n << 8 | usize::from(*b)))
    }

    fn align(&mut self, size: usize) {
        let body = self.cdr.len() - CDR_LE.len();
        self.cdr.resize(CDR_LE.len() + body.next_multiple_of(size), 0);
    }

    fn fields(&mut self, fields: &[Ros1Field], is_kept: bool) -> Result<(), Ros1Error> {
        for field in fields {
            self.value(&field.kind, is_kept && !field.is_dropped)?;
        }
        Ok(())
    }

    fn value(&mut self, kind: &FieldKind, is_kept: bool) -> Result<(), Ros1Error> {
        match kind {
            FieldKind::Number(size) => self.numbers(*size, 1, is_kept),
            FieldKind::Text => {
                let count = self.count()?;
                let text = self.take(count)?;
                if is_kept {
                    self.align(4);
                    self.cdr.extend((count as u32 + 1).to_le_bytes());
                    self.cdr.extend_from_slice(text);
                    self.cdr.push(0);
                }
                Ok(())
            }
            FieldKind::Message(fields) => self.fields(fields, is_kept),
            FieldKind::Array(item, count) => {
                let count = match count {
                    Some(count) => *count,
                    None => {
                        let count = self.count()?;
                        if is_kept {
                            self.align(4);
                            self.cdr.extend((count as u32).to_le_bytes());
                        }
                        count
                    }
                };
                self.values(item, count, is_kept)
            }
        }
    }

    fn values(&mut self, item: &FieldKind, count: usize, is_kept: bool) -> Result<(), Ros1Error> {
        if let FieldKind::Number(size) = item {
            return self.numbers(*size, count, is_kept);
        }
        for _ in 0..count {
            let before = self.left.len();
            self.value(item, is_kept)?;
            // Items without a byte would be as many as a message claims.
            if self.left.len() == before {
                return Err(Ros1Error::Short);
            }
        }
        Ok(())
    }

    fn numbers(&mut self, size: usize, count: usize, is_kept: bool) -> Result<(), Ros1Error> {
        let bytes = self.take(size.saturating_mul(count))?;
        if is_kept && count > 0 {
            self.align(size);
            self.cdr.extend_from_slice(bytes);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2msg::{CameraInfo, JointState, TfMessage, decode};

    const HEADER: &str = "MSG: std_msgs/Header\n# sequence ID\nuint32 seq\ntime stamp\nstring frame_id\n";
    const BAR: &str = "================================================================================\n";

    fn text(s: &str) -> Vec<u8> {
        [&(s.len() as u32).to_le_bytes(), s.as_bytes()].concat()
    }

    fn header(frame: &str) -> Vec<u8> {
        let numbers = [77u32, 5, 9].map(u32::to_le_bytes).concat();
        [numbers, text(frame)].concat()
    }

    #[test]
    fn a_joint_state_of_ros_1_is_that_of_ros_2() {
        let definition = format!(
            "# comment\nHeader header\n\nstring[] name\nfloat64[] position\nfloat64[] velocity\n\
             float64[] effort\n{BAR}{HEADER}"
        );
        let layout = Ros1Layout::parse("sensor_msgs/JointState", &definition).unwrap();
        let message = [
            header("base"),
            2u32.to_le_bytes().to_vec(),
            text("a"),
            text("elbow"),
            2u32.to_le_bytes().to_vec(),
            [1.5f64, -2.0].map(f64::to_le_bytes).concat(),
            0u32.to_le_bytes().to_vec(),
            1u32.to_le_bytes().to_vec(),
            7.25f64.to_le_bytes().to_vec(),
        ]
        .concat();
        let state: JointState = decode(&layout.cdr(&message).unwrap()).unwrap();
        assert_eq!(state.header.stamp.nanos(), Some(5_000_000_009));
        assert_eq!(
            (state.header.frame_id.as_str(), state.name),
            ("base", vec!["a".to_owned(), "elbow".into()])
        );
        assert_eq!((state.position, state.velocity, state.effort), (vec![1.5, -2.0], vec![], vec![7.25]));
        for cut in 0..message.len() {
            assert_eq!(layout.cdr(&message[..cut]), Err(Ros1Error::Short));
        }
    }

    #[test]
    fn fixed_arrays_constants_and_types_of_types_are_read() {
        let definition = format!(
            "uint8 A=1\nstring B = a # b\nHeader header\nuint32 height\nuint32 width\n\
             string distortion_model\n\
             float64[] D\nfloat64[9]  K\nfloat64[9]  R\nfloat64[12] P\nuint32 binning_x\nuint32 binning_y\n\
             RegionOfInterest roi\n{BAR}{HEADER}{BAR}MSG: sensor_msgs/RegionOfInterest\nuint32 x_offset\n\
             uint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n"
        );
        let layout = Ros1Layout::parse("sensor_msgs/msg/CameraInfo", &definition).unwrap();
        let numbers: Vec<u8> = (0..30).flat_map(|i| f64::from(i).to_le_bytes()).collect();
        let message = [
            header("c"),
            [480u32, 640].map(u32::to_le_bytes).concat(),
            text("plumb_bob"),
            0u32.to_le_bytes().to_vec(),
            numbers,
            [1u32, 2, 3, 4, 5, 6].map(u32::to_le_bytes).concat(),
            vec![1],
        ]
        .concat();
        let info: CameraInfo = decode(&layout.cdr(&message).unwrap()).unwrap();
        assert_eq!((info.height, info.width, info.k[8], info.p[11]), (480, 640, 8.0, 29.0));
        assert_eq!((info.binning_y, info.roi.width, info.roi.do_rectify), (2, 6, true));
    }

    #[test]
    fn transforms_are_read_and_a_count_of_nothing_is_refused() {
        let definition = format!(
            "geometry_msgs/TransformStamped[] transforms\n{BAR}MSG: geometry_msgs/TransformStamped\n\
             Header header\n\
             string child_frame_id\nTransform transform\n{BAR}{HEADER}{BAR}MSG: geometry_msgs/Transform\n\
             Vector3 translation\nQuaternion rotation\n{BAR}MSG: geometry_msgs/Vector3\n\
             float64 x\nfloat64 y\n\
             float64 z\n{BAR}MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
        );
        let layout = Ros1Layout::parse("tf2_msgs/TFMessage", &definition).unwrap();
        let one = [
            header("world"),
            text("camera"),
            [1f64, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0].map(f64::to_le_bytes).concat(),
        ]
        .concat();
        let message = [2u32.to_le_bytes().to_vec(), one.clone(), one].concat();
        let transforms = decode::<TfMessage>(&layout.cdr(&message).unwrap()).unwrap().transforms;
        assert_eq!((transforms.len(), transforms[1].transform.translation.z), (2, 3.0));
        assert_eq!(transforms[1].child_frame_id, "camera");
        let empty = format!("Nothing[] all\n{BAR}MSG: p/Nothing\nuint8 A=1\n");
        let layout = Ros1Layout::parse("p/All", &empty).unwrap();
        assert_eq!(layout.cdr(&u32::MAX.to_le_bytes()), Err(Ros1Error::Short));
        assert!(matches!(Ros1Layout::parse("p/A", "Gone x\n"), Err(Ros1Error::Type(t)) if t == "p/Gone"));
        assert_eq!(Ros1Layout::parse("p/A", "A x\n"), Err(Ros1Error::Large));
    }

    #[test]
    fn type_names_are_those_of_ros_2() {
        for (name, expected) in [
            ("sensor_msgs/Image", "sensor_msgs/msg/Image"),
            ("sensor_msgs/msg/Image", "sensor_msgs/msg/Image"),
            ("sensor_msgs::msg::dds_::Image_", "sensor_msgs/msg/Image"),
            ("sensor_msgs::msg::Image", "sensor_msgs/msg/Image"),
            ("tf/tfMessage", "tf2_msgs/msg/TFMessage"),
            ("foxglove.RawImage", "foxglove.RawImage"),
            ("Example", "Example"),
            ("", ""),
        ] {
            assert_eq!(ros2_type_name(name), expected);
        }
    }
}
