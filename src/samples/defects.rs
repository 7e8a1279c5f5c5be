//! What scanners and modellers leave behind: complex edges and vertices, crumbs, points, polygon soups.

use super::noise::turn;
use crate::mesh::Mesh;
use crate::random::Random;

/// A book: `pages` quads on one spine edge (an edge of more than two faces), every third of them turned round; `copies`
/// of it stand in a row and touch their neighbours in one vertex (a vertex of several fans). A dangling edge, a duplicate
/// page, a page in both orientations and an isolated vertex come with each.
pub fn fan_book(pages: u32, copies: u32, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = Mesh::default();
    let mut last_tip = None;
    for copy in 0..copies.max(1) {
        let x = 3.0 * f64::from(copy);
        let base = mesh.vertex_count() as u32;
        mesh.positions.extend([[x, 0.0, 0.0], [x, 0.0, 1.0]]);
        for page in 0..pages.max(1) {
            let (c, s) = turn(page, pages.max(1));
            let z = 0.1 * random.unit();
            mesh.positions.extend([[x + c, s, z], [x + c, s, 1.0 + z]]);
            let (a, b) = (base + 2 + 2 * page, base + 3 + 2 * page);
            let mut quad = [base, a, b, base + 1];
            if page % 3 == 0 {
                quad.reverse();
            }
            mesh.push_face(&quad);
            match page {
                0 => mesh.push_face(&quad),
                1 => {
                    quad.reverse();
                    mesh.push_face(&quad);
                }
                _ => {}
            }
        }
        let extra = mesh.vertex_count() as u32;
        mesh.positions.extend([[x, 0.0, 2.0], [x, 1.5, 2.0]]);
        mesh.push_face(&[base + 1, extra]);
        if let Some(tip) = last_tip {
            mesh.push_face(&[tip, base, base + 2]);
        }
        last_tip = Some(base + 3);
    }
    mesh
}

/// `pieces` tiny components in a cube: isolated vertices, dangling edges, triangles, quads and tetrahedra in turn.
pub fn crumbs(pieces: u32, seed: u64) -> Mesh {
    crumbs_around(pieces, seed, |random| random.point())
}

/// [`crumbs`] at the places that `place` gives.
pub(super) fn crumbs_around(pieces: u32, seed: u64, mut place: impl FnMut(&mut Random) -> [f64; 3]) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = Mesh::default();
    for piece in 0..pieces {
        let centre = place(&mut random);
        let size = 0.004 + 0.016 * random.unit();
        let first = mesh.vertex_count() as u32;
        let count = [1, 2, 3, 4, 4][piece as usize % 5];
        for _ in 0..count {
            let offset = random.point();
            mesh.positions.push(std::array::from_fn(|k| centre[k] + size * offset[k]));
        }
        let [a, b, c, d] = [first, first + 1, first + 2, first + 3];
        match piece % 5 {
            0 => {}
            1 => mesh.push_face(&[a, b]),
            2 => mesh.push_face(&[a, b, c]),
            3 => mesh.push_face(&[a, b, c, d]),
            _ => {
                for face in [[a, b, c], [a, c, d], [a, d, b], [b, d, c]] {
                    mesh.push_face(&face);
                }
            }
        }
    }
    mesh
}

/// `count` points near a surface (a bent sheet), with some on one spot.
pub fn point_cloud(count: u32, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = Mesh::default();
    for i in 0..count {
        let (x, y) = (random.unit(), random.unit());
        let p = [x, y, 0.3 * x * x - 0.2 * x * y + 0.004 * random.unit()];
        let p = if i % 97 == 96 { mesh.positions[i as usize / 2] } else { p };
        mesh.positions.push(p);
    }
    mesh
}

/// Random polygons (degree 2 to 7) over random vertices: anything goes, a repeated vertex, a duplicate face, a face turned round.
pub fn soup(vertices: u32, faces: u32, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = Mesh::default();
    let vertices = vertices.max(1);
    mesh.positions = (0..vertices).map(|_| random.point()).collect();
    for f in 0..faces {
        if f > 0 && random.below(10) == 0 {
            let mut old = mesh.face(random.below(f) as usize).to_vec();
            if random.below(2) == 0 {
                old.reverse();
            }
            mesh.push_face(&old);
            continue;
        }
        let degree = 2 + random.below(3) + random.below(2) * random.below(4);
        // Near neighbours by number, so that faces share edges now and then.
        let first = random.below(vertices);
        let face: Vec<u32> = (0..degree).map(|_| (first + random.below(12)) % vertices).collect();
        mesh.push_face(&face);
    }
    mesh
}
