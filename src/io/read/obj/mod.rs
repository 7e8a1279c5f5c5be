//! Wavefront OBJ: `v`, `vt`, `vn`, `f` of any degree, `l` as dangling edges, `p`, `usemtl`, `mtllib`; all else is
//! skipped and counted.
//!
//! Vertices are numbered from 1; negative numbers count back from the last vertex so far. A face may name a
//! vertex that comes later, so numbers are checked at the end, against the largest one seen. A number of texture
//! coordinates or of a normal that is not there is as good as none. `\` at the end of a line joins it with the next.
//!
//! Materials are those that faces use, in the order of their first use. Libraries are read when the rest is done.

mod materials;
mod vertex;

use std::collections::BTreeMap;

use super::attribute::{Attribute, Place as Values};
use super::build::{Builder, Kind, MAX};
use super::error::{At, Fail, Place, ReadErrorKind, printable};
use super::text::Cursor;
use super::warning::{Layer, Warning};
use super::{ReadMesh, ReadOptions};
use crate::io::beside::Folder;
use crate::io::name;
use crate::mesh::{LayerKind, NO_VALUE, Stored};
use materials::{MAX_LIBRARIES, load_materials};
use vertex::{Colours, vertex};

/// The face, line or point with the largest vertex number so far.
#[derive(Clone, Copy, Default)]
struct Farthest {
    index: i64,
    line: u64,
    what: &'static str,
}

#[derive(Default)]
struct Unknown {
    count: u64,
    first: Option<(String, u64)>,
}

/// Values that corners number apart from vertices: `vt` or `vn`.
struct Side {
    wanted: bool,
    values: Vec<f64>,
    width: i64,
    /// The value of each corner, as far as corners have any.
    at: Vec<u32>,
    /// Corners that name a value before the first.
    outside: u64,
}

impl Side {
    fn new(wanted: bool, width: i64) -> Self {
        Side { wanted, values: Vec::new(), width, at: Vec::new(), outside: 0 }
    }

    /// Corner `corner` has the value that stands in the file as `index`; 0 is none.
    #[inline]
    fn put(&mut self, b: &mut Builder, corner: usize, index: i64) -> Result<(), Kind> {
        if index == 0 || !self.wanted {
            return Ok(());
        }
        let value = if index > 0 { index - 1 } else { self.values.len() as i64 / self.width + index };
        if corner >= self.at.capacity() {
            let more = corner + 1 - self.at.len();
            b.budget.grow(&mut self.at, more, "corners")?;
        }
        self.at.resize(corner, NO_VALUE);
        self.outside += u64::from(value < 0);
        self.at.push(u32::try_from(value).unwrap_or(NO_VALUE));
        Ok(())
    }

    #[inline]
    fn value(&mut self, b: &mut Builder, x: f64) -> Result<(), Kind> {
        if self.values.len() == self.values.capacity() {
            b.budget.grow(&mut self.values, 3, "texture coordinates or normals")?;
        }
        self.values.push(x);
        Ok(())
    }

    fn finish(self, b: &mut Builder, name: &str, kind: LayerKind) {
        let mut layer = Attribute::new(name, kind, self.width as u8, Stored::F32);
        layer.values = self.values;
        layer.place = Values::Listed(self.at);
        layer.outside = self.outside;
        if !layer.values.is_empty() {
            b.layers.push(layer);
            return;
        }
        let Values::Listed(list) = &layer.place else { return };
        let count = self.outside + list.iter().filter(|i| **i != NO_VALUE).count() as u64;
        if count > 0 {
            b.tally.others.push(Warning::MissingValues { layer: name.to_string(), count });
        }
    }
}

/// All that a file says beside positions and corners.
struct Extras {
    layers: Layers,
    uvs: Side,
    normals: Side,
    colours: Colours,
    libraries: Vec<String>,
    /// Materials in the order of their first use.
    materials: Vec<String>,
    numbers: BTreeMap<String, u32>,
}

