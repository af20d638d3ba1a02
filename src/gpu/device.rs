//! A GPU, its buffers, and kernels that run on it.

use std::{
    collections::HashMap,
    future::Future,
    pin::pin,
    sync::{Arc, Mutex, PoisonError},
    task::{Context, Poll, Waker},
};

use bytemuck::Pod;
use wgpu::util::DeviceExt as _;

use super::{adapter::Adapter, error::GpuError, kernel::Kernel};

/// Bytes in storage of a GPU.
pub(crate) type Buffer = wgpu::Buffer;

/// A GPU. A copy is the same GPU.
#[derive(Clone, Debug)]
pub struct Gpu(Arc<Opened>);

#[derive(Debug)]
struct Opened {
    adapter: Adapter,
    device: wgpu::Device,
    queue: wgpu::Queue,
    /// Kernels by name.
    pipelines: Mutex<HashMap<&'static str, wgpu::ComputePipeline>>,
}

/// What a future of wgpu gives. Outside browsers they are ready at once, or wait for the driver by
/// themselves.
fn wait<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    loop {
        match future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(value) => return value,
            Poll::Pending => std::thread::yield_now(),
        }
    }
}

fn all() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    wait(instance.enumerate_adapters(wgpu::Backends::all()))
}

fn described(adapter: &wgpu::Adapter) -> Adapter {
    let i = adapter.get_info();
    let driver = format!("{} {}", i.driver, i.driver_info);
    let description = format!("{} ({:?}, {:?}, driver {})", i.name, i.device_type, i.backend, driver.trim());
    Adapter { description, is_software: i.device_type == wgpu::DeviceType::Cpu }
}

/// Adapters that wgpu sees.
///
/// # Errors
/// [`GpuError::NotBuilt`] without the `wgpu` feature.
pub fn adapters() -> Result<Vec<Adapter>, GpuError> {
    Ok(all().iter().map(described).collect())
}

impl Gpu {
    /// Opens the best adapter: a card of its own before one that shares the processor's memory, and with
    /// `software` one in software, where there is no other.
    ///
    /// # Errors
    /// Without such an adapter, or if its driver refuses it.
    pub fn open(software: bool) -> Result<Self, GpuError> {
        use wgpu::DeviceType::{Cpu, DiscreteGpu, IntegratedGpu};
        let rank = |adapter: &wgpu::Adapter| match adapter.get_info().device_type {
            DiscreteGpu => Some(0),
            IntegratedGpu => Some(1),
            Cpu => software.then_some(3),
            _ => Some(2),
        };
        let adapter = all().into_iter().filter_map(|a| rank(&a).map(|rank| (rank, a))).min_by_key(|a| a.0);
        let (_, adapter) = adapter.ok_or(GpuError::NoAdapter)?;
        // Everything that the adapter has: buffers are as large as the recording asks for.
        let wanted = wgpu::DeviceDescriptor {
            label: Some("artitwin"),
            required_limits: adapter.limits(),
            memory_hints: wgpu::MemoryHints::Performance,
            ..wgpu::DeviceDescriptor::default()
        };
        let opened = wait(adapter.request_device(&wanted));
        let (device, queue) = opened.map_err(|e| GpuError::Unavailable(e.to_string()))?;
        let adapter = described(&adapter);
        Ok(Self(Arc::new(Opened { adapter, device, queue, pipelines: Mutex::default() })))
    }

    /// The adapter that it works on.
    #[must_use]
    pub fn adapter(&self) -> &Adapter {
        &self.0.adapter
    }

    /// Runs work and gives the first error that the device reports meanwhile to this thread.
    pub(crate) fn guarded<T>(
        &self,
        doing: &'static str,
        work: impl FnOnce() -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        use wgpu::ErrorFilter::{Internal, OutOfMemory, Validation};
        let scopes = [Validation, Internal, OutOfMemory].map(|kind| self.0.device.push_error_scope(kind));
        let result = work();
        // The last that was opened is closed first.
        let errors: Vec<wgpu::Error> =
            scopes.into_iter().rev().filter_map(|scope| wait(scope.pop())).collect();
        match errors.first() {
            Some(error) => Err(GpuError::Failed { doing, message: error.to_string() }),
            None => result,
        }
    }

