//! Attributes of two meshes, corner by corner.
//!
//! What columns say of a corner (its vertex, its value of each layer, the material of its face) becomes one number; then faces over
//! these numbers are compared as faces over vertices are.

use super::{CanonicalFaces, Difference, quantize};
use crate::image::jpeg::same_picture;
use crate::mesh::lattice::Lattice;
use crate::mesh::{Image, Layer, MAX_WIDTH, Mesh, NO_VALUE};
use std::cmp::Ordering;

/// What makes values of a layer equal: those with equal keys are. The number is that of the layer.
pub type Key<'a> = dyn Fn(usize, &Layer, &[f64]) -> [i64; MAX_WIDTH as usize] + 'a;

/// The key of exact comparison: the bits of the numbers, with both zeros as one.
pub fn exact(_: usize, _: &Layer, value: &[f64]) -> [i64; MAX_WIDTH as usize] {
    let mut out = [0; MAX_WIDTH as usize];
    out.iter_mut().zip(value).for_each(|(o, x)| *o = (x + 0.0).to_bits() as i64);
    out
}

/// The key by which a `.lods` file keeps attributes: values with equal integers are equal. `layers` are those of its header; a
/// direction on the rim of its square has two places, of which one is what comes back.
pub fn quantized(
    layers: &[crate::format::container::LayerHeader],
) -> impl Fn(usize, &Layer, &[f64]) -> [i64; MAX_WIDTH as usize] + '_ {
    |n, layer, value| {
        // A layer that the file does not list has lost its match already; exact bits tell it apart.
        let Some(info) = layers.get(n) else { return exact(n, layer, value) };
        let (quantizer, kind) = (info.quantizer, layer.kind);
        let mut back = [0.0; MAX_WIDTH as usize];
        let back = &mut back[..layer.width.min(MAX_WIDTH) as usize];
        quantizer.restore(kind, &quantizer.quantize(kind, value), back);
        quantizer.quantize(kind, back).map(i64::from)
    }
}

/// Compare attributes of two meshes that are equal [by map](super::by_map): layers at corners and isolated vertices, materials of faces, and the
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

/// Compare attributes of two meshes that are equal [by position](super::by_position). Vertices at one lattice point count as one.
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

/// A texture may have been coded in another way, without loss.
fn same_images(a: &[Image], b: &[Image]) -> bool {
    let same = |(a, b): (&Image, &Image)| a.name == b.name && a.mime == b.mime && same_picture(&a.bytes, &b.bytes);
    a.len() == b.len() && a.iter().zip(b).all(same)
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
        ("images", same_images(&x.images, &y.images)),
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

#[cfg(test)]
mod tests {
    use super::super::by_map;
    use super::super::tests::{UNIT, mesh, square};
    use super::*;

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
}
