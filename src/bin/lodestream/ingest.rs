//! `lodestream ingest`: folders and buckets full of meshes into `.lods` files.

use crate::Outcome;
use crate::device::DeviceArgs;
use crate::encode::{ImageArgs, Isolated, LatticeArgs, PrecisionArgs, ReadingArgs, WeldArgs, stage_name};
use crate::ingest_progress::{LogFormat, Watch};
use crate::shared::{self, parse_size};
use anyhow::{Result, anyhow};
use lodestream::ingest::{self, DROP_NAMES, IngestError, OnError, Plan, Retries, Settings, Shard, Summary};
use std::path::PathBuf;
use std::time::Duration;

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  lodestream ingest scans/ -o encoded/
  lodestream ingest 'scans/**/tile_*.ply.gz' -o encoded/ --resume --verify --report report.html
  lodestream ingest s3://raw-scans/2026/ -o s3://encoded/2026/ --memory 16GiB --shard 1/4
  lodestream ingest scans/ -o encoded/ --manifest jobs.csv

Stores: s3://bucket/prefix, gs://bucket/prefix, az://container/prefix. Credentials and endpoints come from the environment
(AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION, AWS_ENDPOINT; GOOGLE_SERVICE_ACCOUNT; AZURE_STORAGE_ACCOUNT_NAME, …).

Exit codes: 0 all done; 1 the run could not start or its report could not be written; 2 wrong usage, or errors in the
manifest; 3 some files failed: each is named on standard error and in the report.")]
pub struct Args {
    /// Files, folders (with all below), patterns in quotes, URLs of stores; with --manifest the folder that its sources are in
    #[arg(value_name = "SOURCE", required_unless_present = "manifest")]
    sources: Vec<String>,
    /// A folder or the URL of a store; for one source also a file that ends with .lods
    #[arg(short, long, value_name = "DEST")]
    output: String,
    /// The files to ingest, with settings of their own: .csv, .jsonl or .toml
    #[arg(long, value_name = "FILE")]
    manifest: Option<PathBuf>,
    #[command(flatten)]
    lattice: LatticeArgs,
    #[command(flatten)]
    precision: PrecisionArgs,
    #[command(flatten)]
    images: ImageArgs,
    /// Never move a vertex of a border, so that tiles fit at every level
    #[arg(long)]
    lock_borders: bool,
    #[command(flatten)]
    weld: WeldArgs,
    #[command(flatten)]
    reading: ReadingArgs,
    /// What becomes of vertices that no face or edge uses
    #[arg(long, value_name = "WHAT", value_enum, default_value = "keep")]
    isolated: Isolated,
    /// Leave out attributes without a warning
    #[arg(long, value_name = "WHAT", value_delimiter = ',', value_parser = parse_drop)]
    drop: Vec<String>,
    /// How many files to encode at a time [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Cores for them together [default: all]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// The most memory that the program may take, as in 20GiB [default: four fifths of what is free]
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    memory: Option<u64>,
    #[command(flatten)]
    device: DeviceArgs,
    /// Skip outputs that are there already, made from the same bytes with the same settings
    #[arg(long)]
    resume: bool,
    /// Decode every output and compare it with its source before it is written
    #[arg(long)]
    verify: bool,
    /// Do only the K-th of N parts, for N machines: 1/4 to 4/4
    #[arg(long, value_name = "K/N", value_parser = parse_shard)]
    shard: Option<Shard>,
    /// Take hidden files and folders too, as .git, ._scan.obj and __MACOSX; otherwise they are passed over and counted
    #[arg(long)]
    hidden: bool,
    /// Write a report: .json or .html
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// What to do when a file fails
    #[arg(long, value_enum, default_value = "continue")]
    on_error: OnErrorArg,
    /// How the lines on standard error look
    #[arg(long, value_enum, default_value = "text")]
    log_format: LogFormat,
    /// How often a request to a failing store is repeated
    #[arg(long, value_name = "N", default_value = "10")]
    retries: u32,
    /// For how many seconds it is repeated at most
    #[arg(long, value_name = "SECONDS", default_value = "180", value_parser = clap::value_parser!(u64).range(1..=3600))]
    retry_within: u64,
    /// How many seconds one request to a store may take
    #[arg(long, value_name = "SECONDS", default_value = "60", value_parser = clap::value_parser!(u64).range(1..=3600))]
    request_timeout: u64,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum OnErrorArg {
    /// Go on with the other files
    Continue,
    /// Start no more
    Stop,
}

fn parse_drop(text: &str) -> Result<String, String> {
    match ingest::drop_set([text]) {
        Ok(_) => Ok(text.to_string()),
        Err(_) => Err(format!("known are {}", DROP_NAMES.join(", "))),
    }
}

fn parse_shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(k, n)| Some((k.parse::<u32>().ok()?, n.parse::<u32>().ok()?)));
    match parts {
        Some((k, n)) if k >= 1 && k <= n => Ok(Shard { k: k - 1, n }),
        _ => Err("a shard looks like 2/4, the second of four parts".to_string()),
    }
}

