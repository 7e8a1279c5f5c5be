//! STL, ASCII and binary. Corners repeat their vertex, so they are welded by default; loops of an ASCII file may
//! have any number of corners.
//!
//! Many binary files begin with `solid` as ASCII ones do: a file is binary when its size is what its count says,
//! or when it does not look like text. Where the size is one of whole triangles it is believed before the count.

use std::borrow::Cow;

use super::build::{Builder, Kind, MAX};
use super::error::{At, Fail, Place, ReadErrorKind, printable};
use super::text::Cursor;
use super::warning::{Layer, Warning};
use super::{ReadMesh, ReadOptions};

const HEADER: usize = 84;
const RECORD: usize = 50;

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<ReadMesh, Fail> {
    let mut b = Builder::new(options, true, bytes.len());
    if is_binary(bytes)? {
        binary(&mut b, bytes)?;
    } else {
        ascii(&mut b, bytes)?;
    }
    Ok(b.finish()?)
}

fn announced(bytes: &[u8]) -> Option<u64> {
    let n = bytes.get(80..HEADER)?;
    Some(u64::from(u32::from_le_bytes([n[0], n[1], n[2], n[3]])))
}

fn is_binary(bytes: &[u8]) -> Result<bool, Fail> {
    let size = |n: u64| HEADER as u64 + RECORD as u64 * n;
    if announced(bytes).is_some_and(|n| size(n) == bytes.len() as u64) {
        return Ok(true);
    }
    let head = &bytes[..bytes.len().min(512)];
    let text = !head.iter().any(|&c| c == 0 || c == 0x7f || c < 0x20 && !c.is_ascii_whitespace() && c != 0x0b);
    let start = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head).trim_ascii_start();
    if text && start.get(..5).is_some_and(|w| w.eq_ignore_ascii_case(b"solid")) {
        return Ok(false);
    }
    if text || bytes.len() < HEADER {
        let (format, found) = ("an STL file", printable(bytes));
        return Err(ReadErrorKind::WrongMagic { format, expected: "`solid` or a header of 84 bytes", found }.into());
    }
    Ok(true)
}

/// How many triangles a body has: what the header says, unless the size disproves it. Programs that do not know the
/// count when they begin write zero, or the largest number, and forget to come back.
fn count(b: &mut Builder, announced: u64, body: u64) -> Result<u64, Kind> {
    let (found, whole) = (body / RECORD as u64, body.is_multiple_of(RECORD as u64));
    let fits = announced.saturating_mul(RECORD as u64) <= body;
    match announced {
        n if n == found && whole => Ok(n),
        // A count of nothing, with something behind it, is no count.
        n if !whole && (n == 0 || !fits) => {
            Err(ReadErrorKind::Count { what: "triangles".to_string(), count: n, bytes: body })
        }
        n if !whole => Ok(n),
        announced => {
            b.tally.others.push(Warning::WrongCount { what: "triangles", announced, found });
            Ok(found)
        }
    }
}

fn binary(b: &mut Builder, bytes: &[u8]) -> Result<(), Fail> {
    let body = &bytes[HEADER.min(bytes.len())..];
    let count = count(b, announced(bytes).unwrap_or(0), body.len() as u64).at(|| Place::Byte(80))?;
    if 3 * count > MAX as u64 {
        return Err(ReadErrorKind::TooLarge { what: "corners", limit: MAX as u64 }).at(|| Place::Byte(80));
    }
    let (count, mut coloured) = (count as usize, 0);
    b.expect_records(3 * count)?;
    b.expect_faces(count, 3 * count)?;
    let (records, behind) = body.split_at(count * RECORD);
    for (i, r) in records.chunks_exact(RECORD).enumerate() {
        for k in 0..3 {
            let at = 12 + 12 * k;
            let p = std::array::from_fn(|axis| {
                let x = &r[at + 4 * axis..];
                f64::from(f32::from_le_bytes([x[0], x[1], x[2], x[3]]))
            });
            b.vertex(p).at(|| Place::Byte((HEADER + RECORD * i + at) as u64))?;
        }
        coloured += u64::from(r[48] != 0 || r[49] != 0);
        let first = 3 * i as u32;
        b.triangle([first, first + 1, first + 2])?;
    }
    b.tally.drop_layer(Layer::Colours, coloured);
    if !behind.is_empty() {
        b.tally.others.push(Warning::TrailingBytes { count: behind.len() as u64 });
    }
    Ok(())
}

