//! The exact comparison of a decoded mesh with its source, written apart from the codec: it knows only meshes and the lattice.
//!
//! *Exact* means equal to the quantized source up to the numbering of vertices, the order of faces and which corner of a
//! face comes first; orientation and multiplicity count. With a vertex map the test is complete ([`by_map`]). Without
//! one it compares all that positions tell ([`by_position`]): where vertices share a lattice point, it cannot see which of them a face names.
//!
//! Attributes are compared apart ([`attributes_by_map`], [`attributes_by_position`]), corner by corner: a layer may number its values
//! otherwise, and what makes two values equal the caller says. Layers and materials are matched by their order.

use crate::lattice::{Lattice, LatticeError};
use crate::mesh::{Layer, MAX_WIDTH, Mesh, NO_VALUE};
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

/// What makes values of a layer equal: those with equal keys are. The number is that of the layer.
pub type Key<'a> = dyn Fn(usize, &Layer, &[f64]) -> [i64; MAX_WIDTH as usize] + 'a;

/// The key of exact comparison: the bits of the numbers, with both zeros as one.
pub fn exact(_: usize, _: &Layer, value: &[f64]) -> [i64; MAX_WIDTH as usize] {
    let mut out = [0; MAX_WIDTH as usize];
    out.iter_mut().zip(value).for_each(|(o, x)| *o = (x + 0.0).to_bits() as i64);
    out
}

/// Compare attributes of two meshes that are equal [by map](by_map): layers at corners and isolated vertices, materials of faces, and the
/// appearance.
///
/// # Errors
/// The first [`Difference`]: lists first, then each layer and the materials alone, then all together.
pub fn attributes_by_map(source: &Mesh, decoded: &Mesh, map: &[u32], key: &Key<'_>) -> Result<(), Difference> {
    let (lines, vertices) = (map.len(), source.vertex_count());
    if lines != vertices {
        return Err(Difference::MapLength { lines, vertices });
    }
    if let Some(vertex) = map.iter().position(|&v| v as usize >= decoded.vertex_count()) {
        return Err(Difference::MapRange { vertex, target: map[vertex], vertices: decoded.vertex_count() });
    }
    let own: Vec<u32> = (0..decoded.vertex_count() as u32).collect();
    attributes(source, decoded, map, &own, key)
}

/// Compare attributes of two meshes that are equal [by position](by_position). Vertices at one lattice point count as one.
///
/// # Errors
/// The first [`Difference`], as [`attributes_by_map`] has them.
pub fn attributes_by_position(
    source: &Mesh,
    decoded: &Mesh,
    lattice: &Lattice,
    key: &Key<'_>,
) -> Result<(), Difference> {
    let (a, b) = (quantize(source, lattice, "source")?, quantize(decoded, lattice, "decoded mesh")?);
    let mut points: Vec<[i32; 3]> = a.iter().chain(&b).copied().collect();
    points.sort_unstable();
    points.dedup();
    let ranks = |list: &[[i32; 3]]| -> Vec<u32> {
        list.iter().map(|p| points.partition_point(|other| other < p) as u32).collect()
    };
    attributes(source, decoded, &ranks(&a), &ranks(&b), key)
}

fn attributes(a: &Mesh, b: &Mesh, name_a: &[u32], name_b: &[u32], key: &Key<'_>) -> Result<(), Difference> {
    let list = |m: &Mesh| m.layers.iter().map(|l| format!("{} ({:?}, {})", l.name, l.kind, l.width)).collect();
    let (source_layers, decoded_layers): (Vec<String>, Vec<String>) = (list(a), list(b));
    if source_layers != decoded_layers {
        return Err(Difference::Layers { source_layers, decoded_layers });
    }
    let (x, y) = (&a.appearance, &b.appearance);
    for (what, equal) in [
        ("materials", x.materials == y.materials),
        ("textures", x.textures == y.textures),
        ("samplers", x.samplers == y.samplers),
        ("images", x.images == y.images),
    ] {
        if !equal {
            return Err(Difference::Appearance { what });
        }
    }
    let mut columns = vec![Column::new("vertices", name_a, name_b, &a.corners, &b.corners)];
    for (n, (la, lb)) in a.layers.iter().zip(&b.layers).enumerate() {
        let (values_a, values_b) = ranks(n, la, lb, key);
        isolated(la, lb, [name_a, name_b], [&values_a, &values_b])?;
        columns.push(Column::new(&format!("layer `{}`", la.name), &values_a, &values_b, &la.corners, &lb.corners));
    }
    if !a.material.is_empty() || !b.material.is_empty() {
        columns.push(Column { what: "materials".to_string(), a: of_corners(a), b: of_corners(b) });
    }
    // Each alone, so that the message can name it; then all together.
    for k in 1..columns.len() {
        compare_columns(a, b, &[&columns[0], &columns[k]], &columns[k].what)?;
    }
    if columns.len() > 2 {
        compare_columns(a, b, &columns.iter().collect::<Vec<_>>(), "all attributes together")?;
    }
    Ok(())
}

