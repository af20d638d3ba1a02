//! Handles of doors and drawers, and where they are.

use geometry::Pose;

/// Handles of doors and drawers in place of the plain ones of their family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HandleStyle {
    /// Bars on two posts.
    Bar,
    /// Knobs.
    Knob,
    /// Grips let into the plate.
    Recess,
    /// One of these each.
    Mixed,
    /// None at all.
    Bare,
}

impl HandleStyle {
    /// The style by its name on the command line.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        Some(match name {
            "bar" => Self::Bar,
            "knob" => Self::Knob,
            "recess" => Self::Recess,
            "mixed" => Self::Mixed,
            "none" => Self::Bare,
            _ => return None,
        })
    }
}

/// Type and sizes of a handle, meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HandleKind {
    /// A bar along x, centered on its frame.
    Bar {
        /// Along x.
        length_m: f64,
        /// Along y and z.
        thickness_m: f64,
        /// Air between bar and plate.
        clearance_m: f64,
    },
    /// A disk about z on a stem, its head centered on its frame.
    Knob {
        /// Of the head.
        diameter_m: f64,
        /// From the plate to the outer end.
        height_m: f64,
    },
    /// A box let into the plate; the middle of its opening is the frame's origin.
    Recess {
        /// Along x.
        length_m: f64,
        /// Along y.
        width_m: f64,
        /// Along -z.
        depth_m: f64,
    },
}

impl HandleKind {
    /// Name in files.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Bar { .. } => "bar",
            Self::Knob { .. } => "knob",
            Self::Recess { .. } => "recess",
        }
    }
}

/// A handle and where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Handle {
    /// Its type and sizes.
    pub kind: HandleKind,
    /// Its frame in its part's: x along it, z out of the plate.
    pub part_from_handle: Pose,
}
