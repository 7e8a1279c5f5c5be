//! The run: one thread lists, some survey, and workers take from a window of surveyed files the largest that fits.
//!
//! Largest first, because then the last files to finish are small and no core idles long. A file that does not fit at the
//! moment may be passed by a bounded number of smaller ones, then everybody waits for it. Workers are more than cores:
//! while some encode, others fetch or wait for a disk or a store.

use super::error::{Failure, FailureKind, IngestError};
use super::job::{self, Account, End, Job, REPORT, Record, Surroundings};
use super::ledger::{Cores, Memory};
use super::list::{Found, Hidden, Item, Listing};
use super::location::is_staged;
use super::location::{self, Dest, Folder, Object};
use super::output::Staging;
use super::report::Report;
use super::store::Stores;
use super::{Event, Observer, OnError, Plan, Summary, predict};
use crate::image::jpeg::Working;
use crate::io::files::{Place, open_regular};
use crate::io::read::{self, Format, Survey};
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Files that are surveyed and wait.
const WINDOW: usize = 1024;
/// Objects up to this size in a store are not surveyed before they are fetched: asking would take as long.
const SMALL: u64 = 1 << 20;
/// Bytes of an object that a survey before fetching looks at.
const HEAD: u64 = 1 << 18;
/// Memory beside the jobs: stacks, lists, buffers.
const ASIDE: u64 = 4 << 20;

struct State {
    pending: BTreeMap<(u64, Reverse<u64>), Job>,
    complete: bool,
    stop: bool,
    memory: Memory,
    most_charged: u64,
    charged: u64,
    /// Files admitted and not yet computed.
    in_hand: usize,
    /// Those of them that have no core yet.
    waiting: usize,
    /// Files admitted and not yet ended.
    active: usize,
    passed: usize,
    found: u64,
    found_vertices: u64,
    next_id: u64,
    summary: Summary,
    report: Option<Report>,
    report_error: Option<std::io::Error>,
}

struct Shared<'a> {
    plan: &'a Plan,
    observer: &'a dyn Observer,
    state: Mutex<State>,
    change: Condvar,
    dest: Dest,
    /// Files that may be in hand at a time.
    most_in_hand: usize,
    /// Bytes for all files together.
    allowed: u64,
    /// Bytes that the program takes without them.
    base: u64,
}

