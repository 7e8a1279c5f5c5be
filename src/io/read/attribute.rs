//! Attribute layers while a file is read.
//!
//! Most formats keep attributes beside the vertex records: then a corner's value has the number of its record, plus an
//! offset that holds for a run of corners ([`Span`]), and nothing is stored per corner until the end. OBJ and the face
//! lists of PLY number values apart from vertices: then each corner has a number of its own.
//!
//! What is not a finite number is no value. A face with values at some of its corners only loses them, counted.

use super::build::{Budget, Builder, Kind, MAX, Tally};
use super::error::ReadErrorKind;
use super::warning::{Layer as Dropped, Warning};
use crate::mesh::{Layer, LayerKind, NO_VALUE, Stored};

/// The most layers that a file may have: each costs four bytes a corner, which the file's own size has to justify.
pub(super) const MAX_LAYERS: usize = 32;

/// A run of corners and a run of records whose values have the number of the record and an offset.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    /// The first corner and the first behind.
    pub corners: [u32; 2],
    /// The first record and the first behind.
    pub records: [u32; 2],
    /// What is added to a record's number.
    pub offset: i64,
}

/// How corners find their values.
#[derive(Debug)]
pub(super) enum Place {
    /// By their records, in runs of increasing corners; corners between runs have none.
    Records(Vec<Span>),
    /// Each by its own number; corners behind the last have none.
    Listed(Vec<u32>),
}

/// Which numbers there are.
struct Extent {
    low: f64,
    high: f64,
    whole: bool,
}

impl Default for Extent {
    fn default() -> Self {
        Extent { low: 0.0, high: 0.0, whole: true }
    }
}

impl Extent {
    /// How far fractions may lie outside of 0..1 and still be meant for it.
    const SLACK: f64 = 0.1;

    fn add(&mut self, x: f64) {
        if x.is_finite() {
            (self.low, self.high) = (self.low.min(x), self.high.max(x));
            self.whole &= x.fract() == 0.0;
        }
    }

    /// What stands for 1; `None` where that cannot be told.
    fn scale(&self) -> Option<f64> {
        match self.high {
            _ if self.low < -Self::SLACK => None,
            high if high <= 1.0 + Self::SLACK => Some(1.0),
            high if self.whole && high <= 255.0 => Some(255.0),
            high if self.whole && high <= 65535.0 => Some(65535.0),
            _ => None,
        }
    }
}

/// A layer under construction.
#[derive(Debug)]
pub(super) struct Attribute {
    pub name: String,
    pub kind: LayerKind,
    pub width: u8,
    pub stored: Stored,
    pub values: Vec<f64>,
    pub place: Place,
    /// NaN stands for what the file does not have, and is not worth a warning.
    pub gaps: bool,
    /// Records that have no value where no corner says otherwise, though they lie within a run.
    pub without: Vec<u32>,
    /// How many values are none.
    absent: u64,
    /// Corners of a list that name a value before the first, and have been given none.
    pub outside: u64,
}

impl Attribute {
    /// A layer whose values are numbered as the records are.
    pub fn new(name: impl Into<String>, kind: LayerKind, width: u8, stored: Stored) -> Self {
        let place = Place::Records(Vec::new());
        Attribute {
            name: name.into(),
            kind,
            width,
            stored,
            values: Vec::new(),
            place,
            gaps: false,
            without: Vec::new(),
            absent: 0,
            outside: 0,
        }
    }

    /// Values of all corners and all records of the file, one each.
    pub fn everywhere(mut self) -> Self {
        self.place = Place::Records(vec![Span { corners: [0, u32::MAX], records: [0, u32::MAX], offset: 0 }]);
        self
    }

    /// The kind of data for warnings.
    pub fn dropped(&self) -> Dropped {
        dropped(self.kind)
    }

    /// Give colours their range. Whole numbers in `0..=255`, or of more bits in `0..=65535`, become such in `0..=1`.
    /// Fractions are in that range but for what arithmetic has added, and that is cut off. What lies far outside (HDR)
    /// is no colour here but numbers, and stays as it is. Alpha has a range of its own.
    pub fn scale_colours(&mut self, tally: &mut Tally) {
        let width = self.width.max(1) as usize;
        let (mut colour, mut alpha) = (Extent::default(), Extent::default());
        for value in self.values.chunks_exact(width) {
            let (c, a) = value.split_at(width.min(3));
            c.iter().for_each(|&x| colour.add(x));
            a.iter().for_each(|&x| alpha.add(x));
        }
        let Some(scale) = colour.scale() else {
            let count = self.values.iter().filter(|x| x.is_finite() && !(0.0..=1.0).contains(*x)).count() as u64;
            tally.others.push(Warning::HighColours { layer: self.name.clone(), count });
            self.kind = LayerKind::Scalar;
            return;
        };
        let alpha_scale = alpha.scale().unwrap_or(1.0);
        let mut clamped = 0;
        for (k, x) in self.values.iter_mut().enumerate() {
            *x /= if k % width < 3 { scale } else { alpha_scale };
            if *x < 0.0 || *x > 1.0 {
                *x = x.clamp(0.0, 1.0);
                clamped += 1;
            }
        }
        if clamped > 0 {
            tally.others.push(Warning::ClampedColours { layer: self.name.clone(), count: clamped });
        }
        let whole = colour.whole && alpha.whole && (alpha_scale == scale || alpha.high <= 1.0);
        match scale {
            255.0 if whole => self.stored = Stored::U8,
            65535.0 if whole => self.stored = Stored::U16,
            _ => {}
        }
    }

