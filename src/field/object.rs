//! Queries of a trained field: signed distances and colors at world points.

use std::sync::Arc;

use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

use super::harmonics::view_coefficients;
use super::matrix::{COLOR_INPUTS, Matrix, Network};
use super::simd::{
    COLUMN_ALIGN, Columns, Epilogue, InstructionSet, LevelGeometry, LevelJacobian, PointColumns,
};
use super::{FEATURES, FieldParams, GEOMETRY_OUTPUTS, VIEW_COEFFICIENTS};
use geometry::{Grid3, SceneBox};
use surface::{ColorField, ColorSample, TriangleMesh, vertex_normals};

/// Points per task.
const CHUNK: usize = 512;
/// Number of geometry outputs passed to the color network.
const COLOR_FEATURES: usize = GEOMETRY_OUTPUTS - 1;

/// The trained field of one state.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectField {
    /// Parameters of the hash grid and the networks.
    pub params: FieldParams,
    /// The cube of the hash grid.
    pub scene: SceneBox,
    /// Unit of the network's TSDF, meters.
    pub truncation_m: f64,
    /// Base of the network's TSDF, in truncations; `None` if the network gives the whole distance.
    pub base: Option<Arc<Grid3<f32>>>,
}

impl ObjectField {
    /// Projective signed distance at world points, meters, negative inside. Beyond the truncation only the
    /// sign is meaningful; the value is not clamped.
    pub fn signed_distances_m(&self, points: &[Point3<f64>]) -> Vec<f32> {
        let query = Query::new(self);
        points.par_chunks(CHUNK).map(|points| query.chunk_distances_m(points)).collect::<Vec<_>>().concat()
    }

    /// Colors in `[0, 1]` at world points seen along unit world directions.
    ///
    /// # Panics
    /// If points and directions differ in number.
    pub fn view_colors(&self, points: &[Point3<f64>], directions: &[Vector3<f64>]) -> Vec<[f32; 3]> {
        assert_eq!(points.len(), directions.len(), "one direction a point");
        let query = Query::new(self);
        let chunks = points.par_chunks(CHUNK).zip(directions.par_chunks(CHUNK));
        chunks.map(|(points, directions)| query.chunk_colors(points, directions)).collect::<Vec<_>>().concat()
    }

    /// Colors a world mesh as seen along its inward normals.
    pub fn paint_mesh(&self, mesh: &mut TriangleMesh) {
        let normals = vertex_normals(mesh);
        let directions: Vec<Vector3<f64>> =
            normals.iter().map(|n| -n.cast::<f64>().try_normalize(0.0).unwrap_or_else(Vector3::z)).collect();
        let points: Vec<_> = mesh.vertices.iter().map(|p| p.cast::<f64>()).collect();
        mesh.colors = self
            .view_colors(&points, &directions)
            .iter()
            .map(|c| c.map(|x| (255.0 * x).round().clamp(0.0, 255.0) as u8))
            .collect();
    }
}

impl ColorField for ObjectField {
    fn colors(&self, points: &[Point3<f64>], directions: &[Vector3<f64>]) -> Vec<ColorSample> {
        assert_eq!(points.len(), directions.len(), "one direction a point");
        let query = Query::new(self);
        let chunks = points.par_chunks(CHUNK).zip(directions.par_chunks(CHUNK));
        chunks
            .map(|(points, directions)| query.color_samples(points, directions))
            .collect::<Vec<_>>()
            .concat()
    }
}

/// A field with layers packed for the kernels.
struct Query<'a> {
    isa: InstructionSet,
    field: &'a ObjectField,
    network: Network,
    /// The first color layer's weights for the features.
    features: Matrix,
}

/// Activations for one chunk of points; rows have `cols` columns.
struct Buffers {
    cols: usize,
    axes: [Vec<f32>; 3],
    encoded: Vec<f32>,
    hidden: Vec<f32>,
    outputs: Vec<f32>,
    first: Vec<f32>,
    second: Vec<f32>,
    rgb: Vec<f32>,
}

