//! Faces of the input that repeat a vertex: the operators cannot express them, so they travel aside and come back with the
//! full level.
//!
//! There are few of them (a scan's handful of collapsed triangles), and mostly they stand in clusters, so a plain code does:
//! the faces rotated to their least vertex and sorted; the first corner as the distance to that of the face before, each
//! further corner as one of the face's earlier corners, or as a distance to the one before it.
//!
//! Exact: orientation and multiplicity are kept; the order and the starting corner are canonical.

use crate::format::coder::range::{Bit, Coder, exp_golomb};
use crate::format::complex::Faces;
use crate::format::elements::{ElementsError, Origin};

/// Code faces of degree ≥ 2 over `vertices` vertices of the full level, repeated corners allowed.
///
/// An encoder reads `faces` and leaves them in canonical order and rotation; what it returns tells where each came from. A
/// decoder replaces what is in `faces`, and returns nothing. The number of faces is coded here; they may have at most
/// `limit` corners together, which the caller has checked against what it is ready to allocate.
///
/// # Errors
/// Only a decoder's stream can be bad: [`ElementsError::TooManyCorners`] or [`ElementsError::NoSuchVertex`]. An encoder
/// handed such faces gets the same errors.
pub fn code_degenerate<C: Coder>(
    coder: &mut C,
    vertices: usize,
    faces: &mut Faces,
    limit: usize,
) -> Result<Vec<Origin>, ElementsError> {
    let source = std::mem::take(faces);
    *faces = Faces::new();
    let mut origins = Vec::new();
    if !C::DECODING {
        check(&source, vertices, limit)?;
        origins = canonical(&source);
    }
    let corner = |o: Origin, k: u32| {
        let corners = source.get(o.element);
        corners[(o.rotation as usize + k as usize) % corners.len()]
    };
    let mut models = Models::default();
    let count = exp_golomb(coder, &mut models.count, origins.len() as u32) as usize;
    if count > limit / 2 {
        return Err(ElementsError::TooManyCorners { limit });
    }
    let mut face: Vec<u32> = Vec::new();
    let mut first = 0u32;
    for element in 0..count {
        let no_such = ElementsError::NoSuchVertex { element, vertices };
        let origin = origins.get(element).copied();
        let degree = origin.map_or(2, |o| source.get(o.element).len() as u32);
        let degree = exp_golomb(coder, &mut models.degree, degree - 2) as usize + 2;
        if faces.corners.len() + degree > limit {
            return Err(ElementsError::TooManyCorners { limit });
        }
        let wanted = origin.map_or(0, |o| corner(o, 0));
        first = first.saturating_add(exp_golomb(coder, &mut models.first, wanted.wrapping_sub(first)));
        if first as usize >= vertices {
            return Err(no_such);
        }
        face.clear();
        face.push(first);
        for k in 1..degree {
            let wanted = origin.map_or(0, |o| corner(o, k as u32));
            let last = face[k - 1];
            // How many corners back the same vertex stands; 0: it is not among the last few.
            let back = face.iter().rev().take(REPEAT).position(|&v| v == wanted).map_or(0, |b| b as u32 + 1);
            let mut repeat = 0;
            for step in 1..=k.min(REPEAT) as u32 {
                // An earlier corner, or none, so far: one decision for each, nearest first.
                if coder.bit(&mut models.repeat[step as usize - 1], !C::DECODING && back == step) {
                    repeat = step;
                    break;
                }
            }
            let vertex = if repeat > 0 {
                face[k - repeat as usize]
            } else {
                let down = coder.bit(&mut models.down, wanted < last);
                let distance = exp_golomb(coder, &mut models.distance, wanted.abs_diff(last));
                let vertex = if down { last.checked_sub(distance) } else { last.checked_add(distance) };
                match vertex {
                    Some(v) if (v as usize) < vertices => v,
                    _ => return Err(no_such),
                }
            };
            face.push(vertex);
        }
        faces.push(&face);
    }
    Ok(origins)
}

/// How many corners back a repeated vertex is looked for.
const REPEAT: usize = 4;

/// What a decoder would refuse.
fn check(faces: &Faces, vertices: usize, limit: usize) -> Result<(), ElementsError> {
    if faces.corners.len() > limit {
        return Err(ElementsError::TooManyCorners { limit });
    }
    match faces.iter().position(|f| f.iter().any(|&v| v as usize >= vertices)) {
        Some(element) => Err(ElementsError::NoSuchVertex { element, vertices }),
        None => Ok(()),
    }
}

/// The faces, each rotated to begin with its least vertex (of several, the one with the least corner behind it, and so
/// on), in lexicographic order of their corners.
fn canonical(faces: &Faces) -> Vec<Origin> {
    let rotated = |o: &Origin| {
        let (tail, head) = faces.get(o.element).split_at(o.rotation as usize);
        head.iter().chain(tail)
    };
    let mut origins: Vec<Origin> = (0u32..)
        .zip(faces.iter())
        .map(|(element, corners)| Origin { element, rotation: least_rotation(corners) })
        .collect();
    origins.sort_unstable_by(|a, b| rotated(a).cmp(rotated(b)).then(a.element.cmp(&b.element)));
    origins
}

