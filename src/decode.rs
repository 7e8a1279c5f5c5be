//! The decoder's front door, made for viewers: hand in bytes as they arrive, ask for the next level.
//!
//! Integer arithmetic alone decides what comes out; only [`Decoder::positions`] turns lattice points into coordinates. Counts are
//! checked against the memory limit before anything is allocated by them.

use crate::codec::aside::code_aside;
use crate::codec::base::code_elements;
use crate::codec::patch::View;
use crate::codec::points::code_points;
use crate::codec::range;
use crate::codec::segment::{Nonsense, Scratch, Stream};
use crate::codec::stream::{Account, State, Task, code_segment, join, segment_range, segments};
use crate::complex::{Batch, Faces, Level, Side, Star, Wanted, refine};
use crate::container::{ContainerError, Event, Front, Kind, LevelInfo, Reader};
use crate::mesh::Mesh;
use crate::par;
use std::sync::atomic::AtomicU64;
use thiserror::Error;

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
/// # use lodestream::decode::{DecodeOptions, Decoder, Step};
/// # fn show(_: &[[f64; 3]], _: &lodestream::complex::Faces) {}
/// # fn main() -> Result<(), lodestream::decode::DecodeError> {
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
    pub fn front(&mut self) -> Result<Option<&Front>, DecodeError> {
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
                }
            }
        }
        let next = self.at.map_or(0, |l| l + 1);
        let full = self.rows.len() as u32 - 1;
        if next > full {
            return Ok(Step::Full);
        }
        loop {
            let parts = self.run.is_some()
                || (!self.waiting.is_empty() && self.waiting.len() == segments(self.level.positions.len()));
            // The full level is there once what travels aside is.
            let aside = next < full || !self.has_aside || self.aside.is_some();
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
                    if let Some(front) = self.reader.front()? {
                        front.check_memory(full, self.options.memory_limit)?;
                    }
                    self.aside = Some(self.decode_aside(payload)?);
                }
                Kind::Other(_) => {}
                _ => return Err(corrupt(next, "a chunk of another level")),
            }
        }
        if let Some(front) = self.reader.front()? {
            front.check_memory(next, self.options.memory_limit)?;
        }
        if next == 0 {
            self.decode_base()?;
        } else {
            self.decode_batch(next)?;
        }
        self.at = Some(next);
        let row = self.rows[next as usize];
        let found = (self.level.positions.len(), self.level.faces.len(), self.level.faces.corners.len());
        if found != (row.vertices as usize, row.elements as usize, row.corners as usize) {
            return Err(corrupt(next, "other counts than the header announces"));
        }
        let limit = LIMIT >> self.level.shift;
        let far = par::map(self.level.positions.chunks(1 << 15).collect(), |run: &[[i32; 3]]| {
            run.as_flattened().iter().fold(0, |far, c| far.max(c.unsigned_abs()))
        });
        if far.iter().any(|&c| c as i64 > limit) {
            return Err(corrupt(next, "coordinates out of range"));
        }
        Ok(Step::Level(next))
    }

    /// Level 0: points, then the elements on them.
    fn decode_base(&mut self) -> Result<(), DecodeError> {
        let row = self.rows[0];
        let run = self.run.as_mut().ok_or(corrupt(0, "a base without a chunk of its own"))?;
        let mut level = Level { positions: Vec::new(), faces: Faces::new(), shift: row.shift };
        code_points(&mut run.coder, &mut level.positions, row.vertices as usize);
        code_elements(&mut run.coder, &level.positions, &mut level.faces, row.corners as usize)
            .map_err(|_| corrupt(0, "elements that contradict the header or themselves"))?;
        self.parents = vec![crate::complex::NONE; level.positions.len()];
        self.star = Star::with_next(level.positions.len(), &level.faces);
        self.level = level;
        self.end_run(0)
    }

    /// The batch that leads to `next`.
    fn decode_batch(&mut self, next: u32) -> Result<(), DecodeError> {
        let (row, before) = (self.rows[next as usize], self.rows[next as usize - 1]);
        let view = View::new(&self.level, &self.star);
        let n = self.level.positions.len();
        let more =
            (row.vertices.saturating_sub(before.vertices) as u64, row.elements.saturating_sub(before.elements) as u64);
        let pieces = if self.run.is_some() { 1 } else { self.waiting.len() };
        // Segments decode side by side: what they list together is held to the header's count.
        let room = AtomicU64::new(more.1);
        let task = |k: usize| {
            let r = segment_range(n, k, pieces);
            Task { view, range: (r.start, r.end), first: k == 0, more, room: &room, shift: row.shift }
        };
        let nonsense = |Nonsense(what)| corrupt(next, what);
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
            let parts = par::map(items, |(k, payload)| {
                let mut coder = range::Decoder::new(payload);
                let mut state = state.clone();
                let mut batch = Batch::default();
                let (mut scratch, mut account) = (Scratch::default(), Account::default());
                code_segment(&mut coder, &mut state, &mut scratch, &task(k), &mut Stream, &mut batch, &mut account)?;
                if coder.overrun() {
                    return Err(Nonsense("a segment that ends too early"));
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
            join(batches, &self.level)
        };
        // Segments do not see each other: what the operator asks for is checked on the whole.
        if batch.len() as u64 + batch.births.len() as u64 != more.0 {
            return Err(corrupt(next, "other counts than the header announces"));
        }
        let inserted = batch.triangles.len() as u64 + batch.edges.iter().map(|&e| e as u64).sum::<u64>();
        let grown = batch.sides.iter().filter(|&&s| matches!(s, Side::Grow12 | Side::Grow21)).count() as u64;
        let corners = grown + 2 * inserted + batch.triangles.len() as u64;
        if (inserted, corners) != (more.1, row.corners.saturating_sub(before.corners) as u64) {
            return Err(corrupt(next, "other counts than the header announces"));
        }
        let bias = ((self.rows.len() as u32 - 1 - next) & 1) as i32;
        let more_to_come = (next as usize) + 1 < self.rows.len();
        let refined = refine(
            &self.level,
            std::mem::take(&mut self.star),
            &batch,
            bias,
            Wanted { star: more_to_come, element: false },
        );
        if refined.conflict {
            return Err(corrupt(next, "two splits that share an element"));
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
    fn decode_aside(&mut self, payload: Vec<u8>) -> Result<Faces, DecodeError> {
        let full = self.rows.len() as u32 - 1;
        let (vertices, counts) = match self.reader.front()? {
            Some(front) => (front.header().levels[full as usize].vertices, front.header().aside),
            None => return Err(corrupt(full, "elements aside before the header")),
        };
        let mut coder = range::Decoder::new(payload);
        let mut faces = Faces::new();
        code_aside(&mut coder, vertices as usize, &mut faces, counts.corners as usize)
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

    /// For each vertex of the level at hand its vertex in the level before ([`crate::complex::NONE`] for a birth). The
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
        if let (Some(aside), true) = (&self.aside, self.at.is_some_and(|l| l as usize + 1 == self.rows.len())) {
            for f in aside.iter() {
                mesh.push_face(f);
            }
        }
        mesh
    }
}

fn corrupt(level: u32, what: &'static str) -> DecodeError {
    DecodeError::Corrupt { level, what }
}