    /// For each corner, given by its record, its value.
    pub fn resolve(
        &mut self,
        records: &[u32],
        face_start: &[u32],
        budget: &mut Budget,
        tally: &mut Tally,
    ) -> Result<Vec<u32>, Kind> {
        let count = self.values.len() / self.width.max(1) as usize;
        if count > MAX {
            return Err(ReadErrorKind::TooLarge { what: "values of an attribute", limit: MAX as u64 });
        }
        let mut corners = Vec::new();
        match &mut self.place {
            Place::Records(spans) => {
                budget.reserve(&mut corners, records.len())?;
                for span in spans {
                    let end = (span.corners[1] as usize).min(records.len());
                    let first = (span.corners[0] as usize).min(end);
                    corners.resize(first.max(corners.len()), NO_VALUE);
                    let offset = span.offset;
                    corners.extend(records[corners.len().min(end)..end].iter().map(|&r| number(r, offset, count)));
                }
            }
            Place::Listed(list) => {
                corners = std::mem::take(list);
                let more = records.len().saturating_sub(corners.len());
                budget.reserve(&mut corners, more)?;
                let mut outside = self.outside;
                for i in corners.iter_mut().filter(|i| **i as usize >= count) {
                    outside += u64::from(*i != NO_VALUE);
                    *i = NO_VALUE;
                }
                if outside > 0 {
                    tally.others.push(Warning::MissingValues { layer: self.name.clone(), count: outside });
                }
            }
        }
        corners.resize(records.len(), NO_VALUE);
        self.drop_not_finite(&mut corners, tally);
        let mut partial = 0;
        if corners.contains(&NO_VALUE) {
            for face in face_start.windows(2) {
                let own = &mut corners[face[0] as usize..face[1] as usize];
                if own.contains(&NO_VALUE) && own.iter().any(|&i| i != NO_VALUE) {
                    own.fill(NO_VALUE);
                    partial += 1;
                }
            }
        }
        if partial > 0 {
            tally.others.push(Warning::PartialFaces { layer: self.name.clone(), count: partial });
        }
        Ok(corners)
    }

    /// Values that are not finite numbers are none.
    fn drop_not_finite(&mut self, corners: &mut [u32], tally: &mut Tally) {
        let width = self.width.max(1) as usize;
        if self.values.iter().all(|x| x.is_finite()) {
            return;
        }
        let bad = |v: &[f64]| v.iter().any(|x| !x.is_finite());
        for i in corners.iter_mut().filter(|i| **i != NO_VALUE) {
            let at = *i as usize * width;
            if bad(&self.values[at..at + width]) {
                *i = NO_VALUE;
            }
        }
        let count = self.values.chunks_exact(width).filter(|v| bad(v)).count() as u64;
        self.absent = count;
        if !self.gaps {
            tally.others.push(Warning::NotFiniteValues { layer: self.name.clone(), count });
        }
        // Isolated vertices are looked at later, and must see that there is nothing.
        let total = self.values.len() / width;
        if let Place::Records(spans) = &mut self.place {
            let mut kept = Vec::new();
            for span in spans.iter() {
                let behind = i64::from(span.records[1]).min(total as i64 - span.offset);
                let mut open = None;
                for record in span.records[0]..=behind.max(i64::from(span.records[0])) as u32 {
                    let i = number(record, span.offset, total);
                    let good = i64::from(record) < behind
                        && i != NO_VALUE
                        && !bad(&self.values[i as usize * width..][..width]);
                    match (good, open) {
                        (true, None) => open = Some(record),
                        (false, Some(first)) => {
                            kept.push(Span { corners: [0; 2], records: [first, record], offset: span.offset });
                            open = None;
                        }
                        _ => {}
                    }
                }
            }
            *spans = kept;
        }
        self.values.iter_mut().filter(|x| !x.is_finite()).for_each(|x| *x = 0.0);
    }

