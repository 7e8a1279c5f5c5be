//! The decoder's front door, made for viewers: hand in bytes as they arrive, ask for the next level.
//!
//! Integer arithmetic alone decides what comes out; only [`Decoder::positions`] turns lattice points into coordinates. Counts are
//! checked against the memory limit before anything is allocated by them.

use crate::format::attributes::{ExtraAttributes, Scheme, code_base_layers, code_extra_attributes};
use crate::format::coder::range;
use crate::format::complex::{Attributes, Batch, Faces, Level, Side, Star, Wanted, refine, refine_attributes, touched};
use crate::format::container::{ChunkInfo, ContainerError, Event, FileIndex, Kind, LevelInfo, Reader};
use crate::format::degenerate::code_degenerate;
use crate::format::elements::code_elements;
use crate::format::points::code_points;
use crate::format::split::neighbourhood::LevelGeometry;
use crate::format::split::segment::{InvalidStream, Scratch, Stream};
use crate::format::stream::{Account, State, Task, code_segment, join, segment_range, segments};
use crate::mesh::{Appearance, Layer, Mesh, NO_VALUE};
use crate::parallel;
use std::sync::atomic::AtomicU64;
use thiserror::Error;

mod images;

/// What the user chooses.
#[derive(Clone, Debug, PartialEq)]
pub struct DecodeOptions {
    /// The most memory that decoding may take, in bytes; counts are checked against it before anything is allocated.
    pub memory_limit: u64,
}

impl Default for DecodeOptions {
    fn default() -> Self {
        DecodeOptions { memory_limit: 4 << 30 }
    }
}

/// What became of a request for the next level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// This level is ready.
    Level(u32),
    /// The bytes at hand end before the next level does.
    NeedBytes,
    /// The full level was reached before.
    Full,
}

/// Why a stream could not be decoded.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The container is damaged, of another version, or asks for more memory than allowed.
    #[error(transparent)]
    Container(#[from] ContainerError),
    /// A chunk passes its checksum and still makes no sense.
    #[error("level {level}: {what}; the file was made by a faulty or hostile encoder")]
    Corrupt {
        /// The level being decoded.
        level: u32,
        /// What is wrong.
        what: &'static str,
    },
}

/// A coder in the middle of a run of small levels.
#[derive(Debug)]
struct Run {
    coder: range::Decoder<'static>,
    last: u32,
}

/// A decoder in the middle of a stream.
///
/// ```
/// # use lodestream::format::decoder::{DecodeOptions, Decoder, Step};
/// # fn show(_: &[[f64; 3]], _: &lodestream::format::complex::Faces) {}
/// # fn main() -> Result<(), lodestream::format::decoder::DecodeError> {
/// # let pieces: Vec<Vec<u8>> = Vec::new();
/// let mut decoder = Decoder::new(DecodeOptions::default());
/// for bytes in pieces {
///     decoder.push(&bytes);
///     while let Step::Level(_) = decoder.next_level()? {
///         show(&decoder.positions(), decoder.faces());
///     }
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Decoder {
    options: DecodeOptions,
    reader: Reader,
    /// The rows of the levels, once the front is there.
    rows: Vec<LevelInfo>,
    state: State,
    run: Option<Run>,
    /// Segments of the next level that have arrived.
    waiting: Vec<Vec<u8>>,
    at: Option<u32>,
    level: Level,
    star: Star,
    parents: Vec<u32>,
    has_aside: bool,
    aside: Option<Faces>,
    scheme: Scheme,
    attributes: Attributes,
    has_lone: bool,
    lone: Option<ExtraAttributes>,
    /// The payload of the lone values, until the level that they belong to is there.
    late: Option<Vec<u8>>,
    appearance: Option<Appearance>,
    /// Bytes of memory that materials take beyond what their chunk announced.
    held: u64,
    /// Of each image how many pieces are here, and how many there are.
    pieces: Vec<[u32; 2]>,
    /// Of each image the preview that it shows.
    previews: Vec<Option<images::Shown>>,
    /// Bytes of images, or of their previews, that are here.
    image_bytes: u64,
    failed: Option<DecodeError>,
}

/// Coordinates of every level stay within ±`LIMIT` lattice steps.
const LIMIT: i64 = 1 << 26;

