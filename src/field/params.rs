//! Shape and parameters of an object field, in one flat layout for all engines.

use rand_core::Rng;
use serde::{Deserialize, Serialize};

/// Shape of the hash grid and the networks (docs/method.md 12.1).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FieldConfig {
    /// Number of hash grid levels, with two features per entry.
    pub levels: usize,
    /// Nodes along one side at the coarsest level.
    pub base_resolution: usize,
    /// Nodes along one side at the finest level.
    pub finest_resolution: usize,
    /// Base-2 logarithm of the largest number of entries per level.
    pub log2_table_size: u32,
    /// Width of every hidden layer.
    pub hidden: usize,
}

impl Default for FieldConfig {
    fn default() -> Self {
        Self { levels: 12, base_resolution: 16, finest_resolution: 256, log2_table_size: 19, hidden: 64 }
    }
}

/// Number of features per entry of the hash grid.
pub const FEATURES: usize = 2;
/// Number of geometry outputs: one TSDF value (in truncations, positive outside) and 15 features.
pub const GEOMETRY_OUTPUTS: usize = 16;
/// Number of spherical harmonics of the view direction (bands 0 to 3).
pub const VIEW_COEFFICIENTS: usize = 16;

/// One level of the hash grid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LevelLayout {
    /// `position = unit * scale + 0.5`, with unit coordinates in `[0, 1]`.
    pub scale: f32,
    /// Nodes along one side (`ceil(scale) + 2`, so that every cell has its upper nodes).
    pub resolution: usize,
    /// Number of table entries; a dense level is addressed by `resolution`, a hashed one by the spatial hash.
    pub entries: usize,
    /// Whether entries are addressed by hash.
    pub hashed: bool,
    /// Offset of the level's first float in [`FieldParams::table`].
    pub offset: usize,
}

/// A dense layer `y = W x + b`, weights row-major `[outputs][inputs]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Layer {
    /// Input width.
    pub inputs: usize,
    /// Output width.
    pub outputs: usize,
    /// `outputs * inputs` weights.
    pub weights: Vec<f32>,
    /// `outputs` biases.
    pub biases: Vec<f32>,
}

impl Layer {
    /// A random layer, uniform in `+-1/sqrt(inputs)`.
    fn random(inputs: usize, outputs: usize, rng: &mut impl Rng) -> Self {
        let bound = 1.0 / (inputs as f32).sqrt();
        let weights = (0..inputs * outputs).map(|_| uniform_float(rng, bound)).collect();
        let biases = (0..outputs).map(|_| uniform_float(rng, bound)).collect();
        Self { inputs, outputs, weights, biases }
    }
}

/// All parameters of a field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldParams {
    /// Levels, coarse to fine.
    pub levels: Vec<LevelLayout>,
    /// Hash grid: per level and entry, [`FEATURES`] floats.
    pub table: Vec<f32>,
    /// `2 levels -> hidden (ReLU) -> 16`: TSDF and 15 features.
    pub geometry: Vec<Layer>,
    /// `[view coefficients 16, features 15] -> hidden (ReLU) -> hidden (ReLU) -> 3`, followed by a sigmoid.
    pub color: Vec<Layer>,
}

impl FieldParams {
    /// Random initial parameters: table uniform in `+-1e-4`, layers uniform in `+-1/sqrt(inputs)`.
    pub fn random_params(config: &FieldConfig, rng: &mut impl Rng) -> Self {
        let levels = level_layouts(config);
        let floats = levels.last().map_or(0, |l| l.offset + l.entries * FEATURES);
        let table = (0..floats).map(|_| uniform_float(rng, 1e-4)).collect();
        let h = config.hidden;
        let geometry =
            vec![Layer::random(FEATURES * levels.len(), h, rng), Layer::random(h, GEOMETRY_OUTPUTS, rng)];
        let color = vec![
            Layer::random(VIEW_COEFFICIENTS + GEOMETRY_OUTPUTS - 1, h, rng),
            Layer::random(h, h, rng),
            Layer::random(h, 3, rng),
        ];
        Self { levels, table, geometry, color }
    }
}

impl FieldParams {
    /// Number of parameters: the length of their flat layout.
    pub fn parameter_count(&self) -> usize {
        self.table.len()
            + self.geometry.iter().chain(&self.color).map(|l| l.weights.len() + l.biases.len()).sum::<usize>()
    }
}

/// Uniform in `[-bound, bound)`.
fn uniform_float(rng: &mut impl Rng, bound: f32) -> f32 {
    // 24 bits are exact in a single float.
    ((rng.next_u32() >> 8) as f32 / (1u32 << 23) as f32 - 1.0) * bound
}

/// Resolutions grow geometrically from the base to the finest; a level is dense if all its nodes fit in the
/// table.
fn level_layouts(config: &FieldConfig) -> Vec<LevelLayout> {
    let growth = (config.finest_resolution as f64 / config.base_resolution as f64)
        .powf(1.0 / (config.levels.max(2) - 1) as f64);
    let cap = 1usize << config.log2_table_size;
    let mut offset = 0;
    (0..config.levels)
        .map(|l| {
            // docs/method.md (12.1).
            let scale = config.base_resolution as f64 * growth.powi(l as i32) - 1.0;
            let resolution = scale.ceil() as usize + 2;
            let nodes = resolution.pow(3);
            let entries = nodes.min(cap);
            let layout =
                LevelLayout { scale: scale as f32, resolution, entries, hashed: nodes > cap, offset };
            offset += entries * FEATURES;
            layout
        })
        .collect()
}
