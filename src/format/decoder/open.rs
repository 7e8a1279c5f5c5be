//! A file whose index is known: its levels, one after the other.

use super::images::{Allowance, Images, MissingImages};
use super::{DecodeError, Step, at_level, corrupt};
use crate::format::attributes::{ExtraAttributes, code_base_layers, code_extra_attributes};
use crate::format::coder::{InvalidStream, range};
use crate::format::complex::{Attributes, Batch, Faces, Level, Scheme};
use crate::format::container::{ChunkInfo, Event, FileIndex, Kind, Reader};
use crate::format::degenerate::code_degenerate;
use crate::format::elements::code_elements;
use crate::format::points::code_points;
use crate::format::segment::{ModelState, Scratch};
use crate::format::state::{BatchPlan, Counts, LevelState, Segment, segments};
use crate::parallel;
use std::sync::Arc;

/// Coordinates of every level stay within ±`LIMIT` lattice steps.
const LIMIT: i64 = 1 << 26;

/// A coder in the middle of a run of small levels.
#[derive(Debug)]
struct Run {
    coder: range::Decoder<'static>,
    last: u32,
}

/// A decoder since it knows the file's index.
#[derive(Debug)]
pub(super) struct Open {
    pub(super) index: Arc<FileIndex>,
    memory_limit: u64,
    scheme: Scheme,
    models: ModelState,
    scratch: Scratch,
    run: Option<Run>,
    /// Segments of the next level that have arrived.
    waiting: Vec<Vec<u8>>,
    /// The level at hand.
    pub(super) at: Option<u32>,
    pub(super) state: LevelState,
    /// Whether the level at hand has finer coordinates than the one before.
    pub(super) gained_precision: bool,
    pub(super) degenerate: Option<Faces>,
    pub(super) extra: Option<ExtraAttributes>,
    /// Extra attributes, until the level that they belong to is there.
    waiting_extra: Option<Vec<u8>>,
    pub(super) images: Images,
}

/// Vertices that all levels of a file may have in sum: coding a level looks at each of its vertices, so a file whose many levels add
/// nothing could keep a decoder busy for hours. Encoders stay far below: their levels sum up to less than ten times the full one.
fn work_allowed(index: &FileIndex) -> u64 {
    let full = index.header().full().vertices as u64;
    (1u64 << 24).saturating_add(full.saturating_mul(64)).saturating_add(index.total_bytes().saturating_mul(256))
}

impl Open {
    pub(super) fn new(index: Arc<FileIndex>, memory_limit: u64) -> Result<Self, DecodeError> {
        index.check_memory(0, memory_limit)?;
        let work = index.header().levels.iter().map(|l| l.vertices as u64).sum::<u64>();
        if work > work_allowed(&index) {
            return Err(corrupt(0, "more levels than such a file can have"));
        }
        let scheme = index.header().attributes.scheme();
        Ok(Open {
            index,
            memory_limit,
            models: ModelState::new(&scheme),
            scheme,
            scratch: Scratch::default(),
            run: None,
            waiting: Vec::new(),
            at: None,
            state: LevelState::default(),
            gained_precision: false,
            degenerate: None,
            extra: None,
            waiting_extra: None,
            images: Images::default(),
        })
    }

    pub(super) fn step(&mut self, reader: &mut Reader) -> Result<Step, DecodeError> {
        let next = self.at.map_or(0, |l| l + 1);
        let full = self.index.full_level();
        if next > full {
            // Images may follow the last level.
            while let Event::Chunk { info, payload, .. } = reader.next_chunk()? {
                let payload = payload.to_vec();
                self.take_picture(full, info, payload)?;
            }
            return Ok(Step::Full);
        }
        if !self.take_chunks(reader, next)? {
            return Ok(Step::NeedBytes);
        }
        self.afford(next)?;
        if next == 0 {
            self.decode_base()?
        } else {
            self.decode_batch(next)?
        }
        self.at = Some(next);
        Ok(Step::Level(next))
    }

