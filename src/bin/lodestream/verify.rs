//! `lodestream verify`: every checksum, every level, and the comparison with the source.

use crate::Outcome;
use crate::encode::{ISOLATED, NO_VERTEX};
use crate::progress::Bars;
use crate::shared::{self, Machine};
use crate::stream::Stream;
use anyhow::{Context, Result, bail};
use lodestream::format::container::Header;
use lodestream::image::is_jpeg;
use lodestream::io::read::{Format, Invalid, ReadOptions};
use lodestream::mesh::lattice::{Lattice, used_vertices};
use lodestream::mesh::{Image, Mesh};
use lodestream::quality::exact::{self, Difference};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  lodestream verify bunny.lods
  lodestream verify bunny.lods --against bunny.ply
  lodestream encode bunny.ply -o bunny.lods --map bunny.map && lodestream verify bunny.lods --against bunny.ply --map bunny.map

With a map the comparison is complete: every vertex, every face. Without one it compares what positions tell.
Exit codes: 0 sound (and equal); 1 damaged or unreadable; 2 wrong usage; 3 sound, but not equal to the source.")]
pub struct Args {
    /// The .lods file; - for standard input
    #[arg(value_name = "IN.lods")]
    input: PathBuf,
    /// The mesh that it was made from
    #[arg(long, value_name = "INPUT")]
    against: Option<PathBuf>,
    /// The format of the source, where its name does not tell
    #[arg(long, value_name = "FORMAT", requires = "against", value_parser = crate::shared::parse_format)]
    format: Option<Format>,
    /// The vertex map that encoding wrote
    #[arg(long, value_name = "FILE", requires = "against")]
    map: Option<PathBuf>,
    #[command(flatten)]
    machine: Machine,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let start = Instant::now();
    let name = shared::name(&args.input);
    args.machine.run(|_| {
        let mut stream = Stream::open(&args.input, args.machine.memory_limit())?;
        let full = stream.front().full_level();
        let rows = stream.front().header().levels.clone();
        let bars = Bars::new(!args.json);
        let options = crate::decode::options(&args.machine);
        let mut reached = stream.decode(full, options, &bars, |level, decoder| {
            // The level table is under its own checksum, so a level that disagrees with it was encoded wrongly.
            let (faces, vertices) = (decoder.faces().len(), decoder.complex().positions.len());
            let row = rows.get(level as usize).copied().unwrap_or_default();
            if vertices != row.vertices as usize || faces != row.elements as usize {
                bail!(
                    "{name}: level {level} has {vertices} vertices and {faces} faces, its table says {} and {}",
                    row.vertices,
                    row.elements
                );
            }
            Ok(())
        })?;
        if let Some(cut) = reached.cut {
            return Err(cut).context(name.clone());
        }
        stream.pictures(&mut reached.decoder, u64::MAX)?;
        stream.check_end()?;
        let mesh = reached.decoder.to_mesh();
        mesh.validate().with_context(|| format!("{name}: the full level"))?;
        let (levels, chunks) = (rows.len(), stream.front().chunks().len());
        let header = stream.front().header();
        let verdict = args.against.as_deref().map(|source| against(args, source, &mesh, header)).transpose()?;
        let test = match &verdict {
            None => None,
            Some(v) if v.complete => Some("complete, through the vertex map"),
            Some(_) => Some("by position"),
        };
        let difference = verdict.as_ref().and_then(|v| v.difference.clone());
        if args.json {
            shared::print_json(&json!({
                "levels": levels,
                "chunks": chunks,
                "vertices": mesh.vertex_count(),
                "faces": mesh.face_count(),
                "bytes": stream.bytes_read(),
                "sound": true,
                "test": test,
                "lattice_step": header.lattice.step,
                "largest_shift": verdict.as_ref().and_then(|v| v.shift),
                "equal": verdict.as_ref().map(|v| v.difference.is_none()),
                "layers": mesh.layers.iter().map(|l| &l.name).collect::<Vec<_>>(),
                "not_kept": verdict.as_ref().map(|v| &v.not_kept),
                "difference": difference.as_ref().map(ToString::to_string),
                "seconds": { "total": shared::seconds(start) },
                "peak_memory_bytes": shared::peak_memory(),
            }))?;
        } else {
            let sound = format!(
                "{chunks} chunks and {levels} levels are sound, {} bytes",
                shared::thousands(stream.bytes_read())
            );
            let mut rows = vec![("file", sound)];
            if let Some(test) = test {
                rows.push(("test", test.to_string()));
                let layers = match mesh.layers.len() {
                    0 => String::new(),
                    n => format!(", with {n} attribute layer{}", if n == 1 { "" } else { "s" }),
                };
                let (vertices, faces) = (mesh.vertex_count(), mesh.face_count());
                let step = header.lattice.step;
                let equal = format!(
                    "all {vertices} vertices and {faces} faces{layers} are equal to the source on a lattice of step {step:.3e}"
                );
                rows.push(("source", if difference.is_none() { equal } else { "NOT equal".to_string() }));
            }
            if let Some(shift) = verdict.as_ref().and_then(|v| v.shift) {
                rows.push(("shift", format!("at most {shift:.3e}")));
            }
            if let Some(v) = verdict.as_ref().filter(|v| !v.not_kept.is_empty()) {
                rows.push(("not kept", v.not_kept.join(", ")));
            }
            shared::print(&shared::table(&rows))?;
        }
        let Some(difference) = difference else { return Ok(Outcome::Done) };
        let source = args.against.as_deref().map(shared::name).unwrap_or_default();
        shared::complain(&format!("{name} differs from {source}: {difference}"));
        Ok(Outcome::Different)
    })
}

