//! The numbers of a report: encode, decode level by level, measure.

use super::Args;
use crate::decode;
use crate::draw::{Looks, Pen, Work};
use crate::encode::stage_name;
use crate::model;
use crate::progress::Bars;
use crate::shared;
use crate::stream::Stream;
use anyhow::{Context, Result, bail};
use lodestream::encode::{self, EncodeOptions, Progress};
use lodestream::lattice::Quantization;
use lodestream::mesh::Mesh;
use lodestream::picture::{Picture, Scene, Shading, View};
use lodestream::quality::{self, Geometry, Sampled, Weights};
use lodestream::read::ReadOptions;
use serde_json::{Value, json};
use std::io::Cursor;
use std::path::Path;
use std::time::Instant;

/// Pixels of a picture's side in the strip.
const STRIP: u32 = 260;

/// A file and its levels.
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
    pub warnings: Vec<String>,
    /// The device that drew the pictures.
    pub drawn_by: String,
}

/// A level and what it is worth.
pub struct Measured {
    pub level: u32,
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

    /// A distance as a part of the diagonal.
    pub fn relative(&self, distance: f64) -> f64 {
        if self.diagonal > 0.0 { distance / self.diagonal } else { 0.0 }
    }
}

/// Encode where need be, decode and measure one file.
pub fn measure(path: &Path, args: &Args, threads: usize, bars: &Bars) -> Result<Subject> {
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
        warnings: Vec::new(),
        drawn_by: String::new(),
    };
    let (source, bytes) = if model::is_lods(path) {
        (model::load(path, None, &args.machine, bars)?.mesh, shared::read_file(path)?)
    } else {
        let clock = Instant::now();
        let options = ReadOptions { memory_limit: args.machine.memory_limit, ..ReadOptions::default() };
        let mesh = shared::read_mesh(path, None, &options)?.mesh;
        let read = shared::seconds(clock);
        let options =
            EncodeOptions { quantization: Quantization::Bits(args.position_bits), ..EncodeOptions::default() };
        let progress = |p: Progress| bars.show(stage_name(p.stage), p.done, p.total);
        let encoded = encode::encode(&mesh, &options, &progress).with_context(|| path.display().to_string())?;
        let (report, bits) = (&encoded.report, &encoded.report.bits);
        subject.kinds = vec![
            ("connectivity", bits.connectivity),
            ("geometry", bits.geometry),
            ("points", bits.points),
            ("aside", bits.aside),
            ("header", bits.header),
        ];
        subject.kinds.retain(|k| k.1 > 0.0);
        subject.stages = vec![
            ("read", read),
            ("weigh", report.weigh_seconds),
            ("select", report.select_seconds),
            ("collapse", report.collapse_seconds),
            ("encode", report.encode_seconds),
        ];
        (mesh, encoded.bytes)
    };
    if source.vertex_count() == 0 {
        bail!("{}: there is nothing to measure: it has no vertices", path.display());
    }
    subject.vertices = source.vertex_count();
    subject.faces = source.face_count();
    subject.bytes = bytes.len() as u64;
    subject.diagonal = quality::diagonal(&source);
    let pictures = (usize::from(args.levels) + 1) * usize::from(args.looks.views);
    let pen = args.device.pen(&Work { pictures, ..args.looks.work(1, subject.faces) }, threads);
    levels(&source, bytes, args, &pen, bars, &mut subject).with_context(|| path.display().to_string())?;
    subject.drawn_by = pen.put_down();
    Ok(subject)
}

fn levels(source: &Mesh, bytes: Vec<u8>, args: &Args, pen: &Pen, bars: &Bars, subject: &mut Subject) -> Result<()> {
    let sampled = Sampled::new(source);
    let options = args.sampling.options();
    let mut looks = (args.looks.views > 0).then(|| Looks::new(source, pen, args.looks.options())).transpose()?;
    subject.warnings = looks.as_ref().map_or_else(Vec::new, |s| s.warnings().to_vec());
    let view = View::front(source);
    let mut stream = Stream::new(subject.name.clone(), Box::new(Cursor::new(bytes)))?;
    let front = stream.front().clone();
    let full = front.full_level();
    let wanted =
        spread(&(0..=full).map(|l| front.prefix_bytes(l).unwrap_or(0)).collect::<Vec<u64>>(), args.levels.into());
    let mut measured = Vec::new();
    let mut measuring = 0.0;
    let quiet = Bars::new(false);
    let clock = Instant::now();
    let reached = stream.decode(full, decode::options(args.machine.memory_limit), &quiet, |level, decoder| {
        if !wanted.contains(&level) {
            return Ok(());
        }
        let mesh = decoder.to_mesh();
        let decode_seconds = clock.elapsed().as_secs_f64() - measuring;
        let pause = Instant::now();
        let other = Sampled::new(&mesh);
        let ms_ssim = looks.as_mut().map(|l| l.compare(&mesh)).transpose()?.map(|look| look.ms_ssim);
        measured.push(Measured {
            level,
            vertices: mesh.vertex_count(),
            faces: mesh.face_count(),
            bytes: front.prefix_bytes(level).unwrap_or(0),
            bound: front.header().error(level).filter(|e| e.is_finite()),
            geometry: quality::geometry_of(&sampled, &other, &options),
            ms_ssim,
            decode_seconds,
            picture: pen.renderer().draw(&Scene::new(&mesh, Shading::Flat), &view, STRIP, STRIP),
        });
        measuring += pause.elapsed().as_secs_f64();
        bars.show("measure", measured.len() as u64, wanted.len() as u64);
        Ok(())
    })?;
    if let Some(cut) = reached.cut {
        return Err(cut.into());
    }
    subject.stages.push(("decode", reached.decode_time.as_secs_f64() - measuring));
    subject.levels = measured;
    Ok(())
}

/// About `count` levels, evenly spread over the orders of their sizes; the finest and the coarsest among them. Levels that come with
/// the same bytes count as the finest of them.
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
            "bits_per_vertex": s.rate(s.bytes),
            "diagonal": s.diagonal,
            "bits_by_kind": pairs(&s.kinds),
            "seconds": pairs(&s.stages),
            "levels": s.levels.iter().map(|l| level(s, l)).collect::<Vec<_>>(),
            "warnings": s.warnings,
            "device": s.drawn_by,
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
