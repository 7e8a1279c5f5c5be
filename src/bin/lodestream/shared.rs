//! What several commands need: how options are written, memory and time, JSON, warnings.

use anyhow::{Context, Result, bail};
use lodestream::io::files;
use lodestream::io::read::{self, Format, ReadMesh, ReadOptions};
use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// One line on standard error, whatever the message holds.
pub fn complain(message: &str) {
    let line: Vec<&str> = message.split_whitespace().collect();
    // Nobody is left to tell when this fails.
    let _ = writeln!(io::stderr().lock(), "lodestream: {}", escape(&line.join(" ")));
}

/// Text for a terminal: what would steer it, or turn the direction of writing, is spelled out. Names of files may hold both.
pub fn escape(text: &str) -> Cow<'_, str> {
    let steers = |c: char| {
        c.is_control()
            || matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
    };
    if !text.contains(steers) {
        return Cow::Borrowed(text);
    }
    let spelled = |c: char| if steers(c) { c.escape_default().to_string() } else { c.to_string() };
    Cow::Owned(text.chars().map(spelled).collect())
}

/// A warning on standard error.
pub fn warn(message: impl std::fmt::Display) {
    complain(&format!("warning: {message}"));
}

pub fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|e| e.downcast_ref::<io::Error>().is_some_and(|e| e.kind() == io::ErrorKind::BrokenPipe))
}

/// Print a result on standard output; unlike `print!` a closed pipe is an error that can be handled.
pub fn print(text: &str) -> Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())?;
    Ok(out.flush()?)
}

/// Print the one object that `--json` promises.
pub fn print_json(value: &serde_json::Value) -> Result<()> {
    print(&format!("{}\n", serde_json::to_string_pretty(value)?))
}

/// Options of the machine.
#[derive(clap::Args)]
pub struct Machine {
    /// Worker threads [default: one per core]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Refuse work that needs more memory, as in 500MB or 2GiB [default: four fifths of what is free]
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    memory_limit: Option<u64>,
}

impl Machine {
    /// The most bytes of memory that the work may take.
    pub fn memory_limit(&self) -> u64 {
        self.memory_limit.unwrap_or_else(lodestream::ingest::default_memory)
    }

    /// Run `work` on a thread pool of the chosen size, and hand it that size.
    pub fn run<T: Send>(&self, work: impl FnOnce(usize) -> Result<T> + Send) -> Result<T> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(self.threads.map_or(0, usize::from))
            .build()
            .context("the worker threads cannot be started")?;
        pool.install(|| work(pool.current_num_threads()))
    }
}

/// Where a mesh comes from.
#[derive(clap::Args)]
pub struct Input {
    /// The mesh: .obj .ply .stl .off .gltf .glb, each also with .gz, .zst or .xz; - for standard input
    #[arg(value_name = "INPUT")]
    pub path: PathBuf,
    /// The format of the input, where its name does not tell
    #[arg(long, value_name = "FORMAT", value_parser = parse_format)]
    pub format: Option<Format>,
}

impl Input {
    pub fn read(&self, options: &ReadOptions) -> Result<ReadMesh> {
        read_mesh(&self.path, self.format, options)
    }
}

/// Read a mesh from a file or, for `-`, from standard input.
pub fn read_mesh(path: &Path, format: Option<Format>, options: &ReadOptions) -> Result<ReadMesh> {
    let Some(format) = format else {
        if is_dash(path) {
            bail!("standard input: its format is not known; name it with --format, as in --format ply");
        }
        return Ok(read::read_path(path, options)?);
    };
    if is_dash(path) {
        return Ok(read::read_from(io::stdin().lock(), "standard input", format, None, options)?);
    }
    let file = open(path)?;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    Ok(read::read_from(file, &path.display().to_string(), format, Some(folder), options)?)
}

