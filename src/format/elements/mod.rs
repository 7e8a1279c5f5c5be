//! Elements over vertices whose positions both sides know: the connectivity of the base level.
//!
//! A base is mostly empty or a few dozen elements, but holds thousands where much of a mesh cannot be collapsed. So it is
//! coded by region growing that any multiset of elements survives: the edges of a coded element are *gates* in a queue; a
//! gate says whether one more element lies behind it, in the opposite direction as on an orientable surface; where the
//! queue is empty, a *seed* begins anew. The corners of an element are told among the ends of open gates beside it, else
//! by their rank among the vertices near a predicted place, else by number. Elements that do not fit the picture (third
//! at an edge, turned round, dangling edges) become seeds: dearer, but exact.
//!
//! Orientation and multiplicity are kept. The order of the elements and their starting corners are those of the
//! traversal, so the bytes depend on the multiset alone.
//!
//! Invariants: the work at one corner is bounded whatever the input is; a decoder allocates in proportion to the
//! vertices and to the corners that it has read, which are at most the limit given.

mod gates;
mod near;
mod source;

use self::gates::Gates;
use self::near::Near;
use self::source::Source;
use crate::format::coder::range::{Bit, Coder, exp_golomb};
use crate::format::complex::Faces;
use thiserror::Error;

/// What is wrong with a stream of elements.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ElementsError {
    /// The elements have more corners than the caller allows.
    #[error("the elements have more than the {limit} corners that the file declares: the file is damaged")]
    TooManyCorners {
        /// The limit given by the caller.
        limit: usize,
    },
    /// An element names a vertex that does not exist, or has more corners than there are vertices.
    #[error("element {element} names a vertex beyond the {vertices} there are: the file is damaged")]
    NoSuchVertex {
        /// The element, from 0 in canonical order.
        element: usize,
        /// The number of vertices.
        vertices: usize,
    },
    /// An element that names each vertex once repeats one, or one that repeats a vertex does not.
    #[error("element {element} names vertex {vertex} more than once: the file is damaged")]
    RepeatedVertex {
        /// The element, from 0 in canonical order.
        element: usize,
        /// The vertex.
        vertex: u32,
    },
}

/// Where an element of the canonical order comes from, for an encoder that has to carry attributes along.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Origin {
    /// The element's number before.
    pub element: u32,
    /// Its corner `k` is the old corner `(rotation + k) % degree`.
    pub rotation: u32,
}

/// Code elements of degree ≥ 2 over `positions`, each naming a vertex at most once.
///
/// An encoder reads `faces` and leaves them in canonical order and rotation; what it returns tells where each came from.
/// A decoder replaces what is in `faces`, and returns nothing. The number of elements is coded here; they may have at most
/// `limit` corners together, which the caller has checked against what it is ready to allocate. Coordinates are within
/// ±[`POINT_LIMIT`](crate::format::points::POINT_LIMIT).
///
/// # Errors
/// Only a decoder's stream can be bad: see [`ElementsError`]. An encoder handed invalid elements gets the same errors.
pub fn code_elements<C: Coder>(
    coder: &mut C,
    positions: &[[i32; 3]],
    faces: &mut Faces,
    limit: usize,
) -> Result<Vec<Origin>, ElementsError> {
    let source = std::mem::take(faces);
    *faces = Faces::new();
    if !C::DECODING {
        check(&source, positions.len(), limit)?;
    }
    let mut models = Models::default();
    let count = exp_golomb(coder, &mut models.count, if C::DECODING { 0 } else { source.len() as u32 }) as usize;
    if count > limit / 2 {
        return Err(ElementsError::TooManyCorners { limit });
    }
    if count == 0 {
        return Ok(Vec::new());
    }
    let shift = coder.uniform(27, if C::DECODING { 0 } else { mean_edge_bits(&source, positions) });
    let mut source = Source::new(source, C::DECODING);
    let mut gates = Gates::new(positions.len());
    let near = Near::new(positions, shift);
    let mut origins = Vec::new();
    let mut element: Vec<u32> = Vec::new();
    // The last element that names each vertex, from 1.
    let mut named = vec![0u32; positions.len()];
    let mut last_seed = 0u32;
    let mut last_degree = 3u32;
    let mut last_behind = true;
    while faces.len() < count {
        let number = faces.len();
        let stamp = number as u32 + 1;
        let no_such = ElementsError::NoSuchVertex { element: number, vertices: positions.len() };
        element.clear();
        let mut from = None;
        let gate = gates.pop();
        if let Some(gate) = gate {
            if !C::DECODING {
                from = source.with_edge(gate.b, gate.a);
            }
            let context = gates.closing(gate.b, gate.a, true).context() * 2 + last_behind as usize;
            last_behind = coder.bit(&mut models.behind[context], from.is_some());
            if !last_behind {
                continue;
            }
            element.extend([gate.b, gate.a]);
        } else {
            if !C::DECODING {
                from = source.next_seed();
            }
            let first = from.map_or(0, |o| source.corner(o, 0));
            let step = exp_golomb(coder, &mut models.seed, first.wrapping_sub(last_seed));
            last_seed = match last_seed.checked_add(step) {
                Some(v) if (v as usize) < positions.len() => v,
                _ => return Err(no_such),
            };
            element.push(last_seed);
        }
        let least = if gate.is_some() { 3 } else { 2 };
        let degree = from.map_or(least, |o| source.degree(o));
        let same = coder.bit(&mut models.same[gate.is_some() as usize], degree == last_degree);
        let degree = if same {
            last_degree.max(least)
        } else {
            exp_golomb(coder, &mut models.degree, degree - least).saturating_add(least)
        };
        last_degree = degree;
        if degree as usize > positions.len() {
            return Err(no_such);
        }
        for &v in &element {
            named[v as usize] = stamp;
        }
        if faces.corners.len() + degree as usize > limit {
            return Err(ElementsError::TooManyCorners { limit });
        }
        for k in element.len() as u32..degree {
            let wanted = from.map_or(0, |o| source.corner(o, k));
            let (first, last) = (element[0], element[element.len() - 1]);
            let closing = gates.closing(first, last, k + 1 == degree);
            let place = predict(positions, gate, &element, degree);
            let vertex = models.corner(
                coder,
                &near,
                place,
                closing,
                gate.is_some(),
                |v| (named[v as usize] != stamp).then(|| gates.finished(v)),
                wanted,
            );
            if std::mem::replace(&mut named[vertex as usize], stamp) == stamp {
                return Err(ElementsError::RepeatedVertex { element: number, vertex });
            }
            element.push(vertex);
        }
        gates.insert(&element, gate.is_some());
        faces.push(&element);
        if let Some(origin) = from {
            source.take(origin);
            origins.push(origin);
        }
    }
    Ok(origins)
}

