//! OFF and its kin (COFF, NOFF, CNOFF, STOFF, …), ASCII.
//!
//! The letters before `OFF` announce what follows the three coordinates on each vertex line: a normal, a colour of
//! three or four numbers, texture coordinates, in this order. The keyword may be missing, and the first count may
//! stand right behind it. Colours also stand on the lines of files that do not announce them, and programs that write
//! `NCOFF` put the colour before the normal: what has the length of a normal tells. A colour behind a face is skipped,
//! counted. Comments run from `#` to the end of the line.

use super::attribute::{Attribute, opaque};
use super::build::{Builder, Kind, MAX, index_from_zero};
use super::error::{At, Fail, ReadErrorKind, printable};
use super::text::Cursor;
use super::warning::Layer;
use super::{ReadMesh, ReadOptions};
use crate::mesh::{LayerKind, Stored};

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<ReadMesh, Fail> {
    let mut c = Cursor::new(bytes);
    c.skip_space_and_comments();
    let flags = keyword(&mut c, bytes)?;
    c.skip_blanks();
    if c.rest().starts_with(b"BINARY") {
        let what = "binary OFF".to_string();
        return Err(ReadErrorKind::Unsupported { what, advice: "convert the file to ASCII OFF or to PLY" })
            .at(|| c.place());
    }
    c.skip_space_and_comments();
    let vertices = count(&mut c, "vertices", 6)?;
    c.skip_space_and_comments();
    let faces = count(&mut c, "faces", 2)?;
    // The number of edges may be missing and means nothing.
    c.skip_line();

    let mut b = Builder::new(options, false, bytes.len());
    b.expect_records(vertices as usize).at(|| c.place())?;
    b.expect_faces(faces as usize, 0).at(|| c.place())?;
    let mut beside = Beside::new(flags);
    for _ in 0..vertices {
        let mut p = [0.0; 3];
        for x in &mut p {
            c.skip_space_and_comments();
            *x = c.float("a coordinate").at(|| c.place())?;
        }
        b.vertex(p).at(|| c.place())?;
        c.skip_blanks();
        beside.line(&mut b, &mut c)?;
        c.skip_line();
    }
    beside.finish(&mut b)?;
    let mut coloured = 0;
    for _ in 0..faces {
        c.skip_space_and_comments();
        let degree = c.whole("a number of corners").at(|| c.place())?;
        if degree < 0 {
            return Err(Kind::Syntax(format!("a face of {degree} corners; mend the number"))).at(|| c.place());
        }
        for _ in 0..degree {
            c.skip_blanks();
            if c.at_line_end() || c.peek() == Some(b'#') {
                c.skip_space_and_comments();
            }
            let index = c.whole("a vertex number").at(|| c.place())?;
            let v = index_from_zero(index, vertices, "a face").at(|| c.place())?;
            b.corner(v).at(|| c.place())?;
        }
        b.end_face().at(|| c.place())?;
        c.skip_blanks();
        if !c.at_line_end() {
            coloured += u64::from(c.peek() != Some(b'#'));
            c.skip_line();
        }
    }
    if !b.drop.colors {
        b.tally.drop_layer(Layer::FaceColours, coloured);
    }
    Ok(b.finish()?)
}

/// What the keyword announces.
#[derive(Clone, Copy, Default)]
struct Flags {
    texture: bool,
    colour: bool,
    normal: bool,
    /// `N` before `C`: written by programs that put the colour before the normal.
    turned: bool,
}

/// The most numbers behind coordinates that mean something: a normal, a colour, texture coordinates.
const MOST: usize = 9;

/// What follows the coordinates of vertices.
struct Beside {
    flags: Flags,
    /// Vertices so far.
    lines: usize,
    /// The numbers of each vertex that has some: which vertex, how many, which.
    rows: Vec<(u32, u8, [f64; MOST])>,
    /// Vertices with numbers that mean nothing.
    further: u64,
}

impl Beside {
    fn new(flags: Flags) -> Self {
        Beside { flags, lines: 0, rows: Vec::new(), further: 0 }
    }

