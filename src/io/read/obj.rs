//! Wavefront OBJ: `v`, `vt`, `vn`, `f` of any degree, `l` as dangling edges, `p`, `usemtl`, `mtllib`; all else is
//! skipped and counted.
//!
//! Vertices are numbered from 1; negative numbers count back from the last vertex so far. A face may name a
//! vertex that comes later, so numbers are checked at the end, against the largest one seen. A number of texture
//! coordinates or of a normal that is not there is as good as none. `\` at the end of a line joins it with the next.
//!
//! Materials are those that faces use, in the order of their first use. Libraries are read when the rest is done.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::json;

use super::appearance::{Files, shown};
use super::attribute::{Attribute, Place as Values};
use super::build::{Builder, Kind, MAX};
use super::error::{At, Fail, Place, ReadErrorKind, printable};
use super::mtl;
use super::text::Cursor;
use super::warning::{Layer, Warning};
use super::{ReadMesh, ReadOptions};
use crate::mesh::{LayerKind, NO_VALUE, Stored};

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
}

impl Side {
    fn new(wanted: bool, width: i64) -> Self {
        Side { wanted, values: Vec::new(), width, at: Vec::new() }
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
        if !layer.values.is_empty() {
            b.layers.push(layer);
        }
    }
}

/// All that a file says beside positions and corners.
struct Extras {
    layers: Layers,
    uvs: Side,
    normals: Side,
    /// Three numbers per record, NaN where there are none; may end early.
    colours: Vec<f64>,
    libraries: Vec<String>,
    /// Materials in the order of their first use.
    materials: Vec<String>,
    numbers: BTreeMap<String, u32>,
}

