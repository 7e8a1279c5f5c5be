//! Small meshes with everything unusual in them, made by rule: what hardening, golden files and fuzz seeds start from.
#![allow(dead_code, reason = "each test binary uses its own part")]

use lodestream::encode::{EncodeOptions, encode};
use lodestream::generate::{crumbs, fan_book, mixed, point_cloud, soup, sphere, torus};
use lodestream::lattice::Quantization;
use lodestream::mesh::Mesh;

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
fn repeating() -> Mesh {
    let mut mesh = torus(6, 5);
    for f in [&[1u32, 1, 2][..], &[3, 4, 3, 5], &[7, 7], &[7, 7], &[2, 1, 1]] {
        mesh.push_face(f);
    }
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
        ("repeating", repeating()),
        ("points", point_cloud(70, 3)),
        ("quad-torus", torus(9, 7)),
        ("soup", soup(24, 50, 5)),
        ("crumbs", crumbs(40, 6)),
        ("fan-book", fan_book(7, 2, 7)),
        ("mixed", mixed(7, 6, 8)),
        ("sphere", sphere(8, 0.04, 9)),
    ]
}

/// The small meshes as files, by name, at 11 bits.
pub fn files() -> Vec<(&'static str, Vec<u8>)> {
    meshes().into_iter().map(|(name, mesh)| (name, file(&mesh, 11))).collect()
}

/// A mesh as a file.
pub fn file(mesh: &Mesh, bits: u8) -> Vec<u8> {
    let options = EncodeOptions { quantization: Quantization::Bits(bits), ..EncodeOptions::default() };
    encode(mesh, &options, &|_| {}).unwrap().bytes
}
