//! The parts of a file put together: mesh levels, degenerate faces, extra attributes, materials and images, header.

use super::attributes::{Parts, QuantizedAttributes, quantize_attributes};
use super::cost::Engine;
use super::levels::{EncodedLevels, LevelsError, encode_levels};
use super::loss::Loss;
use super::schedule::{self, Pictures};
use super::sets::Sets;
use super::simplify::{History, SimplifyOptions, reorder, simplify_on};
use super::trace::Trace;
use super::{BitsByKind, Control, EncodeError, EncodeOptions, EncodeReport, Encoded, ImageReport, Stage};
use crate::format::appearance::{AppearanceError, code_appearance};
use crate::format::attributes::{ExtraAttributes, Value, code_extra_attributes};
use crate::format::coder::{InvalidStream, range};
use crate::format::complex::{Attributes, Faces, Level, Scheme};
use crate::format::container::{
    self, AttributeHeader, Chunk, ContainerError, DegenerateCounts, ErrorBound, Header, LevelInfo, Preview,
};
use crate::format::degenerate::code_degenerate;
use crate::format::elements::Origin;
use crate::image::jpeg::{Exactness, Pieces, cut};
use crate::mesh::lattice::{Lattice, Quantization};
use crate::mesh::{Image, LayerKind, Mesh};
use std::borrow::Cow;
use std::collections::HashSet;
use std::time::Instant;

/// A chunk whose bytes may lie in the mesh: images that stay as they are go from there into the file without a stop, and are often
/// larger than all else.
type MeshChunk<'m> = Chunk<Cow<'m, [u8]>>;

/// A file that is not written yet.
pub(super) struct Draft<'m> {
    header: Header,
    chunks: Vec<MeshChunk<'m>>,
    map: Vec<u32>,
    report: EncodeReport,
}

impl Draft<'_> {
    /// Put a chunk behind all others.
    #[cfg(all(feature = "quality", feature = "recompress"))]
    pub(super) fn append(&mut self, chunk: Chunk) {
        self.chunks.push(chunk.map(Cow::Owned));
    }

    /// The number of the full level.
    #[cfg(all(feature = "quality", feature = "recompress"))]
    pub(super) fn full_level(&self) -> u32 {
        self.header.levels.len() as u32 - 1
    }

    /// Write the file.
    pub(super) fn write(mut self) -> Result<Encoded, ContainerError> {
        let all: Vec<Chunk<&[u8]>> = self.chunks.iter().map(Chunk::borrowed).collect();
        let bytes = container::write_borrowed(&self.header, &all)?;
        let payload: usize = all.iter().map(|c| c.payload.len()).sum();
        self.report.bits.header = (bytes.len() - payload) as f64 * 8.0;
        Ok(Encoded { bytes, map: self.map, report: self.report })
    }
}

