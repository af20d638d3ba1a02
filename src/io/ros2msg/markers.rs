//! `visualization_msgs`.

use serde::{Deserialize, Serialize};

use super::{CompressedImage, Header, Time, Transform, Vector3};

/// `std_msgs/msg/ColorRGBA`, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Color {
    /// Red.
    pub r: f32,
    /// Green.
    pub g: f32,
    /// Blue.
    pub b: f32,
    /// Opacity.
    pub a: f32,
}

/// `visualization_msgs/msg/UVCoordinate`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TextureCoordinate {
    /// Across.
    pub u: f32,
    /// Down.
    pub v: f32,
}

/// `visualization_msgs/msg/MeshFile`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeshFile {
    /// Its name.
    pub filename: String,
    /// Its bytes.
    #[serde(with = "serde_bytes")]
    pub data: Vec<u8>,
}

/// Values of [`Marker::kind`].
pub mod kind {
    /// An arrow between two points.
    pub const ARROW: i32 = 0;
    /// A line through points.
    pub const LINE_STRIP: i32 = 4;
    /// Lines between pairs of points.
    pub const LINE_LIST: i32 = 5;
    /// Text facing the viewer.
    pub const TEXT: i32 = 9;
    /// Triangles of three points each.
    pub const TRIANGLE_LIST: i32 = 11;
}

/// Values of [`Marker::action`].
pub mod action {
    /// Removes the marker of the same group and number.
    pub const DELETE: i32 = 2;
    /// Removes all markers of the topic.
    pub const DELETE_ALL: i32 = 3;
}

/// `visualization_msgs/msg/Marker`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Marker {
    /// Stamp and frame.
    pub header: Header,
    /// Group of markers.
    pub ns: String,
    /// Number within the group.
    pub id: i32,
    /// Shape, see [`kind`].
    pub kind: i32,
    /// Action, see [`action`].
    pub action: i32,
    /// Where it stands in the frame.
    pub pose: Transform,
    /// Size, meters; its meaning depends on the kind.
    pub scale: Vector3,
    /// Color.
    pub color: Color,
    /// How long it is shown; 0: until it is removed.
    pub lifetime: Time,
    /// Whether it moves with its frame.
    pub frame_locked: bool,
    /// Points in its pose, meters.
    pub points: Vec<Vector3>,
    /// Color of each point; empty: that of the marker.
    pub colors: Vec<Color>,
    /// Unused here.
    // CDR has no field names: a missing field would shift all behind it.
    pub texture_resource: String,
    /// Unused here.
    pub texture: CompressedImage,
    /// Unused here.
    pub uv_coordinates: Vec<TextureCoordinate>,
    /// Text to show.
    pub text: String,
    /// Unused here.
    pub mesh_resource: String,
    /// Unused here.
    pub mesh_file: MeshFile,
    /// Unused here.
    pub mesh_use_embedded_materials: bool,
}

/// `visualization_msgs/msg/MarkerArray`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MarkerArray {
    /// Its markers.
    pub markers: Vec<Marker>,
}
