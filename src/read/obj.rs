//! Wavefront OBJ: `v`, `f` of any degree, `l` as dangling edges, `p`; all else is skipped and counted.
//!
//! Vertices are numbered from 1; negative numbers count back from the last vertex so far. A face may name a
//! vertex that comes later, so numbers are checked at the end, against the largest one seen. `\` at the end of
//! a line joins it with the next.

use super::build::{Builder, Kind, MAX};
use super::error::{At, Fail, Place, ReadErrorKind, printable};
use super::text::Cursor;
use super::warning::{Layer, Warning};
use super::{ReadMesh, ReadOptions};

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

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<ReadMesh, Fail> {
    let mut b = Builder::new(options, false, bytes.len());
    let mut c = Cursor::new(bytes);
    let mut farthest = Farthest::default();
    let mut unknown = Unknown::default();
    let mut layers = Layers::default();
    loop {
        c.skip_blanks_continued();
        let Some(first) = c.peek() else { break };
        match first {
            // Nearly all lines are one of these two.
            b'v' if c.rest().get(1) == Some(&b' ') => {
                c.skip_byte();
                vertex(&mut b, &mut c, &mut layers)?;
            }
            b'f' if c.rest().get(1) == Some(&b' ') => {
                c.skip_byte();
                face(&mut b, &mut c, &mut farthest)?;
            }
            b'\n' | b'\r' => c.end_line(),
            b'#' => c.skip_line_continued(),
            _ => match c.word() {
                b"v" => vertex(&mut b, &mut c, &mut layers)?,
                b"f" | b"fo" => face(&mut b, &mut c, &mut farthest)?,
                b"vt" => layers.skip(&mut c, Layer::TextureCoordinates),
                b"vn" => layers.skip(&mut c, Layer::Normals),
                b"l" => line(&mut b, &mut c, &mut farthest)?,
                b"p" => {
                    corners(&mut c, b.records(), "a point", &mut farthest, |_| Ok(()))?;
                    c.skip_line_continued();
                }
                b"g" | b"o" | b"s" => layers.skip(&mut c, Layer::Groups),
                b"usemtl" | b"mtllib" | b"usemap" | b"maplib" => layers.skip(&mut c, Layer::Materials),
                b"vp" | b"cstype" | b"deg" | b"bmat" | b"step" | b"curv" | b"curv2" | b"surf" | b"parm" | b"trim"
                | b"hole" | b"scrv" | b"sp" | b"end" | b"con" => layers.skip(&mut c, Layer::FreeForm),
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
    layers.report(&mut b);
    if let Some((first, line)) = unknown.first {
        b.tally.others.push(Warning::UnknownStatements { count: unknown.count, first, line });
    }
    Ok(b.finish()?)
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
fn vertex(b: &mut Builder, c: &mut Cursor<'_>, layers: &mut Layers) -> Result<(), Fail> {
    let mut p = [0.0; 3];
    for x in &mut p {
        c.skip_blanks_continued();
        *x = c.float("a coordinate").at(|| c.place())?;
    }
    b.vertex(p).at(|| c.place())?;
    c.skip_blanks_continued();
    if !c.at_line_end() && c.peek() != Some(b'#') {
        extra(c, layers)?;
    }
    c.skip_line_continued();
    Ok(())
}

/// What follows the three coordinates: one number is a weight, three and more hold a colour.
fn extra(c: &mut Cursor<'_>, layers: &mut Layers) -> Result<(), Fail> {
    let (mut count, mut first) = (0, 1.0);
    while !c.at_line_end() && c.peek() != Some(b'#') {
        let value = c.float("a number or the end of the line").at(|| c.place())?;
        if count == 0 {
            first = value;
        }
        count += 1;
        c.skip_blanks_continued();
    }
    if count >= 3 {
        layers.add(Layer::Colours);
    }
    if matches!(count, 1 | 2 | 4) && first != 1.0 {
        layers.add(Layer::VertexWeights);
    }
    Ok(())
}

/// `v`, `v/vt`, `v//vn` or `v/vt/vn`, up to the end of the line; the vertex of each goes to `take` as a record.
#[inline]
fn corners(
    c: &mut Cursor<'_>,
    records: usize,
    what: &'static str,
    farthest: &mut Farthest,
    mut take: impl FnMut(u32) -> Result<(), Kind>,
) -> Result<(), Fail> {
    loop {
        c.skip_blanks_continued();
        if c.at_line_end() || c.peek() == Some(b'#') {
            return Ok(());
        }
        let Some(index) = c.integer() else {
            return Err(c.unexpected("a vertex number")).at(|| c.place());
        };
        if c.peek() != Some(b' ') {
            // The numbers of texture coordinates and normals.
            while let Some(b'/') = c.peek() {
                c.skip_byte();
                c.integer();
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
        take(record as u32).at(|| c.place())?;
    }
}

/// `f v v v …`
#[inline]
fn face(b: &mut Builder, c: &mut Cursor<'_>, farthest: &mut Farthest) -> Result<(), Fail> {
    corners(c, b.records(), "a face", farthest, |v| b.corner(v))?;
    b.end_face().at(|| c.place())?;
    c.skip_line_continued();
    Ok(())
}

/// `l v v v …`: an edge between each two neighbours.
fn line(b: &mut Builder, c: &mut Cursor<'_>, farthest: &mut Farthest) -> Result<(), Fail> {
    let (records, mut last) = (b.records(), None);
    let mut single = true;
    corners(c, records, "a line", farthest, |v| {
        if let Some(u) = last.replace(v) {
            single = false;
            b.edge(u, v)?;
        }
        Ok(())
    })?;
    if single {
        // A line of one vertex is a point, one of none is nothing: counted as such faces are.
        if let Some(v) = last {
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
                "texture coordinates are not carried yet (1 record left out)",
                "normals are not carried yet (1 record left out)",
                "colours are not carried yet (1 record left out)",
                "materials are not carried yet (2 records left out)",
                "names of groups and objects are not carried yet (2 records left out)",
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
