//! The numbers of a report: encode, decode prefix by prefix, measure.

use super::Args;
use crate::decode::{self, Choice};
use crate::encode::{arrange, stage_name};
use crate::model;
use crate::progress::Bars;
use crate::shared;
use anyhow::{Context, Result, bail};
use lodestream::encode::cost::Engine;
use lodestream::encode::{Control, EncodeOptions, Progress};
use lodestream::format::container::{ChunkInfo, FileIndex, Kind, Parsed};
use lodestream::format::decoder::{Decoder, Step};
use lodestream::io::read::{Invalid, ReadOptions};
use lodestream::mesh::Mesh;
use lodestream::mesh::lattice::Quantization;
use lodestream::quality::picture::{Picture, Scene, Shading, View, draw};
use lodestream::quality::{self, Geometry, Sampled, Snapshots, Weights};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;

/// Pixels of a picture's side in the strip.
const STRIP: u32 = 260;

/// A file and its prefixes.
pub struct Subject {
    pub name: String,
    pub vertices: usize,
    pub faces: usize,
    pub bytes: u64,
    pub diagonal: f64,
    /// Bits of the whole file by kind; empty where the file was there already.
    pub kinds: Vec<(&'static str, f64)>,
    /// Seconds by stage.
    pub stages: Vec<(&'static str, f64)>,
    pub levels: Vec<Measured>,
    /// Bytes of images in the whole file.
    pub images: u64,
    pub warnings: Vec<String>,
}

/// A prefix, that ends with a level or a piece of an image, and what it is worth.
pub struct Measured {
    /// The finest level that is whole.
    pub level: u32,
    /// Bytes of images that are there.
    pub images: u64,
    pub vertices: usize,
    pub faces: usize,
    pub bytes: u64,
    pub bound: Option<f64>,
    pub geometry: Geometry,
    pub ms_ssim: Option<f64>,
    pub decode_seconds: f64,
    pub picture: Picture,
}

impl Subject {
    /// Bits for each vertex of the full mesh.
    pub fn rate(&self, bytes: u64) -> f64 {
        bytes as f64 * 8.0 / self.vertices.max(1) as f64
    }

    /// A distance as a part of the diagonal. What rounding leaves of none is none.
    pub fn relative(&self, distance: f64) -> f64 {
        let part = if self.diagonal > 0.0 { distance / self.diagonal } else { 0.0 };
        if part < 1e-13 { 0.0 } else { part }
    }
}

/// Encode where need be, decode and measure one file.
pub fn measure(path: &Path, args: &Args, bars: &Bars) -> Result<Subject> {
    let name = path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned());
    let mut subject = Subject {
        name,
        vertices: 0,
        faces: 0,
        bytes: 0,
        diagonal: 0.0,
        kinds: Vec::new(),
        stages: Vec::new(),
        levels: Vec::new(),
        images: 0,
        warnings: Vec::new(),
    };
    let (source, bytes) = if model::is_lods(path) {
        (model::load(path, &Choice::default(), &args.machine, bars)?.mesh, shared::read_file(path)?)
    } else {
        let clock = Instant::now();
        let (memory_limit, invalid) = (Some(args.machine.memory_limit()), Invalid::Drop);
        let options = ReadOptions { memory_limit, invalid, ..ReadOptions::default() };
        let mesh = shared::read_mesh(path, None, &options)?.mesh;
        let read = shared::seconds(clock);
        let options = EncodeOptions::default().quantization(Quantization::Bits(args.position_bits));
        let pipeline = args.images.pipeline(options, args.machine.memory_limit());
        // What goes in loses nothing: the source stays what it was.
        let mut changed = mesh.clone();
        for image in pipeline.prepare(&mut changed.appearance) {
            subject.warnings.push(image.to_string());
        }
        let progress = |p: Progress| bars.show(stage_name(p.stage), p.done, p.total);
        let mut encoded = pipeline
            .encode(&changed, Engine::default(), None, Control::new().progress(&progress))
            .with_context(|| path.display().to_string())?;
        drop(changed);
        let clock = Instant::now();
        arrange(&pipeline, &mut encoded, bars).with_context(|| path.display().to_string())?;
        let order = shared::seconds(clock);
        let (report, bits) = (&encoded.report, &encoded.report.bits);
        subject.kinds = vec![
            ("connectivity", bits.connectivity),
            ("geometry", bits.geometry),
            ("points", bits.points),
            ("degenerate", bits.degenerate),
            ("attributes", bits.attributes),
            ("materials", bits.appearance),
            ("images", bits.images),
            ("header", bits.header),
        ];
        subject.kinds.retain(|k| k.1 > 0.0);
        subject.stages = vec![
            ("read", read),
            ("weigh", report.weigh_seconds),
            ("select", report.select_seconds),
            ("collapse", report.collapse_seconds),
            ("encode", report.encode_seconds),
            ("order", order),
        ];
        subject.stages.retain(|s| s.0 != "order" || args.images.by_quality());
        (mesh, encoded.bytes)
    };
    if source.vertex_count() == 0 {
        bail!("{}: there is nothing to measure: it has no vertices", path.display());
    }
    subject.vertices = source.vertex_count();
    subject.faces = source.face_count();
    subject.bytes = bytes.len() as u64;
    subject.diagonal = quality::diagonal(&source);
    levels(&source, bytes, args, bars, &mut subject).with_context(|| path.display().to_string())?;
    Ok(subject)
}

fn levels(source: &Mesh, bytes: Vec<u8>, args: &Args, bars: &Bars, subject: &mut Subject) -> Result<()> {
    let sampled = Sampled::new(source);
    let options = args.sampling.options();
    let looks = (args.looks.views > 0).then(|| Snapshots::new(source, &args.looks.options())).transpose()?;
    subject.warnings.extend(looks.as_ref().map_or_else(Vec::new, |s| s.warnings().to_vec()));
    let view = View::front(source);
    let front = match FileIndex::parse(&bytes)? {
        Parsed::Ready(front) => front,
        Parsed::NeedBytes(_) => bail!("the front of the file is not whole"),
    };
    let stops = stops(&front, args.levels.into());
    let mut decoder = Decoder::new(decode::options(&args.machine));
    let (mut given, mut decoding) = (0, 0.0);
    let mut geometry: Option<(u32, Geometry)> = None;
    for &stop in &stops {
        let clock = Instant::now();
        let end = usize::try_from(stop)?.min(bytes.len());
        decoder.push(&bytes[given..end]);
        given = end;
        while let Step::Level(_) = decoder.next_level()? {}
        if stop == front.total_bytes() {
            decoder.finish()?;
        }
        let Some(level) = decoder.level() else { bail!("the coarsest level is not whole after {stop} bytes") };
        let mesh = decoder.to_mesh();
        decoding += clock.elapsed().as_secs_f64();
        // Pieces of images leave the shape as it is.
        let measured = match geometry {
            Some((same, known)) if same == level => known,
            _ => quality::geometry_of(&sampled, &Sampled::new(&mesh), &options),
        };
        geometry = Some((level, measured));
        let ms_ssim = looks.as_ref().map(|l| l.compare(&mesh)).transpose()?.map(|look| look.ms_ssim);
        subject.levels.push(Measured {
            level,
            images: chunks_until(&front, stop).filter(|c| c.kind == Kind::Image).map(|c| c.length).sum(),
            vertices: mesh.vertex_count(),
            faces: mesh.face_count(),
            bytes: stop,
            bound: front.header().error(level).filter(|e| e.is_finite()),
            geometry: measured,
            ms_ssim,
            decode_seconds: decoding,
            picture: draw(&Scene::new(&mesh, Shading::Flat), &view, STRIP, STRIP),
        });
        bars.show("measure", subject.levels.len() as u64, stops.len() as u64);
    }
    subject.images = front.chunks().iter().filter(|c| c.kind == Kind::Image).map(|c| c.length).sum();
    subject.stages.push(("decode", decoding));
    Ok(())
}

/// The chunks that are whole after so many bytes.
fn chunks_until(front: &FileIndex, bytes: u64) -> impl Iterator<Item = &ChunkInfo> {
    front.chunks().iter().take(front.whole_chunks(bytes))
}

/// About `count` prefixes, evenly spread over the orders of their sizes; the first that shows something and the whole file among them. Each ends
/// with a level or with an image that is better than before.
fn stops(front: &FileIndex, count: usize) -> Vec<u64> {
    let Some(first) = front.prefix_bytes(0) else { return Vec::new() };
    let levels = (0..=front.full_level()).filter_map(|l| front.prefix_bytes(l));
    let pictures = front.chunks().iter().filter(|c| matches!(c.kind, Kind::Image | Kind::Preview)).map(ChunkInfo::end);
    let mut ends: Vec<u64> = levels.chain(pictures).filter(|&end| end >= first).collect();
    ends.push(front.total_bytes());
    ends.sort_unstable();
    ends.dedup();
    spread(&ends, count).into_iter().map(|i| ends[i as usize]).collect()
}

/// About `count` of these sizes, by their numbers, evenly spread over the orders of size; the largest and the smallest among them. Equal
/// ones count as the last of them.
fn spread(bytes: &[u64], count: usize) -> Vec<u32> {
    let mut candidates: Vec<usize> = (0..bytes.len()).filter(|&l| bytes.get(l + 1) != Some(&bytes[l])).collect();
    let (Some(&first), Some(&last)) = (candidates.first(), candidates.last()) else { return Vec::new() };
    if candidates.len() > count {
        let log = |l: usize| (bytes[l].max(1) as f64).ln();
        let steps = (count.max(2) - 1) as f64;
        let near = |k: usize| {
            let at = log(first) + (log(last) - log(first)) * k as f64 / steps;
            candidates.iter().copied().min_by(|&a, &b| (log(a) - at).abs().total_cmp(&(log(b) - at).abs()))
        };
        let mut chosen: Vec<usize> = (0..count.max(2)).filter_map(near).collect();
        chosen.dedup();
        candidates = chosen;
    }
    candidates.into_iter().map(|l| l as u32).collect()
}

/// All numbers of the report.
pub fn json(subjects: &[Subject], args: &Args, threads: usize) -> Value {
    let options = args.sampling.options();
    let level = |s: &Subject, l: &Measured| {
        json!({
            "level": l.level,
            "image_bytes": l.images,
            "vertices": l.vertices,
            "faces": l.faces,
            "bytes": l.bytes,
            "bits_per_vertex": s.rate(l.bytes),
            "bound": l.bound,
            "mean": l.geometry.mean(),
            "rms": l.geometry.rms(),
            "max": l.geometry.max(),
            "relative": {
                "mean": s.relative(l.geometry.mean()),
                "rms": s.relative(l.geometry.rms()),
                "max": s.relative(l.geometry.max()),
            },
            "ms_ssim": l.ms_ssim,
            "decode_seconds": shared::round(l.decode_seconds),
        })
    };
    let file = |s: &Subject| {
        let pairs = |list: &[(&'static str, f64)]| -> serde_json::Map<String, Value> {
            list.iter().map(|(name, value)| (name.to_string(), json!(shared::round(*value)))).collect()
        };
        json!({
            "name": s.name,
            "vertices": s.vertices,
            "faces": s.faces,
            "bytes": s.bytes,
            "image_bytes": s.images,
            "bits_per_vertex": s.rate(s.bytes),
            "diagonal": s.diagonal,
            "bits_by_kind": pairs(&s.kinds),
            "seconds": pairs(&s.stages),
            "levels": s.levels.iter().map(|l| level(s, l)).collect::<Vec<_>>(),
            "warnings": s.warnings,
        })
    };
    json!({
        "files": subjects.iter().map(file).collect::<Vec<_>>(),
        "sampling": {
            "samples": options.samples,
            "weights": match options.weights { Weights::Area => "area", Weights::Samples => "samples" },
        },
        "views": { "count": args.looks.views, "size": args.looks.size },
        "position_bits": args.position_bits,
        "threads": threads,
    })
}

#[cfg(test)]
mod tests {
    use super::spread;

    #[test]
    fn levels_are_spread_over_the_orders_of_size() {
        let bytes: Vec<u64> = (0..40).map(|l| 100 + (1.3f64.powi(l)) as u64 * 10).collect();
        let chosen = spread(&bytes, 6);
        assert!(chosen.len() <= 6 && chosen.len() >= 4, "{chosen:?}");
        assert_eq!(chosen.last(), Some(&39));
        assert!(chosen.is_sorted());
        assert_eq!(spread(&[5, 5, 5, 9], 14), [2, 3]);
        assert_eq!(spread(&[7], 14), [0]);
        assert_eq!(spread(&[], 14), Vec::<u32>::new());
    }
}