/// What a decoder would refuse.
fn check(faces: &Faces, vertices: usize, limit: usize) -> Result<(), ElementsError> {
    if faces.corners.len() > limit {
        return Err(ElementsError::TooManyCorners { limit });
    }
    let mut last = vec![u32::MAX; vertices];
    for (element, corners) in faces.iter().enumerate() {
        for &v in corners {
            match last.get_mut(v as usize) {
                None => return Err(ElementsError::NoSuchVertex { element, vertices }),
                Some(l) if *l == element as u32 => return Err(ElementsError::RepeatedVertex { element, vertex: v }),
                Some(l) => *l = element as u32,
            }
        }
    }
    Ok(())
}

/// The bits of the mean edge length, the width of the search grid; an encoder's choice, which it writes.
fn mean_edge_bits(faces: &Faces, positions: &[[i32; 3]]) -> u32 {
    let (mut sum, mut edges) = (0u64, 0u64);
    for corners in faces.iter() {
        for (k, &a) in corners.iter().enumerate() {
            let (p, q) = (positions[a as usize], positions[corners[(k + 1) % corners.len()] as usize]);
            sum += (0..3).map(|k| (p[k] as i64 - q[k] as i64).unsigned_abs()).max().unwrap_or(0);
            edges += 1;
        }
    }
    (64 - (sum / edges.max(1)).leading_zeros()).min(26)
}

/// Where the next corner of `element` is expected.
fn predict(positions: &[[i32; 3]], gate: Option<gates::Gate>, element: &[u32], degree: u32) -> [i64; 3] {
    let p = |v: u32| positions[v as usize].map(i64::from);
    let sum = |terms: &[(i64, u32)], divisor: i64| -> [i64; 3] {
        std::array::from_fn(|k| terms.iter().map(|&(w, v)| w * p(v)[k]).sum::<i64>().div_euclid(divisor))
    };
    let n = element.len();
    let (first, last) = (element[0], element[n - 1]);
    match gate {
        // Across the gate's middle from the element before it; or straight on along its side.
        Some(g) if degree == 3 => sum(&[(2, g.a), (2, g.b), (-1, g.before), (-1, g.after)], 2),
        Some(g) if n == 2 => sum(&[(2, g.a), (-1, g.before)], 1),
        None if n == 2 && degree == 3 => sum(&[(1, first), (1, last)], 2),
        // The last corner closes a parallelogram.
        _ if n >= 3 && n + 1 == degree as usize => sum(&[(1, last), (1, first), (-1, element[n - 2])], 1),
        _ => p(last),
    }
}

/// The adaptive models.
struct Models {
    count: [Bit; 64],
    seed: [Bit; 64],
    degree: [Bit; 64],
    same: [Bit; 2],
    behind: [Bit; 8],
    closes: [Bit; 40],
    found: [Bit; 2],
    rank: [[Bit; 64]; 2],
}

impl Default for Models {
    fn default() -> Self {
        let (bit, bits) = (Bit::default(), [Bit::default(); 64]);
        Models {
            count: bits,
            seed: bits,
            degree: bits,
            same: [bit; 2],
            behind: [bit; 8],
            closes: [bit; 40],
            found: [bit; 2],
            rank: [bits; 2],
        }
    }
}

impl Models {
    /// Code the next corner of an element. `finished` is `None` of those that it has already.
    #[allow(clippy::too_many_arguments)]
    fn corner<C: Coder>(
        &mut self,
        coder: &mut C,
        near: &Near,
        place: [i64; 3],
        closing: gates::Closing,
        gated: bool,
        finished: impl Fn(u32) -> Option<bool>,
        wanted: u32,
    ) -> u32 {
        let mut candidates = near.around(place, &finished);
        let sides = [closing.left, closing.right];
        for (side, &end) in sides.iter().enumerate() {
            let Some(end) = end.filter(|&v| finished(v).is_some()) else { continue };
            if side == 1 && closing.left == closing.right {
                continue;
            }
            let rank = candidates.iter().position(|&v| v == end).map_or(4, |r| r.min(3));
            let context = (closing.context() * 5 + rank) * 2 + side;
            if coder.bit(&mut self.closes[context], wanted == end) {
                return end;
            }
            candidates.retain(|&v| v != end);
        }
        let rank = if C::DECODING { 0 } else { candidates.iter().position(|&v| v == wanted).unwrap_or(usize::MAX) };
        if coder.bit(&mut self.found[gated as usize], rank < candidates.len()) {
            let rank = exp_golomb(coder, &mut self.rank[gated as usize], rank as u32) as usize;
            if let Some(&v) = candidates.get(rank) {
                return v;
            }
        }
        coder.uniform(near.vertices(), wanted)
    }
}

#[cfg(test)]
mod tests;
