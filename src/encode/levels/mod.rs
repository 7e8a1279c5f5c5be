//! From the base back to the full level in the numbering that a decoder will have, coding every batch on the way.
//!
//! The numbering of a level follows from the base and the batches before it (children take consecutive places), so it is only known
//! top-down: this is why coding waits for the last collapse. It runs the decoder's own `refine`.

mod slots;

use self::slots::{Slots, Told};
use crate::encode::simplify::{History, StoredBatch};
use crate::format::attributes::code_base_layers;
use crate::format::coder::InvalidStream;
use crate::format::coder::range::{Coder, Encoder};
use crate::format::complex::{Attributes, Faces, Level, NONE, Scheme, Wedges};
use crate::format::elements::{ElementsError, Origin, code_elements};
use crate::format::points::{canonical_order, code_points};
use crate::format::segment::{Account, ModelState, Scratch};
use crate::format::state::{BatchPlan, LevelState, Segment, segment_range, segments};
use crate::parallel;
use thiserror::Error;

/// A run of levels that share one coder grows by at least this much (in 1/12) before it ends: the more a chunk's
/// seven bytes of table and checksum weigh, the later.
fn growth(slots: usize) -> usize {
    if slots < 8_000 { 16 } else { 14 }
}
/// A run is not ended below this many vertices.
const SMALL: usize = 256;

/// A piece of the file: the levels it serves and its bytes.
#[derive(Clone, Debug)]
pub struct Piece {
    /// The first level it serves.
    pub first: u32,
    /// The last.
    pub last: u32,
    /// Which segment of how many, for one level; `None` for a run of small levels.
    pub segment: Option<(u32, u32)>,
    /// The bytes.
    pub payload: Vec<u8>,
}

/// Everything that goes into the file.
#[derive(Clone, Debug, Default)]
pub struct EncodedLevels {
    /// In streaming order.
    pub pieces: Vec<Piece>,
    /// Vertices, elements, corners, shift and error bound in steps, of each level, coarse to fine.
    pub levels: Vec<(u32, u32, u32, u8, f64)>,
    /// Bits by kind.
    pub account: Account,
    /// The number at the full level of each slot.
    pub number: Vec<u32>,
    /// Wedges of each layer at the full level.
    pub wedges: Vec<u32>,
}

/// A history that contradicts itself: a bug, not an input's fault.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum LevelsError {
    /// The base breaks its invariants.
    #[error("the base of the simplification: {0}")]
    Base(#[from] ElementsError),
    /// A batch does not fit its level.
    #[error("a batch of the simplification: {0}")]
    Stream(#[from] InvalidStream),
}

/// A chunk of small levels that goes on.
struct Run {
    coder: Encoder,
    /// Its first level.
    first: u32,
    /// The vertices of the level that it begins behind.
    from: usize,
}

/// Code `history`, whose slots are below `slots`. `progress` hears the vertices of each level reached, and says
/// whether to go on; `None` if it does not.
///
/// # Errors
/// [`LevelsError`] for a history that `simplify` does not make.
pub fn encode_levels(
    history: &History,
    slots: usize,
    scheme: &Scheme,
    progress: &(dyn Fn(u64) -> bool + Sync),
) -> Result<Option<EncodedLevels>, LevelsError> {
    let mut writer = Writer {
        history,
        slots,
        scheme,
        out: EncodedLevels::default(),
        models: ModelState::new(scheme),
        scratch: Scratch::default(),
        run: None,
    };
    let (mut state, mut at) = writer.base()?;
    for (b, stored) in history.batches.iter().enumerate().rev() {
        writer.batch(b, stored, &mut state, &mut at)?;
        if !progress(state.level.positions.len() as u64) {
            return Ok(None);
        }
    }
    let mut out = writer.out;
    if let Some(run) = writer.run {
        let last = history.batches.len() as u32;
        out.pieces.push(Piece { first: run.first, last, segment: None, payload: run.coder.finish() });
    }
    out.wedges = state.attributes.layers.iter().map(|l| l.len() as u32).collect();
    out.number = vec![NONE; slots];
    for (v, &slot) in at.vertex.iter().enumerate() {
        out.number[slot as usize] = v as u32;
    }
    Ok(Some(out))
}

/// Levels on their way into chunks.
struct Writer<'a> {
    history: &'a History,
    slots: usize,
    scheme: &'a Scheme,
    out: EncodedLevels,
    models: ModelState,
    scratch: Scratch,
    run: Option<Run>,
}

impl<'a> Writer<'a> {
    /// Code the base.
    fn base(&mut self) -> Result<(LevelState, Slots<'a>), LevelsError> {
        let (history, account) = (self.history, &mut self.out.account);
        let mut coder = Encoder::new();
        let order = canonical_order(&history.base.positions);
        let mut level = Level {
            positions: order.iter().map(|&v| history.base.positions[v as usize]).collect(),
            faces: history.base.faces.clone(),
            shift: history.base.shift,
        };
        let mut renumber = vec![0u32; order.len()];
        for (new, &old) in order.iter().enumerate() {
            renumber[old as usize] = new as u32;
        }
        for v in &mut level.faces.corners {
            *v = renumber[*v as usize];
        }
        let count = level.positions.len();
        code_points(&mut coder, &mut level.positions, count);
        account.points += coder.bits();
        let start = coder.bits();
        let limit = level.faces.corners.len();
        let origins = code_elements(&mut coder, &level.positions, &mut level.faces, limit)?;
        account.connectivity += coder.bits() - start;
        let start = coder.bits();
        let mut attributes = base_attributes(history, &origins, &level.faces);
        let wedges = code_base_layers(&mut coder, self.scheme, count, &level.faces, &mut attributes, &[])?;
        account.attributes += coder.bits() - start;
        let vertex = order.iter().map(|&v| history.vertex_slot[v as usize]).collect();
        let face = origins.iter().map(|o| history.face_slot[o.element as usize]).collect();
        let at = Slots::new(history, self.slots, vertex, face, wedges);
        self.run = Some(Run { coder, first: 0, from: count });
        self.note(&level, history.batches.last().map_or(0.0, |b| b.error));
        Ok((LevelState::base(level, attributes), at))
    }

