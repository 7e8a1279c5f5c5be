//! `--device` and what belongs to it.
//!
//! Edges are weighed on a GPU where one is asked for, or where `auto` expects that to be sooner done. Whatever goes
//! wrong with it is said once on standard error, and the processor does the work: same exit code, an exact file. A build
//! without the feature `gpu` takes the same options, and says that it has none.

use crate::shared;
use anyhow::{Context, Result};
#[cfg(feature = "gpu")]
use lodestream::gpu::{Device, DeviceError, DeviceOptions, GpuWeights};
use lodestream::metric::{DeviceChoice, Engine, Evaluator};
#[cfg(feature = "gpu")]
use lodestream::metric::{EvaluateError, Fixed, Task};
use lodestream::trace::Trace;
use std::path::PathBuf;

/// `auto` leaves smaller meshes to the processor: vertices for each of its threads. Finding a device and compiling
/// a kernel takes about a second, in which a thread weighs the edges of so many vertices down to the base.
pub const WORTH: usize = 50_000;

/// Options of the device.
#[derive(clap::Args)]
pub struct DeviceArgs {
    /// Where edges are weighed: auto (a GPU if that is worth it), cpu, gpu, or gpu:NAME as `lodestream devices` lists
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    device: DeviceChoice,
    /// The most memory of the GPU to use, as in 2GiB; larger meshes are weighed in windows
    #[arg(long, value_name = "SIZE", value_parser = shared::parse_size)]
    gpu_memory: Option<u64>,
    /// Write what ran when, as a Chrome trace
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
}

impl DeviceArgs {
    /// What is to weigh the edges of a mesh of so many vertices; says so if that is not what was asked for.
    pub fn engine(&self, vertices: usize, threads: usize) -> Engine {
        let trace = if self.trace.is_some() { Trace::on() } else { Trace::off() };
        let small = self.device == DeviceChoice::Auto && vertices < WORTH * threads;
        if self.device == DeviceChoice::Cpu || small {
            return Engine { trace, ..Engine::default() };
        }
        let span = trace.span("device: upload", "open device");
        let opened = open(&self.device, self.gpu_memory);
        drop(span);
        match opened {
            Ok(evaluator) => Engine { evaluator, trace },
            Err(why) => {
                if let Some(why) = why {
                    fell_back(&why);
                }
                Engine { trace, ..Engine::default() }
            }
        }
    }

    /// Write the trace, if one was asked for.
    pub fn write_trace(&self, trace: &Trace) -> Result<()> {
        let Some(path) = &self.trace else { return Ok(()) };
        std::fs::write(path, trace.to_json()).with_context(|| path.display().to_string())
    }
}

/// The device that is meant, ready to weigh; or why there is none, if that is worth saying.
#[cfg(feature = "gpu")]
fn open(choice: &DeviceChoice, memory: Option<u64>) -> Result<Box<dyn Evaluator>, Option<String>> {
    let options = DeviceOptions { memory, ..DeviceOptions::default() };
    match Device::open(choice, options).and_then(GpuWeights::new) {
        Ok(weights) => Ok(lose_for_a_test(Box::new(weights))),
        // Nothing was asked for by name, and nothing is there: that is the ordinary case.
        Err(DeviceError::None { .. }) if !choice.insists() => Err(None),
        Err(error) => Err(Some(error.to_string())),
    }
}

#[cfg(not(feature = "gpu"))]
fn open(choice: &DeviceChoice, _memory: Option<u64>) -> Result<Box<dyn Evaluator>, Option<String>> {
    Err(choice.insists().then(|| "this program was built without GPU support".to_string()))
}

/// The one line that says that the processor does the work.
pub fn fell_back(why: &str) {
    shared::warn(format!("{why}; the processor weighs the edges instead"));
}

/// With `LODESTREAM_LOSE_DEVICE=N` in the environment, the device is lost at the N-th level: for tests of what then
/// happens.
#[cfg(feature = "gpu")]
fn lose_for_a_test(inner: Box<dyn Evaluator>) -> Box<dyn Evaluator> {
    match std::env::var("LODESTREAM_LOSE_DEVICE").ok().and_then(|n| n.parse().ok()) {
        Some(levels) => Box::new(Lost { inner, levels }),
        None => inner,
    }
}

#[cfg(feature = "gpu")]
#[derive(Debug)]
struct Lost {
    inner: Box<dyn Evaluator>,
    levels: u32,
}

#[cfg(feature = "gpu")]
impl Evaluator for Lost {
    fn name(&self) -> String {
        self.inner.name()
    }

    fn beside(&self) -> bool {
        self.inner.beside()
    }

    fn weigh(&mut self, task: &Task, out: &mut [Fixed]) -> Result<u64, EvaluateError> {
        if self.levels == 0 {
            let (device, reason) = (self.inner.name(), "LODESTREAM_LOSE_DEVICE says so".to_string());
            return Err(EvaluateError(Box::new(DeviceError::Lost { device, reason })));
        }
        self.levels -= 1;
        self.inner.weigh(task, out)
    }
}