/// `-` stands for standard input.
pub fn is_dash(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// A path for people.
pub fn name(path: &Path) -> String {
    if is_dash(path) { "standard input".to_string() } else { path.display().to_string() }
}

/// Read a whole file, with errors that say what to do.
pub fn read_file(path: &Path) -> Result<Vec<u8>> {
    // A pipe without a writer would be waited for, and a device might never end.
    let odd = |meta: std::fs::Metadata| !meta.is_file() && !meta.is_dir();
    if !is_dash(path) && std::fs::metadata(path).is_ok_and(odd) {
        bail!(
            "{}: this is no regular file (a pipe or a device); name a file, or pass the data on standard input as -",
            path.display()
        );
    }
    let mut bytes = Vec::new();
    io::Read::read_to_end(&mut open(path)?, &mut bytes).with_context(|| format!("{}: cannot be read", name(path)))?;
    Ok(bytes)
}

/// Open a file or standard input.
pub fn open(path: &Path) -> Result<Box<dyn io::Read>> {
    if is_dash(path) {
        return Ok(Box::new(io::stdin()));
    }
    let shown = path.display();
    let opened = if files::is_descriptor(path) {
        std::fs::File::open(path)
    } else {
        files::open_regular(path).map(|(file, _)| file)
    };
    match opened {
        Ok(file) => Ok(Box::new(file)),
        Err(e) => match e.kind() {
            io::ErrorKind::IsADirectory => bail!("{shown}: this is a folder; name a file"),
            io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => {
                bail!("{shown}: there is no such file; check the path")
            }
            io::ErrorKind::PermissionDenied => {
                bail!("{shown}: no permission to read it; check the owner and mode of the file")
            }
            io::ErrorKind::InvalidInput => {
                bail!("{shown}: cannot be read: {e}; pipes are read as standard input, named -")
            }
            _ => bail!("{shown}: cannot be read: {e}"),
        },
    }
}

/// `500`, `500MB`, `1.5GiB`, in bytes.
pub fn parse_size(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let digits = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let factor: u64 = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1,
        "k" | "kb" => 1000,
        "m" | "mb" => 1000 * 1000,
        "g" | "gb" => 1000 * 1000 * 1000,
        "t" | "tb" => 1000 * 1000 * 1000 * 1000,
        "kib" => 1 << 10,
        "mib" => 1 << 20,
        "gib" => 1 << 30,
        "tib" => 1 << 40,
        _ => return Err("a size looks like 2000000, 500MB or 2GiB".to_string()),
    };
    if let Ok(whole) = number.parse::<u64>() {
        return whole.checked_mul(factor).ok_or_else(|| "more than 2^64 bytes".to_string());
    }
    match number.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok((value * factor as f64) as u64),
        _ => Err("a size looks like 2000000, 500MB or 2GiB".to_string()),
    }
}

pub fn parse_format(text: &str) -> Result<Format, String> {
    let known = || Format::ALL.map(Format::extension).join(", ");
    Format::from_extension(text.trim_start_matches('.')).ok_or_else(|| format!("known formats are {}", known()))
}

/// The most memory this process has had, in bytes; 0 where the system does not tell.
pub fn peak_memory() -> u64 {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else { return 0 };
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0) * 1024
}

/// Processor seconds that all threads of this process have taken; `None` where the system does not tell.
pub fn cpu_seconds() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The second field may hold anything but ends with the last parenthesis; user and system time are the 14th and 15th.
    let mut fields = stat.rsplit(')').next()?.split_whitespace().skip(11);
    let ticks = fields.next()?.parse::<f64>().ok()? + fields.next()?.parse::<f64>().ok()?;
    Some(ticks / 100.0)
}

/// Seconds since `start`, to the microsecond.
pub fn seconds(start: Instant) -> f64 {
    round(start.elapsed().as_secs_f64())
}

/// Seconds to the microsecond: more digits mean nothing.
pub fn round(seconds: f64) -> f64 {
    (seconds * 1e6).round() / 1e6
}

pub use lodestream::page::thousands;

/// Bytes as people read them.
pub fn human_bytes(n: u64) -> String {
    match n {
        0..10_000 => format!("{} B", thousands(n)),
        10_000..1_000_000 => format!("{:.1} kB", n as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", n as f64 / 1e6),
        _ => format!("{:.1} GB", n as f64 / 1e9),
    }
}

/// Lines of a label and a value, the values in one column.
pub fn table(rows: &[(&str, String)]) -> String {
    let width = rows.iter().map(|(label, _)| label.len()).max().unwrap_or(0);
    rows.iter().fold(String::new(), |mut out, (label, value)| {
        let _ = writeln!(out, "{label:width$}  {}", escape(value));
        out
    })
}

/// Whether progress bars have a place to be drawn.
pub fn stderr_is_terminal() -> bool {
    io::stderr().is_terminal()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_in_both_systems() {
        for (text, bytes) in
            [("0", 0), ("17", 17), ("2GiB", 2 << 30), ("500MB", 500_000_000), ("1.5 kib", 1536), ("3k", 3000)]
        {
            assert_eq!(parse_size(text), Ok(bytes), "{text}");
        }
        for text in ["", "GiB", "-1", "1e3", "12 apples", "99999999999999TiB", "1.2.3"] {
            assert!(parse_size(text).is_err(), "{text}");
        }
    }

    #[test]
    fn numbers_are_grouped() {
        assert_eq!(thousands(0), "0");
        assert_eq!(thousands(999), "999");
        assert_eq!(thousands(1000), "1,000");
        assert_eq!(thousands(1234567), "1,234,567");
        assert_eq!(human_bytes(9_999), "9,999 B");
        assert_eq!(human_bytes(123_456), "123.5 kB");
    }
}