    /// The rest of a vertex line.
    #[inline]
    fn line(&mut self, b: &mut Builder, c: &mut Cursor<'_>) -> Result<(), Fail> {
        self.lines += 1;
        if c.at_line_end() || c.peek() == Some(b'#') {
            return Ok(());
        }
        let Flags { texture, colour, normal, .. } = self.flags;
        let announced = texture || colour || normal;
        let (mut numbers, mut n) = ([f64::NAN; MOST], 0);
        while !c.at_line_end() && c.peek() != Some(b'#') {
            let number = c.float("a number or the end of the line");
            // What was not announced may be anything.
            let number = if announced { number.at(|| c.place())? } else { number.unwrap_or(f64::INFINITY) };
            if number == f64::INFINITY && !announced || n == MOST {
                self.further += 1;
                if !announced {
                    return Ok(());
                }
                break;
            }
            numbers[n] = number;
            n += 1;
            c.skip_blanks();
        }
        if self.rows.len() == self.rows.capacity() {
            b.budget.grow(&mut self.rows, 1, "values of an attribute").at(|| c.place())?;
        }
        self.rows.push((self.lines as u32 - 1, n as u8, numbers));
        Ok(())
    }

    /// Whether normals stand before colours: where a normal is, numbers have the length 1.
    fn normal_first(&self) -> bool {
        let unit = |v: &[f64]| (v.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 0.02;
        let behind = 2 * usize::from(self.flags.texture);
        let (mut first, mut last) = (0u64, 0u64);
        for (_, n, numbers) in &self.rows {
            let end = (*n as usize).saturating_sub(behind);
            if end >= 6 {
                first += u64::from(unit(&numbers[..3]));
                last += u64::from(unit(&numbers[end - 3..end]));
            }
        }
        if first == last { !self.flags.turned } else { first > last }
    }

    fn finish(mut self, b: &mut Builder) -> Result<(), Kind> {
        let Flags { texture, normal, .. } = self.flags;
        let normal_first = !(normal && self.flags.colour) || self.normal_first();
        let behind = 2 * usize::from(texture);
        let (mut colours, mut fours) = (0usize, 0usize);
        let middle = |n: u8| (n as usize).saturating_sub(behind + 3 * usize::from(normal));
        for (_, n, _) in &self.rows {
            colours += usize::from(matches!(middle(*n), 3 | 4));
            fours += usize::from(middle(*n) == 4);
            self.further += u64::from(!matches!(middle(*n), 0 | 3 | 4));
        }
        let width = if fours > 0 { 4 } else { 3 };
        let there = [(normal, "normal", LayerKind::Normal, 3), (colours > 0, "color", LayerKind::Color, width)];
        let there = there.into_iter().chain([(texture, "uv", LayerKind::Uv, 2)]);
        for (there, name, kind, width) in there {
            if !there || self.rows.is_empty() || b.drop.kind(kind) {
                continue;
            }
            let mut layer = Attribute::new(name, kind, width, Stored::F32).everywhere();
            let width = width as usize;
            b.budget.reserve(&mut layer.values, self.lines * width)?;
            layer.values.resize(self.lines * width, f64::NAN);
            layer.gaps = true;
            for (line, n, numbers) in &self.rows {
                let (n, middle) = (*n as usize, middle(*n));
                let before = if normal && normal_first { 3 } else { 0 };
                let found = match kind {
                    LayerKind::Normal if normal_first => numbers.get(..3.min(n)),
                    LayerKind::Normal => n.checked_sub(behind + 3).and_then(|at| numbers.get(at..at + 3)),
                    LayerKind::Color if matches!(middle, 3 | 4) => numbers.get(before..before + middle),
                    LayerKind::Uv => n.checked_sub(2).and_then(|at| numbers.get(at..n)),
                    _ => None,
                };
                if let Some(found) = found.filter(|f| f.len() <= width) {
                    layer.values[*line as usize * width..][..found.len()].copy_from_slice(found);
                }
            }
            if kind == LayerKind::Color {
                opaque(&mut layer);
                layer.scale_colours(&mut b.tally);
            }
            b.layers.push(layer);
        }
        b.tally.drop_layer(Layer::FurtherNumbers, self.further);
        Ok(())
    }
}

/// `[ST][C][N][4][n]OFF` in any order: what each vertex has beside its coordinates. The cursor stands behind it, or at
/// the first count of a file without.
fn keyword(c: &mut Cursor<'_>, bytes: &[u8]) -> Result<Flags, Fail> {
    let start = c.clone();
    let word = c.word();
    let refused = || {
        let (format, expected, found) = ("an OFF file", "`OFF` (or COFF, NOFF, …) or a count", printable(bytes));
        Err(ReadErrorKind::WrongMagic { format, expected, found }.into())
    };
    if !word.is_empty() && word.iter().all(u8::is_ascii_digit) {
        *c = start;
        return Ok(Flags::default());
    }
    let Some(at) = word.windows(3).position(|w| w == b"OFF" || w == b"off") else { return refused() };
    let (mut letters, glued) = (&word[..at], &word[at + 3..]);
    if !glued.iter().all(u8::is_ascii_digit) {
        return refused();
    }
    *c = start;
    (0..at + 3).for_each(|_| c.skip_byte());
    let mut flags = Flags::default();
    while let Some(letter) = letters.first() {
        match letter {
            b'S' if letters.starts_with(b"ST") && !flags.texture => {
                flags.texture = true;
                letters = &letters[1..];
            }
            b'C' if !flags.colour => (flags.colour, flags.turned) = (true, flags.normal),
            b'N' if !flags.normal => flags.normal = true,
            b'4' | b'n' => {
                let what = format!("{} with coordinates of another number than three", String::from_utf8_lossy(word));
                let advice = "convert the file to three coordinates per vertex";
                return Err(ReadErrorKind::Unsupported { what, advice }).at(|| c.place());
            }
            _ => return refused(),
        }
        letters = &letters[1..];
    }
    Ok(flags)
}

/// A count of the header, held against the bytes that follow; each takes at least `least` of them.
fn count(c: &mut Cursor<'_>, what: &str, least: u64) -> Result<u64, Fail> {
    let value = c.whole(&format!("the number of {what}")).at(|| c.place())?;
    let bytes = c.rest().len() as u64;
    let count = value.unsigned_abs();
    if value < 0 {
        return Err(Kind::Syntax(format!("{value} {what} are announced; mend the header"))).at(|| c.place());
    }
    // The last line needs no end.
    if count.saturating_mul(least) > bytes + 1 || count > MAX as u64 {
        return Err(ReadErrorKind::Count { what: what.to_string(), count, bytes }).at(|| c.place());
    }
    Ok(count)
}

#[cfg(test)]
mod tests {
    use super::super::{Format, ReadMesh, ReadOptions, read_bytes};
    use crate::mesh::LayerKind;