impl Buffers {
    fn new(query: &Query<'_>, points: &[Point3<f64>]) -> Self {
        let cols = points.len().next_multiple_of(COLUMN_ALIGN);
        let hidden = query.network.hidden_rows();
        // Padding columns need some point in the cube.
        let mut axes = [(); 3].map(|()| vec![0.5; cols]);
        for (i, p) in points.iter().enumerate() {
            let n = query.field.scene.normalise(p);
            for k in 0..3 {
                axes[k][i] = (0.5 * (n[k] + 1.0)) as f32;
            }
        }
        let rows = |n: usize| vec![0.0; n * cols];
        let first = Vec::new();
        let second = Vec::new();
        let encoded = rows(FEATURES * query.field.params.levels.len());
        Self {
            cols,
            axes,
            encoded,
            hidden: rows(hidden),
            outputs: rows(GEOMETRY_OUTPUTS),
            first,
            second,
            rgb: Vec::new(),
        }
    }

    fn point_columns(&self) -> PointColumns<'_> {
        PointColumns { x: &self.axes[0], y: &self.axes[1], z: &self.axes[2] }
    }

    /// Color of a point and its derivative, from the derivatives `slopes` of the values before the sigmoid by
    /// unit coordinates; one meter is `scale` unit coordinates.
    fn color_sample(&self, point: usize, slopes: &[Vec<f32>; 3], scale: f32) -> ColorSample {
        let rgb = Vector3::from_fn(|c, _| self.rgb[c * self.cols + point]);
        let jacobian =
            Matrix3::from_fn(|c, k| scale * slopes[k][c * self.cols + point] * rgb[c] * (1.0 - rgb[c]));
        ColorSample { rgb, jacobian }
    }
}

/// All rows of a dense matrix.
fn dense_columns(data: &[f32], cols: usize) -> Columns<'_> {
    Columns { data, stride: cols, rows: data.len() / cols }
}

impl<'a> Query<'a> {
    fn new(field: &'a ObjectField) -> Self {
        let network = Network::packed_network(&field.params);
        let features = network.color[0].input_columns(VIEW_COEFFICIENTS..VIEW_COEFFICIENTS + COLOR_FEATURES);
        Self { isa: InstructionSet::detect(), field, network, features }
    }

    /// Signed distances at points, meters.
    fn chunk_distances_m(&self, points: &[Point3<f64>]) -> Vec<f32> {
        let truncation_m = self.field.truncation_m as f32;
        let mut b = Buffers::new(self, points);
        self.run_encoding(&mut b);
        let mut distances_m = Vec::with_capacity(points.len());
        for (s, p) in b.outputs.iter().zip(points) {
            let base = self.field.base.as_ref().map_or(0.0, |base| base.value_at(p));
            distances_m.push((s + base) * truncation_m);
        }
        distances_m
    }

    /// Colors in `[0, 1]` at points seen along directions.
    fn chunk_colors(&self, points: &[Point3<f64>], directions: &[Vector3<f64>]) -> Vec<[f32; 3]> {
        let mut b = Buffers::new(self, points);
        self.run_encoding(&mut b);
        self.run_color_network(&mut b, directions);
        (0..points.len()).map(|i| std::array::from_fn(|c| b.rgb[c * b.cols + i])).collect()
    }

    /// Colors at points seen along directions, and their derivatives by the points.
    fn color_samples(&self, points: &[Point3<f64>], directions: &[Vector3<f64>]) -> Vec<ColorSample> {
        // Unit coordinates per meter.
        let scale = (0.5 * self.field.scene.scale) as f32;
        let mut b = Buffers::new(self, points);
        let mut tangents = self.geometry_with_tangents(&mut b);
        self.run_color_network(&mut b, directions);
        let slopes = tangents.each_mut().map(|t| self.color_tangent(&b, t));
        (0..points.len()).map(|i| b.color_sample(i, &slopes, scale)).collect()
    }

    /// The table of a level.
    fn level_table(&self, level: usize) -> (LevelGeometry, &[f32]) {
        let layout = &self.field.params.levels[level];
        (
            LevelGeometry::new(layout),
            &self.field.params.table[layout.offset..layout.offset + layout.entries * FEATURES],
        )
    }

