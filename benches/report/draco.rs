//! Draco on the same geometry: an OBJ without attributes, `-cl 10`.
//!
//! It drops isolated vertices and merges those on one point, splits complex ones, and drops degenerate faces; so rates are
//! bits per vertex in use of *our* mesh, the same number on both sides.

use crate::measure::Measured;
use lodestream::mesh::Mesh;
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// How long Draco may take for one step.
const PATIENCE: Duration = Duration::from_secs(60);

/// The two programs are there.
pub struct Draco {
    /// What is known of the version.
    pub version: String,
}

/// What Draco made of a mesh.
#[derive(Clone, Debug)]
pub struct DracoRun {
    pub bytes: u64,
    pub encode_ms: Option<f64>,
    pub decode_ms: Option<f64>,
}

impl DracoRun {
    /// Bits per vertex in use.
    pub fn rate(&self, row: &Measured) -> f64 {
        8.0 * self.bytes as f64 / row.in_use as f64
    }
}

/// Look for the programs.
pub fn find() -> Option<Draco> {
    let there = |name: &str| {
        Command::new(name).arg("-h").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
    };
    if !there("draco_encoder") || !there("draco_decoder") {
        return None;
    }
    let package = Command::new("dpkg-query").args(["-W", "-f", "${Version}", "draco"]).stderr(Stdio::null()).output();
    let version = package.ok().filter(|o| o.status.success()).and_then(|o| String::from_utf8(o.stdout).ok());
    Some(Draco { version: version.unwrap_or_else(|| "of unknown version".to_string()) })
}

/// Write the geometry for Draco: every digit, no attributes, no dangling edges.
pub fn write_obj(mesh: &Mesh, path: &Path) -> Result<(), String> {
    let mut text = String::new();
    for [x, y, z] in &mesh.positions {
        // Writing into a string cannot fail.
        let _ = writeln!(text, "v {x} {y} {z}");
    }
    for face in mesh.faces().filter(|f| f.len() > 2) {
        text.push('f');
        for v in face {
            let _ = write!(text, " {}", v + 1);
        }
        text.push('\n');
    }
    std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()))
}

impl Draco {
    /// Encode and decode `obj`; `None` where Draco refuses.
    pub fn run(&self, obj: &Path, mesh: &Mesh, bits: u8, repeats: u32) -> Option<DracoRun> {
        let (drc, back) = (obj.with_extension("drc"), obj.with_extension("draco.obj"));
        let mut best = None::<DracoRun>;
        for _ in 0..repeats {
            let mut encode = Command::new("draco_encoder");
            encode.arg("-i").arg(obj).arg("-o").arg(&drc).args(["-cl", "10", "-qp", &bits.to_string()]);
            if mesh.faces().all(|f| f.len() < 3) {
                encode.arg("-point_cloud");
            } else if mesh.faces().any(|f| f.len() > 3) {
                encode.arg("-preserve_polygons");
            }
            let encode_ms = milliseconds(&mut encode)?;
            let mut decode = Command::new("draco_decoder");
            let decode_ms = milliseconds(decode.arg("-i").arg(&drc).arg("-o").arg(&back)).flatten();
            let bytes = std::fs::metadata(&drc).ok()?.len();
            let least = |a: Option<f64>, b: Option<f64>| match (a, b) {
                (Some(a), Some(b)) => Some(a.min(b)),
                (a, b) => a.or(b),
            };
            best = Some(match best {
                None => DracoRun { bytes, encode_ms, decode_ms },
                Some(old) => DracoRun {
                    bytes,
                    encode_ms: least(old.encode_ms, encode_ms),
                    decode_ms: least(old.decode_ms, decode_ms),
                },
            });
            if decode_ms.is_none() {
                // It does not read its own file, or not in time; once is enough.
                break;
            }
        }
        // Best effort: they lie in a folder of temporary files.
        let _ = std::fs::remove_file(drc);
        let _ = std::fs::remove_file(back);
        best
    }
}

/// Run, and read the time from `… (123 ms to encode).`; `None` on failure.
fn milliseconds(command: &mut Command) -> Option<Option<f64>> {
    // Some input keeps it busy for ever; what it prints fits into a pipe.
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().ok()?;
    let start = Instant::now();
    while child.try_wait().ok()?.is_none() {
        if start.elapsed() > PATIENCE {
            child.kill().ok()?;
            child.wait().ok()?;
            return None;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    let output = child.wait_with_output().ok()?;
    if !output.status.success() {
        return None;
    }
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let number = text.split(" ms to ").next().and_then(|head| head.rsplit('(').next()).and_then(|n| n.parse().ok());
    Some(number)
}
