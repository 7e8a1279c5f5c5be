//! Accessors: typed views of buffers, with strides, normalized integers and sparse replacements; or what Draco data
//! hold in their place.

use serde_json::Value;

use super::super::build::{Budget, Kind};
use super::super::error::{At, Fail, Place, ReadErrorKind};
use super::json::{in_range, list, needed, text, uint};
use super::{Document, top};
use crate::mesh::Stored;

/// The types of components.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    pub fn parse(code: u64) -> Result<Self, Kind> {
        Ok(match code {
            5120 => Component::I8,
            5121 => Component::U8,
            5122 => Component::I16,
            5123 => Component::U16,
            5125 => Component::U32,
            5126 => Component::F32,
            _ => return Err(ReadErrorKind::Syntax(format!("{code} is not a component type; mend the document"))),
        })
    }

    pub fn size(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::U32 | Component::F32 => 4,
        }
    }

    /// The first component of `b`, which holds one.
    #[inline]
    fn value(self, b: &[u8]) -> f64 {
        match self {
            Component::I8 => f64::from(b[0] as i8),
            Component::U8 => f64::from(b[0]),
            Component::I16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
            Component::U16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
            Component::U32 => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Component::F32 => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        }
    }

    /// What a normalized value is divided by.
    fn scale(self) -> f64 {
        match self {
            Component::I8 => 127.0,
            Component::U8 => 255.0,
            Component::I16 => 32767.0,
            Component::U16 => 65535.0,
            Component::U32 | Component::F32 => 1.0,
        }
    }
}

/// A run of items in a buffer; checked to lie inside.
#[derive(Clone, Copy, Debug)]
struct View {
    buffer: usize,
    start: usize,
    stride: usize,
}

/// Items that replace others.
#[derive(Clone, Debug)]
struct Sparse {
    count: usize,
    indices: View,
    index_type: Component,
    values: View,
}

/// Items of one type, as they lie.
struct Run<'a> {
    data: &'a [u8],
    view: View,
    count: usize,
}

impl Run<'_> {
    #[inline]
    fn each<const N: usize, const S: usize>(
        &self,
        decode: impl Fn([u8; S]) -> f64,
        mut take: impl FnMut([f64; N]) -> Result<(), Kind>,
    ) -> Result<(), Kind> {
        let rest = self.data.get(self.view.start..).unwrap_or_default();
        // The last item may lack what lies between items.
        for record in rest.chunks(self.view.stride.max(1)).take(self.count) {
            let (numbers, _) = record.as_chunks::<S>();
            let Some(item) = numbers.first_chunk::<N>() else { break };
            // A plain loop: `map` over an array is a call for each number where nothing inlines it.
            let mut values = [0.0; N];
            for (value, &number) in values.iter_mut().zip(item) {
                *value = decode(number);
            }
            take(values)?;
        }
        Ok(())
    }
}

/// A checked accessor.
#[derive(Clone, Debug)]
pub(super) struct Accessor {
    pub count: usize,
    component: Component,
    normalized: bool,
    /// `None`: all zeros.
    view: Option<View>,
    sparse: Option<Sparse>,
    /// Its number in the document, for messages.
    number: usize,
    /// What tells it from all others: its number, unless its items are those of a Draco mesh.
    pub identity: u64,
}

/// The items that stand for those of an accessor, side by side in a buffer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Replacement {
    pub buffer: usize,
    pub count: usize,
    pub component: Component,
    pub identity: u64,
}

impl Accessor {
    /// Whole numbers of 32 bits in a buffer, which stand for the items of accessor `number`.
    pub fn indices(number: usize, by: Replacement) -> Self {
        let Replacement { buffer, count, component, identity } = by;
        let view = Some(View { buffer, start: 0, stride: component.size() });
        Accessor { count, component, normalized: false, view, sparse: None, number, identity }
    }