/// Ingest everything that the plan names.
///
/// # Errors
/// [`IngestError`] when the run cannot start, or its report cannot be written; files that fail are counted in the summary.
pub fn run(plan: &Plan, observer: &dyn Observer) -> Result<Summary, IngestError> {
    let clock = Instant::now();
    let stores = Stores::new(plan.retries);
    let listing = Listing::new(&plan.sources, plan.manifest.as_deref(), &plan.settings, &stores)?;
    let dest = location::dest(&plan.dest, &stores)?;
    if matches!(dest, Dest::File(_)) && !listing.is_single() {
        let what = format!("{}: many sources cannot go into one file; name a folder", plan.dest);
        return Err(IngestError::Usage(what));
    }
    let staging = staging(&dest, &plan.dest)?;
    if let Some(manifest) = plan.manifest.as_deref().filter(|path| is_staged(path)) {
        let what = format!("{}: it lies among files on their way, which a run removes; move it", manifest.display());
        return Err(IngestError::Usage(what));
    }
    let report = plan.report.as_deref().map(|path| Report::create(path, plan.manifest.as_deref())).transpose()?;
    let own = [(plan.report.as_deref(), REPORT), (plan.manifest.as_deref(), "the manifest")];
    let reserved: Vec<(Place, &str)> =
        own.iter().filter_map(|(path, what)| Some((Place::of((*path)?), *what))).collect();
    let report_is_source = AtomicBool::new(false);
    let (jobs, threads) = (plan.jobs.max(1), plan.threads.max(1).max(plan.jobs));
    let base = predict::resident() + ASIDE;
    if plan.memory <= base + ASIDE {
        let what =
            format!("--memory: {} bytes are less than the program itself takes; give it 64 MiB or more", plan.memory);
        return Err(IngestError::Usage(what));
    }
    let allowed = plan.memory - base;
    let local = listing.is_local() && matches!(dest, Dest::File(Object::Local(_)) | Dest::Folder(Folder::Local(_)));
    let most_in_hand = if local { jobs + 1 } else { 3 * jobs };
    let shared = Shared {
        plan,
        observer,
        state: Mutex::new(State {
            pending: BTreeMap::new(),
            complete: false,
            stop: false,
            memory: Memory::new(allowed),
            most_charged: 0,
            charged: 0,
            in_hand: 0,
            waiting: 0,
            active: 0,
            passed: 0,
            found: 0,
            found_vertices: 0,
            next_id: 0,
            summary: Summary::default(),
            report,
            report_error: None,
        }),
        change: Condvar::new(),
        dest,
        most_in_hand,
        allowed,
        base,
    };
    let cores = Cores::new(threads);
    let around = Surroundings {
        observer,
        cores: &cores,
        staging: staging.as_ref(),
        reserved: &reserved,
        report_is_source: &report_is_source,
        resume: plan.resume,
        verify: plan.verify,
        memory: allowed,
        least: (threads / jobs).max(1),
        engines: plan.engines.as_ref(),
        hook: plan.hook.as_deref(),
    };
    let (send, receive) = sync_channel::<Item>(64);
    let receive = Mutex::new(receive);
    std::thread::scope(|scope| {
        let (shared, around, receive) = (&shared, &around, &receive);
        let surveyors: Vec<_> =
            (0..if local { 2 } else { 8 }).map(|_| scope.spawn(move || survey_all(shared, receive))).collect();
        for _ in 0..most_in_hand + 2 * jobs + 2 {
            scope.spawn(move || work_all(shared, around));
        }
        let hidden = if plan.hidden { Hidden::Taken } else { Hidden::PassedOver };
        listing.walk(plan.shard, hidden, &stores, |found| {
            match found {
                Found::PassedOver => shared.lock().summary.hidden += 1,
                Found::Item(item) => {
                    if send.send(item).is_err() {
                        return false;
                    }
                }
                Found::Failed(name, failure) => {
                    let mut record = Record::new(name, String::new(), None, &Survey::default(), 0);
                    record.fail(failure);
                    shared.found(0);
                    shared.ended(None, &record);
                }
            }
            !shared.lock().stop
        });
        drop(send);
        for surveyor in surveyors {
            // A surveyor catches its panics.
            let _ = surveyor.join();
        }
        let mut state = shared.lock();
        state.complete = true;
        let (files, vertices) = (state.found, state.found_vertices);
        drop(state);
        shared.change.notify_all();
        observer.event(Event::Found { files, vertices, complete: true });
    });
    let state = shared.state.into_inner().unwrap_or_else(PoisonError::into_inner);
    let mut summary = state.summary;
    summary.seconds = (clock.elapsed().as_secs_f64() * 1e6).round() / 1e6;
    summary.peak_bytes = predict::peak_resident();
    summary.predicted_bytes = base + state.most_charged;
    summary.memory = plan.memory;
    summary.shard = (plan.shard.k + 1, plan.shard.n);
    summary.stopped = state.stop;
    if let (Some(e), Some(path)) = (&state.report_error, &plan.report) {
        return Err(IngestError::Setup(Failure::writing(&path.display().to_string(), e).message));
    }
    if let (true, Some(path)) = (report_is_source.into_inner(), &plan.report) {
        let what = "the report would replace a source of this run, or a file that one names; choose another name";
        return Err(IngestError::Setup(format!("{}: {what}", path.display())));
    }
    if let Some(report) = state.report {
        report.finish(&summary)?;
    }
    if summary.files == 0 && plan.shard.n < 2 {
        let what = "no mesh was found: nothing ends with .obj .ply .stl .off .gltf .glb or one of these and .gz";
        let hidden = match summary.hidden {
            0 => String::new(),
            n => format!("; {n} hidden files and folders were passed over, which --hidden takes"),
        };
        return Err(IngestError::Setup(format!("{}: {what}{hidden}", plan.sources.join(", "))));
    }
    Ok(summary)
}

/// The staging folder of a local destination, tried out; nothing for a store.
fn staging(dest: &Dest, shown: &str) -> Result<Option<Staging>, IngestError> {
    let folder: PathBuf = match dest {
        Dest::Folder(Folder::Local(path)) => path.clone(),
        Dest::File(Object::Local(path)) => {
            path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_path_buf()
        }
        _ => return Ok(None),
    };
    let staging = Staging::new(&folder).map_err(|e| IngestError::Setup(Failure::writing(shown, &e).message))?;
    // Whether anything can be written here is better known now than after an hour.
    staging.create().map_err(|e| IngestError::Setup(Failure::writing(shown, &e).message))?;
    Ok(Some(staging))
}

