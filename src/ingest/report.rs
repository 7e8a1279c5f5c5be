//! The report of a run: kept on disk while it goes on, so that memory does not grow with the number of files, and put
//! together at the end as one JSON object or one page.

use super::Summary;
use super::error::{Failure, IngestError};
use super::job::{Record, Status};
use super::location::Object;
use super::location::{STAGING, is_staged};
use super::output::{Staged, Staging, may_write};
use crate::io::files::Place;
use crate::page;
use maud::{Markup, PreEscaped, html};
use std::io::{self, BufRead, BufReader, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// The kinds of reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Json,
    Html,
}

/// A report on its way.
pub(super) struct Report {
    path: PathBuf,
    kind: Kind,
    staging: Staging,
    /// One record a line.
    spool: BufWriter<Staged>,
}

impl Write for Staged {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Report {
    /// See now, before any work, that the report can be written.
    pub fn create(path: &Path, manifest: Option<&Path>) -> Result<Self, IngestError> {
        let shown = path.display().to_string();
        let kind = match path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).as_deref() {
            Some("json") => Kind::Json,
            Some("html" | "htm") => Kind::Html,
            _ => return Err(IngestError::Usage(format!("{shown}: a report ends with .json or .html"))),
        };
        if is_staged(path) {
            let what =
                format!("{shown}: {STAGING} is for files on their way, which a run removes; choose another place");
            return Err(IngestError::Usage(what));
        }
        let manifest: Vec<_> = manifest.map(|path| (Place::of(path), "the manifest")).into_iter().collect();
        may_write(&Object::Local(path.to_path_buf()), &manifest).map_err(|f| IngestError::Setup(f.message))?;
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let staging = Staging::new(folder).map_err(|e| IngestError::Setup(Failure::writing(&shown, &e).message))?;
        let spool = staging.create().map_err(|e| IngestError::Setup(Failure::writing(&shown, &e).message))?;
        Ok(Report { path: path.to_path_buf(), kind, staging, spool: BufWriter::new(spool) })
    }

    /// Keep the record of a file.
    pub fn add(&mut self, record: &Record) -> io::Result<()> {
        serde_json::to_writer(&mut self.spool, record)?;
        self.spool.write_all(b"\n")
    }

    /// Write the report and put it in its place.
    pub fn finish(self, summary: &Summary) -> Result<(), IngestError> {
        let Report { path, kind, staging, spool } = self;
        let work = || {
            let mut spool = spool.into_inner().map_err(io::IntoInnerError::into_error)?;
            let mut out = BufWriter::new(staging.create()?);
            match kind {
                Kind::Json => json(&mut out, &mut spool, summary)?,
                Kind::Html => html(&mut out, &mut spool, summary)?,
            }
            out.into_inner().map_err(io::IntoInnerError::into_error)?.commit(&path)
        };
        work().map_err(|e| IngestError::Setup(Failure::writing(&path.display().to_string(), &e).message))
    }
}

/// Every line of the spool.
fn each(spool: &mut Staged, mut line: impl FnMut(&str) -> io::Result<()>) -> io::Result<()> {
    spool.file.seek(SeekFrom::Start(0))?;
    for text in BufReader::new(&spool.file).lines() {
        line(&text?)?;
    }
    Ok(())
}

fn json(out: &mut impl Write, spool: &mut Staged, summary: &Summary) -> io::Result<()> {
    write!(out, "{{\n\"summary\": ")?;
    serde_json::to_writer_pretty(&mut *out, summary)?;
    write!(out, ",\n\"files\": [")?;
    let mut first = true;
    each(spool, |line| {
        let comma = if std::mem::take(&mut first) { "" } else { "," };
        write!(out, "{comma}\n{line}")
    })?;
    writeln!(out, "\n]\n}}")
}

