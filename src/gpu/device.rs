//! Choosing and opening a device.
//!
//! `auto` and `gpu` take a real GPU: discrete before integrated before virtual. Software Vulkan is taken only by name, as the
//! CPU twin is faster than it. Opening runs on a thread of its own, so that a driver that hangs costs the deadline and
//! not the job.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::error::{DeviceError, line};
use super::layout;
use crate::encode::cost::DeviceChoice;

/// What kind of device it is, the best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A GPU with memory of its own.
    Discrete,
    /// A GPU that shares the processor's memory.
    Integrated,
    /// A part of a GPU, given to a virtual machine.
    Virtual,
    /// The driver does not say.
    Other,
    /// Software on the processor.
    Software,
}

impl DeviceKind {
    /// One word.
    pub fn name(self) -> &'static str {
        match self {
            DeviceKind::Discrete => "discrete",
            DeviceKind::Integrated => "integrated",
            DeviceKind::Virtual => "virtual",
            DeviceKind::Other => "other",
            DeviceKind::Software => "software",
        }
    }
}

/// A device that is there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceInfo {
    /// Its name, as its driver tells it.
    pub name: String,
    /// What it is.
    pub kind: DeviceKind,
    /// The interface: `vulkan`, `metal`, `dx12`.
    pub backend: String,
    /// Its driver, with the version.
    pub driver: String,
    /// Bytes of the largest buffer.
    pub buffer_bytes: u64,
    /// Bytes of a buffer that a kernel sees at once; larger meshes are weighed in windows.
    pub binding_bytes: u64,
    /// Buffers that a kernel can see.
    pub bindings: u32,
}

/// How a device is to be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceOptions {
    /// At most this many bytes of its memory, or what its limits allow.
    pub memory: Option<u64>,
    /// How long to wait for any answer.
    pub deadline: Duration,
}

impl Default for DeviceOptions {
    fn default() -> Self {
        DeviceOptions { memory: None, deadline: Duration::from_secs(30) }
    }
}

fn info(adapter: &wgpu::Adapter) -> DeviceInfo {
    let (info, limits) = (adapter.get_info(), adapter.limits());
    DeviceInfo {
        kind: match info.device_type {
            wgpu::DeviceType::DiscreteGpu => DeviceKind::Discrete,
            wgpu::DeviceType::IntegratedGpu => DeviceKind::Integrated,
            wgpu::DeviceType::VirtualGpu => DeviceKind::Virtual,
            wgpu::DeviceType::Other => DeviceKind::Other,
            wgpu::DeviceType::Cpu => DeviceKind::Software,
        },
        backend: info.backend.to_string(),
        driver: line(&format!("{} {}", info.driver, info.driver_info)),
        buffer_bytes: limits.max_buffer_size,
        binding_bytes: limits.max_storage_buffer_binding_size,
        bindings: limits.max_storage_buffers_per_shader_stage,
        name: info.name,
    }
}

fn adapters() -> Vec<wgpu::Adapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    // Validation layers are for those who write drivers; an old one raises false errors.
    descriptor.flags = wgpu::InstanceFlags::empty();
    let instance = wgpu::Instance::new(descriptor);
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()))
}

/// Run `work` on a thread of its own; `None` if it does not end by the deadline.
pub(super) fn by_deadline<T: Send + 'static>(
    deadline: Duration,
    work: impl FnOnce() -> T + Send + 'static,
) -> Option<T> {
    let (sender, receiver) = crossbeam_channel::bounded(1);
    std::thread::Builder::new()
        .name("lodestream device".to_string())
        .spawn(move || {
            let _ = sender.send(work());
        })
        .ok()?;
    receiver.recv_timeout(deadline).ok()
}

/// All devices that are there; none where no driver is.
///
/// # Errors
/// [`DeviceError::Timeout`] if a driver does not answer.
pub fn devices(options: &DeviceOptions) -> Result<Vec<DeviceInfo>, DeviceError> {
    by_deadline(options.deadline, || adapters().iter().map(info).collect()).ok_or_else(|| late("the driver", options))
}

fn late(device: &str, options: &DeviceOptions) -> DeviceError {
    DeviceError::Timeout { device: device.to_string(), seconds: options.deadline.as_secs() }
}

/// The place of the device that a choice means among those that are there.
///
/// # Errors
/// [`DeviceError::None`] or [`DeviceError::NotFound`]. [`DeviceChoice::Cpu`] counts as none.
pub fn select_device(choice: &DeviceChoice, known: &[DeviceInfo]) -> Result<usize, DeviceError> {
    if let DeviceChoice::Named(wanted) = choice {
        let lower = wanted.to_lowercase();
        let lower = if lower == "lavapipe" { "llvmpipe".to_string() } else { lower };
        return known.iter().position(|d| d.name.to_lowercase().contains(&lower)).ok_or_else(|| {
            DeviceError::NotFound { wanted: wanted.clone(), known: known.iter().map(|d| d.name.clone()).collect() }
        });
    }
    let real = known.iter().enumerate().filter(|(_, d)| d.kind != DeviceKind::Software);
    let best = if *choice == DeviceChoice::Cpu { None } else { real.min_by_key(|(_, d)| d.kind) };
    let software = known.iter().any(|d| d.kind == DeviceKind::Software);
    best.map(|(at, _)| at).ok_or(DeviceError::None { software })
}

