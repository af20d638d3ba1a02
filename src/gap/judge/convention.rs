//! Conventions of the numbers of a recording or a twin other than the program's.

use crate::twin_tree::{Motion, TwinTree};

/// A convention of units or signs. Each factor converts numbers to the program's convention.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Convention {
    /// Factor of the twin's lengths.
    pub lengths: f64,
    /// Factor of its masses.
    pub masses: f64,
    /// Additional factor of its inertia tensors.
    pub tensors: f64,
    /// Factor of recorded efforts.
    pub effort: f64,
    /// Factor of recorded angles.
    pub angles: f64,
    /// Factor of recorded positions of sliding joints.
    pub ways: f64,
    /// What the numbers look like, in words.
    pub looks: &'static str,
    /// What the user should do, in words.
    pub remedy: &'static str,
}

/// The program's convention: SI units and radians, efforts positive along the axis.
pub const AS_GIVEN: Convention = Convention {
    lengths: 1.0,
    masses: 1.0,
    tensors: 1.0,
    effort: 1.0,
    angles: 1.0,
    ways: 1.0,
    looks: "as given",
    remedy: "",
};

/// A thousandth, for units with the prefix milli.
/// derived: the prefix.
const MILLI: f64 = 1e-3;
/// derived: one degree in radians.
const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// A convention of the twin: factors of lengths, masses and inertia tensors.
const fn twin_convention(lengths: f64, masses: f64, tensors: f64, looks: &'static str) -> Convention {
    let remedy = "give the twin in kg, m and kg m^2";
    Convention { lengths, masses, tensors, looks, remedy, ..AS_GIVEN }
}

/// The conventions tried. Each is a single change.
pub const CONVENTIONS: &[Convention] = &[
    twin_convention(MILLI, 1.0, 1.0, "the twin's lengths look like millimeters"),
    twin_convention(1.0, MILLI, 1.0, "the twin's masses look like grams"),
    twin_convention(MILLI, MILLI, 1.0, "the twin's lengths look like millimeters and its masses like grams"),
    twin_convention(1.0, 1.0, MILLI * MILLI, "the twin's inertia tensors look like kg mm^2"),
    twin_convention(1.0, 1.0, MILLI * MILLI * MILLI, "the twin's inertia tensors look like g mm^2"),
    twin_convention(1.0 / MILLI, 1.0, 1.0, "the twin's lengths look like kilometers"),
    twin_convention(1.0, 1.0 / MILLI, 1.0, "the twin's masses look like tonnes"),
    Convention {
        effort: -1.0,
        looks: "its efforts have the sign of the opposite axis",
        remedy: "record efforts in the sense of the axis, or turn them with --effort-unit -1",
        ..AS_GIVEN
    },
    Convention {
        effort: MILLI,
        looks: "its efforts look like thousandths of N m or N (mN m, or mA)",
        remedy: "give their unit with --effort-unit, 0.001 for mN m, or --effort-unit unknown",
        ..AS_GIVEN
    },
    Convention {
        angles: DEGREE,
        looks: "its positions look like degrees",
        remedy: "record positions in radians",
        ..AS_GIVEN
    },
    Convention {
        ways: MILLI,
        looks: "its positions look like millimeters",
        remedy: "record positions in meters",
        ..AS_GIVEN
    },
];

impl Convention {
    /// Whether it concerns the twin, and so all of its joints.
    #[must_use]
    pub fn is_of_twin(&self) -> bool {
        [self.lengths, self.masses, self.tensors] != [1.0; 3]
    }

    /// Whether it only reverses the sign of efforts.
    #[must_use]
    pub fn is_of_sign(&self) -> bool {
        self.effort < 0.0
    }

    /// Whether a joint with this motion can show it.
    #[must_use]
    pub fn concerns_motion(&self, motion: Motion) -> bool {
        match motion {
            Motion::Turn => self.ways == 1.0,
            Motion::Slide => self.angles == 1.0,
            Motion::Fixed => false,
        }
    }

    /// The twin in SI units, assuming it was written in this convention.
    #[must_use]
    pub fn converted_twin(&self, tree: &TwinTree) -> TwinTree {
        let mut tree = tree.clone();
        for link in &mut tree.links {
            link.mass_kg *= self.masses;
            link.center_of_mass.coords *= self.lengths;
            link.inertia *= self.masses * self.lengths * self.lengths * self.tensors;
        }
        for joint in &mut tree.joints {
            joint.parent_from_joint.translation.vector *= self.lengths;
        }
        tree
    }

    /// Factor of a joint's recorded positions.
    #[must_use]
    pub fn of_position(&self, motion: Motion) -> f64 {
        match motion {
            Motion::Turn => self.angles,
            Motion::Slide => self.ways,
            Motion::Fixed => 1.0,
        }
    }
}
