//! Adapter and device, and their errors.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

use relevo_core::{Error, Result};

/// A graphics device and where it comes from.
#[derive(Debug)]
pub struct Gpu {
    /// The instance, which also makes surfaces of windows.
    pub instance: wgpu::Instance,
    /// The adapter.
    pub adapter: wgpu::Adapter,
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    faults: Faults,
}

/// Errors of the device since the last check.
#[derive(Clone, Debug, Default)]
struct Faults(Arc<Mutex<Fault>>);

#[derive(Debug, Default)]
struct Fault {
    lost: Option<String>,
    memory: bool,
    other: Option<String>,
}

impl Faults {
    fn with<T>(&self, act: impl FnOnce(&mut Fault) -> T) -> T {
        act(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn note(&self, error: &wgpu::Error) {
        self.with(|fault| match error {
            wgpu::Error::OutOfMemory { .. } => fault.memory = true,
            // The first one is the cause of those that follow.
            _ => _ = fault.other.get_or_insert_with(|| error.to_string()),
        });
    }
}

fn lost(why: &str) -> Error {
    Error::unsupported(
        format!("the graphics device is gone ({why})"),
        "start again; if it happens again, use a newer driver or the software adapter (--adapter software)",
    )
}

fn too_small(what: impl std::fmt::Display) -> Error {
    let hint = "install the driver of your graphics card, or mesa-vulkan-drivers, which draws in software";
    Error::unsupported(what.to_string(), hint)
}

/// Returns WebGPU's default limits, with the adapter's own sizes of textures and buffers where they
/// are larger.
fn limits(adapter: &wgpu::Adapter) -> wgpu::Limits {
    let (has, least) = (adapter.limits(), wgpu::Limits::default());
    wgpu::Limits {
        max_texture_dimension_2d: least.max_texture_dimension_2d.max(has.max_texture_dimension_2d),
        max_texture_array_layers: least.max_texture_array_layers.max(has.max_texture_array_layers),
        max_buffer_size: least.max_buffer_size.max(has.max_buffer_size),
        max_storage_buffer_binding_size: least
            .max_storage_buffer_binding_size
            .max(has.max_storage_buffer_binding_size),
        ..least
    }
}

/// Returns the adapters of some backends that need no window, and their instance.
fn adapters_of(backends: wgpu::Backends) -> (wgpu::Instance, Vec<wgpu::Adapter>) {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    descriptor.backends = backends;
    let instance = wgpu::Instance::new(descriptor);
    let adapters = pollster::block_on(instance.enumerate_adapters(backends));
    (instance, adapters)
}

impl Gpu {
    /// Returns a device of the best adapter that can draw on `surface`, or of the best at all if
    /// there is none.
    pub fn new(instance: wgpu::Instance, surface: Option<&wgpu::Surface<'_>>) -> Result<Self> {
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            compatible_surface: surface,
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options))
            .map_err(|error| too_small(format!("no graphics adapter can be used ({error})")))?;
        Self::on(instance, adapter)
    }

    /// Returns a device without a window: of a software adapter if `software` holds and there is
    /// one, else of the fastest.
    pub fn headless(software: bool) -> Result<Self> {
        // OpenGL is slow to ask, and chatty: only where it is all there is, or asked for by
        // WGPU_BACKEND.
        let backends = wgpu::Backends::from_env();
        let (mut instance, mut adapters) = adapters_of(backends.unwrap_or(wgpu::Backends::PRIMARY));
        if backends.is_none() && adapters.is_empty() {
            (instance, adapters) = adapters_of(wgpu::Backends::all());
        }
        // Adapters of the same kind stay in the order that wgpu prefers.
        adapters.sort_by_key(|adapter| {
            let kind = adapter.get_info().device_type;
            let speed = match kind {
                wgpu::DeviceType::DiscreteGpu => 1,
                wgpu::DeviceType::IntegratedGpu => 2,
                wgpu::DeviceType::VirtualGpu => 3,
                wgpu::DeviceType::Other => 4,
                wgpu::DeviceType::Cpu => 5,
            };
            if software && kind == wgpu::DeviceType::Cpu { 0 } else { speed }
        });
        let mut first = None;
        for adapter in adapters {
            match Self::on(instance.clone(), adapter) {
                Ok(gpu) => return Ok(gpu),
                Err(error) => first = first.or(Some(error)),
            }
        }
        Err(first.unwrap_or_else(|| too_small("there is no graphics adapter")))
    }