/// An open device.
#[derive(Clone, Debug)]
pub struct Device {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) info: DeviceInfo,
    pub(super) options: DeviceOptions,
    /// The first error that arrived out of turn.
    failure: Arc<Mutex<Option<DeviceError>>>,
}

/// Adapters of the same binding size as what the kernels need at least.
const LEAST_BINDING: u64 = 1 << 20;

/// Whether there may be a real GPU, without asking drivers: loading a software one, which nobody asked for, takes 60 MB and a quarter of a second.
#[cfg(target_os = "linux")]
fn hardware() -> bool {
    // Of the kernel's own drivers, NVIDIA's, the subsystem of Windows, and two of phones.
    let nodes = ["dri", "nvidiactl", "nvidia0", "dxg", "kgsl-3d0", "mali0"];
    nodes.iter().any(|node| std::path::Path::new("/dev").join(node).exists())
}

#[cfg(not(target_os = "linux"))]
fn hardware() -> bool {
    true
}

impl Device {
    /// Open the device that is meant.
    ///
    /// # Errors
    /// [`DeviceError`]: there is none, it refuses, it is too small, it does not answer by the deadline.
    pub fn open(choice: &DeviceChoice, options: DeviceOptions) -> Result<Device, DeviceError> {
        if *choice == DeviceChoice::Auto && !hardware() {
            return Err(DeviceError::None { software: false });
        }
        let choice = choice.clone();
        by_deadline(options.deadline, move || Device::open_here(&choice, options))
            .unwrap_or_else(|| Err(late("the driver", &options)))
    }

    fn open_here(choice: &DeviceChoice, options: DeviceOptions) -> Result<Device, DeviceError> {
        let adapters = adapters();
        let known: Vec<DeviceInfo> = adapters.iter().map(info).collect();
        let at = select_device(choice, &known)?;
        let (adapter, info) = (&adapters[at], known[at].clone());
        let limits = adapter.limits();
        for (what, has, needs) in [
            (
                "the number of buffers a kernel sees",
                u64::from(limits.max_storage_buffers_per_shader_stage),
                layout::BUFFERS as u64,
            ),
            ("the size of a bound buffer", limits.max_storage_buffer_binding_size, LEAST_BINDING),
            (
                "the size of a workgroup",
                u64::from(limits.max_compute_invocations_per_workgroup),
                u64::from(layout::GROUP),
            ),
        ] {
            if has < needs {
                return Err(DeviceError::TooSmall { device: info.name, what, has, needs });
            }
        }
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("lodestream"),
            required_features: wgpu::Features::empty(),
            required_limits: limits,
            experimental_features: wgpu::ExperimentalFeatures::disabled(),
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            trace: wgpu::Trace::Off,
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|e| DeviceError::Refused { device: info.name.clone(), reason: line(&e.to_string()) })?;
        let failure = Arc::new(Mutex::new(None));
        let keep = |failure: &Arc<Mutex<Option<DeviceError>>>, error| {
            if let Ok(mut slot) = failure.lock() {
                slot.get_or_insert(error);
            }
        };
        let (name, slot) = (info.name.clone(), failure.clone());
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let device = name.clone();
            let reason = |text: &str| line(text);
            keep(
                &slot,
                match error {
                    wgpu::Error::OutOfMemory { .. } => DeviceError::OutOfMemory { device },
                    wgpu::Error::Validation { description, .. } | wgpu::Error::Internal { description, .. } => {
                        DeviceError::Failed { device, reason: reason(&description) }
                    }
                },
            );
        }));
        let (name, slot) = (info.name.clone(), failure.clone());
        device.set_device_lost_callback(move |reason, text| {
            if reason != wgpu::DeviceLostReason::Destroyed {
                keep(&slot, DeviceError::Lost { device: name.clone(), reason: line(&text) });
            }
        });
        Ok(Device { device, queue, info, options, failure })
    }

    /// What it is.
    pub fn info(&self) -> &DeviceInfo {
        &self.info
    }

    /// An error that arrived since the device was opened, if one did.
    pub(super) fn check(&self) -> Result<(), DeviceError> {
        match self.failure.lock() {
            Ok(slot) => slot.clone().map_or(Ok(()), Err),
            Err(_) => Err(self.failed("an error handler failed")),
        }
    }

    pub(super) fn failed(&self, reason: &str) -> DeviceError {
        DeviceError::Failed { device: self.info.name.clone(), reason: line(reason) }
    }

    pub(super) fn late(&self) -> DeviceError {
        late(&self.info.name, &self.options)
    }

    /// Bytes of its memory that may be used at once.
    pub(super) fn budget(&self) -> u64 {
        self.options.memory.unwrap_or(u64::MAX)
    }
}