/// One number per corner of both meshes: equal ones mean the same.
struct Column {
    what: String,
    a: Vec<u32>,
    b: Vec<u32>,
}

impl Column {
    /// `corners` pick out of `names`; what they do not name is none.
    fn new(what: &str, names_a: &[u32], names_b: &[u32], a: &[u32], b: &[u32]) -> Self {
        let pick = |names: &[u32], corners: &[u32]| -> Vec<u32> {
            corners.iter().map(|&i| names.get(i as usize).copied().unwrap_or(NO_VALUE)).collect()
        };
        Column { what: what.to_string(), a: pick(names_a, a), b: pick(names_b, b) }
    }
}

/// The material of each corner's face.
fn of_corners(mesh: &Mesh) -> Vec<u32> {
    (0..mesh.face_count())
        .flat_map(|f| {
            let material = mesh.material.get(f).copied().unwrap_or(NO_VALUE);
            std::iter::repeat_n(material, mesh.face(f).len())
        })
        .collect()
}

/// For each value of two layers the rank of its key among those of both.
fn ranks(n: usize, a: &Layer, b: &Layer, key: &Key<'_>) -> (Vec<u32>, Vec<u32>) {
    let keys = |l: &Layer| (0..l.len() as u32).map(|i| key(n, l, l.value(i))).collect::<Vec<_>>();
    let (a, b) = (keys(a), keys(b));
    let mut all: Vec<_> = a.iter().chain(&b).copied().collect();
    all.sort_unstable();
    all.dedup();
    let rank = |k: &[i64; MAX_WIDTH as usize]| all.partition_point(|other| other < k) as u32;
    (a.iter().map(rank).collect(), b.iter().map(rank).collect())
}

/// Isolated vertices have the same values, each as often as it is named; welding may have joined several with one value.
fn isolated(a: &Layer, b: &Layer, names: [&[u32]; 2], values: [&[u32]; 2]) -> Result<(), Difference> {
    let pairs = |l: &Layer, names: &[u32], values: &[u32]| {
        let mut list: Vec<(u32, u32, u32)> =
            l.isolated.iter().map(|&[v, i]| (names[v as usize], values[i as usize], v)).collect();
        list.sort_unstable();
        list
    };
    let (source, decoded) = (pairs(a, names[0], values[0]), pairs(b, names[1], values[1]));
    // Every decoded value is one of the source's at that vertex, and none is missing that the source has alone.
    let has = |list: &[(u32, u32, u32)], vertex: u32, value: Option<u32>| {
        let first = list.partition_point(|p| (p.0, p.1) < (vertex, value.unwrap_or(0)));
        list.get(first).is_some_and(|p| p.0 == vertex && value.is_none_or(|v| p.1 == v))
    };
    for &(vertex, value, own) in &source {
        let alone = source.iter().skip(source.partition_point(|p| p.0 < vertex)).take_while(|p| p.0 == vertex);
        let single = alone.map(|p| p.1).all(|v| v == value);
        let held = if single { has(&decoded, vertex, Some(value)) } else { has(&decoded, vertex, None) };
        if !held {
            return Err(Difference::Isolated { layer: a.name.clone(), vertex: own });
        }
    }
    for &(vertex, value, _) in &decoded {
        if !has(&source, vertex, Some(value)) {
            let own = source.iter().find(|p| p.0 == vertex).map_or(vertex, |p| p.2);
            return Err(Difference::Isolated { layer: a.name.clone(), vertex: own });
        }
    }
    Ok(())
}

