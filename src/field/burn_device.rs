//! Devices of the burn engine, and their errors.

use std::panic::{AssertUnwindSafe, catch_unwind};

/// Why the burn engine cannot run. The CPU engine can take over in each case.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EngineError {
    /// The binary was built without the `gpu` feature.
    #[error(
        "this binary was built without GPU support; build it with `--features gpu` or use the CPU engine"
    )]
    NotBuilt,
    /// There is no adapter, or the driver refused to open it.
    #[error(
        "no GPU could be opened: {message}; install a Vulkan driver (`artitwin doctor` lists adapters) or \
         use the CPU engine"
    )]
    Unavailable {
        /// The driver's message.
        message: String,
    },
    /// The device failed during an operation.
    #[error("the device failed while it {doing}: {message}; use the CPU engine, or a smaller table or batch")]
    Failed {
        /// The operation that failed.
        doing: &'static str,
        /// Message of the device or of burn.
        message: String,
    },
    /// Parameters or moments have inconsistent sizes.
    #[error("field parameters do not fit together: {0}; the checkpoint is damaged or of another version")]
    Shape(String),
}

/// Runs `work` and turns a panic of burn or of the driver into [`EngineError::Failed`].
pub(super) fn guarded<T>(
    doing: &'static str,
    work: impl FnOnce() -> Result<T, EngineError>,
) -> Result<T, EngineError> {
    // A failed engine is never used again, so no half-finished state is read.
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| {
        let text = payload.downcast_ref::<String>().cloned();
        let text = text.or_else(|| payload.downcast_ref::<&str>().map(ToString::to_string));
        Err(EngineError::Failed {
            doing,
            message: text.unwrap_or_else(|| "panicked without a message".into()),
        })
    })
}

/// A GPU adapter visible to wgpu.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adapter {
    /// Name, kind, interface and driver.
    pub description: String,
    /// Whether it renders in software, which is slower than the CPU engine.
    pub is_software: bool,
}

/// Adapters visible to wgpu.
///
/// # Errors
/// [`EngineError::NotBuilt`] without the `gpu` feature, [`EngineError::Failed`] if a driver panics.
#[cfg(feature = "gpu")]
pub fn adapters() -> Result<Vec<Adapter>, EngineError> {
    use burn::tensor::{read_sync, wgpu::wgpu};
    guarded("listed the adapters", || {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let found = read_sync(instance.enumerate_adapters(wgpu::Backends::all()));
        Ok(found.iter().map(|adapter| described_adapter(&adapter.get_info())).collect())
    })
}

#[cfg(feature = "gpu")]
fn described_adapter(info: &burn::tensor::wgpu::wgpu::AdapterInfo) -> Adapter {
    let driver = format!("{} {}", info.driver, info.driver_info);
    Adapter {
        description: format!(
            "{} ({:?}, {:?}, driver {})",
            info.name,
            info.device_type,
            info.backend,
            driver.trim()
        ),
        is_software: info.device_type == burn::tensor::wgpu::wgpu::DeviceType::Cpu,
    }
}

/// Adapters visible to wgpu: this binary has no GPU support.
///
/// # Errors
/// Always [`EngineError::NotBuilt`].
#[cfg(not(feature = "gpu"))]
pub fn adapters() -> Result<Vec<Adapter>, EngineError> {
    Err(EngineError::NotBuilt)
}

/// The best adapter, opened once per process.
///
/// Adapters without atomic addition of floats are refused: on these, burn scatters the table's gradient in
/// one thread. That takes seconds per step, and drivers that limit loops drop most of it without an error.
#[cfg(feature = "gpu")]
pub(super) fn wgpu_device() -> Result<burn::tensor::Device, EngineError> {
    use burn::tensor::Device;
    static DEVICE: std::sync::OnceLock<Result<Device, EngineError>> = std::sync::OnceLock::new();
    DEVICE.get_or_init(|| guarded("was opened", opened_device)).clone()
}

#[cfg(feature = "gpu")]
fn opened_device() -> Result<burn::tensor::Device, EngineError> {
    use burn::tensor::{Device, wgpu::wgpu::Features};
    let (device, setup) = Device::wgpu_options()
        .init_with_setup()
        .map_err(|e| EngineError::Unavailable { message: e.to_string() })?;
    if !setup.device.features().contains(Features::SHADER_FLOAT32_ATOMIC) {
        let message = format!("{} has no atomic addition of floats", setup.adapter.get_info().name);
        return Err(EngineError::Unavailable { message });
    }
    Ok(device)
}
