//! Devices for the burn engine, and what goes wrong with them.

use std::panic::{AssertUnwindSafe, catch_unwind};

/// Why the burn engine cannot work. The CPU engine can take over from any of these.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EngineError {
    /// The binary was built without the `gpu` feature.
    #[error(
        "this binary was built without GPU support; build it with `--features gpu` or use the CPU engine"
    )]
    NotBuilt,
    /// No adapter, or the driver refused to open it.
    #[error(
        "no GPU could be opened: {message}; install a Vulkan driver (`artitwin doctor` lists adapters) or \
         use the CPU engine"
    )]
    Unavailable {
        /// What the driver says.
        message: String,
    },
    /// The device failed at work.
    #[error("the device failed while it {doing}: {message}; use the CPU engine, or a smaller table or batch")]
    Failed {
        /// What was being done.
        doing: &'static str,
        /// What the device or burn says.
        message: String,
    },
    /// Parameters or moments do not fit together.
    #[error("field parameters do not fit together: {0}; the checkpoint is damaged or of another version")]
    Shape(String),
}

/// Runs `work` and turns a panic of burn or of the driver into [`EngineError::Failed`].
pub(super) fn guarded<T>(
    doing: &'static str,
    work: impl FnOnce() -> Result<T, EngineError>,
) -> Result<T, EngineError> {
    // An engine that failed is not asked again, so that nobody sees what a panic left half done.
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| {
        let text = payload.downcast_ref::<String>().cloned();
        let text = text.or_else(|| payload.downcast_ref::<&str>().map(ToString::to_string));
        Err(EngineError::Failed {
            doing,
            message: text.unwrap_or_else(|| "panicked without a message".into()),
        })
    })
}

/// What wgpu can open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adapter {
    /// Its name, kind, interface and driver.
    pub description: String,
    /// Whether it is a renderer in software, which is slower than the CPU engine on the same processor.
    pub is_software: bool,
}

/// Adapters that wgpu sees.
///
/// # Errors
/// [`EngineError::NotBuilt`] without the `gpu` feature, [`EngineError::Failed`] if a driver panics.
#[cfg(feature = "gpu")]
pub fn adapters() -> Result<Vec<Adapter>, EngineError> {
    use burn::tensor::{read_sync, wgpu::wgpu};
    guarded("listed the adapters", || {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let found = read_sync(instance.enumerate_adapters(wgpu::Backends::all()));
        let described = |adapter: &wgpu::Adapter| {
            let i = adapter.get_info();
            let driver = format!("{} {}", i.driver, i.driver_info);
            Adapter {
                description: format!(
                    "{} ({:?}, {:?}, driver {})",
                    i.name,
                    i.device_type,
                    i.backend,
                    driver.trim()
                ),
                is_software: i.device_type == wgpu::DeviceType::Cpu,
            }
        };
        Ok(found.iter().map(described).collect())
    })
}

/// Adapters that wgpu sees: this binary has no GPU support.
///
/// # Errors
/// Always [`EngineError::NotBuilt`].
#[cfg(not(feature = "gpu"))]
pub fn adapters() -> Result<Vec<Adapter>, EngineError> {
    Err(EngineError::NotBuilt)
}

/// The best adapter, opened once in a process.
///
/// Refused without atomic addition of floats: burn then scatters the table's gradient in one thread, which
/// takes seconds a step, and drivers that cap loops drop most of it without an error.
#[cfg(feature = "gpu")]
pub(super) fn wgpu_device() -> Result<burn::tensor::Device, EngineError> {
    use burn::tensor::{Device, wgpu::wgpu::Features};
    static DEVICE: std::sync::OnceLock<Result<Device, EngineError>> = std::sync::OnceLock::new();
    let unavailable = |message: String| EngineError::Unavailable { message };
    let open = || {
        let (device, setup) =
            Device::wgpu_options().init_with_setup().map_err(|e| unavailable(e.to_string()))?;
        if !setup.device.features().contains(Features::SHADER_FLOAT32_ATOMIC) {
            return Err(unavailable(format!(
                "{} has no atomic addition of floats",
                setup.adapter.get_info().name
            )));
        }
        Ok(device)
    };
    DEVICE.get_or_init(|| guarded("was opened", open)).clone()
}