/// Encode `mesh` up to the writing of its file.
pub(super) fn assemble<'m>(
    mesh: &'m Mesh,
    options: &EncodeOptions,
    engine: Engine,
    control: Control,
) -> Result<Draft<'m>, EncodeError> {
    mesh.validate()?;
    let lattice = Lattice::of_mesh(options.quantization, &mesh.positions, &mesh.corners)?;
    let positions = lattice.quantize_mesh(&mesh.positions, &mesh.corners)?;
    let (faces, degenerate, of) = part(mesh);
    let [of_face, of_degenerate] = of;
    let quantized = quantize_attributes(mesh, &Parts { faces: &faces, of_face, of_degenerate }, options)?;
    let loss = Loss::measure(mesh, &lattice, &positions, &quantized.header.layers);
    let QuantizedAttributes { header: mut announced, scheme, attributes, extra, isolated } = quantized;
    // Degenerate faces are not there before the full level: their points are told by their corners.
    let missing = extent_degenerate(mesh, &faces, &degenerate);
    let components = components(positions.len(), mesh);
    let bounds = bounds(&positions);
    let trace = engine.trace.clone();
    let level = Level { positions, faces, shift: 0 };
    let clock = Instant::now();
    let (mut encoded, history) = levels(mesh, level, attributes, &scheme, options, engine, control)?;

    let mut chunks = level_chunks(&mut encoded);
    let full_level = encoded.levels.len() as u32 - 1;
    let mut bits = BitsByKind {
        points: encoded.account.points,
        connectivity: encoded.account.connectivity,
        geometry: encoded.account.geometry,
        attributes: encoded.account.attributes,
        ..BitsByKind::default()
    };
    let degenerate_counts =
        DegenerateCounts { elements: degenerate.len() as u32, corners: degenerate.corners.len() as u32 };
    let (coded, origins) = match degenerate_chunk(&degenerate, &encoded.number, full_level)? {
        Some((chunk, coded, origins)) => {
            bits.degenerate = chunk.payload.len() as f64 * 8.0;
            chunks.push(chunk);
            (coded, origins)
        }
        None => (Faces::new(), Vec::new()),
    };
    if announced.extra {
        let extra = turn(&extra, &degenerate, &origins);
        let isolated = values_of_isolated(mesh, &isolated, scheme.widths.len(), &encoded.number);
        let chunk = extra_chunk(&scheme, &coded, ExtraAttributes { isolated, ..extra }, full_level)?;
        bits.attributes += chunk.payload.len() as f64 * 8.0;
        chunks.push(chunk);
    }
    let mut images = Vec::new();
    if announced.appearance {
        let pictures = pictures(mesh, options.images, full_level, &trace, &mut bits, &mut images)?;
        chunks = schedule::order(chunks, pictures, options.schedule);
    }
    for (layer, &wedges) in announced.layers.iter_mut().zip(&encoded.wedges) {
        layer.wedges = wedges;
    }
    let place = Place { lattice, bounds, components, degenerate: degenerate_counts, missing };
    let header = header(&encoded, announced, options, &place);
    let report = EncodeReport {
        vertices: mesh.vertex_count(),
        faces: mesh.face_count(),
        components: components as usize,
        levels: header.levels.len(),
        bits,
        edges_weighed: history.edges_weighed,
        weighed_by: history.weighed_by,
        fallback: history.fallback,
        weigh_seconds: history.seconds[0],
        select_seconds: history.seconds[1],
        collapse_seconds: history.seconds[2],
        encode_seconds: (clock.elapsed().as_secs_f64() - history.total).max(0.0),
        images,
        loss,
    };
    Ok(Draft { header, chunks, map: encoded.number, report })
}

/// What is left of a history once its levels are coded.
struct Simplified {
    edges_weighed: u64,
    weighed_by: String,
    fallback: Option<String>,
    seconds: [f64; 3],
    /// Seconds of simplification in all.
    total: f64,
}

/// Simplify and code a mesh.
fn levels(
    mesh: &Mesh,
    mut level: Level,
    mut attributes: Attributes,
    scheme: &Scheme,
    options: &EncodeOptions,
    engine: Engine,
    control: Control,
) -> Result<(EncodedLevels, Simplified), EncodeError> {
    let slots = level.positions.len();
    let total = slots as u64;
    let trace = engine.trace.clone();
    let clock = Instant::now();
    let place = reorder(&mut level, &mut attributes);
    let simplify_options = SimplifyOptions {
        lock_borders: options.lock_borders,
        seams: (0..mesh.layers.len()).filter(|&l| mesh.layers[l].kind == LayerKind::Uv).collect(),
        ..SimplifyOptions::default()
    };
    let history = simplify_on(level, attributes, &simplify_options, engine, &|left| {
        control.report(Stage::Simplify, total - left, total)
    });
    if history.cancelled {
        return Err(EncodeError::Cancelled);
    }
    let simplifying = clock.elapsed().as_secs_f64();
    let mut span = trace.span("loop", "code all batches");
    span.items(total);
    let encoded = encode_levels(&history, slots, scheme, &|done| control.report(Stage::Encode, done, total))?;
    let mut encoded = encoded.ok_or(EncodeError::Cancelled)?;
    drop(span);
    if let Some(place) = place {
        // Back to the caller's numbers.
        encoded.number = place.iter().map(|&v| encoded.number[v as usize]).collect();
    }
    let History { edges_weighed, weighed_by, fallback, seconds, .. } = history;
    Ok((encoded, Simplified { edges_weighed, weighed_by, fallback, seconds, total: simplifying }))
}

