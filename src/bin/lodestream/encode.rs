//! `lodestream encode`: a mesh into a `.lods` file.

use crate::Outcome;
use crate::device::{self, DeviceArgs};
use crate::output::{Output, Outputs};
use crate::progress::Bars;
use crate::shared::{self, Input, Machine};
use anyhow::{Context, Result, bail};
use clap::ValueEnum;
use lodestream::encode::pipeline::Pipeline;
use lodestream::encode::quality_order::{self, Effort, Order, Scheduled};
use lodestream::encode::trace::Trace;
use lodestream::encode::{Control, EncodeOptions, EncodeReport, Encoded, ImageReport, Progress, Stage};
use lodestream::image::jpeg::{Exactness, Treatment, Unsupported};
use lodestream::image::preview::Previews;
use lodestream::image::recompress::{Recompressed, Sampling, Textures};
use lodestream::ingest::{Settings, predicted_peak};
use lodestream::io::read::{DropSet, Invalid, ReadMesh, ReadOptions, Survey};
use lodestream::mesh::NO_VALUE;
use lodestream::mesh::lattice::Quantization;
use lodestream::mesh::quantizer::Precision;
use serde_json::{Value, json};
use std::io::{BufWriter, Write};
use std::path::PathBuf;
use std::time::Instant;

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  lodestream encode bunny.ply -o bunny.lods
  lodestream encode tile_3_4.obj.gz -o tile_3_4.lods --position-step 0.001 --origin 512000,5403000,0 --lock-borders
  lodestream encode model.glb -o model.lods --map model.map --json
  zcat scan.ply.gz | lodestream encode - --format ply -o scan.lods")]
pub struct Args {
    #[command(flatten)]
    input: Input,
    /// The file to write
    #[arg(short, long, value_name = "OUT.lods")]
    output: PathBuf,
    #[command(flatten)]
    lattice: LatticeArgs,
    /// Never move a vertex of a border, so that tiles fit at every level
    #[arg(long)]
    lock_borders: bool,
    #[command(flatten)]
    precision: PrecisionArgs,
    #[command(flatten)]
    images: ImageArgs,
    #[command(flatten)]
    weld: WeldArgs,
    #[command(flatten)]
    reading: ReadingArgs,
    /// Leave out attributes, materials or the bytes of images
    #[arg(long, value_name = "WHAT", value_enum, value_delimiter = ',')]
    drop: Vec<Layer>,
    /// What becomes of vertices that no face or edge uses: keep, or drop; points without any face are always kept
    #[arg(long, value_name = "WHAT", value_enum, default_value = "keep")]
    isolated: Isolated,
    /// Write the new number of each vertex of the input, one per line; - for an invalid one that was dropped, isolated for a dropped
    /// isolated one
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
    /// Write what ran when, as a Chrome trace
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    #[command(flatten)]
    machine: Machine,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// The lattice on which positions are kept.
#[derive(clap::Args)]
pub struct LatticeArgs {
    /// Bits per coordinate along the longest side of the bounding box, 1 to 21 [default: 12]
    #[arg(long, value_name = "BITS", value_parser = clap::value_parser!(u8).range(1..=21), conflicts_with = "position_step")]
    position_bits: Option<u8>,
    /// The distance of lattice points, in the units of the model
    #[arg(long, value_name = "STEP", value_parser = parse_step, allow_negative_numbers = true)]
    position_step: Option<f64>,
    /// A point of the lattice, so that tiles encoded apart share their borders bit for bit
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, requires = "position_step", allow_hyphen_values = true)]
    origin: Option<[f64; 3]>,
}

impl LatticeArgs {
    pub fn quantization(&self) -> Quantization {
        match self.position_step {
            Some(step) => Quantization::Step { step, origin: self.origin },
            None => Quantization::Bits(self.position_bits.unwrap_or(12)),
        }
    }
}

