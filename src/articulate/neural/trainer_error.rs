//! What the articulation trainer refuses to work with.

/// Fewest parts: a static and a moving one.
pub(crate) const MIN_PARTS: usize = 2;
/// Most parts that a segmentation can have.
pub(crate) const MAX_PARTS: usize = 64;
/// The articulation trainer cannot work with what it was given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrainerError {
    /// Number of parts out of range.
    #[error(
        "{parts} parts were asked for; between 2 (a static and a moving one) and {MAX_PARTS} can be separated"
    )]
    Parts {
        /// What was asked for.
        parts: usize,
    },
    /// A setting out of range.
    #[error("articulation.{name} = {value} is out of range; {remedy}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: String,
        /// What would be accepted.
        remedy: &'static str,
    },
    /// A state without rays.
    #[error(
        "state {state} has no surface ray; its frames hold no usable object depth: check masks, depth and \
         workspace"
    )]
    NoRays {
        /// Which state.
        state: usize,
    },
    /// An input that does not fit the others.
    #[error("{what} of state {state}: {problem}")]
    Mismatch {
        /// Which input.
        what: &'static str,
        /// Which state.
        state: usize,
        /// What is wrong and what would be right.
        problem: String,
    },
    /// Initial motions that do not fit the number of parts.
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
        /// What differs.
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