    /// Check accessor `number`, which must have `N` components per item, and load its buffers.
    pub fn new<const N: usize>(doc: &mut Document<'_>, number: u64, budget: &mut Budget) -> Result<Self, Fail> {
        let at = || Place::Item(format!("accessors[{number}]"));
        let json = doc.json;
        let buffers = &mut doc.buffers;
        let all = list(json, "accessors").at(top)?;
        let number = in_range(number, all.len(), "accessors").at(at)?;
        let a = &all[number];
        let wanted = ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1];
        let found = text(a, "type").at(at)?.unwrap_or("nothing");
        if found != wanted {
            let found: String = found.escape_debug().take(12).collect();
            return Err(Kind::Syntax(format!("the type is {found}, but {wanted} is needed here; mend the document")))
                .at(at);
        }
        let count = needed(a, "count").at(at)?;
        let component = needed(a, "componentType").and_then(Component::parse).at(at)?;
        let normalized = a.get("normalized").and_then(Value::as_bool).unwrap_or(false);
        if let Some(&Replacement { buffer, count, component: found, identity }) = doc.replaced.get(&(number as u64)) {
            let view = Some(View { buffer, start: 0, stride: N * found.size() });
            // Numbers that were stored as floats already are what they mean.
            let normalized = normalized && found == component;
            return Ok(Accessor { count, component: found, normalized, view, sparse: None, number, identity });
        }
        let size = N * component.size();
        let mut view = |item: &Value, offset_key: &str, count: u64, size: usize| -> Result<Option<View>, Fail> {
            let Some(number) = uint(item, "bufferView").at(at)? else { return Ok(None) };
            let span = buffers.span(json, number, budget)?;
            let (start, length, held) = (span.start as u64, span.length as u64, buffers.get(span.buffer).len() as u64);
            let stride = span.stride.unwrap_or(size as u64);
            let offset = uint(item, offset_key).at(at)?.unwrap_or(0);
            let needs = match count.checked_sub(1) {
                Some(last) => offset.saturating_add(last.saturating_mul(stride)).saturating_add(size as u64),
                None => 0,
            };
            if stride < size as u64 || needs > length {
                let (what, bytes) = (format!("items of {size} bytes"), length.saturating_sub(offset));
                return Err(ReadErrorKind::Count { what, count, bytes }).at(at);
            }
            // All are below the length of the buffer, except for an empty accessor's offset.
            let start = start.saturating_add(offset).min(held) as usize;
            Ok(Some(View { buffer: span.buffer, start, stride: stride.min(held) as usize }))
        };
        let main = view(a, "byteOffset", count, size)?;
        let sparse = match a.get("sparse") {
            None => None,
            Some(s) => {
                let missing = || Kind::Syntax("`sparse` is not complete; mend the document".to_string());
                let (indices, values) = s.get("indices").zip(s.get("values")).ok_or_else(missing).at(at)?;
                let replaced = needed(s, "count").at(at)?;
                let index_type = needed(indices, "componentType").and_then(Component::parse).at(at)?;
                let index_view =
                    view(indices, "byteOffset", replaced, index_type.size())?.ok_or_else(missing).at(at)?;
                let values = view(values, "byteOffset", replaced, size)?.ok_or_else(missing).at(at)?;
                Some(Sparse { count: replaced as usize, indices: index_view, index_type, values })
            }
        };
        // Zeros need no bytes in the file; but more items than it has bytes are an attack, not a mesh.
        if main.is_none() && count > doc.buffers.bytes {
            let what = "items without data".to_string();
            return Err(ReadErrorKind::Count { what, count, bytes: doc.buffers.bytes }).at(at);
        }
        let identity = number as u64;
        Ok(Accessor { count: count as usize, component, normalized, view: main, sparse, number, identity })
    }

    /// How the numbers are stored, when an attribute of any kind is made of them: what is normalized has no integers.
    pub fn stored(&self, colour: bool) -> Stored {
        match self.component {
            Component::U8 if self.normalized == colour => Stored::U8,
            Component::U16 if self.normalized == colour => Stored::U16,
            Component::I8 if !self.normalized => Stored::I8,
            Component::I16 if !self.normalized => Stored::I16,
            Component::U32 if !self.normalized => Stored::U32,
            _ => Stored::F32,
        }
    }

    /// The number of components of accessor `number`, if it has 1 to 4.
    pub fn width(doc: &Document<'_>, number: u64) -> Result<Option<u8>, Fail> {
        let at = || Place::Item(format!("accessors[{number}]"));
        let all = list(doc.json, "accessors").at(top)?;
        let number = in_range(number, all.len(), "accessors").at(at)?;
        Ok(match text(&all[number], "type").at(at)? {
            Some("SCALAR") => Some(1),
            Some("VEC2") => Some(2),
            Some("VEC3") => Some(3),
            Some("VEC4") => Some(4),
            _ => None,
        })
    }

    /// An accessor of `width` components.
    pub fn of_width(doc: &mut Document<'_>, number: u64, width: u8, budget: &mut Budget) -> Result<Self, Fail> {
        match width {
            1 => Accessor::new::<1>(doc, number, budget),
            2 => Accessor::new::<2>(doc, number, budget),
            3 => Accessor::new::<3>(doc, number, budget),
            _ => Accessor::new::<4>(doc, number, budget),
        }
    }

    /// All items in order, of an accessor of `width` components.
    pub fn each_of(
        &self,
        doc: &Document<'_>,
        width: u8,
        mut take: impl FnMut(&[f64]) -> Result<(), Kind>,
    ) -> Result<(), Fail> {
        match width {
            1 => self.each::<1>(doc, |v| take(&v)),
            2 => self.each::<2>(doc, |v| take(&v)),
            3 => self.each::<3>(doc, |v| take(&v)),
            _ => self.each::<4>(doc, |v| take(&v)),
        }
    }

    /// True when the items can be vertex numbers.
    pub fn is_unsigned(&self) -> bool {
        matches!(self.component, Component::U8 | Component::U16 | Component::U32) && !self.normalized
    }

    pub fn place(&self) -> Place {
        Place::Item(format!("accessors[{}]", self.number))
    }

    #[inline]
    fn item<const N: usize>(&self, doc: &Document<'_>, view: View, i: usize) -> [f64; N] {
        let size = self.component.size();
        let item = &doc.buffers.get(view.buffer)[view.start + i * view.stride..][..N * size];
        std::array::from_fn(|k| {
            let value = self.component.value(&item[k * size..]);
            if self.normalized { (value / self.component.scale()).max(-1.0) } else { value }
        })
    }

    /// All items in order. `N` is the number of components it was checked for.
    #[inline]
    pub fn each<const N: usize>(
        &self,
        doc: &Document<'_>,
        mut take: impl FnMut([f64; N]) -> Result<(), Kind>,
    ) -> Result<(), Fail> {
        // What nearly every file has needs no decision for each number.
        if let (None, false, Some(view)) = (&self.sparse, self.normalized, self.view) {
            let run = Run { data: doc.buffers.get(view.buffer), view, count: self.count };
            return match self.component {
                Component::F32 => run.each(|b| f64::from(f32::from_le_bytes(b)), take),
                Component::U32 => run.each(|b| f64::from(u32::from_le_bytes(b)), take),
                Component::U16 => run.each(|b| f64::from(u16::from_le_bytes(b)), take),
                Component::U8 => run.each(|[b]: [u8; 1]| f64::from(b), take),
                Component::I16 => run.each(|b| f64::from(i16::from_le_bytes(b)), take),
                Component::I8 => run.each(|[b]: [u8; 1]| f64::from(b as i8), take),
            }
            .at(|| self.place());
        }
        let (mut next, mut replacement) = (None, 0);
        if let Some(s) = &self.sparse {
            next = self.sparse_index(doc, s, 0, None)?;
        }
        for i in 0..self.count {
            let mut item = match self.view {
                Some(view) => self.item(doc, view, i),
                None => [0.0; N],
            };
            if next == Some(i)
                && let Some(s) = &self.sparse
            {
                item = self.item(doc, s.values, replacement);
                replacement += 1;
                next = self.sparse_index(doc, s, replacement, next)?;
            }
            take(item).at(|| self.place())?;
        }
        Ok(())
    }

    /// All items as whole numbers, three at a time, where they lie side by side and make whole threes; else `None`, and
    /// nothing is done.
    #[inline]
    pub fn threes(
        &self,
        doc: &Document<'_>,
        mut take: impl FnMut([u32; 3]) -> Result<(), Kind>,
    ) -> Option<Result<(), Fail>> {
        let view = self.view.filter(|v| v.stride == self.component.size())?;
        if self.sparse.is_some() || self.normalized || !self.count.is_multiple_of(3) {
            return None;
        }
        let bytes = doc.buffers.get(view.buffer).get(view.start..)?.get(..self.count * self.component.size())?;
        let done = match self.component {
            Component::U32 => bytes.as_chunks::<12>().0.iter().try_for_each(|b| {
                let word = |i: usize| u32::from_le_bytes([b[i], b[i + 1], b[i + 2], b[i + 3]]);
                take([word(0), word(4), word(8)])
            }),
            Component::U16 => bytes.as_chunks::<6>().0.iter().try_for_each(|b| {
                let word = |i: usize| u32::from(u16::from_le_bytes([b[i], b[i + 1]]));
                take([word(0), word(2), word(4)])
            }),
            Component::U8 => {
                let threes = bytes.as_chunks::<3>().0;
                threes.iter().try_for_each(|b| take([u32::from(b[0]), u32::from(b[1]), u32::from(b[2])]))
            }
            _ => return None,
        };
        Some(done.at(|| self.place()))
    }

    /// The `k`-th replaced item; they have to increase.
    fn sparse_index(
        &self,
        doc: &Document<'_>,
        s: &Sparse,
        k: usize,
        last: Option<usize>,
    ) -> Result<Option<usize>, Fail> {
        if k >= s.count {
            return Ok(None);
        }
        let bytes = &doc.buffers.get(s.indices.buffer)[s.indices.start + k * s.indices.stride..];
        let index = s.index_type.value(bytes) as usize;
        if index >= self.count || last.is_some_and(|l| index <= l) {
            let wrong = format!("sparse index {index} is out of order or not below {}; mend the document", self.count);
            return Err(Kind::Syntax(wrong)).at(|| self.place());
        }
        Ok(Some(index))
    }
}
