//! One file: fetched, checked against what is there, read, encoded, stamped, verified, written.

use super::error::{Failure, FailureKind};
use super::ledger::Cores;
use super::location::Object;
use super::output::{self, Staging};
use super::settings::Settings;
use super::sidecars::Sidecars;
use super::stamp::{Stamp, hex};
use super::{Engines, Event, Observer, predict};
use crate::encode::cost::Engine;
use crate::encode::{Control, EncodeError, Encoded};
use crate::format::container::{FileIndex, Parsed};
use crate::format::decoder::{DecodeOptions, Decoder, Step};
use crate::io::files::Place;
use crate::io::read::{self, Format, ReadError, ReadErrorKind, ReadMesh, ReadOptions, Survey};
use crate::quality::exact;
use rayon::ThreadPool;
use serde::Serialize;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// How a file ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Encoded and written.
    Done,
    /// There already, from the same source and settings.
    Skipped,
    /// Not done; the record says why.
    Failed,
}

/// Seconds spent on a file, by what was done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Seconds {
    /// Reading the bytes, from disk or a store, and their checksum.
    pub fetch: f64,
    /// Waiting for a core.
    pub wait: f64,
    /// Parsing the mesh.
    pub read: f64,
    /// Encoding.
    pub encode: f64,
    /// Decoding and comparing.
    pub verify: f64,
    /// Writing, until the output stands in its place.
    pub write: f64,
}

/// The account of one file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Record {
    /// The source.
    pub source: String,
    /// The output, below the destination.
    pub output: String,
    /// Its line in the manifest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<u64>,
    /// How it ended.
    pub status: Status,
    /// The kind of its failure.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failure: Option<FailureKind>,
    /// What went wrong, for people.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Vertices of the mesh; as surveyed where it was not read.
    pub vertices: u64,
    /// Its polygons and dangling edges.
    pub faces: u64,
    /// Levels of the output.
    pub levels: u64,
    /// Bytes of the source.
    pub bytes_in: u64,
    /// Bytes of the output.
    pub bytes_out: u64,
    /// Where the time went.
    pub seconds: Seconds,
    /// Cores that worked on it.
    pub threads: u64,
    /// Who weighed its edges: `cpu` or the name of a device. Empty where nothing was encoded.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub device: String,
    /// Bytes of memory that it was expected to take at its peak.
    pub predicted_bytes: u64,
    /// SHA-256 of the source.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// What reading left out or read otherwise.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

impl Record {
    pub(super) fn new(source: String, output: String, line: Option<u64>, survey: &Survey, charge: u64) -> Self {
        Record {
            source,
            output,
            line,
            status: Status::Done,
            failure: None,
            error: None,
            vertices: survey.vertices,
            faces: survey.elements,
            levels: 0,
            bytes_in: 0,
            bytes_out: 0,
            seconds: Seconds::default(),
            threads: 0,
            device: String::new(),
            predicted_bytes: charge,
            sha256: None,
            warnings: Vec::new(),
        }
    }

    pub(super) fn fail(&mut self, failure: Failure) {
        self.status = Status::Failed;
        self.failure = Some(failure.kind);
        let line = self.line.map_or(String::new(), |l| format!(" (line {l} of the manifest)"));
        self.error = Some(failure.message + &line);
    }
}

/// What the report is among the files of a run.
pub(super) const REPORT: &str = "the report";

/// What a job asks of the run around it.
pub(super) struct Surroundings<'a> {
    pub observer: &'a dyn Observer,
    pub cores: &'a Cores,
    pub staging: Option<&'a Staging>,
    /// The files of the run itself, which are no outputs, and what they are.
    pub reserved: &'a [(Place, &'a str)],
    /// Whether the report has the place of a source, and so must not be written.
    pub report_is_source: &'a AtomicBool,
    pub resume: bool,
    pub verify: bool,
    /// Bytes that reading one file may take at most.
    pub memory: u64,
    /// The least number of cores for a file.
    pub least: usize,
    pub engines: Option<&'a Engines>,
    pub hook: Option<&'a (dyn Fn(&str) + Send + Sync)>,
}