    fn off(text: &str) -> ReadMesh {
        read_bytes(text.as_bytes(), Format::Off, None, &ReadOptions::default()).unwrap()
    }

    fn error(text: &str) -> String {
        read_bytes(text.as_bytes(), Format::Off, None, &ReadOptions::default()).unwrap_err().to_string()
    }

    fn faces(m: &ReadMesh) -> Vec<Vec<u32>> {
        m.mesh.faces().map(<[u32]>::to_vec).collect()
    }

    #[test]
    fn plain_with_comments_and_face_colours() {
        let m = off("# by hand\nOFF # really\n4 4 0 # counts\n\n0 0 0\n1 0 0 # a vertex\n# between\n1 1 0\n0 1 .5\n\
                     4 0 1 2 3\n3 0 1 2 255 0 0\n2 0\n 3\n1 2");
        assert_eq!(m.mesh.positions[3], [0.0, 1.0, 0.5]);
        assert_eq!(faces(&m), [vec![0, 1, 2, 3], vec![0, 1, 2], vec![0, 3]]);
        let texts: Vec<_> = m.warnings.iter().map(ToString::to_string).collect();
        assert_eq!(
            texts,
            [
                "2 faces with fewer than three corners were read as edges or points",
                "colours of faces are not carried (1 record left out)"
            ]
        );
    }