pub(super) fn read(bytes: &[u8], base: Option<&Folder>, options: &ReadOptions) -> Result<ReadMesh, Fail> {
    let mut b = Builder::new(options, false, bytes.len());
    let mut c = Cursor::new(bytes);
    let mut farthest = Farthest::default();
    let mut unknown = Unknown::default();
    let mut x = Extras {
        layers: Layers::default(),
        uvs: Side::new(!options.drop.uvs, 2),
        normals: Side::new(!options.drop.normals, 3),
        colours: Colours::default(),
        libraries: Vec::new(),
        materials: Vec::new(),
        numbers: BTreeMap::new(),
    };
    loop {
        c.skip_blanks_continued();
        let Some(first) = c.peek() else { break };
        match first {
            // Nearly all lines are one of these two.
            b'v' if c.rest().get(1) == Some(&b' ') => {
                c.skip_byte();
                vertex(&mut b, &mut c, &mut x)?;
            }
            b'f' if c.rest().get(1) == Some(&b' ') => {
                c.skip_byte();
                face(&mut b, &mut c, &mut x, &mut farthest)?;
            }
            b'\n' | b'\r' => c.end_line(),
            b'#' => c.skip_line_continued(),
            _ => match c.word() {
                b"v" => vertex(&mut b, &mut c, &mut x)?,
                b"f" | b"fo" => face(&mut b, &mut c, &mut x, &mut farthest)?,
                b"vt" => texture(&mut b, &mut c, &mut x)?,
                b"vn" => normal(&mut b, &mut c, &mut x)?,
                b"l" => line(&mut b, &mut c, &mut x, &mut farthest)?,
                b"p" => {
                    corners(&mut c, b.records(), "a point", &mut farthest, |_, _| Ok(()))?;
                    c.skip_line_continued();
                }
                b"g" | b"o" | b"s" => x.layers.skip(&mut c, Layer::Groups),
                b"usemtl" => use_material(&mut b, &mut c, &mut x)?,
                b"mtllib" => library(&mut b, &mut c, &mut x)?,
                b"usemap" | b"maplib" => x.layers.skip(&mut c, Layer::Materials),
                b"vp" | b"cstype" | b"deg" | b"bmat" | b"step" | b"curv" | b"curv2" | b"surf" | b"parm" | b"trim"
                | b"hole" | b"scrv" | b"sp" | b"end" | b"con" => x.layers.skip(&mut c, Layer::FreeForm),
                // Hints for display, without a meaning for the mesh.
                b"mg" | b"bevel" | b"c_interp" | b"d_interp" | b"lod" | b"shadow_obj" | b"trace_obj" | b"ctech"
                | b"stech" => c.skip_line_continued(),
                word => {
                    unknown.count += 1;
                    let line = c.line();
                    unknown.first.get_or_insert_with(|| (word_text(word), line));
                    c.skip_line_continued();
                }
            },
        }
    }
    let vertices = b.records();
    if vertices == 0 && unknown.count > 0 {
        let (format, expected, found) = ("an OBJ file", "a line such as `v 0 0 0`", printable(bytes));
        return Err(ReadErrorKind::WrongMagic { format, expected, found }.into());
    }
    if farthest.index > vertices as i64 {
        let Farthest { index, line, what } = farthest;
        let kind = ReadErrorKind::IndexOutOfRange { what, index, vertices: vertices as u64, first: 1 };
        return Err(Fail { place: Some(Place::Line(line)), kind });
    }
    let Extras { layers, uvs, normals, colours, libraries, materials, .. } = x;
    layers.report(&mut b);
    uvs.finish(&mut b, "uv", LayerKind::Uv);
    normals.finish(&mut b, "normal", LayerKind::Normal);
    colours.finish(&mut b, vertices)?;
    if let Some((first, line)) = unknown.first {
        b.tally.others.push(Warning::UnknownStatements { count: unknown.count, first, line });
    }
    if !materials.is_empty() {
        load_materials(&mut b, base, &libraries, &materials)?;
    }
    Ok(b.finish()?)
}

/// The rest of a line as text.
fn rest(c: &mut Cursor<'_>) -> String {
    let text = name::from_bytes(c.rest_of_line());
    c.skip_line();
    text
}

/// `usemtl NAME`
fn use_material(b: &mut Builder, c: &mut Cursor<'_>, x: &mut Extras) -> Result<(), Fail> {
    let at = c.place();
    if b.drop.materials {
        c.skip_line();
        return Ok(());
    }
    let name = rest(c);
    let number = match x.numbers.get(&name) {
        _ if name.is_empty() => NO_VALUE,
        Some(&number) => number,
        None => {
            b.budget.take(4 * name.len() as u64 + 200).at(|| at.clone())?;
            let number = x.materials.len() as u32;
            x.materials.push(name.clone());
            x.numbers.insert(name, number);
            number
        }
    };
    b.use_material(number).at(|| at)
}

/// `mtllib FILE…`
fn library(b: &mut Builder, c: &mut Cursor<'_>, x: &mut Extras) -> Result<(), Fail> {
    let at = c.place();
    let name = rest(c);
    if !b.drop.materials && !name.is_empty() && !x.libraries.contains(&name) && x.libraries.len() < MAX_LIBRARIES {
        b.budget.take(name.len() as u64 + 64).at(|| at)?;
        x.libraries.push(name);
    }
    Ok(())
}

fn word_text(word: &[u8]) -> String {
    word[..word.len().min(24)].escape_ascii().to_string()
}

/// What is left out, counted.
#[derive(Default)]
struct Layers {
    counts: [(Option<Layer>, u64); 8],
}

impl Layers {
    #[inline]
    fn add(&mut self, layer: Layer) {
        for (slot, count) in &mut self.counts {
            if slot.is_none_or(|l| l == layer) {
                *slot = Some(layer);
                *count += 1;
                return;
            }
        }
    }

    #[inline]
    fn skip(&mut self, c: &mut Cursor<'_>, layer: Layer) {
        self.add(layer);
        c.skip_line_continued();
    }