/// Keywords in any case, `endloop` also as `end loop`; line breaks mean nothing but the end of a name.
fn ascii(b: &mut Builder, bytes: &[u8]) -> Result<(), Fail> {
    let mut c = Cursor::new(bytes);
    let is = |word: &[u8], keyword: &str| word.eq_ignore_ascii_case(keyword.as_bytes());
    let (mut open, mut names) = (false, 0);
    loop {
        c.skip_space();
        let before = c.clone();
        let word = keyword(&mut c);
        if word.is_empty() {
            break;
        }
        match &word[..] {
            w if is(w, "facet") => facet(b, &mut c)?,
            // The rest of the line is a name.
            w if is(w, "solid") => {
                open = true;
                names += u64::from(!c.rest_of_line().is_empty());
                c.skip_line();
            }
            w if is(w, "endsolid") => {
                open = false;
                c.skip_line();
            }
            _ => return Err(before.unexpected("`facet`, `solid` or `endsolid`")).at(|| before.place()),
        }
    }
    b.tally.drop_layer(Layer::SolidNames, names);
    if open {
        b.tally.others.push(Warning::UnfinishedSolid);
    }
    Ok(())
}

/// `facet normal n n n / outer loop / vertex x y z … / endloop / endfacet`, from behind `facet`.
fn facet(b: &mut Builder, c: &mut Cursor<'_>) -> Result<(), Fail> {
    expect(c, "normal")?;
    // The normal follows from the corners; writers put anything here, NaN too.
    for _ in 0..3 {
        c.skip_space();
        if c.word().is_empty() {
            return Err(c.unexpected("a normal")).at(|| c.place());
        }
    }
    expect(c, "outer")?;
    expect(c, "loop")?;
    loop {
        c.skip_space();
        let before = c.clone();
        let word = keyword(c);
        if word.eq_ignore_ascii_case(b"endloop") {
            break;
        }
        if !word.eq_ignore_ascii_case(b"vertex") {
            return Err(truncated(&before, "`vertex` or `endloop`")).at(|| before.place());
        }
        let mut p = [0.0; 3];
        for x in &mut p {
            c.skip_space();
            *x = c.float("a coordinate").at(|| c.place())?;
        }
        let record = b.records() as u32;
        b.vertex(p).at(|| c.place())?;
        b.corner(record).at(|| c.place())?;
    }
    b.end_face().at(|| c.place())?;
    expect(c, "endfacet")
}

/// The next word; `end` and the one behind it are one.
fn keyword<'a>(c: &mut Cursor<'a>) -> Cow<'a, [u8]> {
    let word = c.word();
    if !word.eq_ignore_ascii_case(b"end") {
        return Cow::Borrowed(word);
    }
    c.skip_blanks();
    Cow::Owned([word, c.word()].concat())
}

fn expect(c: &mut Cursor<'_>, wanted: &str) -> Result<(), Fail> {
    c.skip_space();
    let before = c.clone();
    if !keyword(c).eq_ignore_ascii_case(wanted.as_bytes()) {
        return Err(truncated(&before, &format!("`{wanted}`"))).at(|| before.place());
    }
    Ok(())
}

fn truncated(c: &Cursor<'_>, what: &str) -> Kind {
    if c.peek().is_none() {
        return ReadErrorKind::Truncated { what: format!("a facet, before {what}"), missing: None };
    }
    c.unexpected(what)
}

#[cfg(test)]
mod tests {
    use super::super::{Format, Layer, ReadMesh, ReadOptions, Warning, read_bytes};

    fn stl(bytes: &[u8]) -> ReadMesh {
        read_bytes(bytes, Format::Stl, None, &ReadOptions::default()).unwrap()
    }

    fn error(bytes: &[u8]) -> String {
        read_bytes(bytes, Format::Stl, None, &ReadOptions::default()).unwrap_err().to_string()
    }

