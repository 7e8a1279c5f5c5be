//! The exact comparison of a decoded mesh with its source, written apart from the codec: it knows only meshes and the lattice.
//!
//! *Exact* means equal to the quantized source up to the numbering of vertices, the order of faces and which corner of a
//! face comes first; orientation and multiplicity count. With a vertex map the test is complete ([`by_map`]). Without
//! one it compares all that positions tell ([`by_position`]): where vertices share a lattice point, it cannot see which of them a face names.
//!
//! Attributes are compared apart ([`attributes_by_map`], [`attributes_by_position`]), corner by corner: a layer may number its values
//! otherwise, and what makes two values equal the caller says. Layers and materials are matched by their order.

mod attributes;

pub use attributes::{Key, attributes_by_map, attributes_by_position, exact, quantized};

use crate::mesh::Mesh;
use crate::mesh::lattice::{Lattice, LatticeError};
use std::cmp::Ordering;
use thiserror::Error;

/// The first difference found between a source and what was decoded.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Difference {
    /// One of the two does not fit the lattice.
    #[error("{which}: {error}")]
    Lattice {
        /// `"source"` or `"decoded mesh"`.
        which: &'static str,
        /// What does not fit.
        error: LatticeError,
    },
    /// The map has not one line per vertex of the source.
    #[error("the map has {lines} entries, the source has {vertices} vertices; is it the map of another file?")]
    MapLength {
        /// Entries of the map.
        lines: usize,
        /// Vertices of the source.
        vertices: usize,
    },
    /// The map names a vertex that was not decoded.
    #[error("the map sends vertex {vertex} to {target}, but {vertices} vertices were decoded")]
    MapRange {
        /// Vertex of the source, from 0.
        vertex: usize,
        /// Where the map sends it.
        target: u32,
        /// Vertices decoded.
        vertices: usize,
    },
    /// Two vertices of the source at different places became one.
    #[error("vertices {first} and {second} of the source lie apart, but the map sends both to {target}")]
    Merged {
        /// A vertex of the source, from 0.
        first: usize,
        /// Another one.
        second: usize,
        /// The decoded vertex that both became.
        target: u32,
    },
    /// A decoded vertex comes from no vertex of the source.
    #[error("decoded vertex {vertex} comes from no vertex of the source")]
    Invented {
        /// The decoded vertex, from 0.
        vertex: usize,
    },
    /// A vertex moved.
    #[error("vertex {vertex} of the source lies on lattice point {expected:?}, its image {target} on {found:?}")]
    Moved {
        /// Vertex of the source, from 0.
        vertex: usize,
        /// The decoded vertex.
        target: u32,
        /// Lattice point of the source vertex.
        expected: [i32; 3],
        /// Lattice point of the decoded vertex.
        found: [i32; 3],
    },
    /// A lattice point holds more vertices in one mesh than in the other.
    #[error("lattice point {point:?} holds {source_count} vertices of the source and {decoded_count} decoded ones")]
    PointCount {
        /// The lattice point.
        point: [i32; 3],
        /// How often the source has it.
        source_count: usize,
        /// How often the decoded mesh has it.
        decoded_count: usize,
    },
    /// The two have not the same layers.
    #[error("the source has the layers {source_layers:?}, the decoded mesh {decoded_layers:?}")]
    Layers {
        /// Names and kinds.
        source_layers: Vec<String>,
        /// Names and kinds.
        decoded_layers: Vec<String>,
    },
    /// Materials, textures, samplers or images differ.
    #[error("{what} of the source and of the decoded mesh differ")]
    Appearance {
        /// Which of them.
        what: &'static str,
    },
    /// A face with these attributes occurs more often in one mesh than in the other.
    #[error("{what}: the face {face} occurs {source_count} times in the source and {decoded_count} times decoded")]
    Attributes {
        /// Which attributes: a layer, materials, or all together.
        what: String,
        /// The number of a face that is in excess, and the mesh that has it.
        face: String,
        /// How often the source has it.
        source_count: usize,
        /// How often the decoded mesh has it.
        decoded_count: usize,
    },
    /// The value of an isolated vertex differs.
    #[error("{layer}: isolated vertex {vertex} of the source has another value decoded, or none")]
    Isolated {
        /// The layer.
        layer: String,
        /// The vertex of the source, from 0.
        vertex: u32,
    },
    /// A face occurs more often in one mesh than in the other.
    #[error("the face {face} occurs {source_count} times in the source and {decoded_count} times decoded")]
    FaceCount {
        /// Which face: its number and its corners, or their lattice points.
        face: String,
        /// How often the source has it.
        source_count: usize,
        /// How often the decoded mesh has it.
        decoded_count: usize,
    },
}

