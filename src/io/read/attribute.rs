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

    /// Colours in `0..=255` or, for integers of more bits, `0..=65535`, become such in `0..=1`.
    pub fn scale_colours(&mut self) {
        let finite = || self.values.iter().filter(|x| x.is_finite());
        let largest = finite().fold(0.0, |m: f64, &x| m.max(x));
        let whole = finite().all(|x| x.fract() == 0.0);
        let (scale, stored) = match largest {
            ..=1.0 => return,
            ..=255.0 => (255.0, Stored::U8),
            ..=65535.0 if whole => (65535.0, Stored::U16),
            _ => return,
        };
        self.values.iter_mut().for_each(|x| *x /= scale);
        if whole {
            self.stored = stored;
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
                corners.iter_mut().filter(|i| **i as usize >= count).for_each(|i| *i = NO_VALUE);
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