struct Verdict {
    /// Whether the comparison went through the map.
    complete: bool,
    difference: Option<Difference>,
    /// How far the farthest vertex of the source is from its place in the file; `None` where the lattice does not reach it.
    shift: Option<f64>,
    /// Attributes of the source that the file leaves out.
    not_kept: Vec<String>,
}

fn against(args: &Args, source: &Path, decoded: &Mesh, header: &Header) -> Result<Verdict> {
    let lattice = &header.lattice;
    let key = exact::quantized(&header.attributes.layers);
    if shared::is_dash(source) && shared::is_dash(&args.input) {
        bail!("the file and its source cannot both come from standard input");
    }
    let read = |weld| {
        // What encoding needs to be told, its output shows.
        let (memory_limit, invalid) = (Some(args.machine.memory_limit()), Invalid::Drop);
        let options = ReadOptions { weld, memory_limit, invalid, allow_empty: true, ..ReadOptions::default() };
        shared::read_mesh(source, args.format, &options)
    };
    if let Some(path) = &args.map {
        // A map speaks of the records of the file, so they are compared as they stand there.
        let mut map = read_map(path)?;
        let mut mesh = read(Some(false))?.mesh;
        let dropped = map.contains(&NO_VERTEX).then(|| {
            let number = mesh.retain_isolated(|v| map.get(v as usize) != Some(&NO_VERTEX));
            not_used(&number)
        });
        map.retain(|v| *v != NO_VERTEX);
        drop_welded_edges(&mut mesh, &map);
        let mut not_kept = leave_out(&mut mesh, decoded);
        not_kept.extend(dropped);
        let difference = exact::by_map(&mesh, decoded, lattice, &map)
            .and_then(|()| exact::attributes_by_map(&mesh, decoded, &map, &key))
            .err();
        return Ok(Verdict { complete: true, difference, shift: shift(&mesh, lattice), not_kept });
    }
    // Whether the encoder was told to weld the file does not say; the number of vertices does.
    let mut mesh = read(None)?.mesh;
    if mesh.vertex_count() != decoded.vertex_count() && !shared::is_dash(source) {
        for weld in [Some(true), Some(false)] {
            let other = read(weld)?.mesh;
            if other.vertex_count() == decoded.vertex_count() {
                mesh = other;
                break;
            }
        }
    }
    let used = used_vertices(mesh.vertex_count(), &mesh.corners).iter().filter(|used| **used).count();
    let is_dropped = mesh.vertex_count() != decoded.vertex_count() && used == decoded.vertex_count();
    let dropped = is_dropped.then(|| not_used(&mesh.drop_isolated()));
    let mut not_kept = leave_out(&mut mesh, decoded);
    not_kept.extend(dropped);
    let difference = exact::by_position(&mesh, decoded, lattice)
        .and_then(|()| exact::attributes_by_position(&mesh, decoded, lattice, &key))
        .err();
    Ok(Verdict { complete: false, difference, shift: shift(&mesh, lattice), not_kept })
}

