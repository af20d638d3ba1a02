//! In place of `device.rs` where the binary was built without the `wgpu` feature: there is no GPU, and what
//! stands here is never run.

use bytemuck::Pod;

use super::{adapter::Adapter, error::GpuError, kernel::Kernel};

/// Nothing is of this type.
#[derive(Clone, Debug)]
enum Never {}

/// Bytes in storage of a GPU: there is none.
pub(crate) struct Buffer(Never);

/// A GPU: there is none.
#[derive(Clone, Debug)]
pub struct Gpu(Never);

impl Gpu {
    /// No GPU is opened.
    ///
    /// # Errors
    /// [`GpuError::NotBuilt`], always.
    pub fn open(_: bool) -> Result<Self, GpuError> {
        Err(GpuError::NotBuilt)
    }

    /// The adapter that it works on.
    #[must_use]
    pub fn adapter(&self) -> &Adapter {
        match self.0 {}
    }

    pub(crate) fn guarded<T>(
        &self,
        _: &'static str,
        _: impl FnOnce() -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        match self.0 {}
    }

    pub(crate) fn require(&self, _: &'static str, _: usize) -> Result<(), GpuError> {
        match self.0 {}
    }

    pub(crate) fn most_bytes(&self) -> u64 {
        match self.0 {}
    }

    pub(crate) fn buffer<T: Pod>(&self, _: &[T]) -> Buffer {
        match self.0 {}
    }

    pub(crate) fn zeros(&self, _: usize) -> Buffer {
        match self.0 {}
    }

    pub(crate) fn start(&self, kernel: &Kernel, _: &[&Buffer], threads: usize) {
        // What a kernel is does not depend on the feature.
        let _ = (kernel.name, kernel.source, threads, Kernel::GROUP, Kernel::MOST_GROUPS);
        match self.0 {}
    }

    pub(crate) fn read<T: Pod>(&self, _: &'static str, _: &Buffer) -> Result<Vec<T>, GpuError> {
        match self.0 {}
    }
}

/// No adapters can be listed.
///
/// # Errors
/// [`GpuError::NotBuilt`], always.
pub fn adapters() -> Result<Vec<Adapter>, GpuError> {
    Err(GpuError::NotBuilt)
}
