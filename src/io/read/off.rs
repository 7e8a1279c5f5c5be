//! OFF and its kin (COFF, NOFF, CNOFF, STOFF, …), ASCII.
//!
//! The letters before `OFF` announce what follows the three coordinates on each vertex line: a normal, a colour of three
//! or four numbers, texture coordinates, in this order. A colour behind a face is skipped, counted. Comments run from
//! `#` to the end of the line.

use super::attribute::Attribute;
use super::build::{Builder, Kind, MAX, index_from_zero};
use super::error::{At, Fail, ReadErrorKind, printable};
use super::text::Cursor;
use super::warning::Layer;
use super::{ReadMesh, ReadOptions};
use crate::mesh::{LayerKind, Stored};

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<ReadMesh, Fail> {
    let mut c = Cursor::new(bytes);
    c.skip_space_and_comments();
    let layers = keyword(&mut c, bytes)?;
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
    let mut beside = Extras::new(&layers);
    for _ in 0..vertices {
        let mut p = [0.0; 3];
        for x in &mut p {
            c.skip_space_and_comments();
            *x = c.float("a coordinate").at(|| c.place())?;
        }
        b.vertex(p).at(|| c.place())?;
        if beside.announced > 0 {
            beside.line(&mut b, &mut c)?;
        }
        c.skip_line();
    }
    beside.finish(&mut b);
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

/// What follows the coordinates of vertices.
struct Extras {
    announced: usize,
    /// Normals, colours, texture coordinates; NaN where a line has none.
    values: [Vec<f64>; 3],
    /// Which of them are there.
    there: [bool; 3],
    /// Whether some colour has four numbers.
    alpha: bool,
}

impl Extras {
    fn new(layers: &[Layer]) -> Self {
        let there = [Layer::Normals, Layer::Colours, Layer::TextureCoordinates].map(|l| layers.contains(&l));
        Extras { announced: layers.len(), values: Default::default(), there, alpha: false }
    }

    /// The rest of a vertex line.
    fn line(&mut self, b: &mut Builder, c: &mut Cursor<'_>) -> Result<(), Fail> {
        let (mut numbers, mut n) = ([f64::NAN; 9], 0);
        c.skip_blanks();
        while n < 9 && !c.at_line_end() && c.peek() != Some(b'#') {
            numbers[n] = c.float("a number or the end of the line").at(|| c.place())?;
            n += 1;
            c.skip_blanks();
        }
        let (behind, before) = (2 * usize::from(self.there[2]), 3 * usize::from(self.there[0]));
        let middle = n.saturating_sub(before + behind);
        let mut colour = [f64::NAN, f64::NAN, f64::NAN, 1.0];
        if middle >= 3 {
            self.alpha |= middle >= 4;
            let count = middle.min(4);
            colour[..count].copy_from_slice(&numbers[before..before + count]);
        }
        let texture = if n >= before + behind { &numbers[n - behind..n] } else { &[f64::NAN; 2][..behind] };
        for (k, list) in [&numbers[..3], &colour[..], texture].into_iter().enumerate() {
            if !self.there[k] {
                continue;
            }
            let values = &mut self.values[k];
            if values.len() + list.len() > values.capacity() {
                b.budget.grow(values, list.len(), "values of an attribute").at(|| c.place())?;
            }
            values.extend_from_slice(list);
        }
        Ok(())
    }

    fn finish(self, b: &mut Builder) {
        let names = [("normal", LayerKind::Normal, 3), ("color", LayerKind::Color, 4), ("uv", LayerKind::Uv, 2)];
        for ((values, (name, kind, width)), there) in self.values.into_iter().zip(names).zip(self.there) {
            if !there || values.is_empty() || b.drop.kind(kind) {
                continue;
            }
            let mut layer = Attribute::new(name, kind, width, Stored::F32).everywhere();
            (layer.values, layer.gaps) = (values, true);
            if kind == LayerKind::Color {
                if !self.alpha {
                    layer.width = 3;
                    layer.values = layer.values.chunks_exact(4).flat_map(|c| [c[0], c[1], c[2]]).collect();
                }
                layer.scale_colours();
            }
            b.layers.push(layer);
        }
    }
}

/// `[ST][C][N][4][n]OFF`: what each vertex has beside its coordinates.
fn keyword(c: &mut Cursor<'_>, bytes: &[u8]) -> Result<Vec<Layer>, Fail> {
    let word = c.word();
    let Some(mut flags) = word.strip_suffix(b"OFF") else {
        let (format, expected, found) = ("an OFF file", "`OFF` (or COFF, NOFF, …)", printable(bytes));
        return Err(ReadErrorKind::WrongMagic { format, expected, found }.into());
    };
    let mut layers = Vec::new();
    for (flag, layer) in [
        (&b"ST"[..], Some(Layer::TextureCoordinates)),
        (b"C", Some(Layer::Colours)),
        (b"N", Some(Layer::Normals)),
        (b"4", None),
        (b"n", None),
    ] {
        if let Some(rest) = flags.strip_prefix(flag) {
            flags = rest;
            let Some(layer) = layer else {
                let what = format!("{} with coordinates of another number than three", String::from_utf8_lossy(word));
                let advice = "convert the file to three coordinates per vertex";
                return Err(ReadErrorKind::Unsupported { what, advice }).at(|| c.place());
            };
            layers.push(layer);
        }
    }
    // `NCOFF` is written too.
    if flags == b"C" && !layers.contains(&Layer::Colours) {
        layers.push(Layer::Colours);
        flags = b"";
    }
    if !flags.is_empty() {
        let (format, expected, found) = ("an OFF file", "`OFF` (or COFF, NOFF, …)", printable(bytes));
        return Err(ReadErrorKind::WrongMagic { format, expected, found }.into());
    }
    Ok(layers)
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
                keyword.contains('C').then(|| if more.ends_with("255") { [&red[..], &[1.0]].concat() } else { red });
            assert_eq!(of(LayerKind::Color), colour, "{keyword}");
            assert_eq!(of(LayerKind::Normal), keyword.contains('N').then(|| vec![0.0, 0.0, 1.0]), "{keyword}");
            assert_eq!(of(LayerKind::Uv), keyword.contains("ST").then(|| vec![0.5, 0.25]), "{keyword}");
        }
        let m = off("OFF 3 1 3\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2");
        assert_eq!(faces(&m), [[0, 1, 2]]);
        assert_eq!(off("OFF\n0 0 0\n").mesh.vertex_count(), 0);
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
            "input, line 3: vertex 0 (counted from 0) has a coordinate that is not a finite number (NaN); mend or remove the vertex"
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
            "input: this is not an OFF file: \"8 6 12\" stands where `OFF` (or COFF, NOFF, …) belongs; check the file or name its true format"
        );
    }
}
