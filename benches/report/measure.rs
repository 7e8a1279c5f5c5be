//! One dataset through the program: bytes, seconds, memory, levels and their errors.

use crate::datasets::Dataset;
use crate::draco::{self, Draco, DracoRun};
use lodestream::format::decoder::{DecodeOptions, Decoder, Step};
use lodestream::io::write::{self, WriteOptions};
use lodestream::mesh::Mesh;
use lodestream::quality::{self, SampleOptions, Sampled};
use serde_json::{Value, json};
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

/// Levels whose error is measured, at most.
const MEASURED_LEVELS: usize = 8;

/// What was found out about a dataset, at 12 bits; the scaling series at as many as keep the detail equal.
pub struct Measured {
    pub name: String,
    pub bits: u8,
    pub vertices: usize,
    pub faces: usize,
    /// Vertices that a face names; all of them where there is no face.
    pub in_use: usize,
    pub bytes: u64,
    /// The program's own account of the encoding.
    pub encode: Value,
    pub encode_seconds: f64,
    pub encode_memory: u64,
    pub decode_seconds: f64,
    pub decode_cpu_seconds: f64,
    pub decode_memory: u64,
    pub levels: Vec<LevelRow>,
    pub draco: Option<DracoRun>,
    pub by_bits: Vec<BitsRow>,
}

/// One level.
pub struct LevelRow {
    pub level: u64,
    pub vertices: u64,
    pub faces: u64,
    pub bytes: u64,
    /// Upper bound of the distance to the input, as the file says.
    pub bound: Option<f64>,
    /// The largest distance found by sampling, both directions.
    pub measured: Option<f64>,
}

/// Sizes at another precision.
pub struct BitsRow {
    pub bits: u8,
    pub bytes: u64,
    pub draco: Option<u64>,
}

impl Measured {
    /// Bits per vertex in use.
    pub fn rate(&self) -> f64 {
        8.0 * self.bytes as f64 / self.in_use as f64
    }

    /// Of the coarsest level with a tenth of the vertices: its share of them, and the bits per vertex of the full mesh until then.
    pub fn prefix_rate(&self) -> Option<(f64, f64)> {
        let level = self.levels.iter().find(|l| 10 * l.vertices as usize >= self.vertices)?;
        let n = self.vertices.max(1) as f64;
        Some((level.vertices as f64 / n, 8.0 * level.bytes as f64 / n))
    }

    /// The smallest ratio of bound and measured error below the full level.
    pub fn bound_over_measured(&self) -> Option<f64> {
        let ratio = |l: &LevelRow| Some(l.bound? / l.measured.filter(|m| *m > 0.0)?);
        self.levels.iter().filter_map(ratio).reduce(f64::min)
    }

    /// Vertices per second, reading and writing left out.
    pub fn encode_speed(&self) -> Option<f64> {
        (self.encode_seconds > 0.0).then(|| self.vertices as f64 / self.encode_seconds)
    }

    /// Vertices per second of processor time, reading and writing included: what a machine that others use can still tell.
    pub fn encode_cpu_speed(&self) -> Option<f64> {
        let seconds = self.encode["seconds"]["cpu"].as_f64()?;
        (seconds > 0.05).then(|| self.vertices as f64 / seconds)
    }

    /// Vertices per second from bytes in memory to the full level in memory.
    pub fn decode_speed(&self) -> Option<f64> {
        (self.decode_seconds > 0.0).then(|| self.vertices as f64 / self.decode_seconds)
    }

    /// Vertices per second of processor time, from bytes in memory to the full level in memory.
    pub fn decode_cpu_speed(&self) -> Option<f64> {
        (self.decode_cpu_seconds > 0.05).then(|| self.vertices as f64 / self.decode_cpu_seconds)
    }

    /// Peak memory of the encoding process; small meshes only show the program itself.
    pub fn encode_memory_per_vertex(&self) -> Option<f64> {
        (self.vertices >= 20_000).then(|| self.encode_memory as f64 / self.vertices as f64)
    }

    /// Peak memory of a process that decodes and does nothing else, the file's bytes included.
    pub fn decode_memory_per_vertex(&self) -> Option<f64> {
        (self.vertices >= 20_000).then(|| self.decode_memory as f64 / self.vertices as f64)
    }