    /// Refuses work that needs more bytes in one piece than the GPU gives.
    pub(crate) fn require(&self, doing: &'static str, needed: usize) -> Result<(), GpuError> {
        let (needed, most) = (needed as u64, self.most_bytes());
        if needed > most { Err(GpuError::TooLarge { doing, needed, most }) } else { Ok(()) }
    }

    /// Most bytes of a buffer.
    pub(crate) fn most_bytes(&self) -> u64 {
        let limits = self.0.device.limits();
        limits.max_buffer_size.min(limits.max_storage_buffer_binding_size)
    }

    /// Values in storage of the GPU; at least one word, as no buffer may be empty.
    pub(crate) fn buffer<T: Pod>(&self, values: &[T]) -> Buffer {
        let contents = match bytemuck::cast_slice(values) {
            [] => &[0u8; 4],
            bytes => bytes,
        };
        let usage = wgpu::BufferUsages::STORAGE;
        self.0.device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
    }

    /// Zeros in storage of the GPU, which can be read back.
    pub(crate) fn zeros(&self, words: usize) -> Buffer {
        self.0.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 4 * words.max(1) as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        })
    }

    /// Starts a kernel with at least so many threads; thread `i` is number
    /// `(group.y * groups.x + group.x) * GROUP + local`.
    pub(crate) fn start(&self, kernel: &Kernel, buffers: &[&Buffer], threads: usize) {
        let groups = threads.div_ceil(Kernel::GROUP);
        let columns = groups.clamp(1, Kernel::MOST_GROUPS);
        let rows = groups.div_ceil(columns);
        let (device, pipeline) = (&self.0.device, self.pipeline(kernel));
        let entries: Vec<_> = (0..)
            .zip(buffers)
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        let layout = &pipeline.get_bind_group_layout(0);
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(kernel.name),
            layout,
            entries: &entries,
        });
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(columns as u32, rows as u32, 1);
        }
        self.0.queue.submit([encoder.finish()]);
    }

    fn pipeline(&self, kernel: &Kernel) -> wgpu::ComputePipeline {
        let mut pipelines = self.0.pipelines.lock().unwrap_or_else(PoisonError::into_inner);
        let compile = || {
            let module = self.0.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(kernel.name),
                source: wgpu::ShaderSource::Wgsl(kernel.source.into()),
            });
            self.0.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(kernel.name),
                layout: None,
                module: &module,
                entry_point: Some("main"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        };
        pipelines.entry(kernel.name).or_insert_with(compile).clone()
    }

    /// What a buffer of [`Self::zeros`] holds when all that was started is done.
    pub(crate) fn read<T: Pod>(&self, doing: &'static str, buffer: &Buffer) -> Result<Vec<T>, GpuError> {
        let failed = |message: String| GpuError::Failed { doing, message };
        let (device, size) = (&self.0.device, buffer.size());
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
        let copy = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size,
            usage,
            mapped_at_creation: false,
        });
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &copy, 0, size);
        let submission_index = Some(self.0.queue.submit([encoder.finish()]));
        let (done, mapped) = std::sync::mpsc::channel();
        copy.map_async(wgpu::MapMode::Read, .., move |result| {
            // Nobody waits where the device failed before.
            done.send(result).ok();
        });
        device
            .poll(wgpu::PollType::Wait { submission_index, timeout: None })
            .map_err(|e| failed(e.to_string()))?;
        mapped.recv().map_err(|e| failed(e.to_string()))?.map_err(|e| failed(e.to_string()))?;
        let view = copy.get_mapped_range(..).map_err(|e| failed(e.to_string()))?;
        Ok(bytemuck::pod_collect_to_vec(&view[..]))
    }
}