/// How exactly attributes are kept.
#[derive(clap::Args)]
pub struct PrecisionArgs {
    /// Bits of texture coordinates along the longest side of their box, 1 to 24 [default: 12]
    #[arg(long, value_name = "BITS", value_parser = clap::value_parser!(u8).range(1..=24), conflicts_with = "uv_step")]
    uv_bits: Option<u8>,
    /// The distance of neighbouring texture coordinates, as in 0.000244140625 for a texture of 4096 pixels
    #[arg(long, value_name = "STEP", value_parser = parse_step, allow_negative_numbers = true)]
    uv_step: Option<f64>,
    /// Bits of each of the two numbers of a normal or tangent, 2 to 16
    #[arg(long, value_name = "BITS", value_parser = clap::value_parser!(u8).range(2..=16), default_value = "10")]
    normal_bits: u8,
    /// Bits of each component of a colour, 1 to 16
    #[arg(long, value_name = "BITS", value_parser = clap::value_parser!(u8).range(1..=16), default_value = "8")]
    color_bits: u8,
    /// Bits on the range of any other attribute, 1 to 24; whole numbers stay whole
    #[arg(long, value_name = "BITS", value_parser = clap::value_parser!(u8).range(1..=24), default_value = "16")]
    scalar_bits: u8,
}

impl PrecisionArgs {
    pub fn options(&self, quantization: Quantization, lock_borders: bool) -> EncodeOptions {
        let uv = match self.uv_step {
            Some(step) => Precision::Step(step),
            None => Precision::Bits(self.uv_bits.unwrap_or(12)),
        };
        EncodeOptions::default()
            .quantization(quantization)
            .lock_borders(lock_borders)
            .uv(uv)
            .normal_bits(self.normal_bits)
            .color_bits(self.color_bits)
            .scalar_bits(self.scalar_bits)
    }
}

/// How images are carried, and where; of `ingest` and `report` too.
#[derive(clap::Args)]
pub struct ImageArgs {
    /// Give images back byte by byte; otherwise baseline JPEG comes back progressive, with the same pixels and metadata
    #[arg(long)]
    exact_images: bool,
    /// What comes first in a file, behind the coarsest level and the coarsest previews: mesh-first, texture-first, linear (both in turns), or
    /// quality, which looks at pictures of the model and finds the order in which every prefix of the file looks best
    #[arg(long, value_name = "ORDER", default_value_t)]
    pub schedule: Order,
    /// How closely the order by quality looks: low, normal or high (6, 12 or 42 views)
    #[arg(long, value_name = "EFFORT", default_value_t)]
    pub schedule_effort: Effort,
    /// What becomes of images that are no JPEG: keep, byte by byte; jpeg, which is much smaller and not exact, at a quality that looks the
    /// same; or jpeg:QUALITY, as in jpeg:90 [default: jpeg; keep with --exact-images]
    #[arg(long, value_name = "WHAT")]
    pub texture: Option<Textures>,
    /// Small pictures that stand in for images until their first piece is there: auto, for images that are large enough, or none
    #[arg(long, value_name = "WHICH", default_value_t)]
    pub previews: Previews,
}

impl ImageArgs {
    /// What becomes of images that are no JPEG.
    pub fn texture(&self) -> Textures {
        self.texture.unwrap_or(Textures::beside(self.exactness()))
    }

    /// What comes back of images.
    pub fn exactness(&self) -> Exactness {
        if self.exact_images { Exactness::Bytes } else { Exactness::Coefficients }
    }

    /// The way from a mesh to its file, with these options for the mesh.
    pub fn pipeline(&self, mut options: EncodeOptions, memory_limit: u64) -> Pipeline {
        options.images = self.exactness();
        if let Order::Fixed(schedule) = self.schedule {
            options.schedule = schedule;
        }
        let looks = quality_order::Options {
            effort: self.schedule_effort,
            // The file is our own: what it takes has been there before.
            memory_limit,
            ..quality_order::Options::default()
        };
        Pipeline { encode: options, textures: self.texture(), previews: self.previews, order: self.schedule, looks }
    }

    /// Whether a finished file is to be put in the order by quality.
    pub fn by_quality(&self) -> bool {
        self.schedule == Order::Quality
    }
}

/// Put a finished file in the order by quality, where that is asked for.
pub fn arrange(pipeline: &Pipeline, encoded: &mut Encoded, bars: &Bars) -> Result<Option<Ordered>> {
    let clock = Instant::now();
    let show = |drawn: usize, all: usize| bars.show("order", drawn as u64, all as u64);
    let scheduled = pipeline.arrange(encoded, None, &show)?;
    Ok(scheduled.map(|scheduled| Ordered { scheduled, seconds: shared::seconds(clock) }))
}

/// What the order by quality came to; the file itself has been taken.
pub struct Ordered {
    scheduled: Scheduled,
    seconds: f64,
}

