//! The encoder's front door: a mesh in, the bytes of a `.lods` file and an account of the work out.

mod attributes;
pub mod cost;
#[cfg(feature = "quality")]
pub mod quality_order;
mod schedule;
mod sets;
pub mod simplify;
pub mod trace;

pub use attributes::AttributeError;
pub use schedule::Schedule;

use self::attributes::{Parts, quantize_attributes};
use crate::encode::cost::Engine;
use crate::encode::sets::Sets;
use crate::encode::simplify::{LevelsError, SimplifyOptions, encode_levels, reorder, simplify_on};
use crate::format::appearance::{AppearanceError, code_appearance};
use crate::format::attributes::{ExtraAttributes, Value, code_extra_attributes};
use crate::format::coder::range;
use crate::format::complex::{Faces, Level};
use crate::format::container::{self, Chunk, ContainerError, DegenerateCounts, ErrorBound, Header, LevelInfo, Preview};
use crate::format::degenerate::code_degenerate;
use crate::format::elements::Origin;
use crate::format::split::segment::InvalidStream;
use crate::image::jpeg::{Exactness, Pieces, Treatment, cut};
use crate::mesh::lattice::{Lattice, LatticeError, Quantization};
use crate::mesh::quantizer::Precision;
use crate::mesh::{LayerKind, Mesh, MeshError};
use std::borrow::Cow;
use std::collections::HashSet;
use std::time::Instant;
use thiserror::Error;

/// What the user chooses.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodeOptions {
    /// The lattice of the positions.
    pub quantization: Quantization,
    /// Never move a vertex of a border, so that tiles fit at every level.
    pub lock_borders: bool,
    /// Texture coordinates: bits on the longest side of their box, or a step.
    pub uv: Precision,
    /// Bits of each of the two numbers of a normal or tangent, 2 to 16.
    pub normal_bits: u8,
    /// Bits of each component of a colour, 1 to 24.
    pub color_bits: u8,
    /// Bits on the range of any other attribute, 1 to 24; whole numbers stay whole where 24 bits hold them.
    pub scalar_bits: u8,
    /// Whether images come back with the same pixels, or byte by byte; see [`texture`](crate::image::jpeg).
    pub images: Exactness,
    /// What comes first, the mesh or its images.
    pub schedule: Schedule,
}

impl Default for EncodeOptions {
    fn default() -> Self {
        EncodeOptions {
            quantization: Quantization::Bits(12),
            lock_borders: false,
            uv: Precision::Bits(12),
            normal_bits: 10,
            color_bits: 8,
            scalar_bits: 16,
            images: Exactness::default(),
            schedule: Schedule::default(),
        }
    }
}

/// Where the work stands, for progress bars.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// What is being done.
    pub stage: Stage,
    /// How much of it is done, of `total`.
    pub done: u64,
    /// How much there is to do.
    pub total: u64,
}

/// The stages of an encoding, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Weighing, selecting and collapsing; counted in vertices removed.
    Simplify,
    /// Coding batches into chunks; counted in vertices restored.
    Encode,
}

/// Bits of the file by what they say.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BitsByKind {
    /// Header, level and chunk tables, checksums.
    pub header: f64,
    /// Level 0, isolated vertices and new_vertices.
    pub points: f64,
    /// Which vertices split, and how.
    pub connectivity: f64,
    /// Where the children of the splits lie.
    pub geometry: f64,
    /// Faces that repeat a vertex, which travel aside.
    pub aside: f64,
    /// Labels, wedges and their values.
    pub attributes: f64,
    /// Materials, textures and samplers.
    pub appearance: f64,
    /// Images.
    pub images: f64,
    /// Previews of images.
    pub previews: f64,
}

/// What was done with an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageReport {
    /// Its name, or `image` and its number where it has none.
    pub name: String,
    /// Bytes of its file.
    pub bytes: u64,
    /// Bytes of its chunks, without those of its previews.
    pub stored: u64,
    /// Bytes of the chunk of each of its previews, coarse before fine.
    pub previews: Vec<u64>,
    /// Pieces that it came into; each prefix of them is a picture.
    pub pieces: usize,
    /// What was done with it.
    pub way: Treatment,
}

