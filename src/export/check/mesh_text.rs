//! Meshes of a folder, read only as far as the rules need.

use nalgebra::Point3;

/// Contents of a mesh file.
#[derive(Default)]
pub(super) struct MeshText {
    pub points: Vec<Point3<f64>>,
    pub faces: usize,
    /// The faces as triangles, without those whose corners are counted from the last vertex.
    pub triangles: Vec<[u32; 3]>,
    pub normals: usize,
    /// Least and largest texture coordinate.
    pub uv_range: Option<[f64; 2]>,
    pub vertex_colors: bool,
    pub material_file: Option<String>,
    /// Whether a color, normal or texture coordinate is not a finite number.
    pub bad_number: bool,
    /// Whether a face refers to a missing vertex.
    pub bad_index: bool,
}

impl MeshText {
    /// Reads OBJ text; a malformed number becomes NaN.
    pub(super) fn of_obj(text: &str) -> Self {
        let mut mesh = Self::default();
        let mut highest = 0i64;
        for line in text.lines() {
            let mut words = line.split_whitespace();
            match words.next() {
                Some("v") => {
                    let values: Vec<f64> = words.map(number_of_word).collect();
                    let place = [0, 1, 2].map(|k| values.get(k).copied().unwrap_or(f64::NAN));
                    mesh.points.push(Point3::from(place));
                    mesh.bad_number |= values.iter().skip(3).any(|x| !x.is_finite());
                    // Three more values after the position are a color.
                    mesh.vertex_colors |= values.len() >= 6;
                }
                Some("vn") => {
                    mesh.normals += 1;
                    mesh.bad_number |= words.map(number_of_word).any(|x| !x.is_finite());
                }
                Some("vt") => {
                    for uv in words.take(2).map(number_of_word) {
                        mesh.bad_number |= !uv.is_finite();
                        let [lo, hi] = mesh.uv_range.unwrap_or([uv; 2]);
                        mesh.uv_range = Some([lo.min(uv), hi.max(uv)]);
                    }
                }
                Some("f") => {
                    mesh.faces += 1;
                    let mut fan: [Option<u32>; 2] = [None; 2];
                    for word in words {
                        let index: i64 = word.split('/').next().and_then(|i| i.parse().ok()).unwrap_or(0);
                        // Negative indices count back from the last vertex; 0 is invalid.
                        mesh.bad_index |= index == 0;
                        highest = highest.max(index);
                        let Some(corner) = u32::try_from(index).ok().and_then(|i| i.checked_sub(1)) else {
                            continue;
                        };
                        if let [Some(a), Some(b)] = fan {
                            mesh.triangles.push([a, b, corner]);
                        }
                        fan = [fan[0].or(Some(corner)), fan[0].map(|_| corner)];
                    }
                }
                Some("mtllib") => mesh.material_file = words.next().map(str::to_owned),
                _ => {}
            }
        }
        mesh.bad_index |= highest > mesh.points.len() as i64;
        mesh
    }

    /// Reads STL, binary or text; `None` if it is cut short.
    pub(super) fn of_stl(bytes: &[u8]) -> Option<Self> {
        let mut mesh = Self::default();
        let count = bytes.get(80..84).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
        // The length decides, as a binary file's header may also begin with "solid".
        if let Some(count) = count.filter(|n| bytes.len() == 84 + 50 * n) {
            for facet in bytes[84..].chunks_exact(50) {
                for corner in [12, 24, 36] {
                    mesh.points.push(Point3::from([0, 4, 8].map(|k| float_at(facet, corner + k))));
                }
            }
            mesh.faces = count;
            mesh.normals = count;
            mesh.triangles = in_order(count);
            return Some(mesh);
        }
        let text = std::str::from_utf8(bytes).ok().filter(|t| t.trim_start().starts_with("solid"))?;
        for line in text.lines() {
            let mut words = line.split_whitespace();
            if words.next() == Some("vertex") {
                let at: Vec<f64> = words.map(number_of_word).collect();
                mesh.points.push(Point3::new(*at.first()?, *at.get(1)?, *at.get(2)?));
            }
        }
        mesh.faces = mesh.points.len() / 3;
        mesh.triangles = in_order(mesh.faces);
        Some(mesh)
    }
}

fn number_of_word(word: &str) -> f64 {
    word.parse().unwrap_or(f64::NAN)
}

/// The little-endian `f32` at a byte.
fn float_at(bytes: &[u8], k: usize) -> f64 {
    f64::from(f32::from_le_bytes([bytes[k], bytes[k + 1], bytes[k + 2], bytes[k + 3]]))
}

/// Triangles of consecutive corners.
fn in_order(count: usize) -> Vec<[u32; 3]> {
    (0..count as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect()
}

/// A material file: its textures, and whether a color turns them black.
pub(super) struct MaterialFile {
    pub materials: usize,
    pub textures: Vec<String>,
    pub black: bool,
}

impl MaterialFile {
    pub(super) fn parse(text: &str) -> Self {
        let mut material = Self { materials: 0, textures: Vec::new(), black: false };
        for line in text.lines() {
            let (word, rest) = line.trim().split_once(char::is_whitespace).unwrap_or((line.trim(), ""));
            match word {
                "newmtl" => material.materials += 1,
                // Options may precede the file name.
                "map_Kd" => material.textures.extend(rest.split_whitespace().last().map(str::to_owned)),
                "Kd" => material.black |= rest.split_whitespace().all(|c| c.parse::<f64>() == Ok(0.0)),
                _ => {}
            }
        }
        material
    }
}