impl Shared<'_> {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'g>(&self, guard: MutexGuard<'g, State>) -> MutexGuard<'g, State> {
        self.change.wait(guard).unwrap_or_else(PoisonError::into_inner)
    }

    fn target(&self, output: &str) -> Object {
        match &self.dest {
            Dest::File(object) => object.clone(),
            Dest::Folder(folder) => folder.object(output),
        }
    }

    /// One file more, of so many vertices.
    fn found(&self, vertices: u64) {
        let mut state = self.lock();
        state.found += 1;
        state.found_vertices += vertices;
        let (files, vertices) = (state.found, state.found_vertices);
        drop(state);
        self.observer.event(Event::Found { files, vertices, complete: false });
    }

    /// A file has come to its end.
    fn ended(&self, id: Option<u64>, record: &Record) {
        let mut state = self.lock();
        let id = id.unwrap_or_else(|| {
            state.next_id += 1;
            state.next_id - 1
        });
        state.summary.add(record);
        if record.failure.is_some() && self.plan.on_error == OnError::Stop {
            state.stop = true;
        }
        if state.report_error.is_none()
            && let Some(report) = &mut state.report
            && let Err(e) = report.add(record)
        {
            state.report_error = Some(e);
        }
        drop(state);
        self.change.notify_all();
        self.observer.event(Event::Ended { id, record });
    }
}

/// Survey files until there are no more.
fn survey_all(shared: &Shared<'_>, receive: &Mutex<Receiver<Item>>) {
    loop {
        let item = receive.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(item) = item else { return };
        if shared.lock().stop {
            continue;
        }
        let name = item.object.name();
        let surveyed =
            catch_unwind(AssertUnwindSafe(|| survey(&item))).unwrap_or_else(|panic| Err(job::bug(&name, &*panic)));
        let (survey, stored) = surveyed.as_ref().map_or((Survey::default(), 0), |s| *s);
        let charge = predict::peak(&survey, stored, (0, Working::default()), &item.settings, shared.plan.verify);
        let mut record = Record::new(name.clone(), item.output.clone(), item.line, &survey, charge);
        record.bytes_in = stored;
        shared.found(survey.vertices);
        let failure = match surveyed {
            Err(failure) => Some(failure),
            Ok(_) if survey.exact && survey.vertices.max(survey.corners) > predict::MOST => {
                let what = format!(
                    "{name}: {} vertices and {} corners are more than a file can have ({}); cut the mesh into tiles",
                    survey.vertices,
                    survey.corners,
                    predict::MOST
                );
                Some(Failure::new(FailureKind::Encode, what))
            }
            Ok(_) if charge > shared.allowed => Some(job::too_large(&name, charge, shared.allowed)),
            Ok(_) => None,
        };
        if let Some(failure) = failure {
            record.fail(failure);
            shared.ended(None, &record);
            continue;
        }
        let target = shared.target(&item.output);
        let mut state = shared.lock();
        while state.pending.len() >= WINDOW && !state.stop {
            state = shared.wait(state);
        }
        let id = state.next_id;
        state.next_id += 1;
        let job = Job { id, object: item.object, target, settings: item.settings, survey, charge, record };
        state.pending.insert((charge, Reverse(id)), job);
        drop(state);
        shared.change.notify_all();
    }
}

/// How large a file is going to be, and how many bytes it has.
fn survey(item: &Item) -> Result<(Survey, u64), Failure> {
    let name = item.object.name();
    let Ok(format) = Format::from_path(item.object.path()) else {
        // The job itself will say what is wrong.
        return Ok((Survey { exact: true, ..Survey::default() }, item.size.unwrap_or(0)));
    };
    match &item.object {
        Object::Local(path) => {
            let work = || {
                let size = open_regular(path)?.1.len();
                Ok((read::survey_path(path, format)?, size))
            };
            work().map_err(|e| Failure::reading(&name, &e))
        }
        Object::Stored(store, key) => {
            if let Some(size) = item.size.filter(|s| *s <= SMALL) {
                return Ok((read::survey_head(&[], size, format), size));
            }
            let Some(meta) = store.head(key)? else {
                return Err(Failure::new(
                    FailureKind::Missing,
                    format!("{name}: there is no such object; check the path"),
                ));
            };
            let head = store.range(key, &meta, 0..HEAD)?;
            Ok((read::survey_head(&head, meta.size, format), meta.size))
        }
    }
}

