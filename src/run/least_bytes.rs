//! Least size of a command's results: a disk with less space is refused before the work.

use config::{Config, Method};
use field::FieldConfig;

/// Bytes of a reconstruction's folder. Measured: 3.7 MB for two parts at `surface.nodes=64`; less only for
/// coarser surfaces.
pub(super) const RECONSTRUCTION: u64 = 2 << 20;
/// Bytes in a checkpoint for each parameter: four for each of the parameter itself and two moments of the
/// optimizer.
const PARAMETER: u64 = 4 * 3;
/// Bytes of a demonstration's folder. Measured: 0.3 to 1 MB with a film.
pub(super) const DEMONSTRATION: u64 = 1 << 20;
/// Bytes of a diagnosis beside its copy of the twin. Derived: four files at least, in blocks of 4 KiB.
const DIAGNOSIS: u64 = 16 << 10;

/// Least bytes of the result folder and the checkpoint of a run with `states` states.
pub(super) fn least_reconstruction(states: usize, config: &Config) -> u64 {
    let checkpoint = match config.run.method {
        Method::Surfaces if config.trains_fields() => states as u64 * field(&config.train.field),
        Method::Surfaces => 0,
        // At least a static part and a mobile one.
        Method::Radiance => 2 * field(&config.radiance.field),
    };
    RECONSTRUCTION.saturating_add(checkpoint)
}

/// Bytes of the checkpoint of one field: of its finest table.
fn field(config: &FieldConfig) -> u64 {
    1u64.checked_shl(config.log2_table_size).unwrap_or(u64::MAX).saturating_mul(PARAMETER)
}

/// Least bytes of a diagnosis of a twin with URDF `text`, of which it contains an updated copy.
pub(super) fn least_diagnosis(text: &str) -> u64 {
    DIAGNOSIS + text.len() as u64
}