fn html(out: &mut impl Write, spool: &mut Staged, summary: &Summary) -> io::Result<()> {
    let head = html! {
        (page::head("lodestream ingest"))
        h1 { "lodestream ingest" }
        dl { @for (label, value) in summary.rows() { dt { (label) } dd { (value) } } }
    };
    out.write_all(head.into_string().as_bytes())?;
    // Failures first: they are what somebody has to look at.
    for (title, failed) in [("Failures", true), ("Files", false)] {
        if failed && summary.failed() == 0 {
            continue;
        }
        let heads = ["source", "output", "status", "vertices", "bytes in", "bytes out", "seconds", "notes"];
        let start = html! { h2 { (title) } (PreEscaped("<table>")) tr { @for head in heads { th { (head) } } } };
        out.write_all(start.into_string().as_bytes())?;
        each(spool, |line| {
            let value: serde_json::Value = serde_json::from_str(line)?;
            if (value["status"] == "failed") != failed {
                return Ok(());
            }
            out.write_all(row(&value).into_string().as_bytes())
        })?;
        writeln!(out, "</table>")?;
    }
    out.write_all(page::END.as_bytes())
}

/// The row of one file.
fn row(value: &serde_json::Value) -> Markup {
    let text = |key: &str| value[key].as_str().unwrap_or("");
    let seconds: f64 = value["seconds"].as_object().into_iter().flatten().filter_map(|(_, v)| v.as_f64()).sum();
    let warnings = value["warnings"].as_array().into_iter().flatten().filter_map(|w| w.as_str());
    html! {
        tr class=(text("status")) {
            @for key in ["source", "output", "status"] { td.w { (text(key)) } }
            @for key in ["vertices", "bytes_in", "bytes_out"] { td { (value[key].as_u64().unwrap_or(0)) } }
            td { (format!("{seconds:.2}")) }
            td.w { @for note in value["error"].as_str().into_iter().chain(warnings) { (note) br; } }
        }
        "\n"
    }
}

impl Summary {
    /// Count a file.
    pub(super) fn add(&mut self, record: &Record) {
        self.files += 1;
        match record.status {
            Status::Done => {
                self.done += 1;
                self.vertices += record.vertices;
                self.faces += record.faces;
                self.bytes_in += record.bytes_in;
                self.bytes_out += record.bytes_out;
            }
            Status::Skipped => self.skipped += 1,
            Status::Failed => {
                if let Some(kind) = record.failure {
                    *self.failures.entry(kind).or_default() += 1;
                }
            }
        }
    }

    /// How many files failed.
    pub fn failed(&self) -> u64 {
        self.failures.values().sum()
    }

    /// The final table, as labels and values.
    pub fn rows(&self) -> Vec<(String, String)> {
        let rate = |n: u64| if self.seconds > 0.0 { n as f64 / self.seconds } else { 0.0 };
        let count = page::thousands;
        let bytes = |n: u64| match n {
            0..10_000 => format!("{} B", count(n)),
            10_000..1_000_000 => format!("{:.1} kB", n as f64 / 1e3),
            1_000_000..1_000_000_000 => format!("{:.1} MB", n as f64 / 1e6),
            _ => format!("{:.1} GB", n as f64 / 1e9),
        };
        let ratio = if self.bytes_out > 0 { self.bytes_in as f64 / self.bytes_out as f64 } else { 0.0 };
        let mut rows = vec![
            (
                "files",
                format!(
                    "{}: {} done, {} skipped, {} failed",
                    count(self.files),
                    count(self.done),
                    count(self.skipped),
                    count(self.failed())
                ),
            ),
            ("vertices", format!("{} ({} a second)", count(self.vertices), count(rate(self.vertices) as u64))),
            ("faces", count(self.faces)),
            ("bytes in", format!("{} ({:.1} MB a second)", bytes(self.bytes_in), rate(self.bytes_in) / 1e6)),
            ("bytes out", format!("{} (ratio {ratio:.1})", bytes(self.bytes_out))),
            ("time", format!("{:.1} s", self.seconds)),
            (
                "memory",
                format!(
                    "{} at most, {} foreseen, {} allowed",
                    bytes(self.peak_bytes),
                    bytes(self.predicted_bytes),
                    bytes(self.memory)
                ),
            ),
        ];
        if self.hidden > 0 {
            rows.push(("hidden", format!("{} files and folders passed over; --hidden takes them", count(self.hidden))));
        }
        if self.shard.1 > 1 {
            rows.push(("shard", format!("{} of {}", self.shard.0, self.shard.1)));
        }
        let mut rows: Vec<(String, String)> = rows.into_iter().map(|(a, b)| (a.to_string(), b)).collect();
        rows.extend(self.failures.iter().map(|(kind, n)| (format!("failed: {kind}"), count(*n))));
        rows
    }
}
