//! Refusals of the articulation trainer.

/// Fewest parts: a static and a moving one.
pub(crate) const MIN_PARTS: usize = 2;
/// Most parts of a segmentation.
pub(crate) const MAX_PARTS: usize = 64;
/// An unusable input of the articulation trainer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrainerError {
    /// Number of parts out of range.
    #[error(
        "{parts} parts were asked for; between 2 (a static and a moving one) and {MAX_PARTS} can be separated"
    )]
    Parts {
        /// The wanted number.
        parts: usize,
    },
    /// A setting out of range.
    #[error("articulation.{name} = {value} is out of range; {remedy}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: String,
        /// Accepted values.
        remedy: &'static str,
    },
    /// A state without rays.
    #[error(
        "state {state} has no surface ray; its frames hold no usable object depth: check masks, depth and \
         workspace"
    )]
    NoRays {
        /// Number of the state.
        state: usize,
    },
    /// An input in conflict with the others.
    #[error("{what} of state {state}: {problem}")]
    Mismatch {
        /// Name of the input.
        what: &'static str,
        /// Number of the state.
        state: usize,
        /// The fault and its remedy.
        problem: String,
    },
    /// Initial motions not of the number of parts.
    #[error("{got} initial motions for {parts} parts; give one finite motion a part, the first the identity")]
    InitialMotions {
        /// Motions given.
        got: usize,
        /// Parts asked for.
        parts: usize,
    },
    /// A checkpoint of another problem.
    #[error("the checkpoint belongs to another run ({what} differs); start again without --resume")]
    Checkpoint {
        /// The difference.
        what: &'static str,
    },
}

impl TrainerError {
    /// Refuses a setting unless it is in range.
    pub fn unless(
        in_range: bool,
        name: &'static str,
        value: String,
        remedy: &'static str,
    ) -> Result<(), Self> {
        if in_range { Ok(()) } else { Err(Self::Setting { name, value, remedy }) }
    }
}