/// Where the lexicographically least rotation begins, in linear time (Shiloach 1981).
fn least_rotation(corners: &[u32]) -> u32 {
    let n = corners.len();
    let (mut a, mut b, mut same) = (0, 1, 0);
    while a < n && b < n && same < n {
        let (x, y) = (corners[(a + same) % n], corners[(b + same) % n]);
        if x == y {
            same += 1;
            continue;
        }
        if x > y {
            a += same + 1;
        } else {
            b += same + 1;
        }
        if a == b {
            b += 1;
        }
        same = 0;
    }
    a.min(b) as u32
}

/// The adaptive models.
struct Models {
    count: [Bit; 64],
    degree: [Bit; 64],
    first: [Bit; 64],
    distance: [Bit; 64],
    repeat: [Bit; REPEAT],
    down: Bit,
}

impl Default for Models {
    fn default() -> Self {
        let (bit, bits) = (Bit::default(), [Bit::default(); 64]);
        Models { count: bits, degree: bits, first: bits, distance: bits, repeat: [bit; REPEAT], down: bit }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::coder::range::{Decoder, Encoder};
    use proptest::prelude::*;

    fn round_trip(vertices: usize, faces: &Faces) -> usize {
        let mut e = Encoder::new();
        let mut sorted = faces.clone();
        let origins = code_degenerate(&mut e, vertices, &mut sorted, faces.corners.len()).unwrap();
        let bytes = e.finish();
        let mut seen = vec![false; faces.len()];
        for (new, o) in origins.iter().enumerate() {
            assert!(!std::mem::replace(&mut seen[o.element as usize], true));
            let mut old = faces.get(o.element).to_vec();
            old.rotate_left(o.rotation as usize);
            assert_eq!(sorted.get(new as u32), old);
        }
        assert!(seen.iter().all(|&s| s));
        let mut d = Decoder::new(&bytes);
        let mut back = Faces::new();
        code_degenerate(&mut d, vertices, &mut back, faces.corners.len()).unwrap();
        assert_eq!(back, sorted);
        assert!(!d.overrun());
        bytes.len()
    }

    fn list(n: u32) -> impl Strategy<Value = Vec<Vec<u32>>> {
        prop::collection::vec((prop::collection::vec(0..n, 2..9), 1usize..4), 0..40)
            .prop_map(|l| l.into_iter().flat_map(|(f, k)| vec![f; k]).collect())
    }

    fn faces_of(list: &[Vec<u32>]) -> Faces {
        let mut faces = Faces::new();
        list.iter().for_each(|f| faces.push(f));
        faces
    }

    proptest! {
        #[test]
        fn any_faces_come_back(few in list(4), many in list(u32::MAX)) {
            round_trip(4, &faces_of(&few));
            round_trip(u32::MAX as usize, &faces_of(&many));
        }

        #[test]
        fn the_bytes_depend_on_the_multiset_alone(few in list(3), turn in 0usize..9) {
            let bytes = |faces: &Faces| {
                let mut e = Encoder::new();
                code_degenerate(&mut e, 3, &mut faces.clone(), faces.corners.len()).unwrap();
                e.finish()
            };
            let mut turned = few.clone();
            turned.reverse();
            turned.iter_mut().for_each(|f| { let n = f.len(); f.rotate_left(turn % n) });
            prop_assert_eq!(bytes(&faces_of(&few)), bytes(&faces_of(&turned)));
        }

        #[test]
        fn any_bytes_give_valid_faces_or_an_error(
            bytes in prop::collection::vec(any::<u8>(), 0..300),
            vertices in 0usize..1000,
            limit in 0usize..2000,
        ) {
            let mut faces = Faces::new();
            if code_degenerate(&mut Decoder::new(&bytes), vertices, &mut faces, limit).is_ok() {
                prop_assert!(check(&faces, vertices, limit).is_ok());
                prop_assert!(faces.iter().all(|f| f.len() >= 2));
            }
        }

        #[test]
        fn the_least_rotation_is_least(corners in prop::collection::vec(0u32..3, 1..12)) {
            let turned = |k: usize| { let mut c = corners.clone(); c.rotate_left(k); c };
            let least = (0..corners.len()).map(turned).min().unwrap();
            prop_assert_eq!(turned(least_rotation(&corners) as usize), least);
        }
    }

    #[test]
    fn nothing_costs_next_to_nothing() {
        assert!(round_trip(0, &Faces::new()) <= 1);
    }

    #[test]
    fn a_cluster_costs_little() {
        let faces: Vec<_> = (0..100).map(|k| vec![50_000 + k, 50_001 + k, 50_000 + k]).collect();
        assert!(round_trip(1 << 20, &faces_of(&faces)) < 60);
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let code = |limit| code_degenerate(&mut Encoder::new(), 3, &mut faces_of(&[vec![1, 1, 2], vec![3, 3]]), limit);
        assert_eq!(code(4), Err(ElementsError::TooManyCorners { limit: 4 }));
        assert_eq!(code(5), Err(ElementsError::NoSuchVertex { element: 1, vertices: 3 }));
    }
}