/// Take files and do them until there are no more.
fn work_all(shared: &Shared<'_>, around: &Surroundings<'_>) {
    let mut own = None;
    let mut state = shared.lock();
    loop {
        if state.stop {
            state.pending.clear();
        }
        let Some(job) = pick(shared, &mut state) else {
            if state.active == 0 && state.pending.is_empty() && (state.complete || state.stop) {
                drop(state);
                // The others may be waiting to hear that.
                shared.change.notify_all();
                return;
            }
            state = shared.wait(state);
            continue;
        };
        drop(state);
        // Room in the window.
        shared.change.notify_all();
        let id = job.id;
        let mut charge = Charge { shared, bytes: job.charge, computed: false, has_core: false };
        let end = job::run(job, around, &mut charge, &mut own);
        drop(charge);
        match end {
            End::Record(record) => {
                shared.ended(Some(id), &record);
                state = shared.lock();
            }
            End::Again(job) => {
                state = shared.lock();
                state.pending.insert((job.charge, Reverse(id)), *job);
            }
        }
        state.active -= 1;
        shared.change.notify_all();
    }
}

/// The largest file that fits, if any may start now.
fn pick(shared: &Shared<'_>, state: &mut State) -> Option<Job> {
    if state.in_hand >= shared.most_in_hand {
        return None;
    }
    let largest = *state.pending.last_key_value()?.0;
    // What the allocator keeps of files that are done counts too, unless nothing is left that could give it back.
    let kept = match state.active {
        0 => 0,
        _ => predict::resident().saturating_sub(shared.base.saturating_add(state.charged)),
    };
    let State { pending, memory, .. } = state;
    let key = *pending.keys().rev().find(|key| memory.fits(key.0.saturating_add(kept)) && memory.take(key.0))?;
    if key != largest {
        if state.passed >= 8 * shared.most_in_hand {
            // Others have passed it often enough.
            state.memory.give(key.0);
            return None;
        }
        state.passed += 1;
    } else {
        state.passed = 0;
    }
    let job = state.pending.remove(&key)?;
    state.charged += job.charge;
    state.most_charged = state.most_charged.max(state.charged);
    state.in_hand += 1;
    state.waiting += 1;
    state.active += 1;
    Some(job)
}

/// The charge of a file in work, given back when dropped.
struct Charge<'a, 'b> {
    shared: &'a Shared<'b>,
    bytes: u64,
    computed: bool,
    has_core: bool,
}

impl Charge<'_, '_> {
    fn set(&mut self, state: &mut State, bytes: u64) -> bool {
        state.memory.give(self.bytes);
        state.charged -= self.bytes.min(state.charged);
        let fits = state.memory.take(bytes);
        self.bytes = if fits { bytes } else { 0 };
        state.charged += self.bytes;
        state.most_charged = state.most_charged.max(state.charged);
        fits
    }
}

impl Account for Charge<'_, '_> {
    fn recharge(&mut self, bytes: u64) -> bool {
        let mut state = self.shared.lock();
        let fits = self.set(&mut state, bytes);
        drop(state);
        self.shared.change.notify_all();
        fits
    }

    fn share(&mut self, free: usize) -> usize {
        let mut state = self.shared.lock();
        // While files are left to start, they are what idle cores are for.
        let share = if state.complete && state.pending.is_empty() { free / state.waiting.max(1) } else { 1 };
        state.waiting -= 1;
        self.has_core = true;
        share
    }

    fn computed(&mut self, bytes: u64) {
        let mut state = self.shared.lock();
        self.set(&mut state, bytes.min(self.bytes));
        state.in_hand -= 1;
        self.computed = true;
        drop(state);
        self.shared.change.notify_all();
    }
}

impl Drop for Charge<'_, '_> {
    fn drop(&mut self) {
        let mut state = self.shared.lock();
        self.set(&mut state, 0);
        state.in_hand -= usize::from(!self.computed);
        state.waiting -= usize::from(!self.has_core);
        drop(state);
        self.shared.change.notify_all();
    }
}