pub fn run(args: &Args) -> Result<Outcome> {
    let mut plan = Plan::new(args.sources.clone(), &args.output);
    plan.manifest.clone_from(&args.manifest);
    plan.settings = Settings {
        encode: args.precision.options(args.lattice.quantization(), args.lock_borders),
        weld: args.weld.choice(),
        effort: args.images.schedule_effort,
        drop: ingest::drop_set(args.drop.iter().map(String::as_str)).unwrap_or_default(),
        allow_empty: args.reading.allow_empty,
        invalid: args.reading.invalid(),
        asset_root: args.reading.asset_root.clone(),
        drop_isolated: args.isolated == Isolated::Drop,
        by_quality: false,
        textures: args.images.texture(),
        previews: args.images.previews,
    };
    plan.settings.encode.images = args.images.exactness();
    plan.settings.set_order(args.images.schedule);
    plan.threads = args.threads.map_or(plan.threads, usize::from);
    plan.jobs = args.jobs.map_or(plan.threads, usize::from);
    plan.memory = args.memory.unwrap_or(plan.memory);
    plan.resume = args.resume;
    plan.verify = args.verify;
    plan.shard = args.shard.unwrap_or(plan.shard);
    plan.on_error = match args.on_error {
        OnErrorArg::Continue => OnError::Continue,
        OnErrorArg::Stop => OnError::Stop,
    };
    plan.report.clone_from(&args.report);
    plan.hidden = args.hidden;
    plan.retries = Retries {
        times: args.retries,
        within: Duration::from_secs(args.retry_within),
        timeout: Duration::from_secs(args.request_timeout),
    };
    let watch = Watch::start(args.log_format, &args.device.asked(), stage_name);
    plan.engines = args.device.engines(plan.jobs);
    let result = ingest::run(&plan, &watch);
    watch.finish();
    match result {
        Ok(summary) => finish(&summary),
        Err(IngestError::Manifest(errors)) => {
            errors.iter().for_each(|e| shared::complain(e));
            Ok(Outcome::Usage)
        }
        Err(IngestError::Usage(what)) => {
            shared::complain(&what);
            Ok(Outcome::Usage)
        }
        Err(e) => Err(anyhow!(e)),
    }
}

fn finish(summary: &Summary) -> Result<Outcome> {
    let rows = summary.rows();
    let rows: Vec<(&str, String)> = rows.iter().map(|(label, value)| (label.as_str(), value.clone())).collect();
    shared::print(&shared::table(&rows))?;
    if summary.failed() == 0 {
        return Ok(Outcome::Done);
    }
    if summary.stopped {
        shared::complain("stopped at the first failure; run again with --resume to go on");
    }
    Ok(Outcome::Different)
}
