//! `--device` and what belongs to it, and `lodestream devices`.
//!
//! Edges are weighed on a GPU where one is asked for, or where `auto` expects that to be sooner done. Whatever goes
//! wrong with it is said once on standard error, and the processor does the work: same exit code, an exact file.

use crate::Outcome;
use crate::shared;
use anyhow::{Context, Result};
use lodestream::gpu::{
    Device, DeviceChoice, DeviceError, DeviceInfo, DeviceKind, DeviceOptions, GpuWeights, devices, select_device,
};
use lodestream::metric::{Engine, EvaluateError, Evaluator, Fixed, Task};
use lodestream::trace::Trace;
use serde_json::{Value, json};
use std::path::PathBuf;

/// `auto` leaves smaller meshes to the processor: vertices for each of its threads. Finding a device and compiling
/// a kernel takes about a second, in which a thread weighs the edges of so many vertices down to the base.
const WORTH: usize = 50_000;

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
        let _span = trace.span("device: upload", "open device");
        let options = DeviceOptions { memory: self.gpu_memory, ..DeviceOptions::default() };
        let opened = Device::open(&self.device, options).and_then(GpuWeights::new);
        let engine = match opened {
            Ok(weights) => Engine { evaluator: lose_for_a_test(Box::new(weights)), trace: trace.clone() },
            // Nothing was asked for by name, and nothing is there: that is the ordinary case.
            Err(DeviceError::None { .. }) if self.device == DeviceChoice::Auto => {
                Engine { trace: trace.clone(), ..Engine::default() }
            }
            Err(error) => {
                fell_back(&error.to_string());
                Engine { trace: trace.clone(), ..Engine::default() }
            }
        };
        drop(_span);
        engine
    }

    /// Write the trace, if one was asked for.
    pub fn write_trace(&self, trace: &Trace) -> Result<()> {
        let Some(path) = &self.trace else { return Ok(()) };
        std::fs::write(path, trace.to_json()).with_context(|| path.display().to_string())
    }
}

/// The one line that says that the processor does the work.
pub fn fell_back(why: &str) {
    shared::warn(format!("{why}; the processor weighs the edges instead"));
}

/// With `LODESTREAM_LOSE_DEVICE=N` in the environment, the device is lost at the N-th level: for tests of what then
/// happens.
fn lose_for_a_test(inner: Box<dyn Evaluator>) -> Box<dyn Evaluator> {
    match std::env::var("LODESTREAM_LOSE_DEVICE").ok().and_then(|n| n.parse().ok()) {
        Some(levels) => Box::new(Lost { inner, levels }),
        None => inner,
    }
}

#[derive(Debug)]
struct Lost {
    inner: Box<dyn Evaluator>,
    levels: u32,
}

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

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  lodestream devices
  lodestream encode scan.ply -o scan.lods --device gpu:llvmpipe")]
pub struct Args {
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Say what is there and which one `auto` takes.
pub fn run(args: &Args) -> Result<Outcome> {
    let (known, trouble) = match devices(&DeviceOptions::default()) {
        Ok(known) => (known, None),
        Err(error) => (Vec::new(), Some(error.to_string())),
    };
    let auto = select_device(&DeviceChoice::Auto, &known).ok();
    let why = trouble.unwrap_or_else(|| why(&known, auto));
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    if args.json {
        let list: Vec<Value> = known.iter().enumerate().map(|(i, d)| account(d, auto == Some(i))).collect();
        shared::print_json(&json!({
            "devices": list,
            "processor_threads": threads,
            "auto": auto.map_or("cpu", |at| known[at].name.as_str()),
            "auto_least_vertices": auto.map(|_| WORTH * threads),
            "why": why,
        }))?;
        return Ok(Outcome::Done);
    }
    let mut text = format!("cpu: {threads} threads\n");
    for (i, d) in known.iter().enumerate() {
        let mark = if auto == Some(i) { ", what auto takes" } else { "" };
        text.push_str(&format!("gpu:{}: {} by {}{mark}\n", d.name, d.kind.name(), d.backend));
        text.push_str(&format!(
            "  driver {}; buffers up to {}, {} at once for a kernel\n",
            d.driver,
            shared::human_bytes(d.buffer_bytes),
            shared::human_bytes(d.binding_bytes)
        ));
    }
    text.push_str(&format!("auto: {why}\n"));
    shared::print(&text)?;
    Ok(Outcome::Done)
}

fn account(d: &DeviceInfo, auto: bool) -> Value {
    json!({
        "name": d.name,
        "kind": d.kind.name(),
        "backend": d.backend,
        "driver": d.driver,
        "max_buffer_bytes": d.buffer_bytes,
        "max_binding_bytes": d.binding_bytes,
        "max_storage_buffers": d.bindings,
        "auto": auto,
    })
}

fn why(known: &[DeviceInfo], auto: Option<usize>) -> String {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    match auto {
        Some(at) => format!(
            "takes {} for meshes of {} vertices and more: the {} device there is; below, the processor is done sooner",
            known[at].name,
            shared::thousands((WORTH * threads) as u64),
            if known[at].kind == DeviceKind::Discrete { "fastest kind of" } else { "best" }
        ),
        None if known.is_empty() => "takes the processor: no GPU and no driver is there".to_string(),
        None => "takes the processor: software devices are slower than it, and taken only by name".to_string(),
    }
}