impl Ordered {
    /// Bytes until pictures of the file are so like those of the whole.
    fn bytes_until(&self, quality: f64) -> u64 {
        let curve = &self.scheduled.curve;
        curve.iter().find(|p| p.quality >= quality).or(curve.last()).map_or(0, |p| p.bytes)
    }

    fn json(&self) -> Value {
        let Scheduled { curve, drawn, areas, .. } = &self.scheduled;
        json!({
            "seconds": self.seconds,
            "drawn": drawn,
            "curve": curve.iter().map(|p| json!({
                "bytes": p.bytes, "level": p.level, "pieces": p.pieces, "previews": p.previews, "ms_ssim": p.quality,
            })).collect::<Vec<_>>(),
            "areas": {
                "quality": areas.chosen, "greedy": areas.greedy, "mesh_first": areas.mesh_first,
                "texture_first": areas.texture_first, "linear": areas.linear,
            },
        })
    }

    fn summary(&self) -> String {
        if self.scheduled.drawn == 0 {
            return "as it was: no image that is drawn".to_string();
        }
        let [fair, good] = [0.95, 0.99].map(|q| shared::human_bytes(self.bytes_until(q)));
        format!("by quality: MS-SSIM 0.95 after {fair}, 0.99 after {good} ({:.1} s)", self.seconds)
    }
}

/// Whether vertices at bit-equal positions are joined.
#[derive(clap::Args)]
pub struct WeldArgs {
    /// Join vertices at bit-equal positions, whatever the format
    #[arg(long, conflicts_with = "no_weld")]
    weld: bool,
    /// Never join vertices [default: join in STL, glTF, and PLY with texture coordinates per vertex]
    #[arg(long)]
    no_weld: bool,
}

impl WeldArgs {
    pub fn choice(&self) -> Option<bool> {
        match (self.weld, self.no_weld) {
            (true, _) => Some(true),
            (_, true) => Some(false),
            _ => None,
        }
    }
}

/// How strict reading is.
#[derive(clap::Args)]
pub struct ReadingArgs {
    /// What becomes of vertices with a coordinate that is NaN or infinite: an error, or dropped with the faces that use them
    #[arg(long, value_name = "WHAT", value_enum, default_value = "error")]
    invalid: InvalidArg,
    /// Take a file without any vertex for a mesh
    #[arg(long)]
    pub allow_empty: bool,
    /// The folder in which textures, libraries and buffers that a mesh names have to lie, in a store the first part of their keys [default: that of the mesh]
    #[arg(long, value_name = "FOLDER")]
    pub asset_root: Option<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum InvalidArg {
    Drop,
    Error,
}

impl ReadingArgs {
    pub fn invalid(&self) -> Invalid {
        match self.invalid {
            InvalidArg::Drop => Invalid::Drop,
            InvalidArg::Error => Invalid::Error,
        }
    }
}

/// What becomes of vertices that no element uses.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Isolated {
    Keep,
    Drop,
}

/// Leave out the vertices of a mesh that no element uses; how many they are.
fn drop_isolated(read: &mut ReadMesh) -> usize {
    let number = read.mesh.drop_isolated();
    for v in read.map.iter_mut().filter(|v| **v != NO_VALUE) {
        *v = number.get(*v as usize).copied().flatten().unwrap_or(NO_VERTEX);
    }
    number.iter().filter(|n| n.is_none()).count()
}

/// See that encoding a mesh stays within the limit, before anything is spent on it.
fn foresee(args: &Args, read: &ReadMesh, options: &EncodeOptions) -> Result<()> {
    let settings = Settings {
        encode: options.clone(),
        textures: args.images.texture(),
        previews: args.images.previews,
        by_quality: args.images.by_quality(),
        effort: args.images.schedule_effort,
        ..Settings::default()
    };
    let survey = Survey::of_mesh(&read.mesh, read.map.len() as u64);
    let needs = predicted_peak(&survey, 0, Default::default(), &settings, false);
    let limit = args.machine.memory_limit();
    if needs > limit {
        let [needs, limit] = [needs, limit].map(shared::human_bytes);
        bail!(
            "encoding it takes about {needs} of memory, and {limit} are allowed; raise --memory-limit or cut the mesh into tiles"
        );
    }
    Ok(())
}

/// What `--drop` can name.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Layer {
    All,
    Normals,
    Colors,
    Uvs,
    Images,
    Materials,
    Tangents,
    Scalars,
}