    /// Fills `encoded`, `hidden` and `outputs`.
    fn run_encoding(&self, b: &mut Buffers) {
        let mut encoded = std::mem::take(&mut b.encoded);
        for (l, rows) in encoded.chunks_exact_mut(FEATURES * b.cols).enumerate() {
            let (first, second) = rows.split_at_mut(b.cols);
            let (level, table) = self.level_table(l);
            self.isa.encode(level, table, b.point_columns(), first, second);
        }
        b.encoded = encoded;
        self.run_geometry_network(b);
    }

    /// As [`Self::run_geometry_network`], with the outputs' derivatives by the three unit coordinates.
    fn geometry_with_tangents(&self, b: &mut Buffers) -> [Vec<f32>; 3] {
        let cols = b.cols;
        let mut encoded = std::mem::take(&mut b.encoded);
        let mut slopes = [(); 3].map(|()| vec![0.0; encoded.len()]);
        {
            let [dx, dy, dz] = &mut slopes;
            let pair = FEATURES * cols;
            let rows =
                encoded.chunks_exact_mut(pair).zip(dx.chunks_exact_mut(pair)).zip(dy.chunks_exact_mut(pair));
            for (l, (((v, x), y), z)) in rows.zip(dz.chunks_exact_mut(pair)).enumerate() {
                let (level, table) = self.level_table(l);
                let [(v0, v1), (x0, x1), (y0, y1), (z0, z1)] = [v, x, y, z].map(|r| r.split_at_mut(cols));
                let out = LevelJacobian { first: [v0, x0, y0, z0], second: [v1, x1, y1, z1] };
                self.isa.encode_jacobian(level, table, b.point_columns(), out);
            }
        }
        b.encoded = encoded;
        self.run_geometry_network(b);
        // Forward mode: tangents along the three coordinates pass through both layers with the value.
        slopes.map(|slope| {
            let mut hidden = vec![0.0; b.hidden.len()];
            self.network.geometry[0].apply_linear(
                self.isa,
                dense_columns(&slope, cols),
                &mut hidden,
                cols,
                Epilogue::Mask(&b.hidden),
            );
            let mut out = vec![0.0; b.outputs.len()];
            self.network.geometry[1].apply_linear(
                self.isa,
                dense_columns(&hidden, cols),
                &mut out,
                cols,
                Epilogue::Linear,
            );
            out
        })
    }

    /// The geometry network.
    fn run_geometry_network(&self, b: &mut Buffers) {
        let cols = b.cols;
        self.network.geometry[0].apply_affine(
            self.isa,
            dense_columns(&b.encoded, cols),
            &mut b.hidden,
            cols,
            Epilogue::Relu,
        );
        self.network.geometry[1].apply_affine(
            self.isa,
            dense_columns(&b.hidden, cols),
            &mut b.outputs,
            cols,
            Epilogue::Linear,
        );
    }

    /// Fills `first`, `second` and `rgb`.
    fn run_color_network(&self, b: &mut Buffers, directions: &[Vector3<f64>]) {
        let cols = b.cols;
        let mut inputs = vec![0.0; COLOR_INPUTS * cols];
        for (i, d) in directions.iter().enumerate() {
            let view = view_coefficients([d.x as f32, d.y as f32, d.z as f32]);
            for (row, value) in view.into_iter().enumerate() {
                inputs[row * cols + i] = value;
            }
        }
        // Row 0 of the outputs is the distance, the others are the features.
        inputs[VIEW_COEFFICIENTS * cols..][..COLOR_FEATURES * cols].copy_from_slice(&b.outputs[cols..]);
        let hidden = self.network.hidden_rows();
        b.first.resize(hidden * cols, 0.0);
        b.second.resize(hidden * cols, 0.0);
        b.rgb.resize(self.network.color[2].outputs * cols, 0.0);
        self.network.color[0].apply_affine(
            self.isa,
            dense_columns(&inputs, cols),
            &mut b.first,
            cols,
            Epilogue::Relu,
        );
        self.network.color[1].apply_affine(
            self.isa,
            dense_columns(&b.first, cols),
            &mut b.second,
            cols,
            Epilogue::Relu,
        );
        self.network.color[2].apply_affine(
            self.isa,
            dense_columns(&b.second, cols),
            &mut b.rgb,
            cols,
            Epilogue::Linear,
        );
        self.isa.sigmoid(&mut b.rgb);
    }

