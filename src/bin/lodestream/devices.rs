//! `lodestream devices`: what could weigh edges, and which one `auto` takes and why.

use crate::Outcome;
use crate::device::WORTH;
use crate::shared;
use anyhow::Result;
use lodestream::encode::cost::DeviceChoice;
use lodestream::gpu::{DeviceInfo, DeviceKind, DeviceOptions, devices, select_device};
use serde_json::{Value, json};

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
