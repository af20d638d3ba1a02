//! In place of `device.rs` where the binary was built without the `wgpu` feature: there is no GPU, and what
//! stands here is never run.

use bytemuck::Pod;

use super::{adapter::Adapter, error::GpuError, kernel::Kernel};

/// Bytes in storage of a GPU: there is none.
pub(crate) enum Buffer {}

/// A GPU: there is none.
#[derive(Clone, Debug)]
pub enum Gpu {}

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
        match *self {}
    }

    pub(crate) fn guarded<T>(
        &self,
        _: &'static str,
        _: impl FnOnce() -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        match *self {}
    }

    pub(crate) fn require(&self, _: &'static str, _: usize) -> Result<(), GpuError> {
        match *self {}
    }

    pub(crate) fn most_bytes(&self) -> u64 {
        match *self {}
    }

    pub(crate) fn buffer<T: Pod>(&self, _: &[T]) -> Buffer {
        match *self {}
    }

    pub(crate) fn zeros(&self, _: usize) -> Buffer {
        match *self {}
    }

    pub(crate) fn start(&self, kernel: &Kernel, _: &[&Buffer], threads: usize) {
        // What a kernel is does not depend on the feature.
        let _ = (kernel.name, kernel.source, threads, Kernel::GROUP, Kernel::MOST_GROUPS);
        match *self {}
    }

    pub(crate) fn read<T: Pod>(&self, _: &'static str, _: &Buffer) -> Result<Vec<T>, GpuError> {
        match *self {}
    }
}

/// No adapters can be listed.
///
/// # Errors
/// [`GpuError::NotBuilt`], always.
pub fn adapters() -> Result<Vec<Adapter>, GpuError> {
    Err(GpuError::NotBuilt)
}
