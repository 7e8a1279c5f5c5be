//! Surfaces: closed, bordered, of triangles, quads and mixed polygons.

use super::defects::crumbs_around;
use super::noise::{fractal, noise, turn};
use crate::mesh::Mesh;
use crate::random::Random;

/// A height field of exactly `vertices` vertices in a square, two triangles a cell, with hills of all sizes.
pub fn terrain(vertices: u32, seed: u64) -> Mesh {
    let width = (f64::from(vertices).sqrt() as u32).max(1);
    let mut mesh = Mesh::default();
    mesh.positions.reserve_exact(vertices as usize);
    let scale = 1.0 / f64::from(width);
    for v in 0..vertices {
        let (x, y) = (f64::from(v % width) * scale, f64::from(v / width) * scale);
        let z = 0.12 * fractal([3.0 * x, 3.0 * y, 0.5], 9, seed);
        mesh.positions.push([x, y, z]);
    }
    let rows = vertices.div_ceil(width.max(1));
    let cells = rows.saturating_sub(1) as usize * width.saturating_sub(1) as usize;
    mesh.face_start.reserve_exact(2 * cells + 1);
    mesh.corners.reserve_exact(6 * cells);
    for row in 1..rows {
        for column in 0..width.saturating_sub(1) {
            let a = (row - 1) * width + column;
            let (b, c, d) = (a + 1, a + width, a + width + 1);
            if c < vertices {
                mesh.push_face(&[a, b, c]);
            }
            if d < vertices {
                mesh.push_face(&[b, d, c]);
            }
        }
    }
    mesh
}

/// [`terrain`] with its vertices and faces in no order at all.
pub fn scattered_terrain(vertices: u32, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let ordered = terrain(vertices, seed);
    let mut place: Vec<u32> = (0..vertices).collect();
    let mut order: Vec<u32> = (0..ordered.face_count() as u32).collect();
    for list in [&mut place, &mut order] {
        for i in (1..list.len()).rev() {
            list.swap(i, random.below(i as u32 + 1) as usize);
        }
    }
    let mut mesh = Mesh { positions: ordered.positions.clone(), ..Mesh::default() };
    for (p, &v) in ordered.positions.iter().zip(&place) {
        mesh.positions[v as usize] = *p;
    }
    for f in order {
        let corners: Vec<u32> = ordered.face(f as usize).iter().map(|&v| place[v as usize]).collect();
        mesh.push_face(&corners);
    }
    mesh
}

/// A unit sphere of `10·frequency² + 2` vertices (an icosahedron whose sides are cut into `frequency` parts), moved
/// along the normal by noise of the given amplitude.
pub fn sphere(frequency: u32, amplitude: f64, seed: u64) -> Mesh {
    displaced(frequency, |p| 1.0 + amplitude * noise(p.map(|c| 40.0 * c), seed) + amplitude * fractal(p, 4, seed + 1))
}

/// A rock of `10·frequency² + 2` vertices: a sphere with mountains and craters.
pub fn asteroid(frequency: u32, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let craters: Vec<([f64; 3], f64)> =
        (0..40).map(|_| (unit(random.point()), 0.04 + 0.25 * random.unit() * random.unit())).collect();
    displaced(frequency, |p| {
        let mut r = 1.0 + 0.16 * noise(p.map(|c| 1.7 * c), seed) + 0.02 * fractal(p.map(|c| 6.0 * c), 5, seed + 9);
        for &(c, radius) in &craters {
            let d2 = (0..3).map(|k| (p[k] - c[k]) * (p[k] - c[k])).sum::<f64>() / (radius * radius);
            // A bowl with a raised rim, gone at 1.5 times its radius.
            if d2 < 1.0 {
                r += radius * (0.32 * d2 - 0.25);
            } else if d2 < 2.25 {
                r += radius * 0.07 * (2.25 - d2) / 1.25;
            }
        }
        r
    })
}

/// [`asteroid`] with a ring of crumbs around it: components of one to four vertices, dangling edges among them.
pub fn ringed_asteroid(frequency: u32, pieces: u32, seed: u64) -> Mesh {
    let mut mesh = asteroid(frequency, seed);
    let ring = crumbs_around(pieces, seed + 1, |random| {
        let (cos, sin) = turn(random.below(1 << 20), 1 << 20);
        let r = 1.6 + 0.6 * random.unit();
        [r * cos, r * sin, 0.02 * (random.unit() - 0.5) + 0.25 * r * cos]
    });
    let offset = mesh.vertex_count() as u32;
    mesh.positions.extend_from_slice(&ring.positions);
    for face in ring.faces() {
        let face: Vec<u32> = face.iter().map(|v| v + offset).collect();
        mesh.push_face(&face);
    }
    mesh
}