/// The chunks of all levels, in streaming order; they are taken out of `encoded`.
fn level_chunks(encoded: &mut EncodedLevels) -> Vec<MeshChunk<'static>> {
    let chunk = |p: super::levels::Piece| match p.segment {
        Some((s, of)) => Chunk::segment(p.first, s, of, p.payload),
        None if p.first == 0 => Chunk::base(p.last, p.payload),
        None => Chunk::levels(p.first..=p.last, p.payload),
    };
    std::mem::take(&mut encoded.pieces).into_iter().map(|p| chunk(p).map(Cow::Owned)).collect()
}

/// Faces that repeat a vertex, if there are any: their chunk, and what was coded in which order.
#[allow(clippy::type_complexity, reason = "three things that are made together and go apart")]
fn degenerate_chunk(
    degenerate: &Faces,
    number: &[u32],
    full_level: u32,
) -> Result<Option<(MeshChunk<'static>, Faces, Vec<Origin>)>, LevelsError> {
    if degenerate.is_empty() {
        return Ok(None);
    }
    let mut coder = range::Encoder::new();
    let mut faces = Faces::new();
    for f in degenerate.iter() {
        let f: Vec<u32> = f.iter().map(|&v| number[v as usize]).collect();
        faces.push(&f);
    }
    let origins = code_degenerate(&mut coder, number.len(), &mut faces, degenerate.corners.len())?;
    Ok(Some((Chunk::degenerate(full_level, coder.finish()).map(Cow::Owned), faces, origins)))
}

/// Values of degenerate faces and of isolated vertices.
fn extra_chunk(
    scheme: &Scheme,
    degenerate: &Faces,
    mut extra: ExtraAttributes,
    full_level: u32,
) -> Result<MeshChunk<'static>, LevelsError> {
    let count = extra.isolated.first().map_or(0, Vec::len);
    let mut coder = range::Encoder::new();
    code_extra_attributes(&mut coder, scheme, degenerate, count, &mut extra)?;
    Ok(Chunk::extra(full_level, coder.finish()).map(Cow::Owned))
}

/// Materials and images.
fn pictures<'m>(
    mesh: &'m Mesh,
    exactness: Exactness,
    full_level: u32,
    trace: &Trace,
    bits: &mut BitsByKind,
    reports: &mut Vec<ImageReport>,
) -> Result<Pictures<Cow<'m, [u8]>>, LevelsError> {
    let mut coder = range::Encoder::new();
    let (_, memory) = code_appearance(&mut coder, &mesh.appearance, u64::MAX).map_err(|error| match error {
        AppearanceError::InvalidStream(what) => what,
        AppearanceError::Memory { .. } => InvalidStream("materials without end"),
    })?;
    let payload = coder.finish();
    bits.appearance = payload.len() as f64 * 8.0;
    // Behind the base: what is shown first has its materials.
    let appearance = Chunk::appearance(0, payload).with_memory(memory).map(Cow::Owned);
    let mut out = Pictures {
        appearance: Some(appearance),
        previews: Vec::new(),
        images: Vec::new(),
        reconstructions: Vec::new(),
    };
    let _span = trace.span("loop", "cut images");
    for (i, image) in (0u32..).zip(&mesh.appearance.images) {
        let Pieces { pieces, reconstruction, way, memory } = cut(&image.bytes, exactness);
        let count = pieces.len();
        let reconstruction = reconstruction.map(Cow::Owned);
        let stored = pieces.iter().chain(&reconstruction).map(|p| p.len()).sum::<usize>();
        bits.images += stored as f64 * 8.0;
        let previews = preview_chunks(i, image);
        let sizes: Vec<u64> = previews.iter().map(|p| p.payload.len() as u64).collect();
        bits.previews += sizes.iter().sum::<u64>() as f64 * 8.0;
        if !image.bytes.is_empty() {
            reports.push(ImageReport {
                name: if image.name.is_empty() { format!("image {i}") } else { image.name.clone() },
                bytes: image.bytes.len() as u64,
                stored: stored as u64,
                previews: sizes,
                pieces: count,
                way,
            });
        }
        let piece = |(k, payload)| Chunk::image(full_level, i, k, count as u32, payload);
        out.images.push((0u32..).zip(pieces).map(piece).collect());
        out.previews.push(previews);
        let reconstruction = reconstruction.map(|r| Chunk::reconstruction(full_level, i, r).with_memory(memory));
        out.reconstructions.extend(reconstruction);
    }
    Ok(out)
}

