//! Work of the stages on a GPU, through wgpu (feature `wgpu`). A kernel is a WGSL file beside the code of
//! the stage that it stands in for; what it finds is what that code finds, up to rounding.

mod adapter;
#[cfg(not(feature = "wgpu"))]
#[path = "absent.rs"]
mod device;
#[cfg(feature = "wgpu")]
mod device;
mod error;
mod kernel;
mod offload;

pub use adapter::Adapter;
pub(crate) use device::Buffer;
pub use device::{Gpu, adapters};
pub use error::GpuError;
pub(crate) use kernel::Kernel;
pub use offload::{Offload, Work};

#[cfg(all(test, feature = "wgpu"))]
pub(crate) mod tests {
    use super::*;

    /// What kernels are tried on, in software or not; `None` where there is nothing, but with `CI=true`.
    #[expect(clippy::print_stdout, reason = "tests print")]
    pub(crate) fn any_gpu() -> Option<Gpu> {
        match Gpu::open(true) {
            Ok(gpu) => Some(gpu),
            Err(error) if std::env::var_os("CI").is_some() => panic!("{error}"),
            Err(error) => {
                println!("skipped: {error}");
                None
            }
        }
    }
}
