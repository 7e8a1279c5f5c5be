//! The encoder's front door: a mesh in, the bytes of a `.lods` file and an account of the work out.

use crate::codec::aside::code_aside;
use crate::codec::range;
use crate::complex::{Faces, Level};
use crate::container::{self, AsideCounts, Chunk, ContainerError, ErrorBound, Header, LevelInfo};
use crate::lattice::{Lattice, LatticeError, Quantization};
use crate::mesh::{Mesh, MeshError};
use crate::simplify::{ReplayError, SimplifyOptions, reorder, replay, simplify};
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
}

impl Default for EncodeOptions {
    fn default() -> Self {
        EncodeOptions { quantization: Quantization::Bits(12), lock_borders: false }
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
    /// Level 0, isolated vertices and births.
    pub points: f64,
    /// Which vertices split, and how.
    pub connectivity: f64,
    /// Where the children of the splits lie.
    pub geometry: f64,
    /// Faces that repeat a vertex, which travel aside.
    pub aside: f64,
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
    /// Seconds spent weighing edges.
    pub weigh_seconds: f64,
    /// Seconds spent selecting batches.
    pub select_seconds: f64,
    /// Seconds spent collapsing.
    pub collapse_seconds: f64,
    /// Seconds spent coding.
    pub encode_seconds: f64,
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
    /// The container cannot hold it.
    #[error(transparent)]
    Container(#[from] ContainerError),
    /// A bug of the encoder.
    #[error("{0}; this is a bug of the encoder, please report it with the mesh")]
    Bug(#[from] ReplayError),
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
    mesh.validate()?;
    let lattice = Lattice::choose(options.quantization, &mesh.positions)?;
    let positions = lattice.quantize(&mesh.positions)?;
    let (faces, aside) = part(mesh);
    // What travels aside is not there before the full level: its points are told by its corners.
    let missing = extent_aside(mesh, &faces, &aside);
    let components = components(positions.len(), mesh);
    let bounds = positions.first().map(|&first| {
        positions.iter().fold([first; 2], |[lo, hi], p| {
            [std::array::from_fn(|k| lo[k].min(p[k])), std::array::from_fn(|k| hi[k].max(p[k]))]
        })
    });
    let total = positions.len() as u64;
    let slots = positions.len();
    let mut level = Level { positions, faces, shift: 0 };
    let place = reorder(&mut level);
    let simplify_options = SimplifyOptions { lock_borders: options.lock_borders, ..SimplifyOptions::default() };
    let history = simplify(level, &simplify_options, &|left| {
        progress(Progress { stage: Stage::Simplify, done: total - left, total });
    });
    let clock = Instant::now();
    let mut replayed = replay(&history, slots, &|done| progress(Progress { stage: Stage::Encode, done, total }))?;
    if let Some(place) = place {
        // Back to the caller's numbers.
        replayed.number = place.iter().map(|&v| replayed.number[v as usize]).collect();
    }

    let mut chunks: Vec<Chunk> = replayed
        .pieces
        .into_iter()
        .map(|p| match p.segment {
            Some((s, of)) => Chunk::segment(p.first, s, of, p.payload),
            None if p.first == 0 => Chunk::base(p.last, p.payload),
            None => Chunk::levels(p.first..=p.last, p.payload),
        })
        .collect();
    let full_level = replayed.levels.len() as u32 - 1;
    let mut aside_bits = 0.0;
    let aside_counts = AsideCounts { elements: aside.len() as u32, corners: aside.corners.len() as u32 };
    if !aside.is_empty() {
        let mut coder = range::Encoder::new();
        let mut faces = Faces::new();
        for f in aside.iter() {
            let f: Vec<u32> = f.iter().map(|&v| replayed.number[v as usize]).collect();
            faces.push(&f);
        }
        code_aside(&mut coder, slots, &mut faces, aside.corners.len()).map_err(ReplayError::Base)?;
        let payload = coder.finish();
        aside_bits = payload.len() as f64 * 8.0;
        chunks.push(Chunk::aside(full_level, payload));
    }
    let quantum = lattice.step * 3f64.sqrt() / 2.0;
    let header = Header {
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
    let bytes = container::write(&header, &chunks)?;
    let payload: usize = chunks.iter().map(|c| c.payload.len()).sum();
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
        },
        edges_weighed: history.edges_weighed,
        weigh_seconds: history.seconds[0],
        select_seconds: history.seconds[1],
        collapse_seconds: history.seconds[2],
        encode_seconds: clock.elapsed().as_secs_f64(),
    };
    Ok(Encoded { bytes, map: replayed.number, report })
}

/// The elements that the complex can hold, and those that repeat a vertex.
fn part(mesh: &Mesh) -> (Faces, Faces) {
    let (mut faces, mut aside) = (Faces::new(), Faces::new());
    let mut sorted = Vec::new();
    for f in mesh.faces() {
        let repeats = if f.len() <= 8 {
            (1..f.len()).any(|i| f[..i].contains(&f[i]))
        } else {
            sorted.clear();
            sorted.extend_from_slice(f);
            sorted.sort_unstable();
            sorted.windows(2).any(|w| w[0] == w[1])
        };
        if repeats { aside.push(f) } else { faces.push(f) }
    }
    (faces, aside)
}

/// How far the points of elements that repeat a vertex are at most from vertices, or from the rest of the mesh.
fn extent_aside(mesh: &Mesh, faces: &Faces, aside: &Faces) -> f64 {
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
    let mut root: Vec<u32> = (0..n as u32).collect();
    fn find(root: &mut [u32], mut v: u32) -> u32 {
        while root[v as usize] != v {
            root[v as usize] = root[root[v as usize] as usize];
            v = root[v as usize];
        }
        v
    }
    let mut count = n as u32;
    for f in mesh.faces() {
        for &v in &f[1..] {
            let (a, b) = (find(&mut root, f[0]), find(&mut root, v));
            if a != b {
                root[a.max(b) as usize] = a.min(b);
                count -= 1;
            }
        }
    }
    count
}
