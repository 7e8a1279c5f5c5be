//! Text formats: what the lines of OBJ, OFF, ASCII STL and ASCII PLY announce and hold, one pass, constant memory.

use std::io::{self, Read};

use super::Survey;
use super::distinct::Distinct;
use crate::mesh::LayerKind;

/// Lines longer than this are looked at in pieces; only their count of corners suffers.
const LONGEST: usize = 1 << 20;

/// Hand out the lines of a stream, without their ends; returns the bytes read.
pub(super) fn lines(input: &mut dyn Read, head: &[u8], mut each: impl FnMut(&[u8])) -> io::Result<u64> {
    let mut held: Vec<u8> = head.to_vec();
    let mut total = head.len() as u64;
    let mut buffer = vec![0u8; 1 << 17];
    loop {
        let mut from = 0;
        for end in memchr::memchr_iter(b'\n', &held) {
            each(&held[from..end]);
            from = end + 1;
        }
        if held.len() - from > LONGEST {
            each(&held[from..]);
            from = held.len();
        }
        held.drain(..from);
        let n = loop {
            match input.read(&mut buffer) {
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                other => break other?,
            }
        };
        if n == 0 {
            if !held.is_empty() {
                each(&held);
            }
            return Ok(total);
        }
        total += n as u64;
        held.extend_from_slice(&buffer[..n]);
    }
}

/// How many words a line has.
#[inline]
fn words(line: &[u8]) -> u64 {
    let mut count = 0;
    let mut before = true;
    for &b in line {
        let blank = b <= b' ';
        count += u64::from(before && !blank);
        before = blank;
    }
    count
}

fn trim(line: &[u8]) -> &[u8] {
    line.trim_ascii_start()
}

fn first_number(line: &[u8]) -> Option<u64> {
    let word = trim(line).split(|b| *b <= b' ').next()?;
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// OBJ: counts of `v`, `f`, `l` and `p`.
pub(super) fn obj(input: &mut dyn Read, head: &[u8]) -> io::Result<Survey> {
    let mut s = Survey::default();
    let (mut uvs, mut normals, mut colours) = (0, 0, false);
    let total = lines(input, head, |line| {
        let line = trim(line);
        match line {
            [b'v', b' ' | b'\t', rest @ ..] => {
                if s.vertices == 0 {
                    // Three numbers of a place and three of a colour; the other vertices are as the first.
                    colours = words(rest) >= 6;
                }
                s.vertices += 1;
            }
            [b'v', b't', b' ' | b'\t', ..] => uvs += 1,
            [b'v', b'n', b' ' | b'\t', ..] => normals += 1,
            [b'f', b' ' | b'\t', rest @ ..] => {
                s.elements += 1;
                s.corners += words(rest);
            }
            [b'l', b' ' | b'\t', rest @ ..] => {
                let edges = words(rest).saturating_sub(1);
                s.elements += edges;
                s.corners += 2 * edges;
            }
            _ => {}
        }
    })?;
    for (kind, count, width) in [
        (LayerKind::Uv, uvs, 2),
        (LayerKind::Normal, normals, 3),
        (LayerKind::Color, if colours { s.vertices } else { 0 }, 3),
    ] {
        s.add(kind, u64::from(count > 0), count, width);
    }
    s.records = s.vertices;
    s.unpacked = total;
    Ok(s)
}

/// OFF: the counts of its second line, and the degrees of its faces.
pub(super) fn off(input: &mut dyn Read, head: &[u8]) -> io::Result<Survey> {
    let mut s = Survey::default();
    // 0: before the counts; then how many lines with vertices are still to come, and then faces.
    let (mut counted, mut vertices, mut faces) = (false, 0u64, 0u64);
    let (mut normals, mut colours, mut uvs) = (false, false, false);
    let total = lines(input, head, |line| {
        let line = trim(line);
        if line.is_empty() || line[0] == b'#' {
            return;
        }
        if !counted {
            let mut numbers = line.split(|b| *b <= b' ').filter(|w| !w.is_empty());
            let mut first = numbers.next().unwrap_or_default();
            if let Some(at) = first.windows(3).position(|w| w.eq_ignore_ascii_case(b"OFF")) {
                let flags = &first[..at];
                (normals, colours) = (flags.contains(&b'N'), flags.contains(&b'C'));
                uvs = flags.contains(&b'S');
                // The first count may stand right behind.
                first = if first.len() > at + 3 { &first[at + 3..] } else { numbers.next().unwrap_or_default() };
            }
            let parse = |w: &[u8]| std::str::from_utf8(w).ok()?.parse::<u64>().ok();
            if let (Some(v), Some(f)) = (parse(first), numbers.next().and_then(parse)) {
                (counted, vertices, faces) = (true, v, f);
                s.vertices = v;
                s.elements = f;
            }
        } else if vertices > 0 {
            // Colours need not be announced; the other vertices are as the first.
            colours |= vertices == s.vertices && !normals && !uvs && matches!(words(line), 6 | 7);
            vertices -= 1;
        } else if faces > 0 {
            faces -= 1;
            s.corners += first_number(line).unwrap_or(3);
        }
    })?;
    // What is announced but not there is not going to be read.
    s.vertices -= vertices.min(s.vertices);
    s.elements -= faces.min(s.elements);
    for (kind, there, width) in
        [(LayerKind::Uv, uvs, 2), (LayerKind::Normal, normals, 3), (LayerKind::Color, colours, 4)]
    {
        s.add(kind, u64::from(there), if there { s.vertices } else { 0 }, width);
    }
    s.records = s.vertices;
    s.unpacked = total;
    Ok(s)
}

/// ASCII STL: its `vertex` lines.
pub(super) fn stl(input: &mut dyn Read, head: &[u8]) -> io::Result<Survey> {
    let (mut corners, mut places) = (0u64, Distinct::new());
    let total = lines(input, head, |line| {
        if let Some(rest) = trim(line).strip_prefix(b"vertex") {
            corners += 1;
            // The text stands for the place: a file spells equal numbers alike.
            let hash = rest
                .iter()
                .filter(|b| **b > b' ')
                .fold(0xcbf2_9ce4_8422_2325u64, |h, &b| (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3));
            places.add(hash, 0);
        }
    })?;
    let vertices = places.count().min(corners);
    let (elements, records, exact) = (corners / 3, corners, true);
    Ok(Survey { vertices, elements, corners, records, unpacked: total, exact, ..Survey::default() })
}

/// The body of an ASCII PLY: `skip` lines, then `faces` lines that begin with the number of their corners.
pub(super) fn ply_faces(input: &mut dyn Read, head: &[u8], skip: u64, faces: u64) -> io::Result<(u64, u64)> {
    let (mut skip, mut faces, mut corners) = (skip, faces, 0u64);
    let total = lines(input, head, |line| {
        if skip > 0 {
            skip -= 1;
        } else if faces > 0 {
            faces -= 1;
            corners += first_number(line).unwrap_or(3);
        }
    })?;
    Ok((corners, total))
}
