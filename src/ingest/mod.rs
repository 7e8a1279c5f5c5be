//! Batch ingestion: folders and buckets full of meshes into `.lods` files, unattended.
//!
//! ```text
//! list (one thread, streamed) → survey (how large is it?) → window → admit by memory → fetch → core → read, encode → write
//! ```
//!
//! Invariants:
//! - The sum of predicted peaks of all files in work stays below [`Plan::memory`]; what cannot fit is never started.
//! - A file that fails costs only itself; a panic inside is caught and is its failure.
//! - An output appears whole or not at all, and carries a [`Stamp`] of source and settings, which is all that resuming goes by.
//! - The bytes of an output depend on source and settings alone: not on order, jobs, cores, shards or earlier runs.
//! - Memory does not grow with the number of files, but for a hash of each name.

mod error;
mod job;
mod ledger;
mod list;
mod location;
pub mod manifest;
mod output;
mod predict;
mod report;
mod schedule;
mod settings;
mod sidecars;
mod stamp;
mod store;
#[cfg(test)]
mod tests;

pub use crate::io::memory::default_memory;
pub use error::{Failure, FailureKind, IngestError};
pub use job::{Record, Seconds, Status};
pub use list::Shard;
pub use output::abandon;
pub use predict::peak as predicted_peak;
pub use schedule::run;
pub use settings::{DROP_NAMES, Settings, drop_set};
pub use sidecars::named_files;
pub use stamp::Stamp;
pub use store::Retries;

use crate::encode;
use crate::encode::cost::Engine;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// What to do when a file fails.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnError {
    /// Go on with the others.
    #[default]
    Continue,
    /// Start no more; what is in work is finished.
    Stop,
}

/// Something called with the name of each file before it is read; tests use it to be in the middle.
pub type Hook = Arc<dyn Fn(&str) + Send + Sync>;

/// Makes what weighs the edges of a file, given its vertices and its cores; called from many threads.
pub type Engines = Arc<dyn Fn(u64, usize) -> Engine + Send + Sync>;

/// What to ingest, and how.
#[derive(Clone)]
pub struct Plan {
    /// Files, folders, patterns, URLs of object stores.
    pub sources: Vec<String>,
    /// A list of files with settings of their own, see [`manifest`].
    pub manifest: Option<PathBuf>,
    /// A folder or a URL of an object store; for one source also a file that ends with `.lods`.
    pub dest: String,
    /// Settings for all files that have none of their own.
    pub settings: Settings,
    /// How many files are encoded at a time.
    pub jobs: usize,
    /// How many cores there are for them.
    pub threads: usize,
    /// The most bytes of memory that the process may take.
    pub memory: u64,
    /// Skip what is there already, from the same source and settings.
    pub resume: bool,
    /// Decode each output and compare it with its source before it is written.
    pub verify: bool,
    /// The part of all files that is ours.
    pub shard: Shard,
    /// What to do when a file fails.
    pub on_error: OnError,
    /// Where to write a report, `.json` or `.html`.
    pub report: Option<PathBuf>,
    /// Take hidden files and folders too (`.git`, `._scan.obj`, `__MACOSX`); otherwise they are passed over and counted.
    pub hidden: bool,
    /// How long a failing store is asked again.
    pub retries: Retries,
    /// Who weighs edges, where it is not the processor.
    pub engines: Option<Engines>,
    /// See [`Hook`].
    pub hook: Option<Hook>,
}

impl Plan {
    /// The plan of a run with all defaults.
    pub fn new(sources: Vec<String>, dest: impl Into<String>) -> Self {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Plan {
            sources,
            manifest: None,
            dest: dest.into(),
            settings: Settings::default(),
            jobs: threads,
            threads,
            memory: default_memory(),
            resume: false,
            verify: false,
            shard: Shard { k: 0, n: 1 },
            on_error: OnError::Continue,
            report: None,
            hidden: false,
            retries: Retries::default(),
            engines: None,
            hook: None,
        }
    }
}

/// What happens while a run goes on.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Event<'a> {
    /// So many files have been found and surveyed so far.
    Found {
        /// Files.
        files: u64,
        /// Their vertices.
        vertices: u64,
        /// Whether that is all.
        complete: bool,
    },
    /// A file has got its cores.
    Started {
        /// Its number, the same in all its events.
        id: u64,
        /// Its name.
        source: &'a str,
        /// Its vertices, as surveyed.
        vertices: u64,
        /// How many cores work on it.
        threads: usize,
    },
    /// A file got further.
    Progress {
        /// Its number.
        id: u64,
        /// How far.
        progress: encode::Progress,
    },
    /// A file is done, skipped or failed; not every one has been started before.
    Ended {
        /// Its number.
        id: u64,
        /// Its account.
        record: &'a Record,
    },
}

/// Somebody who wants to know how a run goes on. Called from many threads.
pub trait Observer: Sync {
    /// Something happened.
    fn event(&self, event: Event<'_>);
}

/// Nobody who wants to know.
impl Observer for () {
    fn event(&self, _: Event<'_>) {}
}

/// The account of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Files in all.
    pub files: u64,
    /// Files encoded and written.
    pub done: u64,
    /// Files that were there already.
    pub skipped: u64,
    /// Hidden files and folders that were passed over.
    pub hidden: u64,
    /// Files that failed, by kind.
    pub failures: BTreeMap<FailureKind, u64>,
    /// Vertices of the files that were done.
    pub vertices: u64,
    /// Their polygons and dangling edges.
    pub faces: u64,
    /// Bytes of their sources.
    pub bytes_in: u64,
    /// Bytes of their outputs.
    pub bytes_out: u64,
    /// Seconds of the run.
    pub seconds: f64,
    /// The most bytes of memory that the process has had; 0 where the system does not tell.
    pub peak_bytes: u64,
    /// The most bytes of memory that were foreseen for it.
    pub predicted_bytes: u64,
    /// Bytes of memory that were allowed.
    pub memory: u64,
    /// Part (from 1) and number of parts.
    pub shard: (u32, u32),
    /// Whether a failure stopped the run before all files were tried.
    pub stopped: bool,
}
