//! The order of a file's chunks in which every prefix looks as good as so many bytes can (Caillaud et al. 2016, section 6).
//!
//! [`by_quality`] takes a finished file and writes its chunks in another order; no chunk changes, so any decoder reads the result, and what
//! it decodes to is the same. Levels of the mesh and pieces of the images that are drawn are the two sides of a grid ([`plan`]); what
//! a cell is worth is the mean MS-SSIM of pictures of it against the whole file, from the cameras of [`crate::quality`]. Few cells are drawn
//! (`surface` knows the others from them), and none beyond the level that already looks like the full one. The paper goes greedily by ΔQ/ΔS;
//! with the whole grid known the best path is found instead, so that no other order has a larger area under its curve.
//!
//! Invariants: level 0 and the materials come first; previews of all images that are drawn come before pieces of any, pieces of an image keep
//! their order, and so do levels; images that are not drawn (normal
//! maps, roughness) come when all that is seen is there, reconstructions last. Pictures are drawn on the processor, so the bytes do not depend on
//! the number of threads or a graphics card.

mod draw;
pub mod plan;
mod surface;

use self::draw::Stage;
use self::plan::{Cell, Sizes};
use self::surface::Surface;
use crate::encode::Schedule;
use crate::format::container::{
    self, Chunk, ChunkInfo, ContainerError, FileIndex, Kind, Parsed, Preview, with_chunk, write_borrowed,
};
use crate::format::decoder::DecodeError;
use crate::quality::SsimError;
use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// A step of the grid grows the file by this factor at least, where chunks are small: a shorter one can hardly be seen on the curve.
const LEAST_GROWTH: f64 = 1.2;

/// A level that is as like the full one as this counts as the last that is seen.
const SEEN: f64 = 0.9995;

/// Rounds of planning and measuring what the plan goes through.
const ROUNDS: usize = 3;

/// How closely a file is looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Effort {
    /// 6 views of 192² pixels.
    Low,
    /// 12 views of 256² pixels.
    #[default]
    Normal,
    /// The 42 views of 512² pixels by which quality is measured.
    High,
}

impl Effort {
    /// All of them.
    pub const ALL: [Effort; 3] = [Effort::Low, Effort::Normal, Effort::High];

    /// Cameras, and pixels of a picture's side.
    pub fn views(self) -> (usize, u32) {
        match self {
            Effort::Low => (6, 192),
            Effort::Normal => (12, 256),
            Effort::High => (42, 512),
        }
    }
}

impl fmt::Display for Effort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Effort::Low => "low",
            Effort::Normal => "normal",
            Effort::High => "high",
        })
    }
}

impl FromStr for Effort {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = Effort::ALL.into_iter().find(|e| e.to_string() == name);
        found.ok_or_else(|| format!("{name:?} is no effort; use low, normal or high"))
    }
}

/// An order of chunks, as users name it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// One that the encoder follows.
    Fixed(Schedule),
    /// That of [`by_quality`].
    Quality,
}

impl Default for Order {
    fn default() -> Self {
        Order::Fixed(Schedule::default())
    }
}

impl fmt::Display for Order {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Order::Fixed(schedule) => schedule.fmt(f),
            Order::Quality => f.write_str("quality"),
        }
    }
}

impl FromStr for Order {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        if name == "quality" {
            return Ok(Order::Quality);
        }
        name.parse().map(Order::Fixed).map_err(|why| format!("{why}, or quality"))
    }
}

/// What the caller chooses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// How closely the file is looked at.
    pub effort: Effort,
    /// Bytes of decoded images that are kept for later looks; what one look takes is held beside them. It changes how long it takes, not what comes out.
    pub image_cache: u64,
    /// The most memory that decoding it may take, in bytes.
    pub memory_limit: u64,
}

impl Default for Options {
    fn default() -> Self {
        Options { effort: Effort::default(), image_cache: 512 << 20, memory_limit: 4 << 30 }
    }
}

/// Why a file could not be put in order.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ScheduleError {
    /// It is not a sound file.
    #[error(transparent)]
    Container(#[from] ContainerError),
    /// It does not decode.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// Its pictures cannot be compared.
    #[error(transparent)]
    Pictures(#[from] SsimError),
}

/// A point of a file's curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Bytes from the beginning of the file.
    pub bytes: u64,
    /// The level that is whole by then.
    pub level: u32,
    /// Pieces of images that are there by then, of those that are drawn.
    pub pieces: usize,
    /// Previews of these images that are there by then.
    pub previews: usize,
    /// The mean MS-SSIM against the whole file, measured or estimated from neighbours.
    pub quality: f64,
}