    /// Take chunks until those that level `next` needs are here; whether they are.
    fn take_chunks(&mut self, reader: &mut Reader, next: u32) -> Result<bool, DecodeError> {
        let full = self.index.full_level();
        let (has_degenerate, has_extra) =
            (self.index.header().degenerate.elements > 0, self.index.header().attributes.extra);
        let of = segments(self.state.level.positions.len());
        loop {
            let whole = self.run.is_some() || (!self.waiting.is_empty() && self.waiting.len() == of);
            // The full level is there once what belongs to it alone is.
            let beside = next < full
                || ((!has_degenerate || self.degenerate.is_some()) && (!has_extra || self.waiting_extra.is_some()));
            if whole && beside {
                return Ok(true);
            }
            let (info, payload) = match reader.next_chunk()? {
                Event::NeedBytes(_) => return Ok(false),
                Event::End => return Err(corrupt(next, "the chunks end before the levels do")),
                Event::Chunk { info, payload, .. } => (info, payload.to_vec()),
            };
            match info.kind {
                Kind::Base | Kind::Levels if !whole && info.first_level == next => {
                    self.run = Some(Run { coder: range::Decoder::new(payload), last: info.last_level });
                }
                Kind::Segment if !whole && info.first_level == next && info.last_level == next => {
                    if info.segments as usize != of {
                        return Err(corrupt(next, "a number of segments that the level does not have"));
                    }
                    self.waiting.push(payload);
                }
                Kind::Degenerate => {
                    self.afford(full)?;
                    self.degenerate = Some(self.decode_degenerate(payload)?);
                }
                // They speak of vertices of the level: they wait until that is there.
                Kind::ExtraAttributes => self.waiting_extra = Some(payload),
                Kind::Appearance | Kind::Image | Kind::Reconstruction | Kind::Preview => {
                    self.take_picture(next, info, payload)?;
                }
                Kind::Other(_) => {}
                _ => return Err(corrupt(next, "a chunk of another level")),
            }
        }
    }

    /// Check that a level fits, beside the materials that are here already.
    fn afford(&self, level: u32) -> Result<(), DecodeError> {
        self.images.afford(Allowance { index: &self.index, limit: self.memory_limit }, level)
    }

    /// Take a chunk of materials or images.
    pub(super) fn take_picture(&mut self, level: u32, info: ChunkInfo, payload: Vec<u8>) -> Result<(), DecodeError> {
        self.images.take(Allowance { index: &self.index, limit: self.memory_limit }, level, info, payload)
    }

    /// What has not arrived of the images.
    pub(super) fn missing_images(&self) -> MissingImages {
        self.images.missing(self.index.header().attributes.images as usize)
    }

    /// What the header says of a level.
    fn announced(&self, level: u32) -> Counts {
        let row = self.index.header().levels[level as usize];
        Counts { vertices: row.vertices as u64, elements: row.elements as u64, corners: row.corners as u64 }
    }

    /// Layers have as many wedges as the header announces, at the full level, and no more before it.
    fn check_wedges(&self, level: u32, wedges: impl Fn(usize) -> u64) -> Result<(), DecodeError> {
        let full = level == self.index.full_level();
        for (l, row) in self.index.header().attributes.layers.iter().enumerate() {
            let (found, announced) = (wedges(l), row.wedges as u64);
            if found > announced || (full && found != announced) {
                return Err(corrupt(level, "another number of wedges than the header announces"));
            }
        }
        Ok(())
    }

    /// What can only be said of a level once it is there: its coordinates lie in range; the full one has its extra attributes.
    fn check_level(&self, number: u32, level: &Level) -> Result<Option<ExtraAttributes>, DecodeError> {
        let limit = LIMIT >> level.shift;
        let far = parallel::map(level.positions.chunks(1 << 15).collect(), |run: &[[i32; 3]]| {
            run.as_flattened().iter().fold(0, |far, c| far.max(c.unsigned_abs()))
        });
        if far.iter().any(|&c| c as i64 > limit) {
            return Err(corrupt(number, "coordinates out of range"));
        }
        match &self.waiting_extra {
            Some(payload) if number == self.index.full_level() => {
                self.decode_extra_attributes(payload, level).map(Some)
            }
            _ => Ok(None),
        }
    }

    /// Keep the extra attributes, whose payload is no longer needed.
    fn keep(&mut self, extra: Option<ExtraAttributes>) {
        if extra.is_some() {
            (self.extra, self.waiting_extra) = (extra, None);
        }
    }

    /// Level 0: points, then the elements on them.
    fn decode_base(&mut self) -> Result<(), DecodeError> {
        let row = self.index.header().levels[0];
        let max_wedges: Vec<u32> = self.index.header().attributes.layers.iter().map(|l| l.wedges).collect();
        let run = self.run.as_mut().ok_or(corrupt(0, "a base without a chunk of its own"))?;
        let mut level = Level { positions: Vec::new(), faces: Faces::new(), shift: row.shift };
        code_points(&mut run.coder, &mut level.positions, row.vertices as usize);
        code_elements(&mut run.coder, &level.positions, &mut level.faces, row.corners as usize)
            .map_err(|_| corrupt(0, "elements that contradict the header or themselves"))?;
        let count = level.positions.len();
        let mut attributes = Attributes::default();
        code_base_layers(&mut run.coder, &self.scheme, count, &level.faces, &mut attributes, &max_wedges)
            .map_err(at_level(0))?;
        let state = LevelState::base(level, attributes);
        if state.counts() != self.announced(0) {
            return Err(corrupt(0, "other counts than the header announces"));
        }
        self.end_run(0)?;
        self.check_wedges(0, |l| state.attributes.layers.get(l).map_or(0, |layer| layer.len() as u64))?;
        let extra = self.check_level(0, &state.level)?;
        self.keep(extra);
        self.state = state;
        Ok(())
    }