/// A torus of `rings · sides` quads.
pub fn torus(rings: u32, sides: u32) -> Mesh {
    let (rings, sides) = (rings.max(3), sides.max(3));
    let mut mesh = Mesh::default();
    for i in 0..rings {
        let (c, s) = turn(i, rings);
        for j in 0..sides {
            let (d, t) = turn(j, sides);
            mesh.positions.push([(1.0 + 0.4 * d) * c, (1.0 + 0.4 * d) * s, 0.4 * t]);
        }
    }
    let at = |i: u32, j: u32| (i % rings) * sides + j % sides;
    for i in 0..rings {
        for j in 0..sides {
            mesh.push_face(&[at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    mesh
}

/// An open cylinder of `rings · sides` vertices in quads, two borders, with `holes` of its quads missing at random places.
pub fn cylinder(rings: u32, sides: u32, holes: u32, seed: u64) -> Mesh {
    let (rings, sides) = (rings.max(2), sides.max(3));
    let mut random = Random::new(seed);
    let mut missing = vec![false; ((rings - 1) * sides) as usize];
    for _ in 0..holes {
        let at = random.below(missing.len() as u32) as usize;
        missing[at] = true;
    }
    let mut mesh = Mesh::default();
    for i in 0..rings {
        for j in 0..sides {
            let (c, s) = turn(j, sides);
            mesh.positions.push([c, s, 4.0 * f64::from(i) / f64::from(rings)]);
        }
    }
    for i in 0..rings - 1 {
        for j in 0..sides {
            if !missing[(i * sides + j) as usize] {
                let k = (j + 1) % sides;
                mesh.push_face(&[i * sides + j, i * sides + k, (i + 1) * sides + k, (i + 1) * sides + j]);
            }
        }
    }
    mesh
}

/// A wavy sheet of `columns · rows` vertices whose cells are quads, pairs of triangles, and larger polygons that
/// swallow their neighbours to the right (degree 6, 8 and 10).
pub fn mixed(columns: u32, rows: u32, seed: u64) -> Mesh {
    let (columns, rows) = (columns.max(2), rows.max(2));
    let mut random = Random::new(seed);
    let mut mesh = Mesh::default();
    for j in 0..rows {
        for i in 0..columns {
            let (x, y) = (f64::from(i) / f64::from(columns), f64::from(j) / f64::from(columns));
            mesh.positions.push([x, y, 0.2 * fractal([4.0 * x, 4.0 * y, 0.0], 3, seed)]);
        }
    }
    for j in 0..rows - 1 {
        let mut i = 0;
        while i < columns - 1 {
            let a = j * columns + i;
            let wide = match random.below(10) {
                kind @ 0..=2 => (kind + 2).min(columns - 1 - i),
                _ => 1,
            };
            if wide == 1 && random.below(3) == 0 {
                mesh.push_face(&[a, a + 1, a + columns]);
                mesh.push_face(&[a + 1, a + 1 + columns, a + columns]);
            } else {
                let below = a..=a + wide;
                let above = (a + columns..=a + columns + wide).rev();
                mesh.push_face(&below.chain(above).collect::<Vec<_>>());
            }
            i += wide;
        }
    }
    mesh
}

fn unit(p: [f64; 3]) -> [f64; 3] {
    let length = p.iter().map(|c| c * c).sum::<f64>().sqrt();
    if length > 0.0 { p.map(|c| c / length) } else { [0.0, 0.0, 1.0] }
}

/// The icosahedron's sides cut into `n` parts, put on the unit sphere and scaled by `radius`.
fn displaced(n: u32, radius: impl Fn([f64; 3]) -> f64) -> Mesh {
    const PHI: f64 = 1.618_033_988_749_895;
    const CORNERS: [[f64; 3]; 12] = [
        [-1.0, PHI, 0.0],
        [1.0, PHI, 0.0],
        [-1.0, -PHI, 0.0],
        [1.0, -PHI, 0.0],
        [0.0, -1.0, PHI],
        [0.0, 1.0, PHI],
        [0.0, -1.0, -PHI],
        [0.0, 1.0, -PHI],
        [PHI, 0.0, -1.0],
        [PHI, 0.0, 1.0],
        [-PHI, 0.0, -1.0],
        [-PHI, 0.0, 1.0],
    ];
    #[rustfmt::skip]
    const FACES: [[u32; 3]; 20] = [
        [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6],
        [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7],
        [9, 8, 1],
    ];
    let n = n.max(1);
    // Vertices: 12 corners, then n − 1 a side, then the inner ones of each face.
    let mut flat: Vec<[f64; 3]> = CORNERS.to_vec();
    let mut sides = std::collections::HashMap::new();
    let blend = |corners: &[u32], weights: &[u32]| -> [f64; 3] {
        std::array::from_fn(|k| {
            corners.iter().zip(weights).map(|(&c, &w)| CORNERS[c as usize][k] * f64::from(w)).sum::<f64>()
                / f64::from(n)
        })
    };
    for face in FACES {
        for i in 0..3 {
            let (a, b) = (face[i].min(face[(i + 1) % 3]), face[i].max(face[(i + 1) % 3]));
            sides.entry((a, b)).or_insert_with(|| {
                let first = flat.len() as u32;
                flat.extend((1..n).map(|t| blend(&[a, b], &[n - t, t])));
                first
            });
        }
    }
    let mut mesh = Mesh::default();
    for [a, b, c] in FACES {
        let inner = flat.len() as u32;
        for j in 1..n {
            for i in 1..n - j {
                flat.push(blend(&[a, b, c], &[n - i - j, i, j]));
            }
        }
        let on_side = |from: u32, to: u32, t: u32| {
            let (lo, hi, t) = if from < to { (from, to, t) } else { (to, from, n - t) };
            if t == 0 {
                lo
            } else if t == n {
                hi
            } else {
                sides[&(lo, hi)] + t - 1
            }
        };
        // Row j holds the vertices i = 0..=n − j of weight (n − i − j, i, j).
        let at = |i: u32, j: u32| {
            if j == 0 {
                on_side(a, b, i)
            } else if i == 0 {
                on_side(a, c, j)
            } else if i + j == n {
                on_side(b, c, j)
            } else {
                // Rows 1..j hold n − 2, n − 3, … inner vertices.
                inner + (j - 1) * (2 * n - j - 2) / 2 + i - 1
            }
        };
        for j in 0..n {
            for i in 0..n - j {
                mesh.push_face(&[at(i, j), at(i + 1, j), at(i, j + 1)]);
                if i + j + 1 < n {
                    mesh.push_face(&[at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
    }
    mesh.positions = flat
        .into_iter()
        .map(|p| {
            let p = unit(p);
            let r = radius(p);
            p.map(|c| r * c)
        })
        .collect();
    mesh
}
