//! What wgpu can open.

/// An adapter that wgpu sees.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adapter {
    /// Its name, kind, interface and driver.
    pub description: String,
    /// Whether it is a renderer in software, which is slower than this program on the same processor.
    pub is_software: bool,
}
