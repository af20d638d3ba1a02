//! Named materials and their densities.

use serde::{Deserialize, Serialize};

/// A material by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Material {
    /// Boards and plywood.
    #[default]
    Wood,
    /// Moulded parts.
    Plastic,
    /// Glass and ceramics.
    Glass,
    /// Aluminium.
    Aluminium,
    /// Steel sheet and bars.
    Steel,
}

impl Material {
    /// Density in kg/m^3: usual, lowest and highest (handbook values: pine to oak, PP to POM, soda-lime glass
    /// to ceramics, alloys).
    pub fn density_kg_m3(self) -> [f64; 3] {
        match self {
            Self::Wood => [600.0, 400.0, 800.0],
            Self::Plastic => [1050.0, 900.0, 1420.0],
            Self::Glass => [2500.0, 2200.0, 2700.0],
            Self::Aluminium => [2700.0, 2600.0, 2850.0],
            Self::Steel => [7850.0, 7700.0, 8050.0],
        }
    }

    /// Its name in settings and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Wood => "wood",
            Self::Plastic => "plastic",
            Self::Glass => "glass",
            Self::Aluminium => "aluminium",
            Self::Steel => "steel",
        }
    }
}
