//! `lodestream info`: what a `.lods` file holds, from its front alone.

use crate::Outcome;
use crate::shared;
use crate::stream::Stream;
use anyhow::Result;
use lodestream::format::container::{ChunkInfo, FileIndex, Kind};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::PathBuf;

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  lodestream info bunny.lods
  lodestream info bunny.lods --chunks
  lodestream info bunny.lods --json")]
pub struct Args {
    /// The .lods file; - for standard input. Only its front is read
    #[arg(value_name = "IN.lods")]
    input: PathBuf,
    /// List the chunks too
    #[arg(long)]
    chunks: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// The kinds that `bytes_by_kind` of a level counts, under these names.
fn kind_name(kind: Kind) -> &'static str {
    match kind {
        Kind::Base => "base",
        Kind::Levels => "levels",
        Kind::Segment => "segment",
        Kind::Degenerate => "degenerate",
        Kind::ExtraAttributes => "extra",
        Kind::Appearance => "appearance",
        Kind::Image => "image",
        Kind::Reconstruction => "reconstruction",
        Kind::Preview => "preview",
        _ => "other",
    }
}

/// The bytes that come with a level, by kind of chunk. A chunk of several levels counts for the first of them.
fn bytes_by_kind(front: &FileIndex, level: u32) -> Vec<(&'static str, u64)> {
    let mut sums: Vec<(&'static str, u64)> = Vec::new();
    for chunk in front.chunks().iter().filter(|c| c.first_level == level) {
        let name = kind_name(chunk.kind);
        match sums.iter_mut().find(|(other, _)| *other == name) {
            Some((_, sum)) => *sum += chunk.length,
            None => sums.push((name, chunk.length)),
        }
    }
    sums
}

pub fn run(args: &Args) -> Result<Outcome> {
    let stream = Stream::open(&args.input, lodestream::ingest::default_memory())?;
    if args.json {
        shared::print_json(&object(&stream))?;
    } else {
        shared::print(&text(&stream, args.chunks))?;
    }
    Ok(Outcome::Done)
}

fn object(stream: &Stream) -> Value {
    let front = stream.front();
    let header = front.header();
    let levels: Vec<Value> = (0..=header.full_level())
        .map(|level| {
            let kinds: serde_json::Map<String, Value> =
                bytes_by_kind(front, level).into_iter().map(|(name, sum)| (name.to_string(), json!(sum))).collect();
            json!({
                "level": level,
                "vertices": stream.vertices(level),
                "faces": stream.faces(level),
                "prefix_bytes": front.prefix_bytes(level),
                "bytes_by_kind": kinds,
                "shift": header.levels.get(level as usize).map(|row| row.shift),
                "error": header.error(level),
            })
        })
        .collect();
    let chunk = |c: &ChunkInfo| {
        json!({
            "kind": c.kind.to_string(),
            "first_level": c.first_level,
            "last_level": c.last_level,
            "segment": c.segment,
            "segments": c.segments,
            "image": matches!(c.kind, Kind::Image | Kind::Reconstruction).then_some(c.image),
            "offset": c.offset,
            "length": c.length,
            "checksum": format!("{:08x}", c.checksum),
            "memory": c.memory,
        })
    };
    json!({
        "version": lodestream::format::container::VERSION,
        "vertices": header.vertices(),
        "faces": header.elements(),
        "corners": header.corners(),
        "components": header.components,
        "bytes": front.total_bytes(),
        "front_bytes": front.length(),
        "memory_bytes": front.memory(header.full_level()),
        "quantization": { "origin": header.lattice.origin, "step": header.lattice.step, "bits": header.position_bits },
        "bounds": header.bounds.map(|b| b.map(|q| header.lattice.point(q))),
        "levels": levels,
        "chunks": front.chunks().iter().map(chunk).collect::<Vec<_>>(),
    })
}

fn text(stream: &Stream, chunks: bool) -> String {
    let front = stream.front();
    let header = front.header();
    let [x, y, z] = header.lattice.origin;
    let chosen = header.position_bits.map_or(String::new(), |bits| format!(" ({bits} bits)"));
    let mut out = shared::table(&[
        ("format", format!(".lods version {}", lodestream::format::container::VERSION)),
        ("vertices", shared::thousands(u64::from(header.vertices()))),
        ("faces", shared::thousands(u64::from(header.elements()))),
        ("components", shared::thousands(u64::from(header.components))),
        ("size", shared::human_bytes(front.total_bytes())),
        ("lattice", format!("step {}{chosen}, origin {x}, {y}, {z}", header.lattice.step)),
        ("chunks", format!("{}, after {} bytes of header and tables", front.chunks().len(), front.length())),
    ]);
    // Writing into a string cannot fail.
    let _ = writeln!(
        out,
        "\n{:>5} {:>12} {:>12} {:>14} {:>12}  bytes by kind",
        "level", "vertices", "faces", "prefix bytes", "error"
    );
    for level in 0..=header.full_level() {
        let kinds: Vec<String> = bytes_by_kind(front, level)
            .iter()
            .map(|(name, sum)| format!("{name} {}", shared::thousands(*sum)))
            .collect();
        let error = header.error(level).filter(|e| e.is_finite()).map_or("?".to_string(), |e| format!("{e:.6}"));
        let _ = writeln!(
            out,
            "{level:>5} {:>12} {:>12} {:>14} {error:>12}  {}",
            shared::thousands(stream.vertices(level)),
            shared::thousands(stream.faces(level)),
            shared::thousands(front.prefix_bytes(level).unwrap_or(0)),
            kinds.join(", ")
        );
    }
    if chunks {
        let _ = writeln!(
            out,
            "\n{:>5} {:<10} {:>9} {:>9} {:>12} {:>12}  checksum",
            "chunk", "kind", "levels", "segment", "offset", "bytes"
        );
        for (i, c) in front.chunks().iter().enumerate() {
            let levels = if c.first_level == c.last_level {
                c.first_level.to_string()
            } else {
                format!("{}-{}", c.first_level, c.last_level)
            };
            let _ = writeln!(
                out,
                "{i:>5} {:<10} {levels:>9} {:>9} {:>12} {:>12}  {:08x}",
                match c.kind {
                    Kind::Image | Kind::Reconstruction => format!("{} {}", c.kind, c.image),
                    kind => kind.to_string(),
                },
                format!("{}/{}", c.segment + 1, c.segments),
                shared::thousands(c.offset),
                shared::thousands(c.length),
                c.checksum
            );
        }
    }
    out
}