/// The previews of an image that is there.
fn preview_chunks(i: u32, image: &Image) -> Vec<MeshChunk<'static>> {
    let previews = if image.bytes.is_empty() { &[][..] } else { &image.previews };
    let chunk = |(bytes, number)| Chunk::preview(0, &Preview { image: i, number, bytes }).map(Cow::Owned);
    previews.iter().zip(0..).map(|(bytes, number): (&Vec<u8>, u32)| chunk((bytes, number))).collect()
}

/// Where the mesh lies, and what of it the levels do not tell.
struct Place {
    lattice: Lattice,
    bounds: Option<[[i32; 3]; 2]>,
    components: u32,
    degenerate: DegenerateCounts,
    /// How far points of degenerate faces lie from coarser levels.
    missing: f64,
}

fn header(encoded: &EncodedLevels, attributes: AttributeHeader, options: &EncodeOptions, place: &Place) -> Header {
    let lattice = place.lattice;
    let quantum = lattice.step * 3f64.sqrt() / 2.0;
    let full_level = encoded.levels.len() - 1;
    let row = |(l, &(vertices, elements, corners, shift, error)): (usize, &(u32, u32, u32, u8, f64))| {
        let missing = if l == full_level { 0.0 } else { place.missing };
        let error = ErrorBound::covering(error * lattice.step + quantum + missing, lattice.step);
        LevelInfo { vertices, elements, corners, shift, error }
    };
    Header {
        attributes,
        required: 0,
        optional: 0,
        lattice,
        position_bits: match options.quantization {
            Quantization::Bits(b) => Some(b),
            Quantization::Step { .. } => None,
        },
        bounds: place.bounds,
        components: place.components,
        degenerate: place.degenerate,
        levels: encoded.levels.iter().enumerate().map(row).collect(),
    }
}

/// The box of all positions.
fn bounds(positions: &[[i32; 3]]) -> Option<[[i32; 3]; 2]> {
    positions.first().map(|&first| {
        positions.iter().fold([first; 2], |[lo, hi], p| {
            [std::array::from_fn(|k| lo[k].min(p[k])), std::array::from_fn(|k| hi[k].max(p[k]))]
        })
    })
}

/// The elements that the complex can hold, those that repeat a vertex, and their numbers in the mesh.
fn part(mesh: &Mesh) -> (Faces, Faces, [Vec<u32>; 2]) {
    let (mut faces, mut degenerate) = (Faces::new(), Faces::new());
    let mut of = [Vec::with_capacity(mesh.face_count()), Vec::new()];
    let mut sorted = Vec::new();
    for (i, f) in mesh.faces().enumerate() {
        let repeats = if f.len() <= 8 {
            (1..f.len()).any(|i| f[..i].contains(&f[i]))
        } else {
            sorted.clear();
            sorted.extend_from_slice(f);
            sorted.sort_unstable();
            sorted.windows(2).any(|w| w[0] == w[1])
        };
        if repeats {
            degenerate.push(f)
        } else {
            faces.push(f)
        }
        of[repeats as usize].push(i as u32);
    }
    (faces, degenerate, of)
}