/// Complete comparison: `map[v]` is the decoded vertex of the source's vertex `v`. Several vertices of the source may share one
/// decoded vertex only where their coordinates are bit-equal (welding).
///
/// # Errors
/// The first [`Difference`], vertices before faces.
pub fn by_map(source: &Mesh, decoded: &Mesh, lattice: &Lattice, map: &[u32]) -> Result<(), Difference> {
    let (lines, vertices) = (map.len(), source.vertex_count());
    if lines != vertices {
        return Err(Difference::MapLength { lines, vertices });
    }
    let (expected, found) = (quantize(source, lattice, "source")?, quantize(decoded, lattice, "decoded mesh")?);
    const NONE: u32 = u32::MAX;
    let mut first_of = vec![NONE; decoded.vertex_count()];
    for (vertex, &target) in map.iter().enumerate() {
        let Some(first) = first_of.get_mut(target as usize) else {
            return Err(Difference::MapRange { vertex, target, vertices: decoded.vertex_count() });
        };
        if *first == NONE {
            *first = vertex as u32;
        } else if !same_place(source.positions[*first as usize], source.positions[vertex]) {
            return Err(Difference::Merged { first: *first as usize, second: vertex, target });
        }
        if expected[vertex] != found[target as usize] {
            let (expected, found) = (expected[vertex], found[target as usize]);
            return Err(Difference::Moved { vertex, target, expected, found });
        }
    }
    if let Some(vertex) = first_of.iter().position(|&v| v == NONE) {
        return Err(Difference::Invented { vertex });
    }
    let a = CanonicalFaces::new(source, |v| map[v as usize]);
    let b = CanonicalFaces::new(decoded, |v| v);
    a.compare(&b).map_err(|(face, source_count, decoded_count)| Difference::FaceCount {
        face: match face {
            Ok(f) => format!("{f} of the source (vertices {:?})", source.face(f)),
            Err(f) => format!("{f} of the decoded mesh (vertices {:?})", decoded.face(f)),
        },
        source_count,
        decoded_count,
    })
}

/// Comparison without a map: the same lattice points as often, and the same faces over lattice points as often.
///
/// # Errors
/// The first [`Difference`], points before faces.
pub fn by_position(source: &Mesh, decoded: &Mesh, lattice: &Lattice) -> Result<(), Difference> {
    let (a, b) = (quantize(source, lattice, "source")?, quantize(decoded, lattice, "decoded mesh")?);
    let (mut sorted_a, mut sorted_b) = (a.clone(), b.clone());
    sorted_a.sort_unstable();
    sorted_b.sort_unstable();
    if let Some(point) = first_in_excess(&sorted_a, &sorted_b) {
        let count = |list: &[[i32; 3]]| list.partition_point(|p| *p <= point) - list.partition_point(|p| *p < point);
        let (source_count, decoded_count) = (count(&sorted_a), count(&sorted_b));
        return Err(Difference::PointCount { point, source_count, decoded_count });
    }
    sorted_a.dedup();
    // Every point of both meshes is in the list now; its rank there is its name.
    let ranks = |points: &[[i32; 3]]| -> Vec<u32> {
        points.iter().map(|p| sorted_a.partition_point(|other| other < p) as u32).collect()
    };
    let (rank_a, rank_b) = (ranks(&a), ranks(&b));
    let faces_a = CanonicalFaces::new(source, |v| rank_a[v as usize]);
    let faces_b = CanonicalFaces::new(decoded, |v| rank_b[v as usize]);
    faces_a.compare(&faces_b).map_err(|(face, source_count, decoded_count)| {
        let describe = |which: &str, f: usize, mesh: &Mesh, points: &[[i32; 3]]| {
            let points: Vec<_> = mesh.face(f).iter().map(|&v| points[v as usize]).collect();
            format!("{f} of the {which} (lattice points {points:?})")
        };
        let face = match face {
            Ok(f) => describe("source", f, source, &a),
            Err(f) => describe("decoded mesh", f, decoded, &b),
        };
        Difference::FaceCount { face, source_count, decoded_count }
    })
}

fn quantize(mesh: &Mesh, lattice: &Lattice, which: &'static str) -> Result<Vec<[i32; 3]>, Difference> {
    lattice.quantize(&mesh.positions).map_err(|error| Difference::Lattice { which, error })
}

/// Bit-equal, except that −0 is 0.
fn same_place(a: [f64; 3], b: [f64; 3]) -> bool {
    (0..3).all(|k| a[k] == b[k])
}