/// What the reader leaves out.
fn drop_set(what: &[Layer]) -> DropSet {
    let mut set = DropSet::NONE;
    for layer in what {
        match layer {
            Layer::All => set = DropSet::ALL,
            Layer::Normals => set.normals = true,
            Layer::Colors => set.colors = true,
            Layer::Uvs => set.uvs = true,
            Layer::Images => set.images = true,
            Layer::Materials => set.materials = true,
            Layer::Tangents => set.tangents = true,
            Layer::Scalars => set.scalars = true,
        }
    }
    set
}

fn parse_step(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(step) if step > 0.0 && step.is_finite() => Ok(step),
        _ => Err("a step is a positive number, as in 0.001".to_string()),
    }
}

fn parse_point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|c| c.trim().parse::<f64>()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, z]) if [x, y, z].iter().all(|c| c.is_finite()) => Ok([x, y, z]),
        _ => Err("three numbers, as in 512000,5403000,0".to_string()),
    }
}

/// The name of a stage on the progress bar.
pub fn stage_name(stage: Stage) -> &'static str {
    match stage {
        Stage::Simplify => "simplify",
        Stage::Encode => "encode",
    }
}

pub fn run(args: &Args) -> Result<Outcome> {
    let start = Instant::now();
    let mut outputs =
        Outputs::with_assets([(args.input.path.as_path(), args.input.format)], args.reading.asset_root.as_deref());
    let output = outputs.create(&args.output)?;
    let map = args.map.as_deref().map(|path| outputs.create(path)).transpose()?;
    let trace_file = args.trace.as_deref().map(|path| outputs.create(path)).transpose()?;
    let bars = Bars::new(!args.json);
    let options = args.precision.options(args.lattice.quantization(), args.lock_borders);
    let pipeline = args.images.pipeline(options, args.machine.memory_limit());
    let name = shared::name(&args.input.path);
    args.machine.run(|threads| {
        let read_options = ReadOptions {
            weld: args.weld.choice(),
            memory_limit: Some(args.machine.memory_limit()),
            drop: drop_set(&args.drop),
            allow_empty: args.reading.allow_empty,
            invalid: args.reading.invalid(),
            asset_root: args.reading.asset_root.clone(),
        };
        let mut read = args.input.read(&read_options)?;
        let read_seconds = shared::seconds(start);
        let mut warnings: Vec<String> = read.warnings.iter().map(ToString::to_string).collect();
        warnings.iter().for_each(|w| shared::warn(format!("{name}: {w}")));
        let dropped = if args.isolated == Isolated::Drop { drop_isolated(&mut read) } else { 0 };
        if dropped > 0 {
            shared::warn(format!("{name}: {dropped} vertices that nothing uses are left out"));
        }
        foresee(args, &read, &pipeline.encode).with_context(|| name.clone())?;
        let recompressed = pipeline.prepare(&mut read.mesh.appearance);
        // Who asked for JPEG learns what is none; who did not, what is.
        let asked = args.images.texture.is_some();
        for image in recompressed.iter().filter(|i| i.outcome.is_err() == asked) {
            let exact = if asked { "" } else { "; --texture keep carries it as it is" };
            shared::warn(format!("{name}: {image}{exact}"));
        }
        let progress = |p: Progress| bars.show(stage_name(p.stage), p.done, p.total);
        let trace = if args.trace.is_some() { Trace::on() } else { Trace::off() };
        let engine = args.device.engine(read.mesh.vertex_count(), threads, &trace);
        let mut encoded = pipeline
            .encode(&read.mesh, engine, None, Control::new().progress(&progress))
            .with_context(|| name.clone())?;
        let ordered = arrange(&pipeline, &mut encoded, &bars).with_context(|| name.clone())?;
        bars.finish();
        if let Some(why) = &encoded.report.fallback {
            device::fell_back(why);
        }
        let losses: Vec<String> = encoded.report.loss.warnings().iter().map(ToString::to_string).collect();
        losses.iter().for_each(|w| shared::warn(format!("{name}: {w}")));
        warnings.extend(losses);
        for image in &encoded.report.images {
            // A PNG is none for a reason that nobody needs to be told.
            if let Treatment::Kept(odd) = image.way
                && odd != Unsupported::NO_JPEG
            {
                shared::warn(format!("{name}: {}: kept as it is: {odd}", image.name));
            }
        }
        if let Some(file) = &trace_file {
            file.write(|out| out.write_all(trace.to_json().as_bytes()))?;
        }
        let write_start = Instant::now();
        output.write(|out| out.write_all(&encoded.bytes))?;
        if let Some(map) = &map {
            map.write(|out| write_map(out, &read, &encoded))?;
        }
        output.commit()?;
        map.map_or(Ok(()), Output::commit)?;
        trace_file.map_or(Ok(()), Output::commit)?;
        let seconds = [read_seconds, shared::seconds(write_start), shared::seconds(start)];
        if args.json {
            let mut object = account(&encoded, seconds);
            object["recompressed"] = recompressed.iter().map(recompressed_json).collect();
            object["device"] = json!(encoded.report.weighed_by);
            object["threads"] = json!(threads);
            object["seconds"]["cpu"] = json!(shared::cpu_seconds());
            object["peak_memory_bytes"] = json!(shared::peak_memory());
            object["warnings"] = json!(warnings);
            object["schedule"] = json!(ordered.as_ref().map(Ordered::json));
            shared::print_json(&object)?;
        } else {
            let order = ordered.as_ref().map(Ordered::summary);
            let bytes = encoded.bytes.len() as u64;
            shared::print(&summary(&encoded.report, &recompressed, bytes, order, seconds))?;
        }
        Ok(Outcome::Done)
    })
}