pub(super) fn read(bytes: &[u8], base: Option<&Path>, options: &ReadOptions) -> Result<ReadMesh, Fail> {
    let mut b = Builder::new(options, false, bytes.len());
    let mut c = Cursor::new(bytes);
    let mut farthest = Farthest::default();
    let mut unknown = Unknown::default();
    let mut x = Extras {
        layers: Layers::default(),
        uvs: Side::new(!options.drop.uvs, 2),
        normals: Side::new(!options.drop.normals, 3),
        colours: Vec::new(),
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
    let Extras { layers, uvs, normals, mut colours, libraries, materials, .. } = x;
    layers.report(&mut b);
    uvs.finish(&mut b, "uv", LayerKind::Uv);
    normals.finish(&mut b, "normal", LayerKind::Normal);
    if !colours.is_empty() {
        let more = (3 * vertices).saturating_sub(colours.len());
        b.budget.reserve(&mut colours, more)?;
        colours.resize(3 * vertices, f64::NAN);
        let mut layer = Attribute::new("color", LayerKind::Color, 3, Stored::F32).everywhere();
        (layer.values, layer.gaps) = (colours, true);
        layer.scale_colours();
        b.layers.push(layer);
    }
    if let Some((first, line)) = unknown.first {
        b.tally.others.push(Warning::UnknownStatements { count: unknown.count, first, line });
    }
    if !materials.is_empty() {
        load_materials(&mut b, base, &libraries, &materials)?;
    }
    Ok(b.finish()?)
}

/// The rest of a line as text.
fn name(c: &mut Cursor<'_>) -> String {
    let text = String::from_utf8_lossy(c.rest_of_line()).into_owned();
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
    let name = name(c);
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
    let name = name(c);
    if !b.drop.materials && !name.is_empty() && !x.libraries.contains(&name) && x.libraries.len() < MAX_LIBRARIES {
        b.budget.take(name.len() as u64 + 64).at(|| at)?;
        x.libraries.push(name);
    }
    Ok(())
}

/// Libraries beyond this number are not looked at: a file that names more is no mesh but an attack.
const MAX_LIBRARIES: usize = 1000;

/// Materials by their names, out of the libraries.
fn load_materials(
    b: &mut Builder,
    base: Option<&Path>,
    libraries: &[String],
    materials: &[String],
) -> Result<(), Kind> {
    let mut files = Files::new(base);
    let mut records: BTreeMap<String, mtl::Record> = BTreeMap::new();
    let mut take = |bytes: &[u8]| {
        for record in mtl::records(bytes) {
            records.entry(record.name.clone()).or_insert(record);
        }
    };
    for library in libraries {
        // Several names stand on one line, or one name with blanks.
        let whole = library.trim_matches('"');
        if let Some(bytes) = files.text(b, whole)? {
            take(&bytes);
            continue;
        }
        let parts: Vec<&str> = library.split_whitespace().collect();
        for part in &parts {
            match files.text(b, part)? {
                Some(bytes) => take(&bytes),
                None if parts.len() > 1 && !part.to_ascii_lowercase().ends_with(".mtl") => {
                    files.miss("material library", whole);
                    break;
                }
                None => files.miss("material library", part),
            }
        }
    }
    let mut undescribed = (0, Vec::new());
    let mut textures: BTreeMap<(u32, bool), usize> = BTreeMap::new();
    for name in materials {
        let Some(record) = records.get(name) else {
            undescribed.0 += 1;
            if undescribed.1.len() < 8 {
                undescribed.1.push(shown(name));
            }
            b.appearance.materials.push(json!({ "name": name }).to_string());
            continue;
        };
        let mut asked = Vec::new();
        let first = textures.len();
        let texture = |image: u32, clamp: bool| {
            let next = textures.len();
            *textures.entry((image, clamp)).or_insert_with(|| {
                asked.push((image, clamp));
                next
            })
        };
        let material = mtl::material(record, |file| files.image(b, file), texture)?.to_string();
        b.budget.take(2 * material.len() as u64)?;
        b.appearance.materials.push(material);
        debug_assert_eq!(first + asked.len(), textures.len());
        for (image, clamp) in asked {
            let texture = if clamp { json!({"source": image, "sampler": 0}) } else { json!({ "source": image }) };
            if clamp && b.appearance.samplers.is_empty() {
                b.appearance.samplers.push(json!({"wrapS": 33071, "wrapT": 33071}).to_string());
            }
            b.appearance.textures.push(texture.to_string());
        }
    }
    files.report(b);
    let (count, names) = undescribed;
    if count > 0 {
        b.tally.others.push(Warning::UnknownMaterials { count, names });
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

/// `v x y z [w] [r g b]`
#[inline]
fn vertex(b: &mut Builder, c: &mut Cursor<'_>, x: &mut Extras) -> Result<(), Fail> {
    let mut p = [0.0; 3];
    for x in &mut p {
        c.skip_blanks_continued();
        *x = c.float("a coordinate").at(|| c.place())?;
    }
    b.vertex(p).at(|| c.place())?;
    c.skip_blanks_continued();
    if !c.at_line_end() && c.peek() != Some(b'#') {
        extra(b, c, x)?;
    }
    c.skip_line_continued();
    Ok(())
}

/// What follows the three coordinates: one number is a weight, three and more hold a colour.
fn extra(b: &mut Builder, c: &mut Cursor<'_>, x: &mut Extras) -> Result<(), Fail> {
    let (mut count, mut first, mut last) = (0, 1.0, [0.0; 3]);
    while !c.at_line_end() && c.peek() != Some(b'#') {
        let value = c.float("a number or the end of the line").at(|| c.place())?;
        if count == 0 {
            first = value;
        }
        count += 1;
        last = [last[1], last[2], value];
        c.skip_blanks_continued();
    }
    if count >= 3 && !b.drop.colors {
        let at = 3 * (b.records() - 1);
        let more = at + 3 - x.colours.len();
        if at + 3 > x.colours.capacity() {
            b.budget.grow(&mut x.colours, more, "colours").at(|| c.place())?;
        }
        x.colours.resize(at, f64::NAN);
        x.colours.extend(last);
    }
    if matches!(count, 1 | 2 | 4) && first != 1.0 {
        x.layers.add(Layer::VertexWeights);
    }
    Ok(())
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
mod tests {
    use super::super::{Format, ReadMesh, ReadOptions, Warning, read_bytes};

    fn obj(text: &str) -> ReadMesh {
        read_bytes(text.as_bytes(), Format::Obj, None, &ReadOptions::default()).unwrap()
    }

    fn error(text: &str) -> String {
        read_bytes(text.as_bytes(), Format::Obj, None, &ReadOptions::default()).unwrap_err().to_string()
    }

    fn faces(m: &ReadMesh) -> Vec<Vec<u32>> {
        m.mesh.faces().map(<[u32]>::to_vec).collect()
    }

    #[test]
    fn polygons_lines_points_and_continuations() {
        let m = obj(
            "# a comment \\\nstill a comment\r\nmtllib a.mtl\r\no thing\nv 0 0 0\nv 1 0 \\\r\n0\nv 1 1 0 1.0\n\
             v 0 1 0 0.5 0.5 0.5\nv .5 1.5e0 0 # top\nvt 0 0\nvn 0 0 1\ng a b\nusemtl m\nf 1/1/1 2//1 3/1 5 4 # a face\n\
             f -5 -4 \\\n -1\nl 1 3 5\np 2 3\nf 1 1 2\n\tf 1 2\nf 3\nf 4 4\n  f  5 4 3",
        );
        assert_eq!(m.mesh.positions.len(), 5);
        assert_eq!(m.mesh.positions[4], [0.5, 1.5, 0.0]);
        let expected: [&[u32]; 7] = [&[0, 1, 2, 4, 3], &[0, 1, 4], &[0, 2], &[2, 4], &[0, 0, 1], &[0, 1], &[4, 3, 2]];
        assert_eq!(faces(&m), expected);
        assert_eq!(m.map, [0, 1, 2, 3, 4]);
        let texts: Vec<_> = m.warnings.iter().map(ToString::to_string).collect();
        assert_eq!(
            texts,
            [
                "2 faces with fewer than three corners were read as edges or points",
                "1 edge from a vertex to itself was read as a point",
                "texture coordinates are not carried (1 record left out)",
                "normals are not carried (1 record left out)",
                "colours are not carried (1 record left out)",
                "names of groups and objects are not carried (2 records left out)",
                "1 material library not found: a.mtl",
                "1 material is used but not described; the name is kept: m",
                "1 face has values of `uv` at some corners only; they were left out",
                "1 face has values of `normal` at some corners only; they were left out",
                "2 faces have values of `color` at some corners only; they were left out",
            ]
        );
    }

    #[test]
    fn forward_references_and_old_line_ends() {
        let m = obj("f 1 2 3\rv 0 0 0\rv 1 0 0\rv 0 1 0\r");
        assert_eq!(faces(&m), [[0, 1, 2]]);
        assert!(m.warnings.is_empty());
    }

    #[test]
    fn empty_files_and_unknown_statements() {
        assert_eq!(obj("").mesh.vertex_count(), 0);
        assert_eq!(obj("# nothing\n").mesh.vertex_count(), 0);
        let m = obj("v 0 0 0\nfrob 1\nfrob 2\n");
        let first = "frob".to_string();
        assert_eq!(m.warnings, [Warning::UnknownStatements { count: 2, first, line: 2 }]);
        assert_eq!(
            m.warnings[0].to_string(),
            "2 lines with an unknown statement skipped (the first: `frob` on line 2)"
        );
    }

    #[test]
    fn welding_on_demand() {
        let options = ReadOptions { weld: Some(true), ..Default::default() };
        let text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 0\nf 4 2 3\nl 1 4\nl 1 2";
        let m = read_bytes(text, Format::Obj, None, &options).unwrap();
        assert_eq!(faces(&m), [vec![0, 1, 2], vec![0, 1]]);
        assert_eq!(m.map, [0, 1, 2, 0]);
        assert_eq!(m.warnings, [Warning::PointEdges { count: 1 }]);
    }

    #[test]
    fn errors_say_where_what_and_what_to_do() {
        let v = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        assert_eq!(
            error(&format!("{v}f 1 2 9\n")),
            "input, line 4: a face names vertex 9, but the file has 3 vertices, numbered from 1; mend the index or add the vertex"
        );
        assert_eq!(
            error(&format!("{v}f 1 2 0\n")),
            "input, line 4: a face names vertex 0, but the file has 3 vertices, numbered from 1; mend the index or add the vertex"
        );
        assert_eq!(
            error(&format!("{v}l 1 -4\n")),
            "input, line 4: a line names vertex -4, but the file has 3 vertices, numbered from 1; mend the index or add the vertex"
        );
        assert_eq!(
            error("v 0 0 0\nv 0 nan 1\n"),
            "input, line 2: vertex 1 (counted from 0) has a coordinate that is not a finite number (NaN); mend or remove the vertex"
        );
        assert_eq!(
            error("v 0 0 1e999\n"),
            "input, line 1: vertex 0 (counted from 0) has a coordinate that is not a finite number (inf); mend or remove the vertex"
        );
        assert_eq!(error("v 0 0\n"), "input, line 1: the line ends where a coordinate belongs; complete it");
        assert_eq!(error("v 0 0 zero\n"), "input, line 1: \"zero\" stands where a coordinate belongs; mend it");
        assert_eq!(
            error(&format!("{v}f 1 2 x\n")),
            "input, line 4: \"x\" stands where a vertex number belongs; mend it"
        );
        assert_eq!(
            error(&format!("{v}f 1 2 3x\n")),
            "input, line 4: \"x\" stands where the end of a vertex number belongs; mend it"
        );
        assert_eq!(
            error("v 0 0"),
            "input, line 1: the file ends inside a line, before a coordinate; it was cut, fetch it again"
        );
        assert_eq!(
            error("\u{7f}ELF hello\n"),
            "input: this is not an OBJ file: \"\\x7fELF hello\" stands where a line such as `v 0 0 0` belongs; check the file or name its true format"
        );
    }
}