/// A file in order.
#[derive(Clone, Debug)]
pub struct Scheduled {
    /// The file.
    pub bytes: Vec<u8>,
    /// Its curve; one point for a file without images that are drawn.
    pub curve: Vec<Point>,
    /// How many states of the mesh and its images were drawn.
    pub drawn: usize,
    /// Areas under the curves of all orders on a logarithmic axis of bytes, 1 for a file that is perfect from its first byte.
    pub areas: Areas,
}

/// See [`Scheduled::areas`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Areas {
    /// The order that was chosen.
    pub chosen: f64,
    /// By the core paper's greedy rule.
    pub greedy: f64,
    /// The mesh before its images.
    pub mesh_first: f64,
    /// The images before the mesh.
    pub texture_first: f64,
    /// In turns.
    pub linear: f64,
}

/// Put the chunks of `file` in the order in which its prefixes look best. A file without images that are drawn keeps its order. `progress` gets
/// the number of states that were drawn, and about how many there will be.
///
/// # Errors
/// [`ScheduleError`] for a file that is damaged or exceeds the memory limit.
pub fn by_quality(
    file: &[u8],
    options: &Options,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Scheduled, ScheduleError> {
    with_trailer(file, options, None, progress)
}

/// [`by_quality`], with a chunk behind all others, made for the number of the full level, that plays no part in what is planned.
pub(super) fn with_trailer(
    file: &[u8],
    options: &Options,
    trailer: Option<&dyn Fn(u32) -> Chunk>,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Scheduled, ScheduleError> {
    let front = match FileIndex::parse(file)? {
        Parsed::Ready(front) => front,
        Parsed::NeedBytes(need) => {
            return Err(ContainerError::Truncated { have: file.len() as u64, need, exact: false, level: None }.into());
        }
    };
    front.check_length(file.len() as u64)?;
    let previews = previews(file, &front)?;
    let mut stage = Stage::new(file, &front, &previews, options)?;
    let layout = Layout::new(&front, &previews, stage.shown());
    let mut sizes = layout.sizes(&front);
    if sizes.images.len() < 2 {
        let curve =
            vec![Point { bytes: file.len() as u64, level: front.full_level(), pieces: 0, previews: 0, quality: 1.0 }];
        let bytes = match trailer {
            Some(make) => with_chunk(file, make)?,
            None => file.to_vec(),
        };
        return Ok(Scheduled { bytes, curve, drawn: 0, areas: Areas::default() });
    }
    // The table takes a few bytes more or less in another order: what is planned does not depend on where the file comes from.
    let payload = sizes.base;
    sizes.base += layout.front_length(file, &front, &plan::mesh_first(&sizes))?;
    let last = sizes.last();
    let expected = 3 * (last.0 + last.1);
    let mut report = |drawn: usize| progress(drawn.min(expected), expected);

    // Rows until one that looks like the full level, first with all images.
    let (resolved, rows) = stage.first_resolved(&layout, last, SEEN, &mut report)?;
    let mut surface = Surface::new(last, resolved);
    surface.add(rows);
    let mut measure = |surface: &mut Surface, stage: &mut Stage<'_>, cells: Vec<Cell>| -> Result<(), ScheduleError> {
        let mut cells: Vec<Cell> = cells.into_iter().map(|c| surface.measurable(c)).collect();
        cells.sort_unstable();
        cells.dedup();
        cells.retain(|&c| !surface.knows(c));
        let measured = stage.measure(&layout, &cells, &mut report)?;
        surface.add(measured);
        Ok(())
    };
    let borders = surface.borders();
    measure(&mut surface, &mut stage, borders)?;
    let linear = plan::linear(&sizes);
    measure(&mut surface, &mut stage, linear.clone())?;
    let mut known = vec![plan::mesh_first(&sizes), plan::texture_first(&sizes), linear];
    for _ in 0..ROUNDS {
        let path = plan::best(&sizes, |c| surface.quality(c));
        if known.contains(&path) {
            break;
        }
        measure(&mut surface, &mut stage, path.clone())?;
        known.push(path);
    }
    let area = |path: &[Cell]| plan::area(&sizes, path, |c| surface.quality(c));
    let chosen = known.iter().max_by(|a, b| area(a).total_cmp(&area(b))).cloned().unwrap_or_default();
    let areas = Areas {
        chosen: area(&chosen),
        greedy: area(&plan::greedy(&sizes, |c| surface.quality(c))),
        mesh_first: area(&known[0]),
        texture_first: area(&known[1]),
        linear: area(&known[2]),
    };
    let last = trailer.map(|make| make(front.full_level()));
    let mut chunks = layout.chunks(file, &front, &chosen)?;
    chunks.extend(last.as_ref().map(Chunk::borrowed));
    let bytes = write_borrowed(front.header(), &chunks)?;
    let base = front_length(&bytes)? + payload;
    let curve = chosen.iter().map(|&cell| {
        let there =
            |kind| layout.pieces[..cell.1].iter().flatten().filter(|&&i| front.chunks()[i].kind == kind).count();
        Point {
            bytes: base + sizes.at(cell) - sizes.base,
            level: layout.levels[cell.0],
            pieces: there(Kind::Image),
            previews: there(Kind::Preview),
            quality: surface.quality(cell),
        }
    });
    let curve = curve.collect();
    progress(expected, expected);
    Ok(Scheduled { bytes, curve, drawn: stage.drawn(), areas })
}

/// Bytes before the first chunk.
fn front_length(file: &[u8]) -> Result<u64, ContainerError> {
    Ok(match FileIndex::parse(file)? {
        Parsed::Ready(front) => front.length(),
        Parsed::NeedBytes(need) => need,
    })
}

/// Of chunks that are previews of images that are there: the image, and the number of the preview.
type Previews = BTreeMap<usize, (usize, u32)>;

fn previews(file: &[u8], front: &FileIndex) -> Result<Previews, ContainerError> {
    let mut out = Previews::new();
    for (i, _) in front.chunks().iter().enumerate().filter(|(_, c)| c.kind == Kind::Preview) {
        let preview = front.payload(file, i)?.and_then(Preview::of);
        if let Some(p) = preview.filter(|p| p.image < front.header().attributes.images) {
            out.insert(i, (p.image as usize, p.number));
        }
    }
    Ok(out)
}

/// The chunks of a file as steps.
#[derive(Debug)]
struct Layout {
    /// Level 0, what is coded with it, and the materials.
    first: Vec<usize>,
    /// Chunks of each step of the mesh.
    mesh: Vec<Vec<usize>>,
    /// The level that is there after so many steps of the mesh.
    levels: Vec<u32>,
    /// Chunks of each step of the images that are drawn: previews, then pieces.
    pieces: Vec<Vec<usize>>,
    /// Images that are not drawn, reconstructions, and what else stands in the file.
    rest: Vec<usize>,
}

impl Layout {
    fn new(front: &FileIndex, previews: &Previews, drawn: &[bool]) -> Self {
        let chunks = front.chunks();
        let is_drawn = |image: usize| drawn.get(image).copied().unwrap_or(false);
        let (mut first, mut mesh, mut late, mut rest) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let (mut seen, mut unseen) = (Vec::new(), Vec::new());
        let (mut small, mut unseen_small) = (Vec::new(), Vec::new());
        for (i, c) in chunks.iter().enumerate() {
            match c.kind {
                Kind::Base | Kind::Appearance => first.push(i),
                // Segments of a level stay together.
                Kind::Segment if c.segment > 0 => match mesh.last_mut() {
                    Some(group) => Vec::push(group, i),
                    None => mesh.push(vec![i]),
                },
                Kind::Levels | Kind::Segment => mesh.push(vec![i]),
                Kind::Degenerate | Kind::ExtraAttributes => late.push(i),
                Kind::Image if is_drawn(c.image as usize) => seen.push(i),
                Kind::Image => unseen.push(i),
                Kind::Preview => match previews.get(&i) {
                    Some(&(image, _)) if is_drawn(image) => small.push(i),
                    Some(_) => unseen_small.push(i),
                    None => rest.push(i),
                },
                Kind::Reconstruction | Kind::Other(_) => rest.push(i),
            }
        }
        first.sort_by_key(|&i| chunks[i].kind != Kind::Base);
        match mesh.last_mut() {
            Some(group) => group.extend(late),
            None => first.extend(late),
        }
        let base: u64 = front.length() + first.iter().map(|&i| chunks[i].length).sum::<u64>();
        let by_turns = |pieces: Vec<usize>| turns(chunks, pieces);
        let single = |pieces: Vec<usize>| pieces.into_iter().map(|i| vec![i]).collect();
        let mesh = bundle(chunks, base, mesh);
        // The coarsest of all images first.
        let by_number = |i: &usize| previews.get(i).map(|&(image, number)| (number, image));
        small.sort_by_key(by_number);
        unseen_small.sort_by_key(by_number);
        // A preview that waited for a piece would be none.
        let mut pieces = bundle(chunks, base, single(small));
        pieces.extend(bundle(chunks, base, single(by_turns(seen))));
        let start = first.iter().map(|&i| chunks[i].last_level).max().unwrap_or(0);
        let levels = std::iter::once(start)
            .chain(mesh.iter().map(|group| group.iter().map(|&i| chunks[i].last_level).max().unwrap_or(0)))
            .collect();
        let rest = unseen_small.into_iter().chain(by_turns(unseen)).chain(rest).collect();
        Layout { first, mesh, levels, pieces, rest }
    }

    /// Without the bytes before the first chunk.
    fn sizes(&self, front: &FileIndex) -> Sizes {
        let bytes = |group: &[usize]| group.iter().map(|&i| front.chunks()[i].length).sum::<u64>();
        let sums = |groups: &[Vec<usize>]| {
            let mut sum = 0;
            let rest = groups.iter().map(|group| {
                sum += bytes(group);
                sum
            });
            std::iter::once(0).chain(rest).collect()
        };
        Sizes { base: bytes(&self.first), mesh: sums(&self.mesh), images: sums(&self.pieces) }
    }

    /// Bytes before the first chunk of the file with its chunks along a path.
    fn front_length(&self, file: &[u8], front: &FileIndex, path: &[Cell]) -> Result<u64, ScheduleError> {
        let chunks = self.chunks(file, front, path)?;
        Ok(container::front_of(front.header(), &chunks)?.len() as u64)
    }

    /// The chunks of the file along a path.
    fn chunks<'f>(
        &self,
        file: &'f [u8],
        front: &FileIndex,
        path: &[Cell],
    ) -> Result<Vec<Chunk<&'f [u8]>>, ScheduleError> {
        let steps = path.windows(2).flat_map(|pair| match (pair[0], pair[1]) {
            ((l, _), (m, _)) if m > l => &self.mesh[l],
            ((_, s), _) => &self.pieces[s],
        });
        let mut chunks: Vec<Chunk<&[u8]>> = Vec::with_capacity(front.chunks().len());
        let mut level = 0;
        for &index in self.first.iter().chain(steps).chain(&self.rest) {
            let payload = front.payload(file, index)?.unwrap_or_default();
            let mut chunk = front.chunks()[index].chunk(payload);
            match chunk.kind {
                // Where it stands.
                Kind::Appearance | Kind::Image | Kind::Reconstruction | Kind::Preview => {
                    (chunk.first_level, chunk.last_level) = (level, level)
                }
                Kind::Other(_) => {}
                _ => level = chunk.last_level,
            }
            chunks.push(chunk);
        }
        Ok(chunks)
    }
}