/// The faces of both meshes over the combinations of what columns say of their corners.
fn compare_columns(a: &Mesh, b: &Mesh, columns: &[&Column], what: &str) -> Result<(), Difference> {
    let (n, m) = (a.corners.len(), b.corners.len());
    let order_of = |i: u32, j: u32| {
        let at = |c: &Column, i: u32| if (i as usize) < n { c.a[i as usize] } else { c.b[i as usize - n] };
        columns.iter().map(|c| at(c, i).cmp(&at(c, j))).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
    };
    let mut order: Vec<u32> = (0..(n + m) as u32).collect();
    order.sort_unstable_by(|&i, &j| order_of(i, j));
    let mut names = vec![0u32; n + m];
    for pair in order.windows(2) {
        let step = u32::from(order_of(pair[0], pair[1]).is_ne());
        names[pair[1] as usize] = names[pair[0] as usize] + step;
    }
    let of_b = names.split_off(n);
    let faces_a = CanonicalFaces::of_names(&a.face_start, names);
    let faces_b = CanonicalFaces::of_names(&b.face_start, of_b);
    faces_a.compare(&faces_b).map_err(|(face, source_count, decoded_count)| Difference::Attributes {
        what: what.to_string(),
        face: match face {
            Ok(f) => format!("{f} of the source (vertices {:?})", a.face(f)),
            Err(f) => format!("{f} of the decoded mesh (vertices {:?})", b.face(f)),
        },
        source_count,
        decoded_count,
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

    const UNIT: Lattice = Lattice { origin: [0.0; 3], step: 1.0 };

    fn mesh(points: &[[f64; 3]], faces: &[&[u32]]) -> Mesh {
        let mut mesh = Mesh { positions: points.to_vec(), ..Mesh::default() };
        faces.iter().for_each(|f| mesh.push_face(f));
        mesh
    }

    fn square() -> Mesh {
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

    fn with_layers() -> Mesh {
        let mut a = square();
        a.positions.push([3.0; 3]);
        a.layers.push(Layer {
            name: "uv".into(),
            width: 2,
            values: vec![0.0, 0.0, 0.5, 0.5, 1.0, 0.25],
            corners: vec![0, 1, 2, 0, 2, 1],
            isolated: vec![[4, 1]],
            ..Layer::default()
        });
        a.layers.push(Layer {
            name: "q".into(),
            width: 1,
            values: vec![7.0],
            corners: vec![0, 0, 0, NO_VALUE, NO_VALUE, NO_VALUE],
            ..Layer::default()
        });
        a.material = vec![0, NO_VALUE];
        a.appearance.materials.push("{}".into());
        a
    }

    #[test]
    fn attributes_may_be_numbered_otherwise_and_no_more() {
        let a = with_layers();
        // Vertices, faces, first corners and values in another order.
        let map = [4, 3, 2, 1, 0];
        let mut b =
            mesh(&[[3.0; 3], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0; 3]], &[&[1, 4, 2], &[3, 2, 4]]);
        b.layers.push(Layer {
            corners: vec![1, 2, 0, 1, 0, 2],
            values: vec![1.0, 0.25, 0.5, 0.5, 0.0, 0.0, 0.5, 0.5],
            isolated: vec![[0, 3]],
            ..a.layers[0].clone()
        });
        b.layers.push(Layer { corners: vec![NO_VALUE, NO_VALUE, NO_VALUE, 0, 0, 0], ..a.layers[1].clone() });
        b.material = vec![NO_VALUE, 0];
        b.appearance = a.appearance.clone();
        assert_eq!(by_map(&a, &b, &UNIT, &map), Ok(()));
        let check = |b: &Mesh| [attributes_by_map(&a, b, &map, &exact), attributes_by_position(&a, b, &UNIT, &exact)];
        assert_eq!(check(&b), [Ok(()), Ok(())]);
        let broken = |edit: &dyn Fn(&mut Mesh)| {
            let mut b = b.clone();
            edit(&mut b);
            let [x, y] = check(&b).map(|r| r.unwrap_err().to_string());
            assert_eq!(x.split(':').next(), y.split(':').next());
            x
        };
        assert_eq!(
            broken(&|b| b.layers[0].corners.swap(0, 1)),
            "layer `uv`: the face 0 of the decoded mesh (vertices [1, 4, 2]) occurs 0 times in the source and 1 times decoded"
        );
        assert!(broken(&|b| b.layers[1].values[0] = 7.5).starts_with("layer `q`: the face "));
        assert!(broken(&|b| b.layers[0].isolated.clear()).starts_with("uv: isolated vertex 4 of the source"));
        assert!(broken(&|b| b.layers[0].isolated[0][1] = 0).starts_with("uv: isolated vertex 4"));
        assert!(broken(&|b| b.material.swap(0, 1)).starts_with("materials: the face"));
        assert_eq!(
            broken(&|b| b.appearance.materials.clear()),
            "materials of the source and of the decoded mesh differ"
        );
        assert!(broken(&|b| drop(b.layers.pop())).starts_with("the source has the layers [\"uv (Scalar, 2)\", "));
        // Two equal faces that differ in two layers, and have them crossed.
        let mut c = square();
        c.push_face(&[0, 1, 2]);
        let layer = |x: [u32; 3]| Layer {
            width: 1,
            values: vec![1.0, 2.0],
            corners: [[x[0]; 3], [x[1]; 3], [x[2]; 3]].concat(),
            ..Layer::default()
        };
        c.layers = vec![layer([0, 0, 1]), layer([0, 0, 1])];
        let mut d = c.clone();
        d.layers[1] = layer([1, 0, 0]);
        let error = attributes_by_map(&c, &d, &[0, 1, 2, 3], &exact).unwrap_err().to_string();
        assert!(error.starts_with("all attributes together: the face "), "{error}");
        // Equal is what the key says.
        let mut e = b.clone();
        e.layers[0].values[0] = 1.001;
        assert!(attributes_by_map(&a, &e, &map, &exact).is_err());
        let coarse = |_: usize, _: &Layer, v: &[f64]| [(v[0] * 64.0).round() as i64, 0, 0, 0];
        assert_eq!(attributes_by_map(&a, &e, &map, &coarse), Ok(()));
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