    /// The batch that leads to `next`.
    fn decode_batch(&mut self, next: u32) -> Result<(), DecodeError> {
        let bias = ((self.index.full_level() - next) & 1) as i32;
        let batch = self.code_batch(next, bias)?;
        // Segments do not see each other: what the operator asks for is checked on the whole.
        if self.state.counts_after(&batch) != self.announced(next) {
            return Err(corrupt(next, "other counts than the header announces"));
        }
        self.end_run(next)?;
        self.check_wedges(next, |l| self.state.wedges_after(&batch, l))?;
        let last = next == self.index.full_level();
        let precision = self.state.level.shift;
        let mut state = std::mem::take(&mut self.state);
        let mut extra = None;
        let advanced = state.advance(&self.scheme, &batch, bias, false, last, |level| {
            extra = self.check_level(next, level).map_err(Refused)?;
            Ok::<_, Refused>(())
        });
        self.state = state;
        advanced.map_err(|Refused(error)| match error {
            DecodeError::Corrupt { what, .. } => corrupt(next, what),
            error => error,
        })?;
        self.gained_precision = self.state.level.shift < precision;
        self.keep(extra);
        Ok(())
    }

    /// Decode the symbols of the batch that leads to `next`.
    fn code_batch(&mut self, next: u32, bias: i32) -> Result<Batch, DecodeError> {
        let rows = &self.index.header().levels;
        let (row, before) = (rows[next as usize], rows[next as usize - 1]);
        let layers = self.index.header().attributes.layers.iter().zip(&self.state.attributes.layers);
        let plan = BatchPlan {
            growth: (
                row.vertices.saturating_sub(before.vertices) as u64,
                row.elements.saturating_sub(before.elements) as u64,
            ),
            wedge_growth: layers.map(|(row, layer)| (row.wedges as u64).saturating_sub(layer.len() as u64)).collect(),
            shift: row.shift,
            bias,
        };
        let (scheme, models, scratch) = (&self.scheme, &mut self.models, &mut self.scratch);
        let batch = match self.run.take() {
            Some(Run { coder, last }) => {
                let segments = vec![Segment { coder, given: None }];
                let (batch, coded) =
                    self.state.code_batch(scheme, models, scratch, &plan, segments).map_err(at_level(next))?;
                self.run = coded.into_iter().next().map(|c| Run { coder: c.coder, last });
                batch
            }
            None => {
                let payloads = std::mem::take(&mut self.waiting).into_iter();
                let segments = payloads.map(|p| Segment { coder: range::Decoder::new(p), given: None }).collect();
                self.state.code_batch(scheme, models, scratch, &plan, segments).map_err(at_level(next))?.0
            }
        };
        Ok(batch)
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
    fn decode_degenerate(&self, payload: Vec<u8>) -> Result<Faces, DecodeError> {
        let (full, counts) = (self.index.full_level(), self.index.header().degenerate);
        let vertices = self.index.header().full().vertices;
        let mut coder = range::Decoder::new(payload);
        let mut faces = Faces::new();
        code_degenerate(&mut coder, vertices as usize, &mut faces, counts.corners as usize)
            .map_err(|_| corrupt(full, "degenerate faces that contradict the header or themselves"))?;
        if coder.overrun() || faces.len() != counts.elements as usize || faces.corners.len() != counts.corners as usize
        {
            return Err(corrupt(full, "degenerate faces that contradict the header"));
        }
        Ok(faces)
    }

    /// The vertices of the full level that no element names, degenerate or not.
    pub(super) fn isolated(&self, level: &Level) -> Vec<u32> {
        let mut used = vec![false; level.positions.len()];
        let degenerate = self.degenerate.as_ref().map_or(&[][..], |d| &d.corners);
        level.faces.corners.iter().chain(degenerate).for_each(|&v| used[v as usize] = true);
        (0..used.len() as u32).filter(|&v| !used[v as usize]).collect()
    }

    /// Values of degenerate faces and of isolated vertices.
    fn decode_extra_attributes(&self, payload: &[u8], level: &Level) -> Result<ExtraAttributes, DecodeError> {
        let full = self.index.full_level();
        let mut coder = range::Decoder::new(payload);
        let mut extra = ExtraAttributes::default();
        let none = Faces::new();
        let degenerate = self.degenerate.as_ref().unwrap_or(&none);
        let isolated = self.isolated(level).len();
        code_extra_attributes(&mut coder, &self.scheme, degenerate, isolated, &mut extra).map_err(at_level(full))?;
        if coder.overrun() {
            return Err(corrupt(full, "values that end too early"));
        }
        Ok(extra)
    }
}

/// Why a finer level was not taken.
struct Refused(DecodeError);

impl From<InvalidStream> for Refused {
    fn from(InvalidStream(what): InvalidStream) -> Self {
        Refused(corrupt(0, what))
    }
}
