//! `lodestream decode`: a level of a `.lods` file into a mesh file.

use crate::Outcome;
use crate::output::Outputs;
use crate::progress::Bars;
use crate::shared::{self, Machine};
use crate::stream::Stream;
use anyhow::{Context, Result, bail};
use lodestream::format::container::FileIndex;
use lodestream::format::decoder::DecodeOptions;
use lodestream::io::read::Format;
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  lodestream decode bunny.lods -o bunny.ply
  lodestream decode bunny.lods -o preview.glb --max-vertices 5000
  lodestream decode scan.lods -o within_5mm.obj --max-error 0.005
  head -c 100000 scan.lods | lodestream decode - -o start.ply
  lodestream decode scan.lods -o - --format ply | gzip > scan.ply.gz

A file that is cut gives its best whole level and a warning; with --strict that is an error.")]
pub struct Args {
    /// The .lods file; - for standard input
    #[arg(value_name = "IN.lods")]
    input: PathBuf,
    /// The mesh to write: .obj, .ply (binary), .stl or .glb; - for standard output, with --format
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// The format to write, where the name of the output does not tell: obj, ply, stl or glb
    #[arg(long, value_name = "FORMAT", value_parser = parse_written)]
    format: Option<Format>,
    #[command(flatten)]
    choice: Choice,
    /// A file that is cut is an error
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    machine: Machine,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Which level; the full one when nothing is said.
#[derive(Default, clap::Args)]
#[group(multiple = false)]
pub struct Choice {
    /// The level of this number, 0 is the coarsest
    #[arg(long, value_name = "N")]
    level: Option<u32>,
    /// The finest level of at most so many vertices
    #[arg(long, value_name = "N")]
    max_vertices: Option<u64>,
    /// The finest level that the first so many bytes of the file hold, as in 100000 or 2MB
    #[arg(long, value_name = "N", value_parser = shared::parse_size)]
    max_bytes: Option<u64>,
    /// The coarsest level that is at most so far from the input, in the units of the model
    #[arg(long, value_name = "E", value_parser = parse_error, allow_negative_numbers = true)]
    max_error: Option<f64>,
}

fn parse_error(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(error) if error >= 0.0 => Ok(error),
        _ => Err("a distance is a number of at least 0".to_string()),
    }
}

impl Choice {
    /// The first bytes of the file to which all that is read is confined.
    pub fn max_bytes(&self) -> Option<u64> {
        self.max_bytes
    }

    /// The option that was given, if any.
    pub fn given(&self) -> Option<&'static str> {
        let given = [
            (self.level.is_some(), "--level"),
            (self.max_vertices.is_some(), "--max-vertices"),
            (self.max_bytes.is_some(), "--max-bytes"),
            (self.max_error.is_some(), "--max-error"),
        ];
        given.into_iter().find(|(given, _)| *given).map(|(_, name)| name)
    }

    /// The number of the level asked for.
    pub fn pick(&self, front: &FileIndex) -> Result<u32> {
        let header = front.header();
        let full = header.full_level();
        let vertices = |level: u32| header.levels.get(level as usize).map_or(0, |row| u64::from(row.vertices));
        let finest = |fits: &dyn Fn(u32) -> bool| (0..=full).rev().find(|&level| fits(level));
        if let Some(level) = self.level {
            if level > full {
                bail!("there is no level {level}: the levels are 0 to {full}; see lodestream info");
            }
            return Ok(level);
        }
        if let Some(most) = self.max_vertices {
            return finest(&|level| vertices(level) <= most).with_context(|| {
                format!("level 0 has {} vertices already, more than {most}; allow more", vertices(0))
            });
        }
        if let Some(most) = self.max_bytes {
            let bytes = |level| front.prefix_bytes(level).unwrap_or(u64::MAX);
            return finest(&|level| bytes(level) <= most)
                .with_context(|| format!("level 0 takes {} bytes already, more than {most}; allow more", bytes(0)));
        }
        if let Some(most) = self.max_error {
            let error = |level| header.error(level).unwrap_or(f64::INFINITY);
            return (0..=full).find(|&level| error(level) <= most).with_context(|| {
                let least = error(full);
                format!(
                    "not even the full level is known to be within {most} of the input, but within {least}; allow more"
                )
            });
        }
        Ok(full)
    }
}

/// Formats that can be written.
fn parse_written(text: &str) -> Result<Format, String> {
    match shared::parse_format(text) {
        Ok(format @ (Format::Obj | Format::Ply | Format::Stl | Format::Glb)) => Ok(format),
        _ => Err("obj, ply, stl and glb can be written".to_string()),
    }
}

