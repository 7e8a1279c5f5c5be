//! Small meshes with everything unusual in them, made by rule: what hardening, golden files and fuzz seeds start from.
#![allow(dead_code, reason = "each test binary uses its own part")]

use lodestream::encode::{EncodeOptions, encode};
use lodestream::mesh::lattice::Quantization;
use lodestream::mesh::{Appearance, Image, Layer, LayerKind, Mesh, NO_VALUE, Stored};
use lodestream::samples::{crumbs, fan_book, mixed, point_cloud, soup, sphere, torus};

/// xorshift64*, the same on every machine.
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.next() >> 33) as usize % n.max(1)
    }
}

/// A mesh from lists.
pub fn of(positions: &[[f64; 3]], faces: &[&[u32]]) -> Mesh {
    let mut mesh = Mesh { positions: positions.to_vec(), ..Mesh::default() };
    faces.iter().for_each(|f| mesh.push_face(f));
    mesh
}

const CORNERS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];

/// Two triangles turned alike and one turned round on one edge, a dangling edge, a duplicate face, a fan of its own at a
/// vertex.
fn non_manifold() -> Mesh {
    let mut positions: Vec<[f64; 3]> = CORNERS.to_vec();
    positions.extend([[1.0, 1.0, 1.0], [-1.0, 0.5, 0.0], [-1.0, -1.0, 0.5], [4.0, 4.0, 4.0]]);
    of(&positions, &[&[0, 1, 2], &[0, 1, 3], &[1, 0, 4], &[0, 5, 6], &[0, 1, 2], &[2, 1, 0], &[4, 7], &[4, 7]])
}

/// Faces that repeat a vertex, among honest ones.
fn repeating(mut mesh: Mesh) -> Mesh {
    for f in [&[1u32, 1, 2][..], &[3, 4, 3, 5], &[7, 7], &[7, 7], &[2, 1, 1]] {
        mesh.push_face(f);
    }
    mesh
}

/// A sphere of quads and triangles with texture coordinates that meet in a seam, another value for each triangle at the poles.
fn seamed(rings: u32, segments: u32) -> Mesh {
    let mut positions = vec![[0.0, 0.0, 1.0]];
    let turn = std::f64::consts::TAU / f64::from(segments);
    for i in 1..rings {
        let (r, z) = (turn * f64::from(segments) / 2.0 * f64::from(i) / f64::from(rings)).sin_cos();
        for k in 0..segments {
            let (s, c) = (turn * f64::from(k)).sin_cos();
            positions.push([r * c, r * s, z]);
        }
    }
    positions.push([0.0, 0.0, -1.0]);
    let last = positions.len() as u32 - 1;
    let mut mesh = of(&positions, &[]);
    let mut uv = Layer { name: "uv".into(), kind: LayerKind::Uv, width: 2, ..Layer::default() };
    let mut put = |faces: &[(u32, f64, u32)]| {
        let names: Vec<u32> = faces.iter().map(|f| f.0).collect();
        mesh.push_face(&names);
        for &(_, u, i) in faces {
            uv.corners.push((uv.values.len() / 2) as u32);
            uv.values.extend([u / f64::from(segments), f64::from(i) / f64::from(rings)]);
        }
    };
    let at = |i: u32, k: u32| (1 + (i - 1) * segments + k % segments, f64::from(k), i);
    for k in 0..segments {
        put(&[(0, f64::from(k) + 0.5, 0), at(1, k), at(1, k + 1)]);
        for i in 1..rings - 1 {
            put(&[at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]);
        }
        put(&[(last, f64::from(k) + 0.5, rings), at(rings - 1, k + 1), at(rings - 1, k)]);
    }
    mesh.layers.push(uv);
    mesh
}

/// A layer whose corners choose among a few values; one element in five has none, and isolated vertices now and then have one.
pub fn any_layer(mesh: &Mesh, name: &str, kind: LayerKind, width: u8, r: &mut Random) -> Layer {
    let palette = 1 + r.below(7);
    let mut layer = Layer { name: name.into(), kind, width, stored: Stored::F32, ..Layer::default() };
    layer.values = (0..palette * width as usize).map(|_| r.below(1001) as f64 / 1000.0).collect();
    for corners in mesh.faces() {
        let (kind, one) = (r.below(5), r.below(palette) as u32);
        layer.corners.extend(corners.iter().map(|_| match kind {
            0 => NO_VALUE,
            1 | 2 => one,
            _ => r.below(palette) as u32,
        }));
    }
    let mut isolated = vec![true; mesh.vertex_count()];
    mesh.corners.iter().for_each(|&v| isolated[v as usize] = false);
    for v in (0..isolated.len()).filter(|&v| isolated[v]) {
        if r.below(3) > 0 {
            layer.isolated.push([v as u32, r.below(palette) as u32]);
        }
    }
    layer
}