impl Surroundings<'_> {
    /// Refuse a report in the place of one of the files that `name` is read from.
    fn keep_from_report(&self, name: &str, files: &[Place]) -> Result<(), Failure> {
        let report = self.reserved.iter().find(|(_, what)| *what == REPORT);
        if !report.is_some_and(|(report, _)| files.contains(report)) {
            return Ok(());
        }
        self.report_is_source.store(true, Ordering::Relaxed);
        let what = format!("{name}: the report of this run would replace it, or a file that it names; move the report");
        Err(Failure::new(FailureKind::Name, what))
    }
}

/// What a job wants of the ledger while it runs.
pub(super) trait Account {
    /// Change the charge to this many bytes; `false`: they are not free.
    fn recharge(&mut self, bytes: u64) -> bool;
    /// The turn has come: how many of the free cores this file may have.
    fn share(&mut self, free: usize) -> usize;
    /// The mesh is gone: only the output, of so many bytes, is left.
    fn computed(&mut self, bytes: u64);
}

/// A file to be done.
pub(super) struct Job {
    pub id: u64,
    pub object: Object,
    pub target: Object,
    pub settings: Arc<Settings>,
    pub survey: Survey,
    /// Bytes charged for it.
    pub charge: u64,
    pub record: Record,
}

/// How a job ended.
pub(super) enum End {
    Record(Box<Record>),
    /// It takes more memory than it seemed to, and that was not free: once more, later.
    Again(Box<Job>),
}

/// Do one file. Never panics: a panic inside is a failure of kind [`FailureKind::Bug`].
pub(super) fn run(
    mut job: Job,
    around: &Surroundings<'_>,
    account: &mut dyn Account,
    own: &mut Option<ThreadPool>,
) -> End {
    let name = job.object.name();
    let result = catch_unwind(AssertUnwindSafe(|| work(&mut job, &name, around, account, own)));
    let failure = match result {
        Ok(Ok(true)) => None,
        Ok(Ok(false)) => return End::Again(Box::new(job)),
        Ok(Err(failure)) => Some(failure),
        Err(panic) => Some(bug(&name, &*panic)),
    };
    if let Some(failure) = failure {
        job.record.fail(failure);
    }
    End::Record(Box::new(job.record))
}

/// The failure that a panic is.
pub(super) fn bug(name: &str, panic: &(dyn std::any::Any + Send)) -> Failure {
    let said = panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    let said = said.unwrap_or("a panic without a message");
    Failure::new(FailureKind::Bug, format!("{name}: a bug of lodestream: {said}; please report it with this file"))
}

/// Seconds since then, to the microsecond.
fn since(clock: Instant) -> f64 {
    (clock.elapsed().as_secs_f64() * 1e6).round() / 1e6
}