/// Pieces of several images in turns, each image as far through its bytes as the others.
fn turns(chunks: &[ChunkInfo], mut pieces: Vec<usize>) -> Vec<usize> {
    pieces.sort_by_key(|&i| (chunks[i].image, chunks[i].segment));
    let mut keyed: Vec<(u128, usize)> = Vec::with_capacity(pieces.len());
    for image in pieces.chunk_by(|&a, &b| chunks[a].image == chunks[b].image) {
        let total = image.iter().map(|&i| u128::from(chunks[i].length)).sum::<u128>().max(1);
        let mut done = 0u128;
        for &i in image {
            done += u128::from(chunks[i].length);
            // Fractions of 2^64.
            keyed.push(((done << 64) / total, i));
        }
    }
    // Stable: pieces of an image keep their order.
    keyed.sort_by_key(|&(share, _)| share);
    keyed.into_iter().map(|(_, i)| i).collect()
}

/// Join steps until each makes the file noticeably larger.
fn bundle(chunks: &[ChunkInfo], base: u64, groups: Vec<Vec<usize>>) -> Vec<Vec<usize>> {
    let mut out: Vec<Vec<usize>> = Vec::new();
    let (mut done, mut open) = (base as f64, 0.0);
    let mut group = Vec::new();
    for next in groups {
        open += next.iter().map(|&i| chunks[i].length as f64).sum::<f64>();
        group.extend(next);
        if done + open >= LEAST_GROWTH * done {
            out.push(std::mem::take(&mut group));
            (done, open) = (done + open, 0.0);
        }
    }
    if !group.is_empty() {
        out.push(group);
    }
    out
}
