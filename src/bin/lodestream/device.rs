//! `--device` and what belongs to it.
//!
//! Edges are weighed on a GPU where one is asked for, or where `auto` expects that to be sooner done. Whatever goes
//! wrong with it is said once on standard error, and the processor does the work: same exit code, an exact file. A build
//! without the feature `gpu` takes the same options, and says that it has none.

use crate::shared;
use lodestream::encode::cost::{DeviceChoice, Engine, Evaluator};
#[cfg(feature = "gpu")]
use lodestream::encode::cost::{EvaluateError, Fixed, Task};
use lodestream::encode::trace::Trace;
#[cfg(feature = "gpu")]
use lodestream::gpu::{Device, DeviceError, DeviceOptions, SharedGpu};
use lodestream::ingest::Engines;
use std::sync::{Arc, OnceLock};

/// `auto` leaves smaller meshes to the processor: vertices for each of its threads. Finding a device and compiling
/// a kernel takes about a second, in which a thread weighs the edges of so many vertices down to the base.
pub const WORTH: usize = 50_000;

/// Options of the device.
#[derive(Clone, clap::Args)]
pub struct DeviceArgs {
    /// Where edges are weighed: auto (a GPU if that is worth it), cpu, gpu, or gpu:NAME as `lodestream devices` lists
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    device: DeviceChoice,
    /// The most memory of the GPU to use, as in 2GiB; larger meshes are weighed in windows
    #[arg(long, value_name = "SIZE", value_parser = shared::parse_size)]
    gpu_memory: Option<u64>,
}

impl DeviceArgs {
    /// What was asked for, as it was written.
    pub fn asked(&self) -> String {
        self.device.to_string()
    }

    /// Whether a mesh of so many vertices is left to so many threads.
    fn leaves(&self, vertices: usize, threads: usize) -> bool {
        match self.device {
            DeviceChoice::Cpu => true,
            DeviceChoice::Auto => vertices < WORTH * threads,
            _ => false,
        }
    }

    /// What is to weigh the edges of a mesh of so many vertices; says so if that is not what was asked for.
    pub fn engine(&self, vertices: usize, threads: usize, trace: &Trace) -> Engine {
        let cpu = || Engine { trace: trace.clone(), ..Engine::default() };
        if self.leaves(vertices, threads) {
            return cpu();
        }
        let span = trace.span("device: upload", "open device");
        let opened = open(&self.device, self.gpu_memory, 1).and_then(|gpu| weigher(&gpu).map_err(Some));
        drop(span);
        match opened {
            Ok(evaluator) => Engine { evaluator, trace: trace.clone() },
            Err(why) => {
                if let Some(why) = why {
                    fell_back(&why);
                }
                cpu()
            }
        }
    }

    /// The same for so many jobs at a time, which share a device; it is opened for the first file that is worth it.
    pub fn engines(&self, jobs: usize) -> Option<Engines> {
        if self.device == DeviceChoice::Cpu {
            return None;
        }
        let (args, opened) = (self.clone(), OnceLock::new());
        Some(Arc::new(move |vertices, threads| {
            if args.leaves(usize::try_from(vertices).unwrap_or(usize::MAX), threads) {
                return Engine::default();
            }
            let gpu = opened.get_or_init(|| match open(&args.device, args.gpu_memory, jobs) {
                Ok(gpu) => Some(gpu),
                Err(why) => {
                    if let Some(why) = why {
                        tracing::warn!("{why}; the processor weighs the edges instead");
                    }
                    None
                }
            });
            // A device that has failed was told of with the file that it failed.
            match gpu.as_ref().map(weigher) {
                Some(Ok(evaluator)) => Engine { evaluator, ..Engine::default() },
                _ => Engine::default(),
            }
        }))
    }
}

/// A device for all jobs of the program.
#[cfg(feature = "gpu")]
type Gpu = SharedGpu;
#[cfg(not(feature = "gpu"))]
type Gpu = std::convert::Infallible;

/// The device that is meant, for so many jobs; or why there is none, if that is worth saying.
#[cfg(feature = "gpu")]
fn open(choice: &DeviceChoice, memory: Option<u64>, jobs: usize) -> Result<Gpu, Option<String>> {
    let options = DeviceOptions { memory, ..DeviceOptions::default() };
    match Device::open(choice, options).and_then(|device| SharedGpu::new(device, jobs)) {
        Ok(gpu) => Ok(gpu),
        // Nothing was asked for by name, and nothing is there: that is the ordinary case.
        Err(DeviceError::None { .. }) if !choice.insists() => Err(None),
        Err(error) => Err(Some(error.to_string())),
    }
}

#[cfg(not(feature = "gpu"))]
fn open(choice: &DeviceChoice, _memory: Option<u64>, _jobs: usize) -> Result<Gpu, Option<String>> {
    Err(choice.insists().then(|| "this program was built without GPU support".to_string()))
}

/// Who weighs one mesh on it.
#[cfg(feature = "gpu")]
fn weigher(gpu: &Gpu) -> Result<Box<dyn Evaluator>, String> {
    gpu.evaluator().map(lose_for_a_test).map_err(|error| error.to_string())
}

#[cfg(not(feature = "gpu"))]
fn weigher(gpu: &Gpu) -> Result<Box<dyn Evaluator>, String> {
    match *gpu {}
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
