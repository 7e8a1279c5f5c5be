//! What `ingest` shows while it runs: bars on a terminal, one line per event elsewhere, JSON lines on request.
//!
//! All lines are `tracing` events on standard error; only their form differs.

use crate::shared;
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use lodestream::encode::Stage;
use lodestream::ingest::{Event, Observer, Record, Status};
use std::collections::HashMap;
use std::fmt;
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tracing::{error, info, warn};
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::FormatTime;

/// How the lines look.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// For people
    Text,
    /// One JSON object a line
    Json,
}

/// Seconds since the start.
struct SinceStart(Instant);

impl FormatTime for SinceStart {
    fn format_time(&self, w: &mut Writer<'_>) -> fmt::Result {
        write!(w, "{:9.2}s", self.0.elapsed().as_secs_f64())
    }
}

/// Follows a run.
pub struct Watch {
    bars: Option<Bars>,
    stage_name: fn(Stage) -> &'static str,
    start: Instant,
    found: AtomicU64,
    ended: AtomicU64,
    failed: AtomicU64,
    /// When the last line about the whole was written, in milliseconds since the start.
    told: AtomicU64,
}

struct Bars {
    multi: MultiProgress,
    whole: ProgressBar,
    running: Mutex<Running>,
}

#[derive(Default)]
struct Running {
    bars: HashMap<u64, (ProgressBar, u64)>,
    /// Vertices of files that have ended, as surveyed, and bytes read.
    vertices: u64,
    bytes: u64,
}

/// How often plain lines tell of the whole.
const EVERY: Duration = Duration::from_secs(10);

impl Watch {
    /// Set the log up and show the first bar.
    pub fn start(format: LogFormat, device: &str, stage_name: fn(Stage) -> &'static str) -> Self {
        let start = Instant::now();
        let bars = (format == LogFormat::Text && shared::stderr_is_terminal()).then(Bars::new);
        let builder = tracing_subscriber::fmt().with_writer(io::stderr).with_target(false);
        // A second run in one process (there is none) would keep the first log.
        let _ = match (format, &bars) {
            (LogFormat::Json, _) => {
                tracing::subscriber::set_global_default(builder.json().flatten_event(true).finish())
            }
            // On a terminal only warnings and failures get a line, above the bars.
            (LogFormat::Text, Some(bars)) => {
                let multi = bars.multi.clone();
                let above = move || AboveBars(multi.clone());
                let builder = builder.with_ansi(false).without_time().with_max_level(tracing::Level::WARN);
                tracing::subscriber::set_global_default(builder.with_writer(above).finish())
            }
            (LogFormat::Text, None) => {
                let builder = builder.with_ansi(false).with_timer(SinceStart(start));
                tracing::subscriber::set_global_default(builder.finish())
            }
        };
        // A panic of a job becomes a failure with the name of its file; where it happened belongs in the log.
        std::panic::set_hook(Box::new(|info| {
            let place = info.location().map_or(String::new(), ToString::to_string);
            error!(place, "a panic was caught: this is a bug of lodestream");
        }));
        info!(device, "ingest starts");
        let [found, ended, failed, told] = Default::default();
        Watch { bars, stage_name, start, found, ended, failed, told }
    }

    /// Clear the bars.
    pub fn finish(&self) {
        if let Some(bars) = &self.bars {
            let _ = bars.multi.clear();
        }
    }

    fn tell_of_the_whole(&self) {
        let now = self.start.elapsed().as_millis() as u64;
        let told = self.told.load(Ordering::Relaxed);
        let due = now >= told + EVERY.as_millis() as u64;
        if due && self.told.compare_exchange(told, now, Ordering::Relaxed, Ordering::Relaxed).is_ok() {
            let [found, ended, failed] = [&self.found, &self.ended, &self.failed].map(|n| n.load(Ordering::Relaxed));
            info!(found, ended, failed, "so far");
        }
    }
}