/// Instead of a vertex: an isolated one that was left out.
pub const NO_VERTEX: u32 = u32::MAX - 1;

/// The same in a map.
pub const ISOLATED: &str = "isolated";

/// One line per vertex record of the input: the vertex it has become.
fn write_map(out: &mut dyn Write, read: &ReadMesh, encoded: &Encoded) -> std::io::Result<()> {
    let mut out = BufWriter::new(out);
    for &vertex in &read.map {
        if vertex == NO_VALUE {
            // Left out for its place, which was none.
            writeln!(out, "-")?;
            continue;
        }
        match encoded.map.get(vertex as usize) {
            None if vertex == NO_VERTEX => writeln!(out, "{ISOLATED}")?,
            Some(new) => writeln!(out, "{new}")?,
            None => return Err(std::io::Error::other("the reader and the encoder disagree on the vertices")),
        }
    }
    out.flush()
}

/// The JSON account of an encoding, machine fields left out; `seconds`: read, write, total.
fn account(encoded: &Encoded, seconds: [f64; 3]) -> Value {
    let (report, bytes) = (&encoded.report, encoded.bytes.len());
    let kind = |bits: f64| (bits / 8.0 * 1000.0).round() / 1000.0;
    json!({
        "vertices": report.vertices,
        "faces": report.faces,
        "components": report.components,
        "bytes": bytes,
        "bits_per_vertex": bits_per_vertex(bytes as u64, report.vertices),
        "bytes_by_kind": {
            "connectivity": kind(report.bits.connectivity),
            "geometry": kind(report.bits.geometry),
            "header": kind(report.bits.header),
            "points": kind(report.bits.points),
            "degenerate": kind(report.bits.degenerate),
            "attributes": kind(report.bits.attributes),
            "appearance": kind(report.bits.appearance),
            "images": kind(report.bits.images),
            "previews": kind(report.bits.previews),
        },
        "images": report.images.iter().map(|i| json!({
            "name": i.name,
            "bytes": i.bytes,
            "stored": i.stored,
            "pieces": i.pieces,
            "previews": i.previews,
            "way": way(i.way),
            "reason": match i.way { Treatment::Kept(odd) => Some(odd.to_string()), _ => None },
        })).collect::<Vec<_>>(),
        "levels": report.levels,
        "lattice_step": report.loss.step,
        "largest_shift": report.loss.shift,
        "merged_places": report.loss.merged,
        "edges_weighed": report.edges_weighed,
        "seconds": {
            "read": seconds[0],
            "weigh": shared::round(report.weigh_seconds),
            "select": shared::round(report.select_seconds),
            "collapse": shared::round(report.collapse_seconds),
            "encode": shared::round(report.encode_seconds),
            "write": seconds[1],
            "total": seconds[2],
        },
    })
}

/// One word for what was done with an image.
fn way(way: Treatment) -> &'static str {
    match way {
        Treatment::Kept(_) => "kept",
        Treatment::Cut => "cut",
        Treatment::Transcoded => "transcoded",
    }
}