    /// All of it.
    pub fn json(&self) -> Value {
        let rate = |bytes: u64| 8.0 * bytes as f64 / self.in_use as f64;
        json!({
            "name": self.name,
            "bits": self.bits,
            "vertices": self.vertices,
            "vertices_in_use": self.in_use,
            "faces": self.faces,
            "bytes": self.bytes,
            "bits_per_vertex_in_use": self.rate(),
            "target": crate::target(&self.name).map(|(must, aim)| json!({ "must": must, "aim": aim })),
            "encode": self.encode,
            "encode_seconds": self.encode_seconds,
            "encode_vertices_per_second": self.encode_speed(),
            "encode_vertices_per_cpu_second": self.encode_cpu_speed(),
            "encode_peak_memory_bytes": self.encode_memory,
            "decode_seconds": self.decode_seconds,
            "decode_vertices_per_second": self.decode_speed(),
            "decode_vertices_per_cpu_second": self.decode_cpu_speed(),
            "decode_peak_memory_bytes": self.decode_memory,
            "prefix": self.prefix_rate().map(|(share, bits)| json!({ "share_of_vertices": share, "bits_per_vertex": bits })),
            "draco": self.draco.as_ref().map(|d| json!({
                "bytes": d.bytes,
                "bits_per_vertex_in_use": rate(d.bytes),
                "encode_ms": d.encode_ms,
                "decode_ms": d.decode_ms,
            })),
            "by_bits": self.by_bits.iter().map(|b| json!({
                "bits": b.bits,
                "bits_per_vertex_in_use": rate(b.bytes),
                "draco_bits_per_vertex_in_use": b.draco.map(rate),
            })).collect::<Vec<_>>(),
            "levels": self.levels.iter().map(|l| json!({
                "level": l.level,
                "vertices": l.vertices,
                "faces": l.faces,
                "bytes": l.bytes,
                "bound": l.bound,
                "measured": l.measured,
            })).collect::<Vec<_>>(),
        })
    }
}

/// Measure one dataset, with temporary files in `folder`.
pub fn dataset(
    dataset: &Dataset,
    folder: &Path,
    draco: Option<&Draco>,
    more_bits: bool,
    repeats: u32,
) -> Result<Measured, String> {
    let mesh = dataset.load(None)?;
    let bits = bits(dataset);
    let mut used = vec![false; mesh.vertex_count()];
    mesh.corners.iter().for_each(|&v| used[v as usize] = true);
    let in_use = match used.iter().filter(|u| **u).count() {
        0 => mesh.vertex_count().max(1),
        n => n,
    };
    // One geometry for everybody: what the reader gave, as binary PLY for us and as OBJ for Draco.
    let stem = dataset.name.replace('/', "-");
    let [source, lods, obj] = ["ply", "lods", "obj"].map(|e| folder.join(format!("tmp-{stem}.{e}")));
    write::write_path(&source, &mesh, None, &WriteOptions::default()).map_err(|e| e.to_string())?;
    let (mut encode, mut encode_seconds) = (Value::Null, f64::INFINITY);
    for _ in 0..repeats {
        let account = encode_once(&source, &lods, bits)?;
        let seconds = |field: &str| account["seconds"][field].as_f64().unwrap_or(0.0);
        let working = seconds("total") - seconds("read") - seconds("write");
        if working < encode_seconds {
            (encode, encode_seconds) = (account, working);
        }
    }
    let (mut decode_seconds, mut decode_cpu_seconds, mut decode_memory) = (f64::INFINITY, f64::INFINITY, 0);
    for _ in 0..repeats {
        let me = std::env::current_exe().map_err(|e| e.to_string())?;
        let account = json_of(Command::new(me).arg("--child-decode").arg(&lods))?;
        decode_seconds = decode_seconds.min(account["seconds"].as_f64().unwrap_or(f64::INFINITY));
        decode_cpu_seconds = decode_cpu_seconds.min(account["cpu_seconds"].as_f64().unwrap_or(f64::INFINITY));
        decode_memory = decode_memory.max(account["peak_memory_bytes"].as_u64().unwrap_or(0));
    }
    let mut by_bits = Vec::new();
    let mut draco_run = None;
    if let Some(draco) = draco {
        draco::write_obj(&mesh, &obj)?;
        draco_run = draco.run(&obj, &mesh, bits, repeats);
    }
    let bytes = std::fs::metadata(&lods).map_err(|e| e.to_string())?.len();
    let levels = levels(&lods, &mesh)?;
    if more_bits {
        for bits in [10, 12, 14, 16] {
            encode_once(&source, &lods, bits)?;
            let bytes = std::fs::metadata(&lods).map_err(|e| e.to_string())?.len();
            let draco = draco.and_then(|d| d.run(&obj, &mesh, bits, 1)).map(|run| run.bytes);
            by_bits.push(BitsRow { bits, bytes, draco });
        }
    }
    for file in [&source, &lods, &obj] {
        // Not all were made.
        let _ = std::fs::remove_file(file);
    }
    Ok(Measured {
        name: dataset.name.clone(),
        bits,
        vertices: mesh.vertex_count(),
        faces: mesh.face_count(),
        in_use,
        bytes,
        encode_memory: encode["peak_memory_bytes"].as_u64().unwrap_or(0),
        encode,
        encode_seconds,
        decode_seconds,
        decode_cpu_seconds,
        decode_memory,
        levels,
        draco: draco_run,
        by_bits,
    })
}