/// An account of one encoding.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EncodeReport {
    /// Vertices of the mesh.
    pub vertices: usize,
    /// Its elements.
    pub faces: usize,
    /// Its connected components; an isolated vertex is one.
    pub components: usize,
    /// Levels of detail in the file, the full one included.
    pub levels: usize,
    /// Where the bits went.
    pub bits: BitsByKind,
    /// Edges weighed in all.
    pub edges_weighed: u64,
    /// Who weighed them: `cpu` or the name of a device. The bytes do not say.
    pub weighed_by: String,
    /// Why the device that was to weigh them did not go on and the processor did.
    pub fallback: Option<String>,
    /// Seconds spent weighing edges; on a device, beside collapsing.
    pub weigh_seconds: f64,
    /// Seconds spent selecting batches.
    pub select_seconds: f64,
    /// Seconds spent collapsing.
    pub collapse_seconds: f64,
    /// Seconds spent coding.
    pub encode_seconds: f64,
    /// The images, in their order; without those of which the source had but the name.
    pub images: Vec<ImageReport>,
}

/// An encoded mesh.
#[derive(Clone, Debug)]
pub struct Encoded {
    /// The file.
    pub bytes: Vec<u8>,
    /// For each vertex of the input the number it has at the full level of the file.
    pub map: Vec<u32>,
    /// What was done.
    pub report: EncodeReport,
}