    /// The layer; `alone` holds isolated vertices with their records. `None` where nothing names any of the values.
    pub fn finish(mut self, corners: Vec<u32>, alone: &[[u32; 2]], tally: &mut Tally) -> Option<Layer> {
        let count = self.values.len() / self.width.max(1) as usize;
        let mut isolated: Vec<[u32; 2]> = Vec::new();
        if let Place::Records(spans) = &mut self.place {
            spans.sort_unstable_by_key(|s| s.records);
            self.without.sort_unstable();
            for &[v, record] in alone {
                let known = isolated.last().is_some_and(|last| last[0] == v);
                // The last run that begins at or before the record; runs either coincide or lie apart.
                let at = spans.partition_point(|s| s.records[0] <= record);
                let span = spans[..at].last().filter(|s| record < s.records[1]);
                if let (false, Some(span), Err(_)) = (known, span, self.without.binary_search(&record)) {
                    let i = number(record, span.offset, count);
                    if i != NO_VALUE {
                        isolated.push([v, i]);
                    }
                }
            }
        }
        if isolated.is_empty() && corners.iter().all(|&i| i == NO_VALUE) {
            tally.drop_layer(self.dropped(), count as u64 - self.absent.min(count as u64));
            return None;
        }
        let Attribute { name, kind, width, stored, values, .. } = self;
        Some(Layer { name, kind, width, stored, values, corners, isolated })
    }
}

/// Colours without alpha among those with it have the largest there is.
pub(super) fn opaque(layer: &mut Attribute) {
    if layer.width == 4 {
        let values = layer.values.chunks_exact_mut(4);
        let largest = values.filter_map(|c| Some(c[3]).filter(|a| a.is_finite())).fold(0.0, f64::max);
        let full = match largest {
            ..=1.0 => 1.0,
            ..=255.0 => 255.0,
            _ => 65535.0,
        };
        for c in layer.values.chunks_exact_mut(4).filter(|c| c[3].is_nan() && !c[0].is_nan()) {
            c[3] = full;
        }
    }
}

/// The value of a record.
#[inline]
fn number(record: u32, offset: i64, count: usize) -> u32 {
    let i = i64::from(record) + offset;
    if (0..count as i64).contains(&i) { i as u32 } else { NO_VALUE }
}

/// What warnings call a layer of this kind.
pub(super) fn dropped(kind: LayerKind) -> Dropped {
    match kind {
        LayerKind::Uv => Dropped::TextureCoordinates,
        LayerKind::Normal => Dropped::Normals,
        LayerKind::Tangent => Dropped::Tangents,
        LayerKind::Color => Dropped::Colours,
        _ => Dropped::OtherAttributes,
    }
}

impl Builder {
    /// Add a number to layer `layer`.
    #[inline]
    pub fn value(&mut self, layer: usize, x: f64) -> Result<(), Kind> {
        let values = &mut self.layers[layer].values;
        if values.len() == values.capacity() {
            self.budget.grow(values, 4, "values of an attribute")?;
        }
        values.push(x);
        Ok(())
    }

    /// Give the corners from `first` on their texture coordinates, two numbers each, in a layer with a list.
    pub fn wedges(&mut self, layer: usize, first: usize, uvs: &[f64], wedges: &mut Wedges) -> Result<(), Kind> {
        let Attribute { values, place, .. } = &mut self.layers[layer];
        let Place::Listed(list) = place else { return Ok(()) };
        if self.corners.len() > list.capacity() {
            let more = self.corners.len() - list.len();
            self.budget.grow(list, more, "corners")?;
        }
        list.resize(first, NO_VALUE);
        for (&record, uv) in self.corners[first..].iter().zip(uvs.chunks_exact(2)) {
            list.push(wedges.insert(values, record, [uv[0], uv[1]], &mut self.budget)?);
        }
        Ok(())
    }
}

/// Values listed at faces, where corners of one vertex mostly repeat each other: equal ones become one.
#[derive(Default)]
pub(super) struct Wedges {
    /// For each record its latest value.
    head: Vec<u32>,
    /// For each value the one before it at the same record.
    next: Vec<u32>,
}

impl Wedges {
    /// How many values of a vertex are compared; beyond it they are told apart by where they stand.
    const LONGEST: usize = 32;

    /// The number of `value` at `record`, appended to `values` where it is new.
    pub fn insert(
        &mut self,
        values: &mut Vec<f64>,
        record: u32,
        value: [f64; 2],
        budget: &mut Budget,
    ) -> Result<u32, Kind> {
        let record = record as usize;
        if record >= self.head.len() {
            if record >= self.head.capacity() {
                let more = record + 1 - self.head.len();
                budget.grow(&mut self.head, more, "vertices")?;
            }
            self.head.resize(record + 1, NO_VALUE);
        }
        let mut i = self.head[record];
        for _ in 0..Self::LONGEST {
            if i == NO_VALUE {
                break;
            }
            let known = &values[2 * i as usize..][..2];
            if (0..2).all(|k| known[k].to_bits() == value[k].to_bits()) {
                return Ok(i);
            }
            i = self.next[i as usize];
        }
        if values.len() + 2 > values.capacity() {
            budget.grow(values, 2, "texture coordinates")?;
        }
        if self.next.len() == self.next.capacity() {
            budget.grow(&mut self.next, 1, "texture coordinates")?;
        }
        let new = self.next.len() as u32;
        values.extend(value);
        self.next.push(self.head[record]);
        self.head[record] = new;
        Ok(new)
    }
}
