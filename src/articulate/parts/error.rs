//! Why the registration found no parts and motions.

/// Why there is no registration.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum RegisterError {
    /// The arguments make no sense.
    #[error("{what}; {remedy}")]
    Input {
        /// What is wrong.
        what: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Nothing moved.
    #[error(
        "no part moved between the two states ({static_percent:.0} % of the surface stands still); \
         record the second state with the joints moved"
    )]
    NoMotion {
        /// Static share of the surface, percent.
        static_percent: f64,
    },
    /// Nothing stands still.
    #[error(
        "the two states do not overlap: {static_percent:.1} % of the surface stands still; record both \
         states in one world frame, with the same object and one part at rest"
    )]
    NoOverlap {
        /// Share of the surface that stands still, percent.
        static_percent: f64,
    },
    /// One motion is left, and most of the surface neither follows nor contradicts it.
    #[error(
        "too little surface is shared by the states: {static_percent:.1} % of it stands still, \
         {moved_percent:.1} % left its place, and the rest is seen in one state only; the object was moved \
         as a whole, or recorded from other sides: leave one part at rest and walk around all of it in \
         every state"
    )]
    LittleShared {
        /// Share of the surface that stands still, percent.
        static_percent: f64,
        /// Share of the surface moved from its place, percent.
        moved_percent: f64,
    },
    /// Something moved, and no rigid motion explains it.
    #[error(
        "{moved_percent:.1} % of the surface moved between the two states, but no rigid motion explains \
         it; record more views that overlap in both states, or a smaller motion"
    )]
    Unexplained {
        /// Share of unexplained moved surface, percent.
        moved_percent: f64,
    },
    /// Fewer motions are supported than were asked for.
    #[error(
        "{asked} parts were asked for, but {found} are supported (the static part and {moving} that \
         move: {support}); ask for {found} parts or record more views of the others"
    )]
    FewerParts {
        /// Number of parts asked for.
        asked: usize,
        /// Number of parts supported, the static one included.
        found: usize,
        /// Number of moving parts supported.
        moving: usize,
        /// Support of each, in words.
        support: String,
    },
}