/// Why a mesh could not be encoded.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// The mesh breaks its own invariants.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The lattice cannot hold it.
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    /// Its attributes cannot be carried.
    #[error(transparent)]
    Attributes(#[from] AttributeError),
    /// The container cannot hold it.
    #[error(transparent)]
    Container(#[from] ContainerError),
    /// A bug of the encoder.
    #[error("{0}; this is a bug of the encoder, please report it with the mesh")]
    Bug(#[from] LevelsError),
}

/// Encode `mesh`. Runs on the current rayon pool; the bytes do not depend on its size.
///
/// # Errors
/// [`EncodeError`] when the mesh is invalid or its coordinates do not fit the lattice.
pub fn encode(
    mesh: &Mesh,
    options: &EncodeOptions,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Encoded, EncodeError> {
    encode_on(mesh, options, Engine::default(), progress)
}

/// The same with somebody who weighs edges, and a trace. A device that fails is replaced by the processor, which
/// [`EncodeReport::fallback`] tells; the file is exact either way.
///
/// # Errors
/// As [`encode`].
pub fn encode_on(
    mesh: &Mesh,
    options: &EncodeOptions,
    engine: Engine,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Encoded, EncodeError> {
    mesh.validate()?;
    let lattice = Lattice::choose(options.quantization, &mesh.positions)?;
    let positions = lattice.quantize(&mesh.positions)?;
    let (faces, aside, of) = part(mesh);
    let [of_face, of_aside] = of;
    let dressed = quantize_attributes(mesh, &Parts { faces: &faces, of_face, of_aside }, options)?;
    let scheme = dressed.scheme;
    // What travels aside is not there before the full level: its points are told by its corners.
    let missing = extent_degenerate(mesh, &faces, &aside);
    let components = components(positions.len(), mesh);
    let bounds = positions.first().map(|&first| {
        positions.iter().fold([first; 2], |[lo, hi], p| {
            [std::array::from_fn(|k| lo[k].min(p[k])), std::array::from_fn(|k| hi[k].max(p[k]))]
        })
    });
    let total = positions.len() as u64;
    let slots = positions.len();
    let mut level = Level { positions, faces, shift: 0 };
    let mut attributes = dressed.attributes;
    let place = reorder(&mut level, &mut attributes);
    let simplify_options = SimplifyOptions {
        lock_borders: options.lock_borders,
        seams: (0..mesh.layers.len()).filter(|&l| mesh.layers[l].kind == LayerKind::Uv).collect(),
        ..SimplifyOptions::default()
    };
    let trace = engine.trace.clone();
    let history = simplify_on(level, attributes, &simplify_options, engine, &|left| {
        progress(Progress { stage: Stage::Simplify, done: total - left, total });
    });
    let clock = Instant::now();
    let mut span = trace.span("loop", "code all batches");
    span.items(total);
    let mut replayed =
        encode_levels(&history, slots, &scheme, &|done| progress(Progress { stage: Stage::Encode, done, total }))?;
    drop(span);
    if let Some(place) = place {
        // Back to the caller's numbers.
        replayed.number = place.iter().map(|&v| replayed.number[v as usize]).collect();
    }

    // Images that stay as they are go from the mesh into the file without a stop: they are often larger than all else.
    let mut chunks: Vec<Chunk<Cow<'_, [u8]>>> = replayed
        .pieces
        .into_iter()
        .map(|p| match p.segment {
            Some((s, of)) => Chunk::segment(p.first, s, of, p.payload),
            None if p.first == 0 => Chunk::base(p.last, p.payload),
            None => Chunk::levels(p.first..=p.last, p.payload),
        })
        .map(|c| c.map(Cow::Owned))
        .collect();
    let full_level = replayed.levels.len() as u32 - 1;
    let mut aside_bits = 0.0;
    let mut coded_aside = Faces::new();
    let mut origins = Vec::new();
    let aside_counts = DegenerateCounts { elements: aside.len() as u32, corners: aside.corners.len() as u32 };
    if !aside.is_empty() {
        let mut coder = range::Encoder::new();
        let mut faces = Faces::new();
        for f in aside.iter() {
            let f: Vec<u32> = f.iter().map(|&v| replayed.number[v as usize]).collect();
            faces.push(&f);
        }
        origins = code_degenerate(&mut coder, slots, &mut faces, aside.corners.len()).map_err(LevelsError::Base)?;
        let payload = coder.finish();
        aside_bits = payload.len() as f64 * 8.0;
        chunks.push(Chunk::aside(full_level, payload).map(Cow::Owned));
        coded_aside = faces;
    }
    let mut attribute_bits = replayed.account.splits.attributes;
    if dressed.header.lone {
        let lone = turn(&dressed.lone, &aside, &origins);
        let number = |v: u32| replayed.number[v as usize];
        let isolated = isolated(mesh, &dressed.isolated, scheme.widths.len(), &number);
        let count = isolated.first().map_or(0, Vec::len);
        let mut lone = ExtraAttributes { isolated, ..lone };
        let mut coder = range::Encoder::new();
        code_extra_attributes(&mut coder, &scheme, &coded_aside, count, &mut lone).map_err(LevelsError::Stream)?;
        let payload = coder.finish();
        attribute_bits += payload.len() as f64 * 8.0;
        chunks.push(Chunk::lone(full_level, payload).map(Cow::Owned));
    }
    let (mut appearance_bits, mut image_bits, mut preview_bits) = (0.0, 0.0, 0.0);
    let mut reports = Vec::new();
    if dressed.header.appearance {
        let mut coder = range::Encoder::new();
        let (_, memory) = code_appearance(&mut coder, &mesh.appearance, u64::MAX).map_err(|error| match error {
            AppearanceError::InvalidStream(nonsense) => LevelsError::Stream(nonsense),
            AppearanceError::Memory { .. } => LevelsError::Stream(InvalidStream("materials without end")),
        })?;
        let payload = coder.finish();
        appearance_bits = payload.len() as f64 * 8.0;
        // Behind the base: what is shown first has its materials.
        let appearance = Chunk::appearance(0, payload).with_memory(memory).map(Cow::Owned);
        let (mut previews, mut images, mut reconstructions) = (Vec::new(), Vec::new(), Vec::new());
        let span = trace.span("loop", "cut images");
        for (i, image) in (0u32..).zip(&mesh.appearance.images) {
            let Pieces { pieces, reconstruction, way, memory } = cut(&image.bytes, options.images);
            let count = pieces.len();
            let reconstruction = reconstruction.map(Cow::Owned);
            let stored = pieces.iter().chain(&reconstruction).map(|p| p.len()).sum::<usize>();
            image_bits += stored as f64 * 8.0;
            let small: Vec<Chunk<Cow<'_, [u8]>>> = if image.bytes.is_empty() { &[][..] } else { &image.previews }
                .iter()
                .zip(0..)
                .map(|(bytes, number)| Chunk::preview(0, &Preview { image: i, number, bytes }).map(Cow::Owned))
                .collect();
            preview_bits += small.iter().map(|p| p.payload.len()).sum::<usize>() as f64 * 8.0;
            if !image.bytes.is_empty() {
                let name = if image.name.is_empty() { format!("image {i}") } else { image.name.clone() };
                reports.push(ImageReport {
                    name,
                    bytes: image.bytes.len() as u64,
                    stored: stored as u64,
                    previews: small.iter().map(|p| p.payload.len() as u64).collect(),
                    pieces: count,
                    way,
                });
            }
            let piece = |(k, payload)| Chunk::image(full_level, i, k, count as u32, payload);
            images.push((0u32..).zip(pieces).map(piece).collect());
            previews.push(small);
            reconstructions.extend(reconstruction.map(|r| Chunk::reconstruction(full_level, i, r).with_memory(memory)));
        }
        drop(span);
        let pictures = schedule::Pictures { appearance: Some(appearance), previews, images, reconstructions };
        chunks = schedule::order(chunks, pictures, options.schedule);
    }
    let mut announced = dressed.header;
    for (layer, &wedges) in announced.layers.iter_mut().zip(&replayed.wedges) {
        layer.wedges = wedges;
    }
    let quantum = lattice.step * 3f64.sqrt() / 2.0;
    let header = Header {
        attributes: announced,
        required: 0,
        optional: 0,
        lattice,
        position_bits: match options.quantization {
            Quantization::Bits(b) => Some(b),
            Quantization::Step { .. } => None,
        },
        bounds,
        components,
        aside: aside_counts,
        levels: replayed
            .levels
            .iter()
            .enumerate()
            .map(|(l, &(vertices, elements, corners, shift, error))| {
                let missing = if l as u32 == full_level { 0.0 } else { missing };
                let error = ErrorBound::covering(error * lattice.step + quantum + missing, lattice.step);
                LevelInfo { vertices, elements, corners, shift, error }
            })
            .collect(),
    };
    let all: Vec<Chunk<&[u8]>> = chunks.iter().map(Chunk::borrowed).collect();
    let bytes = container::write_borrowed(&header, &all)?;
    let payload: usize = all.iter().map(|c| c.payload.len()).sum();
    let account = replayed.account;
    let report = EncodeReport {
        vertices: slots,
        faces: mesh.face_count(),
        components: components as usize,
        levels: header.levels.len(),
        bits: BitsByKind {
            header: (bytes.len() - payload) as f64 * 8.0,
            points: account.points,
            connectivity: account.splits.connectivity,
            geometry: account.splits.geometry,
            aside: aside_bits,
            attributes: attribute_bits,
            appearance: appearance_bits,
            images: image_bits,
            previews: preview_bits,
        },
        edges_weighed: history.edges_weighed,
        weighed_by: history.weighed_by,
        fallback: history.fallback,
        weigh_seconds: history.seconds[0],
        select_seconds: history.seconds[1],
        collapse_seconds: history.seconds[2],
        encode_seconds: clock.elapsed().as_secs_f64(),
        images: reports,
    };
    Ok(Encoded { bytes, map: replayed.number, report })
}

/// The elements that the complex can hold, those that repeat a vertex, and their numbers in the mesh.
fn part(mesh: &Mesh) -> (Faces, Faces, [Vec<u32>; 2]) {
    let (mut faces, mut aside) = (Faces::new(), Faces::new());
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
            aside.push(f)
        } else {
            faces.push(f)
        }
        of[repeats as usize].push(i as u32);
    }
    (faces, aside, of)
}

/// Values of elements aside in the order and rotation in which they are coded.
fn turn(lone: &ExtraAttributes, aside: &Faces, origins: &[Origin]) -> ExtraAttributes {
    let corners = |list: &Vec<Option<Value>>| {
        let mut out = Vec::with_capacity(list.len());
        for o in origins {
            let own = &list[aside.start[o.element as usize] as usize..aside.start[o.element as usize + 1] as usize];
            out.extend((0..own.len()).map(|k| own[(o.rotation as usize + k) % own.len()]));
        }
        out
    };
    let labels = if lone.labels.is_empty() {
        Vec::new()
    } else {
        origins.iter().map(|o| lone.labels[o.element as usize]).collect()
    };
    ExtraAttributes { labels, corners: lone.corners.iter().map(corners).collect(), isolated: Vec::new() }
}

/// For each layer the values of the vertices that no element names, in the order of the full level.
fn isolated(
    mesh: &Mesh,
    known: &[(u32, u32, Value)],
    layers: usize,
    number: &dyn Fn(u32) -> u32,
) -> Vec<Vec<Option<Value>>> {
    let mut used = vec![false; mesh.positions.len()];
    mesh.corners.iter().for_each(|&v| used[v as usize] = true);
    let mut order: Vec<(u32, u32)> =
        (0..used.len() as u32).filter(|&v| !used[v as usize]).map(|v| (number(v), v)).collect();
    order.sort_unstable();
    let value = |v: u32, layer: u32| {
        let at = known.binary_search_by_key(&(v, layer), |k| (k.0, k.1)).ok()?;
        known.get(at).map(|k| k.2)
    };
    (0..layers as u32).map(|layer| order.iter().map(|&(_, v)| value(v, layer)).collect()).collect()
}

/// How far the points of elements that repeat a vertex are at most from vertices, or from the rest of the mesh.
fn extent_degenerate(mesh: &Mesh, faces: &Faces, aside: &Faces) -> f64 {
    if aside.is_empty() {
        return 0.0;
    }
    let mut edges: HashSet<[u32; 2]> = HashSet::new();
    for f in aside.iter() {
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
    aside.iter().map(reach).fold(0.0, f64::max) * (1.0 + 1e-9)
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