    /// Derivatives of the three channels before the logistic function, given the derivatives of the geometry
    /// outputs.
    fn color_tangent(&self, b: &Buffers, outputs: &[f32]) -> Vec<f32> {
        let cols = b.cols;
        // The view direction is fixed: derivatives are by position alone.
        let mut first = vec![0.0; b.first.len()];
        let mut second = vec![0.0; b.second.len()];
        let mut rgb = vec![0.0; b.rgb.len()];
        self.features.apply_linear(
            self.isa,
            dense_columns(&outputs[cols..], cols),
            &mut first,
            cols,
            Epilogue::Mask(&b.first),
        );
        self.network.color[1].apply_linear(
            self.isa,
            dense_columns(&first, cols),
            &mut second,
            cols,
            Epilogue::Mask(&b.second),
        );
        self.network.color[2].apply_linear(
            self.isa,
            dense_columns(&second, cols),
            &mut rgb,
            cols,
            Epilogue::Linear,
        );
        rgb
    }
}

#[cfg(test)]
mod tests {
    use super::super::FieldConfig;
    use super::super::reference::{Reference, field, uniform};
    use super::*;
    use numeric::random::stage_rng;

    fn object() -> ObjectField {
        let config = FieldConfig {
            levels: 6,
            base_resolution: 4,
            finest_resolution: 40,
            log2_table_size: 12,
            hidden: 64,
        };
        let scene = SceneBox::around_box(&Point3::new(-0.3, 0.1, 0.0), &Point3::new(0.4, 0.5, 1.1));
        ObjectField { params: field(&config, 21), scene, truncation_m: 0.025, base: None }
    }

    fn queries(n: usize) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
        let mut rng = stage_rng(22, "test/queries", 0);
        let mut next = move || f64::from(uniform(&mut rng)) - 0.5;
        let points = (0..n)
            .map(|_| Point3::new(0.05 + 0.9 * next(), 0.3 + 0.9 * next(), 0.55 + 0.9 * next()))
            .collect();
        let directions = (0..n).map(|_| Vector3::new(next(), next(), next()).normalize()).collect();
        (points, directions)
    }

    #[test]
    fn distances_and_colors_are_those_of_the_equations() {
        let object = object();
        let (points, directions) = queries(700);
        let reference = Reference::new(&object.params);
        let tsdf = object.signed_distances_m(&points);
        let rgb = object.view_colors(&points, &directions);
        let samples = object.colors(&points, &directions);
        for (i, p) in points.iter().enumerate() {
            let unit: [f64; 3] = object.scene.normalise(p).coords.map(|x| 0.5 * (x + 1.0)).into();
            let view = directions[i].into();
            assert!((f64::from(tsdf[i]) - 0.025 * reference.geometry(unit)[0]).abs() < 1e-6);
            for (c, expected) in reference.color(unit, view).into_iter().enumerate() {
                assert!((f64::from(rgb[i][c]) - expected).abs() < 1e-5);
                assert!((rgb[i][c] - samples[i].rgb[c]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn the_color_jacobian_is_the_derivative_by_world_position() {
        let object = object();
        let (points, directions) = queries(200);
        let reference = Reference::new(&object.params);
        let samples = object.colors(&points, &directions);
        let color = |p: &Point3<f64>, d: &Vector3<f64>| {
            let unit: [f64; 3] = object.scene.normalise(p).coords.map(|x| 0.5 * (x + 1.0)).into();
            reference.color(unit, (*d).into())
        };
        let h = 1e-7;
        let mut compared = 0;
        for (i, p) in points.iter().enumerate() {
            for k in 0..3 {
                let step = Vector3::ith(k, h);
                let up = color(&(p + step), &directions[i]);
                let zero = color(p, &directions[i]);
                let down = color(&(p - step), &directions[i]);
                for c in 0..3 {
                    let right = (up[c] - zero[c]) / h;
                    let left = (zero[c] - down[c]) / h;
                    let exact = f64::from(samples[i].jacobian[(c, k)]);
                    if (right - left).abs() < 1e-3 * (0.1 + right.abs()) {
                        assert!((right - exact).abs() < 2e-3 * (0.1 + right.abs()), "{exact} but {right}");
                        compared += 1;
                    }
                }
            }
        }
        assert!(compared > 1500, "{compared} of 1800 away from kinks");
    }
}