/// The least element that two sorted lists do not hold equally often.
fn first_in_excess<T: Ord + Copy>(a: &[T], b: &[T]) -> Option<T> {
    let at = a.iter().zip(b).position(|(x, y)| x != y).unwrap_or(a.len().min(b.len()));
    match (a.get(at), b.get(at)) {
        (Some(x), Some(y)) => Some(*x.min(y)),
        (Some(x), None) | (None, Some(x)) => Some(*x),
        (None, None) => None,
    }
}

/// The faces of a mesh over other names of its vertices, each turned to its least rotation, in sorted order.
struct CanonicalFaces<'a> {
    start: &'a [u32],
    corners: Vec<u32>,
    order: Vec<u32>,
}

impl<'a> CanonicalFaces<'a> {
    fn new(mesh: &'a Mesh, name: impl Fn(u32) -> u32) -> Self {
        Self::of_names(&mesh.face_start, mesh.corners.iter().map(|&v| name(v)).collect())
    }

    /// Faces over the names of their corners.
    fn of_names(start: &'a [u32], mut corners: Vec<u32>) -> Self {
        for range in start.windows(2) {
            let face = &mut corners[range[0] as usize..range[1] as usize];
            face.rotate_left(least_rotation(face));
        }
        let order = (0..start.len().saturating_sub(1) as u32).collect();
        let mut faces = CanonicalFaces { start, corners, order };
        let mut order = std::mem::take(&mut faces.order);
        order.sort_unstable_by(|&f, &g| compare_faces(faces.get(f), faces.get(g)));
        faces.order = order;
        faces
    }

    fn get(&self, f: u32) -> &[u32] {
        &self.corners[self.start[f as usize] as usize..self.start[f as usize + 1] as usize]
    }

    fn count(&self, face: &[u32]) -> usize {
        let end = self.order.partition_point(|&f| compare_faces(self.get(f), face) != Ordering::Greater);
        end - self.order.partition_point(|&f| compare_faces(self.get(f), face) == Ordering::Less)
    }

    /// `Err` holds the first face in excess (`Ok` of its number here, or `Err` of its number there) and how often it occurs here and there.
    fn compare(&self, other: &CanonicalFaces<'_>) -> Result<(), (Result<usize, usize>, usize, usize)> {
        let n = self.order.len().min(other.order.len());
        let at = (0..n)
            .find(|&i| compare_faces(self.get(self.order[i]), other.get(other.order[i])) != Ordering::Equal)
            .unwrap_or(n);
        let which = match (self.order.get(at), other.order.get(at)) {
            (None, None) => return Ok(()),
            (Some(&f), None) => Ok(f),
            (None, Some(&g)) => Err(g),
            (Some(&f), Some(&g)) => match compare_faces(self.get(f), other.get(g)) {
                Ordering::Greater => Err(g),
                _ => Ok(f),
            },
        };
        let face = match which {
            Ok(f) => self.get(f),
            Err(g) => other.get(g),
        };
        Err((which.map(|f| f as usize).map_err(|g| g as usize), self.count(face), other.count(face)))
    }
}

fn compare_faces(a: &[u32], b: &[u32]) -> Ordering {
    a.len().cmp(&b.len()).then_with(|| a.cmp(b))
}