/// `false`: once more, later.
fn work(
    job: &mut Job,
    name: &str,
    around: &Surroundings<'_>,
    account: &mut dyn Account,
    own: &mut Option<ThreadPool>,
) -> Result<bool, Failure> {
    let mut reserved = around.reserved.to_vec();
    if let Object::Local(source) = &job.object {
        let source = Place::of(source);
        around.keep_from_report(name, std::slice::from_ref(&source))?;
        reserved.push((source, "its own source"));
    }
    output::may_write(&job.target, &reserved)?;
    let there = if around.resume { output::stamp_of(&job.target)? } else { None };
    let clock = Instant::now();
    let format = Format::from_path(job.object.path()).map_err(|extension| {
        read_failure(ReadError {
            name: name.to_string(),
            place: None,
            kind: ReadErrorKind::UnknownExtension { extension },
        })
    })?;
    let bytes = job.object.read()?;
    let root = job.settings.asset_root.as_deref();
    let beside = Sidecars::fetch(&job.object, &bytes, format, job.settings.drop, root)?;
    around.keep_from_report(name, &beside.places)?;
    let named: Vec<_> = beside.places.iter().map(|place| (place.clone(), "a file that its source names")).collect();
    output::may_write(&job.target, &named)?;
    job.record.bytes_in = bytes.len() as u64 + beside.bytes;
    let stamp = Stamp { source: beside.checksum, settings: job.settings.checksum() };
    job.record.sha256 = Some(hex(&stamp.source));
    job.record.seconds.fetch = since(clock);
    if there == Some(stamp) {
        job.record.status = Status::Skipped;
        return Ok(true);
    }
    if !job.survey.exact {
        job.survey = read::survey(Cursor::new(&bytes), format).map_err(|e| Failure::reading(name, &e))?;
    }
    // Images beside the source are known only now.
    let pictures = (beside.images, beside.working);
    let charge = predict::peak(&job.survey, bytes.len() as u64, pictures, &job.settings, around.verify);
    if charge != job.charge {
        if charge > around.memory {
            return Err(too_large(name, charge, around.memory));
        }
        job.record.predicted_bytes = charge;
        let fits = account.recharge(charge);
        job.charge = charge;
        if !fits {
            return Ok(false);
        }
    }
    let clock = Instant::now();
    let least = if job.survey.vertices >= predict::LARGE { usize::MAX } else { around.least };
    let cores = around.cores.take(least, |free| account.share(free));
    job.record.seconds.wait = since(clock);
    job.record.threads = cores.count as u64;
    around.observer.event(Event::Started {
        id: job.id,
        source: name,
        vertices: job.survey.vertices,
        threads: cores.count,
    });
    let pool;
    let pool = if cores.count == 1 {
        if own.is_none() {
            *own = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build().ok();
        }
        own.as_ref()
    } else {
        pool = rayon::ThreadPoolBuilder::new().num_threads(cores.count).build().ok();
        pool.as_ref()
    };
    let Some(pool) = pool else {
        return Err(Failure::new(FailureKind::Bug, format!("{name}: the worker threads cannot be started")));
    };
    let output = pool.install(|| {
        let computed = compute(job, name, bytes, format, &beside, &stamp, around);
        drop(beside);
        computed
    })?;
    account.computed(output.len() as u64);
    drop(cores);
    job.record.bytes_out = output.len() as u64;
    let clock = Instant::now();
    output::write(&job.target, around.staging, output)?;
    job.record.seconds.write = since(clock);
    Ok(true)
}