impl Observer for Watch {
    fn event(&self, event: Event<'_>) {
        if let Some(bars) = &self.bars {
            bars.event(event, self.stage_name);
        }
        match event {
            Event::Found { files, complete, .. } => {
                self.found.store(files, Ordering::Relaxed);
                if complete {
                    info!(files, "all files are found");
                }
            }
            Event::Started { id, source, vertices, threads } => info!(id, source, vertices, threads, "started"),
            Event::Ended { id, record } => {
                self.ended.fetch_add(1, Ordering::Relaxed);
                if record.status == Status::Failed {
                    self.failed.fetch_add(1, Ordering::Relaxed);
                }
                tell(id, record);
                self.tell_of_the_whole();
            }
            _ => {}
        }
    }
}

fn tell(id: u64, r: &Record) {
    let (source, output) = (r.source.as_str(), r.output.as_str());
    for warning in &r.warnings {
        warn!(id, source, "{warning}");
    }
    match (r.status, &r.error) {
        (Status::Failed, error) => {
            let kind = r.failure.map_or("", |k| k.name());
            error!(id, source, kind, "failed: {}", error.as_deref().unwrap_or(""));
        }
        (Status::Skipped, _) => info!(id, source, output, "skipped: there already"),
        (Status::Done, _) => {
            let s = &r.seconds;
            let seconds = shared::round(s.fetch + s.read + s.encode + s.verify + s.write);
            info!(
                id,
                source,
                output,
                vertices = r.vertices,
                bytes_in = r.bytes_in,
                bytes_out = r.bytes_out,
                seconds,
                "done"
            );
        }
    }
}

impl Bars {
    fn new() -> Self {
        let multi = MultiProgress::with_draw_target(ProgressDrawTarget::stderr_with_hz(8));
        let whole = multi.add(ProgressBar::new(0));
        let style = "{msg} {wide_bar:.cyan/blue} {human_pos}/{human_len} vertices, {speed}, {eta} left";
        whole.set_style(style_of(style).with_key("speed", |state: &ProgressState, out: &mut dyn fmt::Write| {
            let _ = write!(out, "{}/s", shared::thousands(state.per_sec() as u64));
        }));
        whole.enable_steady_tick(Duration::from_millis(500));
        Bars { multi, whole, running: Mutex::default() }
    }

    fn lock(&self) -> MutexGuard<'_, Running> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn event(&self, event: Event<'_>, stage_name: fn(Stage) -> &'static str) {
        match event {
            Event::Found { vertices, .. } => self.whole.set_length(vertices),
            Event::Started { id, source, vertices, threads } => {
                let bar = self.multi.add(ProgressBar::new(vertices.max(1)));
                bar.set_style(style_of("  {prefix} {wide_bar:.green/blue} {percent:>3} % {msg:8}"));
                let cores = if threads > 1 { format!(" ({threads} cores)") } else { String::new() };
                // The end of a long name tells more than its beginning.
                let from = source.char_indices().rev().nth(39).map_or(0, |(i, _)| i);
                bar.set_prefix(format!("{:40}{cores}", &source[from..]));
                self.lock().bars.insert(id, (bar, vertices));
            }
            Event::Progress { id, progress } => {
                let running = self.lock();
                if let Some((bar, _)) = running.bars.get(&id) {
                    bar.set_message(stage_name(progress.stage));
                    bar.set_length(progress.total.max(1));
                    bar.set_position(progress.done);
                }
            }
            Event::Ended { id, record } => {
                let mut running = self.lock();
                // What was surveyed is what the length of the whole was made of.
                let surveyed = running.bars.remove(&id).map_or(record.vertices, |(bar, vertices)| {
                    bar.finish_and_clear();
                    self.multi.remove(&bar);
                    vertices
                });
                running.vertices += surveyed;
                running.bytes += record.bytes_in;
                self.whole.set_position(running.vertices);
                let rate = running.bytes as f64 / 1e6 / self.whole.elapsed().as_secs_f64().max(0.001);
                self.whole.set_message(format!("{rate:.1} MB/s"));
            }
            _ => {}
        }
    }
}

fn style_of(template: &str) -> ProgressStyle {
    // The templates are constants; should one ever be wrong, the default bar still shows.
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// Lines written above the bars.
struct AboveBars(MultiProgress);

impl io::Write for AboveBars {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.println(String::from_utf8_lossy(bytes).trim_end())?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