    /// The row of a level.
    fn note(&mut self, level: &Level, error: f64) {
        let Level { positions, faces, shift } = level;
        let counts = (positions.len() as u32, faces.len() as u32, faces.corners.len() as u32);
        self.out.levels.push((counts.0, counts.1, counts.2, *shift, error));
    }

    /// Code batch `b`, and go to the level that it leads to.
    fn batch(
        &mut self,
        b: usize,
        stored: &StoredBatch,
        state: &mut LevelState,
        at: &mut Slots,
    ) -> Result<(), LevelsError> {
        let fine_level = (self.history.batches.len() - b) as u32;
        let vertices = state.level.positions.len();
        let of = segments(vertices);
        if of > 1
            && let Some(run) = self.run.take()
        {
            // A base too large to share its chunk with a level.
            let payload = run.coder.finish();
            self.out.pieces.push(Piece { first: run.first, last: fine_level - 1, segment: None, payload });
        }
        at.announce(stored, &state.level);
        state.prepare();
        let new_vertex_order = Slots::new_vertex_order(stored);
        let prepared = parallel::map((0..of).collect(), |k| {
            let range = segment_range(vertices, k, of);
            at.given(stored, state, range, (k == 0).then_some(&new_vertex_order))
        });
        let mut run = (of == 1).then(|| {
            self.run.take().unwrap_or_else(|| Run { coder: Encoder::new(), first: fine_level, from: vertices })
        });
        let (mut coding, mut behind) = (Vec::with_capacity(of), Vec::with_capacity(of));
        for segment in prepared {
            let coder = run.as_mut().map_or_else(Encoder::new, |run| std::mem::take(&mut run.coder));
            coding.push(Segment { coder, given: Some(segment.given) });
            behind.push(segment.stored);
        }
        let bias = stored.placement.bias;
        let plan = BatchPlan { growth: (u64::MAX, u64::MAX), wedge_growth: Vec::new(), shift: stored.shift, bias };
        let (batch, coded) = state.code_batch(self.scheme, &mut self.models, &mut self.scratch, &plan, coding)?;
        let mut told = Told::default();
        for (k, (segment, stored)) in coded.into_iter().zip(behind).enumerate() {
            self.out.account.add(&segment.coded.account);
            told.splits.extend(stored.into_iter().zip(segment.coded.swapped));
            told.wedges.push((segment.coded.named, segment.new_wedges));
            match run.take() {
                Some(Run { first, from, .. }) => {
                    let fine = vertices + batch.len() + batch.new_vertices.len();
                    self.go_on(Run { coder: segment.coder, first, from }, b, fine);
                }
                None => self.out.pieces.push(Piece {
                    first: fine_level,
                    last: fine_level,
                    segment: Some((k as u32, of as u32)),
                    payload: segment.coder.finish(),
                }),
            }
        }
        let origin = state.advance(self.scheme, &batch, bias, true, b == 0, |_| Ok::<_, InvalidStream>(()))?;
        at.descend(stored, &batch, &state.parents, &origin, &told.splits, &new_vertex_order);
        if !self.scheme.is_empty() {
            at.rename(&told);
        }
        self.note(&state.level, if b == 0 { 0.0 } else { self.history.batches[b - 1].error });
        Ok(())
    }

    /// Let a run go on behind batch `b`, which leads to a level of `fine` vertices, or end it.
    fn go_on(&mut self, run: Run, b: usize, fine: usize) {
        let batches = &self.history.batches;
        // Bits that come back raw are for those who go on.
        let bits = b > 0 && batches[b - 1].shift < batches[b].shift;
        let end =
            b == 0 || (fine >= SMALL && (bits || fine * 12 >= run.from * growth(self.slots))) || segments(fine) > 1;
        if end {
            let last = (batches.len() - b) as u32;
            self.out.pieces.push(Piece { first: run.first, last, segment: None, payload: run.coder.finish() });
        } else {
            self.run = Some(run);
        }
    }
}

/// The attributes of the base in the order of its coded elements, wedges still by slots.
fn base_attributes(history: &History, origins: &[Origin], faces: &Faces) -> Attributes {
    let old = &history.base.faces;
    let corner = |layer: &Wedges| {
        let mut out = Vec::with_capacity(faces.corners.len());
        for o in origins {
            let own = &layer.corner[old.start[o.element as usize] as usize..old.start[o.element as usize + 1] as usize];
            out.extend((0..own.len()).map(|k| own[(o.rotation as usize + k) % own.len()]));
        }
        out
    };
    let a = &history.attributes;
    Attributes {
        layers: a
            .layers
            .iter()
            .map(|l| Wedges { width: l.width, corner: corner(l), values: l.values.clone() })
            .collect(),
        labels: if a.labels.is_empty() {
            Vec::new()
        } else {
            origins.iter().map(|o| a.labels[o.element as usize]).collect()
        },
    }
}