    #[test]
    fn vertices_with_more_than_coordinates() {
        for (keyword, more, layers) in [
            ("COFF", "255 0 0 255", 1),
            ("COFF", "0.5 0 0", 1),
            ("NOFF", "0 0 1", 1),
            ("CNOFF", "0 0 1 1 0 0", 2),
            ("NCOFF", "0 0 1 255 0 0", 2),
            ("NCOFF", "255 0 0 255 0 0 1", 2),
            ("NCOFF", "255 0 0 0 0 1", 2),
            ("CSTOFF", "255 0 0 255 0.5 0.25", 2),
            ("STOFF", "0.5 0.25", 1),
            ("STCNOFF", "0 0 1 255 0 0 0.5 0.25", 3),
        ] {
            let m = off(&format!("{keyword}\r\n3 1\r\n0 0 0 {more}\r\n1 0 0 {more}\r\n0 1 0 {more}\r\n3 0 1 2\r\n"));
            assert_eq!((m.mesh.vertex_count(), faces(&m)), (3, vec![vec![0, 1, 2]]), "{keyword}");
            assert_eq!((m.mesh.layers.len(), m.warnings.len()), (layers, 0), "{keyword}");
            let of = |kind| m.mesh.layers.iter().find(|l| l.kind == kind).map(|l| l.value(0).to_vec());
            let red =
                if keyword == "COFF" && more.starts_with("0.5") { vec![0.5, 0.0, 0.0] } else { vec![1.0, 0.0, 0.0] };
            let colour =
                keyword.contains('C').then(|| if more.contains("0 0 255") { [&red[..], &[1.0]].concat() } else { red });
            assert_eq!(of(LayerKind::Color), colour, "{keyword}");
            assert_eq!(of(LayerKind::Normal), keyword.contains('N').then(|| vec![0.0, 0.0, 1.0]), "{keyword}");
            assert_eq!(of(LayerKind::Uv), keyword.contains("ST").then(|| vec![0.5, 0.25]), "{keyword}");
        }
        let m = off("OFF 3 1 3\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2");
        assert_eq!(faces(&m), [[0, 1, 2]]);
        assert_eq!(error("OFF\n0 0 0\n").split(';').next(), Some("input: there is no vertex in it"));
    }

    #[test]
    fn errors_say_where_what_and_what_to_do() {
        let head = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n";
        assert_eq!(
            error(&format!("{head}3 0 1 3\n")),
            "input, line 6: a face names vertex 3, but the file has 3 vertices, numbered from 0; mend the index or add the vertex"
        );
        assert_eq!(
            error(head),
            "input, line 6: the file ends inside a line, before a number of corners; it was cut, fetch it again"
        );
        assert_eq!(
            error("OFF\n3 1 0\n0 0 nan\n1 0 0\n0 1 0\n3 0 1 2"),
            "input, line 3: vertex 0 (counted from 0) has a coordinate that is not a finite number (NaN); mend or remove the vertex, or drop all such (--invalid drop)"
        );
        assert_eq!(
            error("OFF\n4000000000 1 0\n0 0 0\n"),
            "input, line 2: 4000000000 vertices are announced, but the 11 bytes that follow cannot hold them; the count is wrong or the file was cut"
        );
        assert_eq!(error("OFF\n-1 1 0\n"), "input, line 2: -1 vertices are announced; mend the header");
        assert_eq!(
            error("OFF BINARY\n\0\0"),
            "input, line 1: binary OFF is not supported; convert the file to ASCII OFF or to PLY"
        );
        assert_eq!(
            error("4OFF\n1 0 0\n0 0 0 1\n"),
            "input, line 1: 4OFF with coordinates of another number than three is not supported; convert the file to three coordinates per vertex"
        );
        assert_eq!(
            error("8 6 12\n"),
            "input, line 1: 8 vertices are announced, but the 6 bytes that follow cannot hold them; the count is wrong or the file was cut"
        );
        assert_eq!(
            error("solid\n"),
            "input: this is not an OFF file: \"solid\" stands where `OFF` (or COFF, NOFF, …) or a count belongs; check the file or name its true format"
        );
    }
}