    /// Returns a device of this adapter.
    pub fn on(instance: wgpu::Instance, adapter: wgpu::Adapter) -> Result<Self> {
        let name = adapter.get_info().name;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("relevo"),
            required_features: wgpu::Features::empty(),
            required_limits: limits(&adapter),
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| too_small(format!("the graphics adapter {name} cannot be used ({error})")))?;
        let faults = Faults::default();
        let noted = faults.clone();
        device.on_uncaptured_error(Arc::new(move |error| noted.note(&error)));
        let noted = faults.clone();
        device.set_device_lost_callback(move |reason, message| {
            let why = match (reason, message.is_empty()) {
                (wgpu::DeviceLostReason::Destroyed, true) => "it was destroyed".to_owned(),
                (_, true) => "the driver does not say why".to_owned(),
                (_, false) => message,
            };
            noted.with(|fault| fault.lost = Some(why));
        });
        Ok(Self { instance, adapter, device, queue, faults })
    }

    /// Returns the names of adapter and backend.
    pub fn name(&self) -> String {
        let info = self.adapter.get_info();
        format!("{}, {}", info.name, info.backend)
    }

    /// Fails with what went wrong since the last call: a lost device, too little memory, a call
    /// that the device refused.
    pub fn check(&self) -> Result<()> {
        let (gone, memory, other) = self
            .faults
            .with(|fault| (fault.lost.clone(), std::mem::take(&mut fault.memory), fault.other.take()));
        if let Some(why) = gone {
            return Err(lost(&why));
        }
        if memory {
            return Err(Error::unsupported(
                "the graphics device has too little memory",
                "use a smaller --gpu-memory, or a smaller picture",
            ));
        }
        match other {
            Some(what) => Err(Error::unsupported(
                format!("the graphics device refused a call: {what}"),
                "use a newer driver, or the software adapter (--adapter software), and report it",
            )),
            None => Ok(()),
        }
    }

    /// Runs the callbacks of finished work; waits for all of it if `wait` holds.
    pub(crate) fn poll(&self, wait: bool) -> Result<()> {
        self.check()?;
        let how = if wait { wgpu::PollType::wait_indefinitely() } else { wgpu::PollType::Poll };
        // wgpu reports a device that is lost while it is waited for by a panic.
        match catch_unwind(AssertUnwindSafe(|| self.device.poll(how))) {
            Ok(Ok(_)) => self.check(),
            Ok(Err(error)) => Err(lost(&error.to_string())),
            Err(_) => Err(lost("while it was waited for")),
        }
    }

    /// Returns the bytes of a buffer that can be mapped; waits for them.
    pub(crate) fn read(&self, buffer: &wgpu::Buffer) -> Result<Vec<u8>> {
        let (sender, receiver) = std::sync::mpsc::channel();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| _ = sender.send(result.is_ok()));
        self.poll(true)?;
        if receiver.try_recv() != Ok(true) {
            return Err(lost("it does not give its data back"));
        }
        let bytes = match buffer.get_mapped_range(..) {
            Ok(view) => view.to_vec(),
            Err(error) => return Err(lost(&error.to_string())),
        };
        buffer.unmap();
        Ok(bytes)
    }

    /// Returns `bytes` bytes of a buffer from `at` on; waits for the work before.
    pub(crate) fn copy(&self, buffer: &wgpu::Buffer, at: u64, bytes: u64) -> Result<Vec<u8>> {
        self.check()?;
        if bytes == 0 {
            return Ok(Vec::new());
        }
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let staging = self.buffer("readback", bytes, usage)?;
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(buffer, at, &staging, 0, bytes);
        self.queue.submit([encoder.finish()]);
        let mut out = self.read(&staging)?;
        out.truncate(bytes as usize);
        Ok(out)
    }

    /// Returns a buffer of `size` bytes; fails if the device cannot have one of this size.
    pub(crate) fn buffer(&self, label: &str, size: u64, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer> {
        let limits = self.device.limits();
        let most = if usage.contains(wgpu::BufferUsages::STORAGE) {
            limits.max_buffer_size.min(limits.max_storage_buffer_binding_size)
        } else {
            limits.max_buffer_size
        };
        if size > most {
            return Err(Error::limit(format!("the graphics buffer of {label}, in bytes,"), size, most));
        }
        // An empty binding is none.
        let size = size.max(256).next_multiple_of(16);
        let descriptor =
            wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
        Ok(self.device.create_buffer(&descriptor))
    }
}