    fn faces(m: &ReadMesh) -> Vec<Vec<u32>> {
        m.mesh.faces().map(<[u32]>::to_vec).collect()
    }

    const TEXT: &str = "solid a thing\n facet normal 0 0 nan\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   \
        vertex 0 1 0\n  endloop\n endfacet\nFACET NORMAL 0 0 1 OUTER LOOP VERTEX 0 1 0 VERTEX 1 0 -0 VERTEX 1 1 0 \
        VERTEX .5 2 0 ENDLOOP ENDFACET\nendsolid a thing\nsolid\nendsolid\n";

    fn binary(header: &[u8], triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
        let mut out = vec![0; 80];
        out[..header.len()].copy_from_slice(header);
        out.extend((triangles.len() as u32).to_le_bytes());
        for t in triangles {
            out.extend([0; 12]);
            for x in t.iter().flatten() {
                out.extend(x.to_le_bytes());
            }
            out.extend([0; 2]);
        }
        out
    }

    const TWO: [[[f32; 3]; 3]; 2] =
        [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[0.0, 1.0, 0.0], [1.0, 0.0, -0.0], [1.0, 1.0, 0.0]]];

    #[test]
    fn ascii_is_welded_and_may_have_polygons() {
        let m = stl(TEXT.as_bytes());
        assert_eq!(faces(&m), [vec![0, 1, 2], vec![2, 1, 3, 4]]);
        assert_eq!(m.map, [0, 1, 2, 2, 1, 3, 4]);
        assert_eq!(m.warnings, [Warning::NotCarried { layer: Layer::SolidNames, count: 1 }]);
        let apart = ReadOptions { weld: Some(false), ..Default::default() };
        assert_eq!(read_bytes(TEXT.as_bytes(), Format::Stl, None, &apart).unwrap().mesh.vertex_count(), 7);
        let open = stl(TEXT.split("endsolid").next().unwrap().as_bytes());
        assert_eq!((faces(&open), &open.warnings[1..]), (faces(&m), &[Warning::UnfinishedSolid][..]));
    }

    #[test]
    fn binary_even_if_it_says_solid() {
        for header in [&b"solid but binary"[..], b"", b"any header"] {
            let mut file = binary(header, &TWO);
            assert_eq!(faces(&stl(&file)), [[0, 1, 2], [2, 1, 3]]);
            file.extend([1, 2, 3]);
            assert_eq!(stl(&file).warnings, [Warning::TrailingBytes { count: 3 }]);
        }
        for empty in [&binary(b"", &[])[..], b"solid empty\nendsolid empty", b""] {
            assert!(error(empty).starts_with("input: there is no vertex in it"));
        }
    }

    #[test]
    fn errors_say_where_what_and_what_to_do() {
        let file = binary(b"solid but binary", &TWO);
        assert_eq!(
            error(&file[..file.len() - 1]),
            "input, byte 80: 2 triangles are announced, but the 99 bytes that follow cannot hold them; the count is wrong or the file was cut"
        );
        let mut bad = file.clone();
        bad[84 + 50 + 24..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
        assert_eq!(
            error(&bad),
            "input, byte 158: vertex 4 (counted from 0) has a coordinate that is not a finite number (NaN); mend or remove the vertex, or drop all such (--invalid drop)"
        );
        assert_eq!(
            error(TEXT.split("vertex 1").next().unwrap().as_bytes()),
            "input, line 5: the file ends inside a facet, before `vertex` or `endloop`; it was cut, fetch it again"
        );
        assert_eq!(
            error(TEXT.replace("vertex 1 0 0", "vertex 1 0").as_bytes()),
            "input, line 6: \"vertex\" stands where a coordinate belongs; mend it"
        );
        assert_eq!(
            error(b"solid x\nfrob\n"),
            "input, line 2: \"frob\" stands where `facet`, `solid` or `endsolid` belongs; mend it"
        );
        assert_eq!(
            error(b"v 0 0 0\n"),
            "input: this is not an STL file: \"v 0 0 0\" stands where `solid` or a header of 84 bytes belongs; check the file or name its true format"
        );
    }
}
