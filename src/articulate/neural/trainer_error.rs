//! Errors of the articulation trainer.

/// Fewest parts: a static and a moving one.
pub(crate) const MIN_PARTS: usize = 2;
/// Most parts of a segmentation.
pub(crate) const MAX_PARTS: usize = 64;
/// An unusable input of the articulation trainer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrainerError {
    /// The number of parts is out of range.
    #[error(
        "{parts} parts were asked for; between 2 (a static and a moving one) and {MAX_PARTS} can be separated"
    )]
    Parts {
        /// The number asked for.
        parts: usize,
    },
    /// A setting is out of range.
    #[error("articulation.{name} = {value} is out of range; {remedy}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: String,
        /// What to set instead.
        remedy: &'static str,
    },
    /// A state has no rays.
    #[error(
        "state {state} has no surface ray; its frames hold no usable object depth: check masks, depth and \
         workspace"
    )]
    NoRays {
        /// Index of the state.
        state: usize,
    },
    /// An input contradicts the others.
    #[error("{what} of state {state}: {problem}")]
    Mismatch {
        /// Name of the input.
        what: &'static str,
        /// Index of the state.
        state: usize,
        /// What is wrong, and what to do.
        problem: String,
    },
    /// The number of initial motions is not the number of parts, or one of them is unusable.
    #[error("{got} initial motions for {parts} parts; give one finite motion a part, the first the identity")]
    InitialMotions {
        /// Number of motions given.
        got: usize,
        /// Number of parts asked for.
        parts: usize,
    },
    /// The checkpoint belongs to another problem.
    #[error("the checkpoint belongs to another run ({what} differs); start again without --resume")]
    Checkpoint {
        /// What differs.
        what: &'static str,
    },
}

impl TrainerError {
    /// Returns an error for a setting unless it is in range.
    pub fn unless(
        in_range: bool,
        name: &'static str,
        value: String,
        remedy: &'static str,
    ) -> Result<(), Self> {
        if in_range { Ok(()) } else { Err(Self::Setting { name, value, remedy }) }
    }
}