/// From the bytes of the source to those of the output.
fn compute(
    job: &mut Job,
    name: &str,
    bytes: Vec<u8>,
    format: Format,
    beside: &Sidecars,
    stamp: &Stamp,
    around: &Surroundings<'_>,
) -> Result<Vec<u8>, Failure> {
    if let Some(hook) = around.hook {
        hook(name);
    }
    let clock = Instant::now();
    let options = ReadOptions {
        weld: job.settings.weld,
        memory_limit: Some(around.memory),
        drop: job.settings.drop,
        allow_empty: job.settings.allow_empty,
        invalid: job.settings.invalid,
        asset_root: match job.object {
            Object::Local(_) => job.settings.asset_root.clone(),
            Object::Stored(..) => beside.held().map(Path::to_path_buf),
        },
    };
    read::check_packing(job.object.path(), &bytes, name).map_err(read_failure)?;
    let mut read = read::read_bytes(&bytes, format, beside.folder.as_deref(), &options)
        .map_err(|e| read_failure(ReadError { name: name.to_string(), ..e }))?;
    drop(bytes);
    job.record.warnings = read.warnings.iter().map(ToString::to_string).collect();
    if job.settings.drop_isolated {
        let dropped = read.mesh.drop_isolated().iter().filter(|n| n.is_none()).count();
        if dropped > 0 {
            job.record.warnings.push(format!("{dropped} vertices that nothing uses are left out"));
        }
    }
    // Not a warning of the reader, and still what somebody who looks at the output has to know.
    let pipeline = job.settings.pipeline();
    let recompressed = pipeline.prepare(&mut read.mesh.appearance);
    job.record.warnings.extend(recompressed.iter().map(ToString::to_string));
    job.record.vertices = read.mesh.vertex_count() as u64;
    job.record.faces = read.mesh.face_count() as u64;
    job.record.seconds.read = since(clock);
    let clock = Instant::now();
    let id = job.id;
    let threads = rayon::current_num_threads();
    let engine = around.engines.map_or_else(Engine::default, |make| make(job.record.vertices, threads));
    let stamp_chunk = |full| stamp.chunk(full);
    let tell = |progress| around.observer.event(Event::Progress { id, progress });
    let control = Control::new().progress(&tell);
    let encoded = pipeline.encode(&read.mesh, engine, Some(&stamp_chunk), control);
    let mut encoded = encoded.map_err(|e| match e {
        EncodeError::Bug(_) => Failure::new(FailureKind::Bug, format!("{name}: {e}")),
        _ => Failure::new(FailureKind::Encode, format!("{name}: {e}")),
    })?;
    let inside = |e: &dyn std::fmt::Display| Failure::new(FailureKind::Bug, format!("{name}: {e}; please report it"));
    // Images may be most of what is in memory: the mesh goes before the output is there twice, unless it is needed again.
    let again = around.verify.then(|| (read, std::mem::take(&mut encoded.map)));
    pipeline.arrange(&mut encoded, Some(&stamp_chunk), &|_, _| {}).map_err(|e| inside(&e))?;
    let Encoded { bytes: stamped, report, .. } = encoded;
    job.record.levels = report.levels as u64;
    job.record.warnings.extend(report.loss.warnings().iter().map(ToString::to_string));
    if let Some(why) = &report.fallback {
        job.record.warnings.push(format!("{why}; the processor weighed the edges instead"));
    }
    job.record.device.clone_from(&report.weighed_by);
    job.record.seconds.encode = since(clock);
    if let Some((read, map)) = &again {
        let clock = Instant::now();
        verify(&stamped, read, map).map_err(|what| {
            Failure::new(FailureKind::Verify, format!("{name}: the output is not the source: {what}; please report it"))
        })?;
        job.record.seconds.verify = since(clock);
    }
    Ok(stamped)
}

/// Decode a file in full and compare it with its source: vertices, faces, attributes, materials and images.
fn verify(file: &[u8], read: &ReadMesh, map: &[u32]) -> Result<(), String> {
    let header = match FileIndex::parse(file).map_err(|e| e.to_string())? {
        Parsed::Ready(front) => front.header().clone(),
        Parsed::NeedBytes(_) => return Err("its front is not whole".to_string()),
    };
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(file);
    while let Step::Level(_) = decoder.next_level().map_err(|e| e.to_string())? {}
    decoder.finish().map_err(|e| e.to_string())?;
    let decoded = decoder.to_mesh();
    let layers = &header.attributes.layers;
    // The map of the encoder, not that of the reader: it speaks of the vertices of the mesh that was encoded.
    exact::by_map(&read.mesh, &decoded, &header.lattice, map)
        .and_then(|()| exact::attributes_by_map(&read.mesh, &decoded, map, &exact::quantized(layers)))
        .map_err(|e| e.to_string())
}

/// The failure of a file that can never fit.
pub(super) fn too_large(name: &str, needs: u64, allowed: u64) -> Failure {
    let mib = |n: u64| n.div_ceil(1 << 20);
    let (needs, allowed) = (mib(needs), mib(allowed));
    Failure::new(
        FailureKind::Memory,
        format!(
            "{name}: encoding it takes about {needs} MiB of memory, and {allowed} MiB are allowed beside the program itself; raise --memory or cut the mesh into tiles"
        ),
    )
}

/// The failure that an error of a reader is.
pub(super) fn read_failure(e: ReadError) -> Failure {
    let kind = match e.kind {
        ReadErrorKind::NotFound => FailureKind::Missing,
        ReadErrorKind::Permission => FailureKind::Permission,
        ReadErrorKind::Memory { .. } => FailureKind::Memory,
        _ => FailureKind::Input,
    };
    Failure::new(kind, e.to_string())
}
