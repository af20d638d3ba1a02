//! `sensor_msgs/msg/PointCloud2`.

use serde::{Deserialize, Serialize};

use super::Header;

/// `sensor_msgs/msg/PointField`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PointField {
    /// `x`, `rgb`, ...
    pub name: String,
    /// Bytes from the start of a point.
    pub offset: u32,
    /// 7: float32.
    pub datatype: u8,
    /// Elements.
    pub count: u32,
}

/// `sensor_msgs/msg/PointCloud2`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PointCloud2 {
    /// Stamp and frame.
    pub header: Header,
    /// Rows; 1 for points without order.
    pub height: u32,
    /// Points a row.
    pub width: u32,
    /// Fields of a point.
    pub fields: Vec<PointField>,
    /// Byte order of the data.
    pub is_bigendian: bool,
    /// Bytes a point.
    pub point_step: u32,
    /// Bytes a row.
    pub row_step: u32,
    /// The points.
    #[serde(with = "serde_bytes")]
    pub data: Vec<u8>,
    /// Whether no point is invalid.
    pub is_dense: bool,
}

impl PointCloud2 {
    /// Points with colors: `x`, `y`, `z` in meters and `rgb`, packed as 0x00RRGGBB into the bits of a
    /// float32.
    #[must_use]
    pub fn colored(header: Header, points: &[([f32; 3], [u8; 3])]) -> Self {
        const POINT_BYTES: u32 = 16;
        const FLOAT32: u8 = 7;
        let names = ["x", "y", "z", "rgb"].into_iter().zip(0..);
        let fields = names
            .map(|(name, k)| PointField { name: name.into(), offset: 4 * k, datatype: FLOAT32, count: 1 })
            .collect();
        let mut data = Vec::with_capacity(points.len() * POINT_BYTES as usize);
        for (point, [r, g, b]) in points {
            point.iter().for_each(|v| data.extend(v.to_le_bytes()));
            // 0x00RRGGBB in little-endian order, as PCL and RViz read it out of the float.
            data.extend([*b, *g, *r, 0]);
        }
        let width = points.len() as u32;
        Self {
            header,
            height: 1,
            width,
            fields,
            is_bigendian: false,
            point_step: POINT_BYTES,
            row_step: POINT_BYTES * width,
            data,
            is_dense: true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_colored_point_is_three_floats_and_packed_color() {
        let cloud = PointCloud2::colored(Header::default(), &[([1.0, 2.0, -0.5], [0x10, 0x20, 0x30]); 3]);
        assert_eq!((cloud.width, cloud.row_step, cloud.data.len()), (3, 48, 48));
        assert_eq!(f32::from_le_bytes(cloud.data[24..28].try_into().unwrap()), -0.5);
        assert_eq!(u32::from_le_bytes(cloud.data[28..32].try_into().unwrap()), 0x0010_2030);
    }
}