/// The format to write.
///
/// # Errors
/// Before any work where nothing names a format that can be written.
fn format(args: &Args) -> Result<Format> {
    if let Some(format) = args.format {
        return Ok(format);
    }
    let path = &args.output;
    if shared::is_dash(path) {
        bail!("standard output: its format is not known; name it with --format, as in --format ply");
    }
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    parse_written(&extension).ok().with_context(|| {
        let what = if extension.is_empty() {
            "a file without extension".into()
        } else {
            format!("the extension .{extension}")
        };
        format!("{}: {what} names no format that can be written; use .obj, .ply, .stl or .glb", path.display())
    })
}

/// The options of the decoder on a machine.
pub fn options(machine: &Machine) -> DecodeOptions {
    DecodeOptions { memory_limit: machine.memory_limit() }
}

pub fn run(args: &Args) -> Result<Outcome> {
    let start = Instant::now();
    let format = format(args)?;
    let to_standard = shared::is_dash(&args.output);
    if to_standard && args.json {
        bail!("--json and -o - cannot both have standard output; leave one out");
    }
    let name = shared::name(&args.input);
    args.machine.run(|threads| {
        let mut stream = Stream::open(&args.input, args.machine.memory_limit())?;
        let level = args.choice.pick(stream.front()).with_context(|| name.clone())?;
        let mut outputs = Outputs::of([(args.input.as_path(), None)]);
        let mut output = if to_standard { outputs.standard()? } else { outputs.create(&args.output)? };
        let bars = Bars::new(!args.json);
        let mut reached = stream.decode(level, options(&args.machine), &bars, |_, _| Ok(()))?;
        let mut warnings = Vec::new();
        if let Some(cut) = reached.cut {
            if args.strict || reached.level.is_none() {
                return Err(cut).context(name.clone());
            }
            warnings.push(cut.to_string());
        }
        let Some(level) = reached.level else { bail!("{name}: no level could be decoded") };
        // An image is as good at any level; what was asked not to be read is not.
        let limit = args.choice.max_bytes.unwrap_or(u64::MAX);
        let missing = stream.pictures(&mut reached.decoder, limit)?;
        let all = missing.all;
        if missing.none > 0 {
            warnings.push(format!("{} of {all} images are not among the bytes read and are left out", missing.none));
        }
        if missing.part > 0 {
            warnings.push(format!("{} of {all} images are there in part and lack detail", missing.part));
        }
        if level == stream.front().full_level() && args.choice.max_bytes.is_none() {
            match stream.check_end() {
                Err(error) if args.strict => return Err(error),
                Err(error) => warnings.push(error.root_cause().to_string()),
                Ok(()) => {}
            }
        }
        let mesh_start = Instant::now();
        let mesh = reached.decoder.to_mesh();
        drop(reached.decoder);
        let decode_time = reached.decode_time + mesh_start.elapsed();
        let write_start = Instant::now();
        let lattice = &stream.front().header().lattice;
        let left_out = output.write_mesh(format, &mesh, Some(lattice))?;
        output.commit()?;
        let write_seconds = shared::seconds(write_start);
        warnings.iter().for_each(|w| shared::warn(format!("{name}: {w}")));
        let target = if to_standard { "standard output".to_string() } else { args.output.display().to_string() };
        left_out.iter().for_each(|w| shared::warn(format!("{target}: {w}")));
        warnings.extend(left_out.iter().map(ToString::to_string));
        let header = stream.front().header();
        let (levels, error) = (header.levels.len(), header.error(level));
        let [read, decode] = [stream.read_time(), decode_time].map(|t| shared::round(t.as_secs_f64()));
        let total = shared::seconds(start);
        if args.json {
            shared::print_json(&json!({
                "level": level,
                "levels": levels,
                "vertices": mesh.vertex_count(),
                "faces": mesh.face_count(),
                "error": error,
                "bytes_read": stream.bytes_read(),
                "seconds": { "read": read, "decode": decode, "write": write_seconds, "total": total, "cpu": shared::cpu_seconds() },
                "peak_memory_bytes": shared::peak_memory(),
                "threads": threads,
                "warnings": warnings,
            }))?;
        } else if !to_standard {
            let within = match error {
                Some(e) if e.is_finite() => format!("at most {e:.6} from the input"),
                _ => "not known".to_string(),
            };
            shared::print(&shared::table(&[
                ("level", format!("{level} of 0 to {}", levels.saturating_sub(1))),
                ("vertices", shared::thousands(mesh.vertex_count() as u64)),
                ("faces", shared::thousands(mesh.face_count() as u64)),
                ("error", within),
                ("read", shared::human_bytes(stream.bytes_read())),
                ("seconds", format!("{total:.2} (read {read:.2}, decode {decode:.2}, write {write_seconds:.2})")),
                ("memory", format!("{} at most", shared::human_bytes(shared::peak_memory()))),
            ]))?;
        }
        Ok(Outcome::Done)
    })
}