    fn report(self, b: &mut Builder) {
        for (layer, count) in self.counts {
            if let Some(layer) = layer {
                b.tally.drop_layer(layer, count);
            }
        }
    }
}

/// `vt u [v [w]]`
#[inline]
fn texture(b: &mut Builder, c: &mut Cursor<'_>, x: &mut Extras) -> Result<(), Fail> {
    if !x.uvs.wanted {
        c.skip_line_continued();
        return Ok(());
    }
    let mut uvw = [0.0; 3];
    for (k, value) in uvw.iter_mut().enumerate() {
        c.skip_blanks_continued();
        if k > 0 && (c.at_line_end() || c.peek() == Some(b'#')) {
            break;
        }
        *value = c.float("a texture coordinate").at(|| c.place())?;
    }
    if uvw[2] != 0.0 {
        x.layers.add(Layer::TextureDepth);
    }
    for value in &uvw[..2] {
        x.uvs.value(b, *value).at(|| c.place())?;
    }
    c.skip_line_continued();
    Ok(())
}

/// `vn x y z`
#[inline]
fn normal(b: &mut Builder, c: &mut Cursor<'_>, x: &mut Extras) -> Result<(), Fail> {
    if x.normals.wanted {
        for _ in 0..3 {
            c.skip_blanks_continued();
            let value = c.float("a component of a normal").at(|| c.place())?;
            x.normals.value(b, value).at(|| c.place())?;
        }
    }
    c.skip_line_continued();
    Ok(())
}

/// `v`, `v/vt`, `v//vn` or `v/vt/vn`, up to the end of the line. `take` gets of each the vertex as a record, and the
/// other two numbers as they stand there, 0 for none.
#[inline]
fn corners(
    c: &mut Cursor<'_>,
    records: usize,
    what: &'static str,
    farthest: &mut Farthest,
    mut take: impl FnMut(u32, [i64; 2]) -> Result<(), Kind>,
) -> Result<(), Fail> {
    loop {
        c.skip_blanks_continued();
        if c.at_line_end() || c.peek() == Some(b'#') {
            return Ok(());
        }
        let Some(index) = c.integer() else {
            return Err(c.unexpected("a vertex number")).at(|| c.place());
        };
        let mut beside = [0; 2];
        if c.peek() != Some(b' ') {
            // The numbers of texture coordinates and normals.
            let mut k = 0;
            while let Some(b'/') = c.peek() {
                c.skip_byte();
                if let (Some(i), Some(slot)) = (c.integer(), beside.get_mut(k)) {
                    *slot = i;
                }
                k += 1;
            }
        }
        if !c.at_word_end() {
            return Err(c.unexpected("the end of a vertex number")).at(|| c.place());
        }
        let record = if index > 0 { index - 1 } else { records as i64 + index };
        if index == 0 || record < 0 || record >= MAX as i64 {
            let kind = ReadErrorKind::IndexOutOfRange { what, index, vertices: records as u64, first: 1 };
            return Err(kind).at(|| c.place());
        }
        if record >= farthest.index {
            *farthest = Farthest { index: record + 1, line: c.line(), what };
        }
        take(record as u32, beside).at(|| c.place())?;
    }
}

/// `f v v v …`
#[inline]
fn face(b: &mut Builder, c: &mut Cursor<'_>, x: &mut Extras, farthest: &mut Farthest) -> Result<(), Fail> {
    corners(c, b.records(), "a face", farthest, |v, [vt, vn]| {
        let corner = b.corner_count();
        x.uvs.put(b, corner, vt)?;
        x.normals.put(b, corner, vn)?;
        b.corner(v)
    })?;
    b.end_face().at(|| c.place())?;
    // A face that was none has left no corners.
    x.uvs.at.truncate(b.corner_count());
    x.normals.at.truncate(b.corner_count());
    c.skip_line_continued();
    Ok(())
}

/// `l v v v …`: an edge between each two neighbours.
fn line(b: &mut Builder, c: &mut Cursor<'_>, x: &mut Extras, farthest: &mut Farthest) -> Result<(), Fail> {
    let (records, mut last) = (b.records(), None);
    let mut single = true;
    corners(c, records, "a line", farthest, |v, beside| {
        if let Some((u, before)) = last.replace((v, beside)) {
            single = false;
            let corner = b.corner_count();
            b.edge(u, v)?;
            if b.corner_count() > corner {
                for (k, [vt, vn]) in [before, beside].into_iter().enumerate() {
                    x.uvs.put(b, corner + k, vt)?;
                    x.normals.put(b, corner + k, vn)?;
                }
            }
        }
        Ok(())
    })?;
    if single {
        // A line of one vertex is a point, one of none is nothing: counted as such faces are.
        if let Some((v, _)) = last {
            b.corner(v).at(|| c.place())?;
        }
        b.end_face().at(|| c.place())?;
    }
    c.skip_line_continued();
    Ok(())
}

#[cfg(test)]
mod tests;