/// Where the lexicographically least rotation begins, in linear time (two candidates race; the loser skips what it lost by).
fn least_rotation(face: &[u32]) -> usize {
    let n = face.len();
    let (mut i, mut j, mut k) = (0, 1, 0);
    while i < n && j < n && k < n {
        match face[(i + k) % n].cmp(&face[(j + k) % n]) {
            Ordering::Equal => k += 1,
            Ordering::Greater => {
                i += k + 1;
                k = 0;
            }
            Ordering::Less => {
                j += k + 1;
                k = 0;
            }
        }
        if i == j {
            j += 1;
        }
    }
    i.min(j)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    pub(super) const UNIT: Lattice = Lattice { origin: [0.0; 3], step: 1.0 };

    pub(super) fn mesh(points: &[[f64; 3]], faces: &[&[u32]]) -> Mesh {
        let mut mesh = Mesh { positions: points.to_vec(), ..Mesh::default() };
        faces.iter().for_each(|f| mesh.push_face(f));
        mesh
    }

    pub(super) fn square() -> Mesh {
        mesh(&[[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]], &[&[0, 1, 2], &[0, 2, 3]])
    }

    #[test]
    fn rotations_and_order_do_not_count_but_orientation_and_multiplicity_do() {
        let a = square();
        let b = mesh(&a.positions, &[&[2, 3, 0], &[1, 2, 0]]);
        let map = [0, 1, 2, 3];
        assert_eq!(by_map(&a, &b, &UNIT, &map), Ok(()));
        assert_eq!(by_position(&a, &b, &UNIT), Ok(()));
        let turned = mesh(&a.positions, &[&[2, 3, 0], &[2, 1, 0]]);
        let error = by_map(&a, &turned, &UNIT, &map).unwrap_err().to_string();
        assert_eq!(
            error,
            "the face 0 of the source (vertices [0, 1, 2]) occurs 1 times in the source and 0 times decoded"
        );
        assert!(matches!(by_position(&a, &turned, &UNIT), Err(Difference::FaceCount { .. })));
        let twice = mesh(&a.positions, &[&[2, 3, 0], &[1, 2, 0], &[0, 1, 2]]);
        assert!(matches!(
            by_map(&a, &twice, &UNIT, &map),
            Err(Difference::FaceCount { source_count: 1, decoded_count: 2, .. })
        ));
    }

    #[test]
    fn the_map_is_checked_in_full() {
        let a = square();
        let check = |map: &[u32]| by_map(&a, &a, &UNIT, map).unwrap_err();
        assert_eq!(check(&[0, 1, 2]), Difference::MapLength { lines: 3, vertices: 4 });
        assert_eq!(check(&[0, 1, 2, 4]), Difference::MapRange { vertex: 3, target: 4, vertices: 4 });
        assert_eq!(check(&[0, 1, 2, 2]), Difference::Merged { first: 2, second: 3, target: 2 });
        assert!(matches!(check(&[0, 1, 3, 2]), Difference::Moved { vertex: 2, target: 3, .. }));
        let more = mesh(&[&a.positions[..], &[[9.0; 3]]].concat(), &[&[0, 1, 2], &[0, 2, 3]]);
        assert_eq!(by_map(&a, &more, &UNIT, &[0, 1, 2, 3]), Err(Difference::Invented { vertex: 4 }));
    }

    #[test]
    fn without_a_map_points_are_counted() {
        let a = square();
        let mut b = a.clone();
        b.positions[3] = [0.0, 2.0, 0.0];
        assert_eq!(
            by_position(&a, &b, &UNIT).unwrap_err().to_string(),
            "lattice point [0, 1, 0] holds 1 vertices of the source and 0 decoded ones"
        );
    }

    proptest! {
        #[test]
        fn least_rotation_is_the_least(face in prop::collection::vec(0u32..4, 1..9)) {
            let rotated = |k: usize| { let mut f = face.clone(); f.rotate_left(k); f };
            let best = (0..face.len()).map(rotated).min().unwrap();
            prop_assert_eq!(rotated(least_rotation(&face)), best);
        }

        #[test]
        fn any_renumbering_is_equal_and_any_edit_is_not(
            points in prop::collection::vec(prop::array::uniform3(0i32..3), 2..12),
            faces in prop::collection::vec(prop::collection::vec(0usize..1000, 2..6), 1..10),
            key in prop::collection::vec(0u64..1_000_000, 12),
            edit in (0usize..1000, 0usize..1000),
        ) {
            let n = points.len();
            let mut order: Vec<usize> = (0..n).collect();
            order.sort_by_key(|&v| key[v]);
            let mut map = vec![0u32; n];
            order.iter().enumerate().for_each(|(new, &old)| map[old] = new as u32);
            let place = |v: usize| points[v].map(f64::from);
            let mut a = Mesh { positions: (0..n).map(place).collect(), ..Mesh::default() };
            let mut b = Mesh { positions: order.iter().map(|&v| place(v)).collect(), ..Mesh::default() };
            let faces: Vec<Vec<u32>> = faces.iter().map(|f| f.iter().map(|&v| (v % n) as u32).collect()).collect();
            for (i, face) in faces.iter().enumerate() {
                a.push_face(face);
                let mut other: Vec<u32> = faces[faces.len() - 1 - i].iter().map(|&v| map[v as usize]).collect();
                let turn = i % other.len();
                other.rotate_left(turn);
                b.push_face(&other);
            }
            prop_assert_eq!(by_map(&a, &b, &UNIT, &map), Ok(()));
            prop_assert_eq!(by_position(&a, &b, &UNIT), Ok(()));
            // Move one corner to a vertex that lies elsewhere: both tests have to see it.
            let corner = edit.0 % b.corners.len();
            let vertex = (edit.1 % n) as u32;
            if b.positions[vertex as usize] != b.positions[b.corners[corner] as usize] {
                b.corners[corner] = vertex;
                prop_assert!(by_map(&a, &b, &UNIT, &map).is_err());
                prop_assert!(by_position(&a, &b, &UNIT).is_err());
            }
        }
    }
}