/// The mesh with layers of every kind, materials and images.
pub fn with_attributes(mut mesh: Mesh, seed: u64) -> Mesh {
    let mut r = Random(seed);
    let kinds = [("uv", LayerKind::Uv, 2), ("quality", LayerKind::Scalar, 1), ("tangent", LayerKind::Tangent, 4)];
    for (name, kind, width) in kinds {
        let layer = any_layer(&mesh, name, kind, width, &mut r);
        mesh.layers.push(layer);
    }
    mesh.material = mesh.faces().map(|_| if r.below(4) == 0 { NO_VALUE } else { r.below(2) as u32 }).collect();
    mesh.appearance = Appearance {
        materials: vec![r#"{"name":"a"}"#.into(), r#"{"name":"b"}"#.into()],
        textures: vec![r#"{"source":1}"#.into()],
        samplers: Vec::new(),
        images: vec![
            Image { name: "not there.png".into(), mime: "image/png".into(), bytes: Vec::new(), previews: Vec::new() },
            Image {
                name: String::new(),
                mime: "image/jpeg".into(),
                bytes: vec![0xff, 0xd8, 0, 1, 2],
                previews: Vec::new(),
            },
        ],
    };
    mesh
}

/// The mesh with two previews of its second image, and one of the image that is not there, which no file carries.
fn previewed(mut mesh: Mesh, seed: u64) -> Mesh {
    mesh = with_attributes(mesh, seed);
    let [none, image] = &mut mesh.appearance.images[..] else { unreachable!("two images") };
    none.previews = vec![b"\x89PNG of nothing".to_vec()];
    image.previews = vec![b"\x89PNG coarse".to_vec(), vec![0xff, 0xd8, 0xff, 7, 7, 7]];
    mesh
}

/// A normal for each face.
fn faceted(mut mesh: Mesh) -> Mesh {
    let mut normal = Layer { name: "normal".into(), kind: LayerKind::Normal, width: 3, ..Layer::default() };
    for (f, corners) in (0u32..).zip(mesh.faces()) {
        let at = |k: usize| mesh.positions[corners[k] as usize];
        let [e, f0]: [[f64; 3]; 2] = [1, 2].map(|k| std::array::from_fn(|c| at(k)[c] - at(0)[c]));
        normal.values.extend((0..3).map(|k| e[(k + 1) % 3] * f0[(k + 2) % 3] - e[(k + 2) % 3] * f0[(k + 1) % 3]));
        normal.corners.extend(corners.iter().map(|_| f));
    }
    mesh.layers.push(normal);
    mesh
}

/// A colour of four bytes for each vertex, those without elements too.
fn coloured(mut mesh: Mesh) -> Mesh {
    let mut r = Random(12);
    let values = (0..4 * mesh.vertex_count()).map(|_| (r.below(40) * 6) as f64 / 255.0).collect();
    let n = mesh.vertex_count();
    let layer = Layer::per_vertex("color", LayerKind::Color, 4, Stored::U8, values, &mesh.corners, n);
    mesh.layers.push(layer);
    mesh
}

/// Every small mesh, by name.
pub fn meshes() -> Vec<(&'static str, Mesh)> {
    vec![
        ("empty", Mesh::default()),
        ("one-vertex", of(&CORNERS[..1], &[])),
        ("triangle", of(&CORNERS[..3], &[&[0, 1, 2]])),
        ("tetrahedron", of(&CORNERS, &[&[0, 2, 1], &[0, 1, 3], &[1, 2, 3], &[2, 0, 3]])),
        ("non-manifold", non_manifold()),
        ("repeating", repeating(torus(6, 5))),
        ("points", point_cloud(70, 3)),
        ("quad-torus", torus(9, 7)),
        ("soup", soup(24, 50, 5)),
        ("crumbs", crumbs(40, 6)),
        ("fan-book", fan_book(7, 2, 7)),
        ("mixed", mixed(7, 6, 8)),
        ("sphere", sphere(8, 0.04, 9)),
        ("uv-sphere", seamed(6, 9)),
        ("dressed-soup", with_attributes(soup(14, 26, 5), 21)),
        ("dressed-repeating", with_attributes(repeating(torus(4, 3)), 22)),
        ("dressed-non-manifold", with_attributes(non_manifold(), 23)),
        ("previewed", previewed(torus(5, 4), 24)),
        ("facets", faceted(torus(5, 4))),
        ("colours", coloured(torus(6, 4))),
        ("coloured-points", coloured(point_cloud(12, 3))),
    ]
}

/// The small meshes as files, by name, at 11 bits.
pub fn files() -> Vec<(&'static str, Vec<u8>)> {
    meshes().into_iter().map(|(name, mesh)| (name, file(&mesh, 11))).collect()
}

/// A mesh as a file.
pub fn file(mesh: &Mesh, bits: u8) -> Vec<u8> {
    let options = EncodeOptions::default().quantization(Quantization::Bits(bits));
    encode(mesh, &options).unwrap().bytes
}