/// Bits per coordinate. In the scaling series a mesh of more vertices is more of the same: edges of about a dozen steps.
fn bits(dataset: &Dataset) -> u8 {
    let larger = if dataset.name.contains("/terrain-") { dataset.vertices as f64 / 1e5 } else { 1.0 };
    12 + (0.5 * larger.log2()).round().clamp(0.0, 9.0) as u8
}

fn encode_once(source: &Path, lods: &Path, bits: u8) -> Result<Value, String> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream"));
    command.arg("encode").arg(source).arg("-o").arg(lods).args(["--json", "--position-bits", &bits.to_string()]);
    // Geometry alone: that is what every rival's figures are for.
    json_of(command.args(["--no-weld", "--drop", "all"]))
}

/// Run a command that prints one JSON object.
fn json_of(command: &mut Command) -> Result<Value, String> {
    let output = command.stdin(Stdio::null()).output().map_err(|e| e.to_string())?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).trim().to_string());
    }
    serde_json::from_slice(&output.stdout).map_err(|e| e.to_string())
}

/// Decode a file to its full level in memory, step by step; `each` sees every level.
fn decode(bytes: &[u8], mut each: impl FnMut(u32, &mut Decoder)) -> Result<Decoder, String> {
    let mut decoder = Decoder::new(DecodeOptions { memory_limit: 64 << 30 });
    decoder.push(bytes);
    loop {
        match decoder.next_level().map_err(|e| e.to_string())? {
            Step::Level(level) => each(level, &mut decoder),
            Step::Full => return Ok(decoder),
            Step::NeedBytes => return Err("the file is cut".to_string()),
        }
    }
}

/// Decode in a process of its own, so that its peak memory is that of decoding.
pub fn child_decode(file: &Path) -> ExitCode {
    let run = || -> Result<Value, String> {
        let bytes = std::fs::read(file).map_err(|e| e.to_string())?;
        let (start, cpu) = (Instant::now(), cpu_seconds());
        let decoder = decode(&bytes, |_, _| {})?;
        let seconds = start.elapsed().as_secs_f64();
        let cpu = cpu_seconds() - cpu;
        std::hint::black_box(decoder.complex().positions.len());
        Ok(json!({ "seconds": seconds, "cpu_seconds": cpu, "peak_memory_bytes": peak_memory() }))
    };
    match run() {
        Ok(value) => {
            println!("{value}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

/// Processor seconds of all threads of this process; user and system time are the 14th and 15th field, in hundredths.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or("").split_whitespace().skip(11).take(2);
    fields.filter_map(|f| f.parse::<f64>().ok()).sum::<f64>() / 100.0
}

fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0) * 1024
}

/// The level table, with measured errors for some levels spread over the sizes.
fn levels(lods: &Path, mesh: &Mesh) -> Result<Vec<LevelRow>, String> {
    let bytes = std::fs::read(lods).map_err(|e| e.to_string())?;
    let mut front = None;
    let source = Sampled::new(mesh);
    let options = SampleOptions { samples: 60_000, ..SampleOptions::default() };
    // The distance of a million vertices to a million triangles is worth no one's morning.
    let measurable = !source.surface.is_empty() && mesh.vertex_count() <= 500_000;
    let mut rows: Vec<LevelRow> = Vec::new();
    let mut next = 24.0f64;
    let ratio = (mesh.vertex_count() as f64 / next).max(2.0).powf(1.0 / MEASURED_LEVELS as f64);
    decode(&bytes, |level, decoder| {
        if front.is_none() {
            front = decoder.index().ok().flatten();
        }
        let Some(front) = &front else { return };
        let Some(row) = front.header().levels.get(level as usize) else { return };
        let last = level == front.full_level();
        let mut measured = None;
        if measurable && (last || f64::from(row.vertices) >= next) {
            next = f64::from(row.vertices) * ratio;
            let decoded = decoder.to_mesh();
            measured = Some(quality::geometry_of(&source, &Sampled::new(&decoded), &options).max());
        }
        rows.push(LevelRow {
            level: u64::from(level),
            vertices: u64::from(row.vertices),
            faces: u64::from(row.elements),
            bytes: front.prefix_bytes(level).unwrap_or(0),
            bound: front.header().error(level).filter(|e| e.is_finite()),
            measured,
        });
    })?;
    Ok(rows)
}