/// What was done with the images, in a few words; why a JPEG stayed as it is.
fn image_summary(images: &[ImageReport]) -> String {
    let count = |word| images.iter().filter(|i| way(i.way) == word).count();
    let sum = |of: fn(&ImageReport) -> u64| shared::human_bytes(images.iter().map(of).sum());
    let done: Vec<String> = [
        (count("transcoded"), "made progressive without loss"),
        (count("cut"), "progressive already"),
        (count("kept"), "kept as they are"),
    ]
    .iter()
    .filter(|(n, _)| *n > 0)
    .map(|(n, what)| format!("{n} {what}"))
    .collect();
    format!("{} from {} ({})", sum(|i| i.stored), sum(|i| i.bytes), done.join(", "))
}

/// Bits per vertex; `None` without vertices.
pub fn bits_per_vertex(bytes: u64, vertices: usize) -> Option<f64> {
    (vertices > 0).then(|| (8e4 * bytes as f64 / vertices as f64).round() / 1e4)
}

fn recompressed_json(image: &Recompressed) -> Value {
    json!({
        "name": image.name,
        "bytes": image.from,
        "jpeg_bytes": image.outcome.is_ok().then_some(image.to),
        "sampling": image.outcome.ok().map(|sampling| match sampling {
            Sampling::Grey => "grey",
            Sampling::Halved => "4:2:0",
            Sampling::Sharp | Sampling::Full => "4:4:4",
        }),
        "kept_because": image.outcome.err().map(|odd| odd.to_string()),
    })
}

/// Which images are not what they were.
fn recompressed_summary(images: &[Recompressed]) -> Option<String> {
    let done: Vec<&Recompressed> = images.iter().filter(|i| i.outcome.is_ok()).collect();
    let sum = |of: fn(&Recompressed) -> u64| shared::human_bytes(done.iter().map(|i| of(i)).sum());
    let (count, all) = (done.len(), images.len());
    (all > 0).then(|| {
        format!("{count} of {all} that were no JPEG are one now, not exact: {} from {}", sum(|i| i.to), sum(|i| i.from))
    })
}

fn summary(
    report: &EncodeReport,
    recompressed: &[Recompressed],
    bytes: u64,
    order: Option<String>,
    [read, write, total]: [f64; 3],
) -> String {
    let rate = bits_per_vertex(bytes, report.vertices).map_or(String::new(), |b| format!(" ({b:.2} bits per vertex)"));
    let speed = if total > 0.0 { report.vertices as f64 / total } else { 0.0 };
    let kinds = [
        ("connectivity", report.bits.connectivity),
        ("geometry", report.bits.geometry),
        ("points", report.bits.points),
        ("degenerate", report.bits.degenerate),
        ("attributes", report.bits.attributes),
        ("materials", report.bits.appearance),
        ("images", report.bits.images),
        ("previews", report.bits.previews),
        ("header", report.bits.header),
    ];
    let kinds: Vec<String> = kinds
        .iter()
        .filter(|(_, bits)| *bits > 0.0)
        .map(|(kind, bits)| format!("{kind} {}", shared::human_bytes((bits / 8.0).round() as u64)))
        .collect();
    let mut rows = vec![
        ("vertices", shared::thousands(report.vertices as u64)),
        ("faces", shared::thousands(report.faces as u64)),
        ("components", shared::thousands(report.components as u64)),
        ("levels", report.levels.to_string()),
        ("shift", format!("at most {:.3e}, on a lattice of step {:.3e}", report.loss.shift, report.loss.step)),
        ("size", format!("{}{rate}", shared::human_bytes(bytes))),
        ("  of it", kinds.join(", ")),
    ];
    if !report.images.is_empty() {
        rows.push(("  images", image_summary(&report.images)));
    }
    if let Some(summary) = recompressed_summary(recompressed) {
        rows.push(("  lossy", summary));
    }
    rows.extend(order.map(|order| ("order", order)));
    rows.extend([
        (
            "seconds",
            format!(
                "{total:.2} (read {read:.2}, weigh {:.2}, select {:.2}, collapse {:.2}, encode {:.2}, write {write:.2}), {} vertices/s",
                report.weigh_seconds,
                report.select_seconds,
                report.collapse_seconds,
                report.encode_seconds,
                shared::thousands(speed as u64)
            ),
        ),
        ("memory", format!("{} at most", shared::human_bytes(shared::peak_memory()))),
    ]);
    shared::table(&rows)
}
