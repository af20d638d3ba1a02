//! A program for a GPU.

/// A program for a GPU: a WGSL module with an entry point `main` in groups of [`Kernel::GROUP`] threads,
/// whose bindings are numbered from 0 on.
pub(crate) struct Kernel {
    /// Its name, by which it is compiled once.
    pub name: &'static str,
    /// WGSL.
    pub source: &'static str,
}

impl Kernel {
    /// Threads of a group.
    pub const GROUP: usize = 64;
    /// Most groups along an axis that every device takes.
    pub const MOST_GROUPS: usize = 65_535;
}