/// What an encoder was told to leave out, in words.
fn not_used(number: &[Option<u32>]) -> String {
    format!("{} vertices that nothing uses", number.iter().filter(|n| n.is_none()).count())
}

/// How far the farthest vertex is from its lattice point.
fn shift(source: &Mesh, lattice: &Lattice) -> Option<f64> {
    let quantized = lattice.quantize(&source.positions).ok()?;
    Some(lattice.largest_shift(&source.positions, &quantized))
}

/// Take from a source what its encoder was told to drop, and name it.
fn leave_out(source: &mut Mesh, decoded: &Mesh) -> Vec<String> {
    let mut names = Vec::new();
    source.layers.retain(|layer| {
        let kept = decoded.layers.iter().any(|l| (&l.name, l.kind) == (&layer.name, layer.kind));
        if !kept {
            names.push(layer.name.clone());
        }
        kept
    });
    if decoded.appearance.is_empty() && !source.appearance.is_empty() {
        names.push("materials".to_string());
        source.appearance = Default::default();
        source.material = Vec::new();
    }
    let images = |m: &Mesh| m.appearance.images.iter().any(|i| !i.bytes.is_empty());
    if images(source) && !images(decoded) {
        names.push("images".to_string());
        source.appearance.images.iter_mut().for_each(|i| i.bytes = Vec::new());
    }
    // An encoder makes a JPEG of something else only where it is told to.
    let is_jpeg = |i: &Image| is_jpeg(&i.bytes);
    for (source, decoded) in source.appearance.images.iter_mut().zip(&decoded.appearance.images) {
        if !source.bytes.is_empty() && !is_jpeg(source) && is_jpeg(decoded) && source.name == decoded.name {
            names.push(format!("the pixels of {:?}, which is a JPEG now", source.name));
            source.clone_from(decoded);
        }
    }
    names
}

/// An edge whose ends were welded is a point: readers leave it out, so it is no difference.
fn drop_welded_edges(mesh: &mut Mesh, map: &[u32]) {
    let image = |v: u32| map.get(v as usize);
    let is_point = |face: &[u32]| matches!(*face, [a, b] if a != b && image(a).is_some() && image(a) == image(b));
    if !mesh.faces().any(is_point) {
        return;
    }
    let mut kept = Mesh { positions: std::mem::take(&mut mesh.positions), ..Mesh::default() };
    let faces: Vec<usize> = (0..mesh.face_count()).filter(|&f| !is_point(mesh.face(f))).collect();
    faces.iter().for_each(|&f| kept.push_face(mesh.face(f)));
    let corners = |f: usize| mesh.face_start[f] as usize..mesh.face_start[f + 1] as usize;
    kept.layers = std::mem::take(&mut mesh.layers);
    for layer in &mut kept.layers {
        layer.corners = faces.iter().flat_map(|&f| &layer.corners[corners(f)]).copied().collect();
    }
    kept.material = faces.iter().filter_map(|&f| mesh.material.get(f).copied()).collect();
    kept.appearance = std::mem::take(&mut mesh.appearance);
    *mesh = kept;
}

fn read_map(path: &Path) -> Result<Vec<u32>> {
    let bytes = shared::read_file(path)?;
    let text = std::str::from_utf8(&bytes)
        .ok()
        .with_context(|| format!("{}: this is not a vertex map: not text", path.display()))?;
    // A vertex that was dropped is none here either.
    text.lines()
        .enumerate()
        .filter(|(_, line)| line.trim() != "-")
        .map(|(i, line)| {
            let number = if line.trim() == ISOLATED { Some(NO_VERTEX) } else { line.trim().parse::<u32>().ok() };
            number.with_context(|| {
                let shown: String = line.chars().take(20).collect();
                format!(
                    "{}, line {}: {shown:?} is no vertex number; give the file that encode --map wrote",
                    path.display(),
                    i + 1
                )
            })
        })
        .collect()
}