/// Values of degenerate faces in the order and rotation in which they are coded.
fn turn(extra: &ExtraAttributes, degenerate: &Faces, origins: &[Origin]) -> ExtraAttributes {
    let corners = |list: &Vec<Option<Value>>| {
        let mut out = Vec::with_capacity(list.len());
        for o in origins {
            let own =
                &list[degenerate.start[o.element as usize] as usize..degenerate.start[o.element as usize + 1] as usize];
            out.extend((0..own.len()).map(|k| own[(o.rotation as usize + k) % own.len()]));
        }
        out
    };
    let labels = if extra.labels.is_empty() {
        Vec::new()
    } else {
        origins.iter().map(|o| extra.labels[o.element as usize]).collect()
    };
    ExtraAttributes { labels, corners: extra.corners.iter().map(corners).collect(), isolated: Vec::new() }
}

/// For each layer the values of the vertices that no element names, in the order of the full level.
fn values_of_isolated(
    mesh: &Mesh,
    known: &[(u32, u32, Value)],
    layers: usize,
    number: &[u32],
) -> Vec<Vec<Option<Value>>> {
    let mut used = vec![false; mesh.positions.len()];
    mesh.corners.iter().for_each(|&v| used[v as usize] = true);
    let mut order: Vec<(u32, u32)> =
        (0..used.len() as u32).filter(|&v| !used[v as usize]).map(|v| (number[v as usize], v)).collect();
    order.sort_unstable();
    let value = |v: u32, layer: u32| {
        let at = known.binary_search_by_key(&(v, layer), |k| (k.0, k.1)).ok()?;
        known.get(at).map(|k| k.2)
    };
    (0..layers as u32).map(|layer| order.iter().map(|&(_, v)| value(v, layer)).collect()).collect()
}

/// How far the points of elements that repeat a vertex are at most from vertices, or from the rest of the mesh.
fn extent_degenerate(mesh: &Mesh, faces: &Faces, degenerate: &Faces) -> f64 {
    if degenerate.is_empty() {
        return 0.0;
    }
    let mut edges: HashSet<[u32; 2]> = HashSet::new();
    for f in degenerate.iter() {
        edges.extend(segment(f));
    }
    let mut held: HashSet<[u32; 2]> = HashSet::new();
    for f in faces.iter() {
        let around = (0..f.len()).map(|i| [f[i], f[(i + 1) % f.len()]]);
        held.extend(around.map(|[a, b]| [a.min(b), a.max(b)]).filter(|e| edges.contains(e)));
    }
    let distance = |a: u32, b: u32| {
        let (p, q) = (mesh.positions[a as usize], mesh.positions[b as usize]);
        (0..3).map(|k| (p[k] - q[k]) * (p[k] - q[k])).sum::<f64>().sqrt()
    };
    let reach = |f: &[u32]| match segment(f) {
        // Half of a segment that nothing else holds.
        Some(e) if held.contains(&e) => 0.0,
        Some([a, b]) => distance(a, b) / 2.0,
        // The farthest corner from the first is no nearer than any point between.
        None => f.iter().map(|&x| distance(f[0], x)).fold(0.0, f64::max),
    };
    degenerate.iter().map(reach).fold(0.0, f64::max) * (1.0 + 1e-9)
}

/// The two vertices of an element that names no others, in order.
fn segment(f: &[u32]) -> Option<[u32; 2]> {
    let (a, b) = (f.iter().copied().min()?, f.iter().copied().max()?);
    (a != b && f.iter().all(|&x| x == a || x == b)).then_some([a, b])
}

/// Connected components of `n` vertices through the elements of the mesh.
fn components(n: usize, mesh: &Mesh) -> u32 {
    let mut sets = Sets::default();
    sets.reset(n as u32);
    let joined = mesh.faces().flat_map(|f| f[1..].iter().map(move |&v| (f[0], v))).filter(|&(a, b)| sets.join(a, b));
    n as u32 - joined.count() as u32
}
