//! Why a GPU does no work.

/// Why a GPU does no work. The processor can take over from any of these.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// The binary was built without the `wgpu` feature.
    #[error("built without GPU support; build it with `--features wgpu`")]
    NotBuilt,
    /// There is no adapter of the kind that is asked for.
    #[error("no GPU was found; install a Vulkan driver (`artitwin doctor` lists adapters)")]
    NoAdapter,
    /// The driver refused to open it.
    #[error("the GPU could not be opened: {0}")]
    Unavailable(String),
    /// The work needs more memory in one piece than the GPU gives.
    #[error("{doing} needs {needed} bytes in one piece, and the GPU gives {most}")]
    TooLarge {
        /// The work.
        doing: &'static str,
        /// Bytes that it needs.
        needed: u64,
        /// Most bytes of a buffer.
        most: u64,
    },
    /// The device failed at work.
    #[error("the GPU failed at {doing}: {message}")]
    Failed {
        /// The work.
        doing: &'static str,
        /// What the device says.
        message: String,
    },
}