impl Decoder {
    /// A decoder that has seen nothing yet.
    pub fn new(options: DecodeOptions) -> Self {
        Decoder {
            options,
            reader: Reader::new(),
            rows: Vec::new(),
            state: State::default(),
            run: None,
            waiting: Vec::new(),
            at: None,
            level: Level { positions: Vec::new(), faces: Faces::new(), shift: 0 },
            star: Star::default(),
            parents: Vec::new(),
            has_aside: false,
            aside: None,
            scheme: Scheme::default(),
            attributes: Attributes::default(),
            has_lone: false,
            lone: None,
            late: None,
            appearance: None,
            held: 0,
            pieces: Vec::new(),
            previews: Vec::new(),
            image_bytes: 0,
            failed: None,
        }
    }

    /// Hand in the next bytes of the file.
    pub fn push(&mut self, bytes: &[u8]) {
        self.reader.push(bytes);
    }

    /// Header and tables of the file, `None` until their bytes are there.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn front(&mut self) -> Result<Option<&FileIndex>, DecodeError> {
        Ok(self.reader.front()?)
    }

    /// Say that no more bytes will come.
    ///
    /// # Errors
    /// [`ContainerError::Truncated`] when the file goes on behind what was handed in.
    pub fn finish(&mut self) -> Result<(), DecodeError> {
        Ok(self.reader.finish()?)
    }

    /// Decode the next level, if its bytes are there.
    ///
    /// # Errors
    /// [`DecodeError`]; the decoder then stays at the level it had reached, and says the same again.
    pub fn next_level(&mut self) -> Result<Step, DecodeError> {
        if let Some(error) = &self.failed {
            return Err(error.clone());
        }
        let step = self.step();
        if let Err(error) = &step {
            self.failed = Some(error.clone());
        }
        step
    }

    fn step(&mut self) -> Result<Step, DecodeError> {
        if self.rows.is_empty() {
            match self.reader.front()? {
                None => return Ok(Step::NeedBytes),
                Some(front) => {
                    front.check_memory(0, self.options.memory_limit)?;
                    self.rows = front.header().levels.clone();
                    self.has_aside = front.header().aside.elements > 0;
                    self.has_lone = front.header().attributes.lone;
                    self.scheme = front.header().attributes.scheme();
                    self.state = State::new(&self.scheme);
                }
            }
        }
        let next = self.at.map_or(0, |l| l + 1);
        let full = self.rows.len() as u32 - 1;
        if next > full {
            // Images may follow the last level.
            while let Event::Chunk { info, payload, .. } = self.reader.next_chunk()? {
                let payload = payload.to_vec();
                self.take_picture(full, info, payload)?;
            }
            return Ok(Step::Full);
        }
        loop {
            let parts = self.run.is_some()
                || (!self.waiting.is_empty() && self.waiting.len() == segments(self.level.positions.len()));
            // The full level is there once what travels aside is.
            let aside =
                next < full || ((!self.has_aside || self.aside.is_some()) && (!self.has_lone || self.late.is_some()));
            if parts && aside {
                break;
            }
            let (info, payload) = match self.reader.next_chunk()? {
                Event::NeedBytes(_) => return Ok(Step::NeedBytes),
                Event::End => return Err(corrupt(next, "the chunks end before the levels do")),
                Event::Chunk { info, payload, .. } => (info, payload.to_vec()),
            };
            match info.kind {
                Kind::Base | Kind::Levels if !parts && info.first_level == next => {
                    self.run = Some(Run { coder: range::Decoder::new(payload), last: info.last_level });
                }
                Kind::Segment if !parts && info.first_level == next && info.last_level == next => {
                    if info.segments as usize != segments(self.level.positions.len()) {
                        return Err(corrupt(next, "a number of segments that the level does not have"));
                    }
                    self.waiting.push(payload);
                }
                Kind::Aside => {
                    self.afford(full)?;
                    self.aside = Some(self.decode_degenerate(payload)?);
                }
                // It speaks of vertices of the level: it waits until that is there.
                Kind::ExtraAttributes => self.late = Some(payload),
                Kind::Appearance | Kind::Image | Kind::Recipe | Kind::Preview => {
                    self.take_picture(next, info, payload)?;
                }
                Kind::Other(_) => {}
                _ => return Err(corrupt(next, "a chunk of another level")),
            }
        }
        self.afford(next)?;
        if next == 0 {
            self.decode_base()?;
        } else {
            self.decode_batch(next)?;
        }
        let row = self.rows[next as usize];
        let found = (self.level.positions.len(), self.level.faces.len(), self.level.faces.corners.len());
        if found != (row.vertices as usize, row.elements as usize, row.corners as usize) {
            return Err(corrupt(next, "other counts than the header announces"));
        }
        let limit = LIMIT >> self.level.shift;
        let far = parallel::map(self.level.positions.chunks(1 << 15).collect(), |run: &[[i32; 3]]| {
            run.as_flattened().iter().fold(0, |far, c| far.max(c.unsigned_abs()))
        });
        if far.iter().any(|&c| c as i64 > limit) {
            return Err(corrupt(next, "coordinates out of range"));
        }
        self.check_wedges(next, next == full)?;
        if next == full
            && let Some(payload) = self.late.take()
        {
            self.lone = Some(self.decode_extra_attributes(payload)?);
        }
        self.at = Some(next);
        Ok(Step::Level(next))
    }

    /// Check that a level fits, beside the materials that are here already.
    fn afford(&mut self, level: u32) -> Result<(), DecodeError> {
        let (held, images, limit) = (self.held, self.image_bytes, self.options.memory_limit);
        let Some(front) = self.reader.front()? else { return Ok(()) };
        // Images that were fetched apart are here before their turn.
        let early = images.saturating_sub(front.image_bytes(level));
        let needed = front.memory(level).saturating_add(held).saturating_add(early);
        if needed > limit { Err(ContainerError::MemoryLimit { needed, limit }.into()) } else { Ok(()) }
    }

    /// The most wedges of each layer.
    fn max_wedges(&mut self) -> Result<Vec<u32>, DecodeError> {
        let front = self.reader.front()?;
        Ok(front.map_or(Vec::new(), |f| f.header().attributes.layers.iter().map(|l| l.wedges).collect()))
    }

    /// Layers have as many wedges as the header announces.
    fn check_wedges(&mut self, level: u32, full: bool) -> Result<(), DecodeError> {
        let Some(front) = self.reader.front()? else { return Ok(()) };
        for (layer, row) in self.attributes.layers.iter().zip(&front.header().attributes.layers) {
            let announced = row.wedges as usize;
            if layer.len() > announced || (full && layer.len() != announced) {
                return Err(corrupt(level, "another number of wedges than the header announces"));
            }
        }
        Ok(())
    }

    /// For each vertex of the level at hand whether no element names it, aside or not.
    fn isolated(&self) -> Vec<u32> {
        let mut used = vec![false; self.level.positions.len()];
        let aside = self.aside.as_ref().map_or(&[][..], |a| &a.corners);
        self.level.faces.corners.iter().chain(aside).for_each(|&v| used[v as usize] = true);
        (0..used.len() as u32).filter(|&v| !used[v as usize]).collect()
    }

    /// Values of elements aside and of isolated vertices.
    fn decode_extra_attributes(&self, payload: Vec<u8>) -> Result<ExtraAttributes, DecodeError> {
        let full = self.rows.len() as u32 - 1;
        let mut coder = range::Decoder::new(payload);
        let mut lone = ExtraAttributes::default();
        let none = Faces::new();
        let aside = self.aside.as_ref().unwrap_or(&none);
        let isolated = self.isolated().len();
        code_extra_attributes(&mut coder, &self.scheme, aside, isolated, &mut lone)
            .map_err(|InvalidStream(what)| corrupt(full, what))?;
        if coder.overrun() {
            return Err(corrupt(full, "values that end too early"));
        }
        Ok(lone)
    }

    /// Level 0: points, then the elements on them.
    fn decode_base(&mut self) -> Result<(), DecodeError> {
        let row = self.rows[0];
        let most = self.max_wedges()?;
        let run = self.run.as_mut().ok_or(corrupt(0, "a base without a chunk of its own"))?;
        let mut level = Level { positions: Vec::new(), faces: Faces::new(), shift: row.shift };
        code_points(&mut run.coder, &mut level.positions, row.vertices as usize);
        code_elements(&mut run.coder, &level.positions, &mut level.faces, row.corners as usize)
            .map_err(|_| corrupt(0, "elements that contradict the header or themselves"))?;
        self.parents = vec![crate::format::complex::NONE; level.positions.len()];
        self.star = Star::with_next(level.positions.len(), &level.faces);
        let count = level.positions.len();
        code_base_layers(&mut run.coder, &self.scheme, count, &level.faces, &mut self.attributes, &most)
            .map_err(|InvalidStream(what)| corrupt(0, what))?;
        self.level = level;
        self.end_run(0)
    }

    /// The batch that leads to `next`.
    fn decode_batch(&mut self, next: u32) -> Result<(), DecodeError> {
        let (row, before) = (self.rows[next as usize], self.rows[next as usize - 1]);
        let most = self.max_wedges()?;
        let view = LevelGeometry::with(&self.level, &self.star, &self.attributes, &self.scheme);
        let bias = ((self.rows.len() as u32 - 1 - next) & 1) as i32;
        let n = self.level.positions.len();
        let more =
            (row.vertices.saturating_sub(before.vertices) as u64, row.elements.saturating_sub(before.elements) as u64);
        let pieces = if self.run.is_some() { 1 } else { self.waiting.len() };
        // Segments decode side by side: what they list together is held to the header's count.
        let room = AtomicU64::new(more.1);
        let wedges: Vec<AtomicU64> = most
            .iter()
            .zip(&self.attributes.layers)
            .map(|(&most, layer)| AtomicU64::new((most as u64).saturating_sub(layer.len() as u64)))
            .collect();
        let task = |k: usize| {
            let r = segment_range(n, k, pieces);
            Task {
                view,
                range: (r.start, r.end),
                first: k == 0,
                more,
                room: &room,
                wedges: &wedges,
                shift: row.shift,
                bias,
            }
        };
        let nonsense = |InvalidStream(what)| corrupt(next, what);
        let batch = if let Some(run) = &mut self.run {
            let mut batch = Batch::default();
            let (mut scratch, mut account) = (Scratch::default(), Account::default());
            code_segment(
                &mut run.coder,
                &mut self.state,
                &mut scratch,
                &task(0),
                &mut Stream,
                &mut batch,
                &mut account,
            )
            .map_err(nonsense)?;
            batch
        } else {
            let state = &self.state;
            let items: Vec<_> = std::mem::take(&mut self.waiting).into_iter().enumerate().collect();
            let parts = parallel::map(items, |(k, payload)| {
                let mut coder = range::Decoder::new(payload);
                let mut state = state.clone();
                let mut batch = Batch::default();
                let (mut scratch, mut account) = (Scratch::default(), Account::default());
                code_segment(&mut coder, &mut state, &mut scratch, &task(k), &mut Stream, &mut batch, &mut account)?;
                if coder.overrun() {
                    return Err(InvalidStream("a segment that ends too early"));
                }
                Ok((batch, (k == 0).then_some(state)))
            });
            let mut batches = Vec::with_capacity(parts.len());
            let mut first = None;
            for part in parts {
                let (batch, state) = part.map_err(nonsense)?;
                first = first.or(state);
                batches.push(batch);
            }
            if let Some(state) = first {
                self.state = state;
            }
            join(batches, &self.level, &self.scheme.widths)
        };
        // Segments do not see each other: what the operator asks for is checked on the whole.
        if batch.len() as u64 + batch.new_vertices.len() as u64 != more.0 {
            return Err(corrupt(next, "other counts than the header announces"));
        }
        let inserted = batch.triangles.len() as u64 + batch.edges.iter().map(|&e| e as u64).sum::<u64>();
        let grown = batch.sides.iter().filter(|&&s| matches!(s, Side::Grow12 | Side::Grow21)).count() as u64;
        let corners = grown + 2 * inserted + batch.triangles.len() as u64;
        if (inserted, corners) != (more.1, row.corners.saturating_sub(before.corners) as u64) {
            return Err(corrupt(next, "other counts than the header announces"));
        }
        let more_to_come = (next as usize) + 1 < self.rows.len();
        let bare = self.scheme.is_empty();
        let touched = if bare { Vec::new() } else { touched(&self.level.faces, &self.star, &batch) };
        let refined = refine(
            &self.level,
            std::mem::take(&mut self.star),
            &batch,
            bias,
            Wanted { star: more_to_come, element: !bare },
        );
        if refined.conflict {
            return Err(corrupt(next, "two splits that share an element"));
        }
        if !bare {
            let coarse = std::mem::take(&mut self.attributes);
            self.attributes = refine_attributes(coarse, &self.level.faces, &touched, &batch, &refined);
        }
        drop(batch);
        self.level = refined.level;
        self.parents = refined.parent;
        if more_to_come {
            self.star = Star::fill(refined.star_start, &self.level.faces, true);
        }
        self.end_run(next)
    }

    /// Let a run go that has served its last level.
    fn end_run(&mut self, level: u32) -> Result<(), DecodeError> {
        if let Some(run) = self.run.take_if(|run| run.last == level)
            && run.coder.overrun()
        {
            return Err(corrupt(level, "a chunk that ends too early"));
        }
        Ok(())
    }

    /// Elements that repeat a vertex.
    fn decode_degenerate(&mut self, payload: Vec<u8>) -> Result<Faces, DecodeError> {
        let full = self.rows.len() as u32 - 1;
        let (vertices, counts) = match self.reader.front()? {
            Some(front) => (front.header().levels[full as usize].vertices, front.header().aside),
            None => return Err(corrupt(full, "elements aside before the header")),
        };
        let mut coder = range::Decoder::new(payload);
        let mut faces = Faces::new();
        code_degenerate(&mut coder, vertices as usize, &mut faces, counts.corners as usize)
            .map_err(|_| corrupt(full, "elements aside that contradict the header or themselves"))?;
        if coder.overrun() || faces.len() != counts.elements as usize || faces.corners.len() != counts.corners as usize
        {
            return Err(corrupt(full, "elements aside that contradict the header"));
        }
        Ok(faces)
    }

    /// The level at hand, `None` before the first.
    pub fn level(&self) -> Option<u32> {
        self.at
    }

    /// Positions of the level at hand, in the units of the model. Where low bits are not known yet, a vertex lies
    /// in the middle of its cell.
    pub fn positions(&mut self) -> Vec<[f64; 3]> {
        let Ok(Some(front)) = self.reader.front() else { return Vec::new() };
        let lattice = front.header().lattice;
        let shift = self.level.shift as u32;
        let (scale, half) = ((1u64 << shift) as f64, ((1u64 << shift) - 1) as f64 / 2.0);
        self.level
            .positions
            .iter()
            .map(|p| std::array::from_fn(|k| lattice.origin[k] + (p[k] as f64 * scale + half) * lattice.step))
            .collect()
    }

    /// Lattice coordinates of the level at hand, in steps of `2^shift`, and its elements.
    pub fn complex(&self) -> &Level {
        &self.level
    }

    /// Elements of the level at hand, without those that travel aside.
    pub fn faces(&self) -> &Faces {
        &self.level.faces
    }

    /// Elements that repeat a vertex; they belong to the full level.
    pub fn aside(&self) -> Option<&Faces> {
        self.aside.as_ref()
    }

    /// For each vertex of the level at hand its vertex in the level before ([`crate::format::complex::NONE`] for a new_vertex). The
    /// children of a split stand side by side.
    pub fn parents(&self) -> &[u32] {
        &self.parents
    }

    /// The level at hand as a mesh, with the elements that travel aside when it is the full one.
    pub fn to_mesh(&mut self) -> Mesh {
        let mut mesh = Mesh {
            positions: self.positions(),
            face_start: self.level.faces.start.clone(),
            corners: self.level.faces.corners.clone(),
            ..Mesh::default()
        };
        let full = self.at.is_some_and(|l| l as usize + 1 == self.rows.len());
        if let (Some(aside), true) = (&self.aside, full) {
            for f in aside.iter() {
                mesh.push_face(f);
            }
        }
        let isolated = if full && self.lone.is_some() { self.isolated() } else { Vec::new() };
        let Ok(Some(front)) = self.reader.front() else { return mesh };
        let announced = &front.header().attributes;
        let lone = self.lone.as_ref().filter(|_| full);
        for (l, (layer, wedges)) in announced.layers.iter().zip(&self.attributes.layers).enumerate() {
            let width = layer.width as usize;
            let mut values = vec![0.0; wedges.len() * width];
            for (out, value) in
                values.chunks_exact_mut(width.max(1)).zip(wedges.values.chunks_exact(wedges.width.max(1)))
            {
                layer.quantizer.restore(layer.kind, value, out);
            }
            let mut out = Layer {
                name: layer.name.clone(),
                kind: layer.kind,
                width: layer.width,
                stored: layer.stored,
                values,
                corners: wedges.corner.clone(),
                isolated: Vec::new(),
            };
            let add = |out: &mut Layer, value: &[i32]| {
                let at = out.values.len();
                out.values.resize(at + width, 0.0);
                layer.quantizer.restore(layer.kind, &value[..wedges.width], &mut out.values[at..]);
                (at / width.max(1)) as u32
            };
            if let Some(lone) = lone {
                for value in lone.corners.get(l).into_iter().flatten() {
                    let i = value.as_ref().map_or(NO_VALUE, |v| add(&mut out, v));
                    out.corners.push(i);
                }
                for (&v, value) in isolated.iter().zip(lone.isolated.get(l).into_iter().flatten()) {
                    if let Some(value) = value {
                        let i = add(&mut out, value);
                        out.isolated.push([v, i]);
                    }
                }
            }
            out.corners.resize(mesh.corners.len(), NO_VALUE);
            mesh.layers.push(out);
        }
        if announced.materials > 0 {
            let material =
                |label: u16| announced.labels.get(label as usize).map_or(NO_VALUE, |l| l.material.wrapping_sub(1));
            let complex = self.level.faces.len();
            mesh.material = if self.attributes.labels.is_empty() {
                vec![material(0); complex]
            } else {
                self.attributes.labels.iter().map(|&l| material(l)).collect()
            };
            let aside = lone.map_or(&[][..], |l| &l.labels);
            let more = mesh.face_count() - complex;
            mesh.material.extend((0..more).map(|f| material(aside.get(f).copied().unwrap_or(0))));
        }
        if let Some(appearance) = &self.appearance {
            mesh.appearance = appearance.clone();
        } else {
            // Its chunk has not arrived: a number alone is no material.
            mesh.material = Vec::new();
        }
        mesh
    }

    /// Hand in the payload of a chunk of materials, or of a preview, piece or reconstruction of an image, that was fetched apart, its checksum verified
    /// ([`FileIndex::payload`], [`FileIndex::check_chunk`]); other kinds, and what is there already, are passed over. Pieces of an image come in
    /// their order, those of different images in any.
    ///
    /// # Errors
    /// [`DecodeError::Corrupt`] for materials that make no sense, and for a piece of an image that comes before
    /// them, or before the pieces that it follows.
    pub fn offer(&mut self, info: ChunkInfo, payload: Vec<u8>) -> Result<(), DecodeError> {
        let level = self.at.unwrap_or(0);
        self.take_picture(level, info, payload)
    }

    /// Labels and wedges of the level at hand, in the order of its elements and corners.
    pub fn attributes(&self) -> &Attributes {
        &self.attributes
    }

    /// Materials, textures and images, as far as they have arrived: an image of which some pieces are here is a whole file of less detail,
    /// one of which none is here is its finest preview, with the media type of that, or empty.
    pub fn appearance(&self) -> Option<&Appearance> {
        self.appearance.as_ref()
    }
}

impl Decoder {
    /// How many images there are, and of how many of them nothing, and not all, has arrived.
    pub fn missing_images(&mut self) -> MissingImages {
        let all = match self.reader.front() {
            Ok(Some(front)) => front.header().attributes.images as usize,
            _ => 0,
        };
        let begun = self.pieces.iter().zip(&self.previews).filter(|(p, shown)| p[0] > 0 || shown.is_some()).count();
        let whole = self.pieces.iter().filter(|p| p[0] > 0 && p[0] == p[1]).count();
        MissingImages { all, none: all.saturating_sub(begun), part: begun - whole }
    }
}

/// What has not arrived of the images of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MissingImages {
    /// How many images there are.
    pub all: usize,
    /// Those of which nothing has arrived.
    pub none: usize,
    /// Those of which a preview or some pieces have arrived, and not all.
    pub part: usize,
}

fn corrupt(level: u32, what: &'static str) -> DecodeError {
    DecodeError::Corrupt { level, what }
}
