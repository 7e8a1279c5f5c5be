//! Meshes made by rule, for the demo, the tests and the benches: no data file is needed to try any case.
//!
//! Every function gives the same mesh, bit for bit, on every machine: integers, the four operations and square roots only.
//! [`by_name`] is the door for `datasets.toml`.

mod defects;
mod noise;
mod shapes;

pub use crate::random::Random;
pub use defects::{crumbs, fan_book, point_cloud, soup};
pub use shapes::{asteroid, cylinder, mixed, ringed_asteroid, scattered_terrain, sphere, terrain, torus};

use crate::mesh::Mesh;

/// Names that [`by_name`] knows, in order.
pub const NAMES: [&str; 11] = [
    "asteroid",
    "crumbs",
    "cylinder",
    "fan-book",
    "mixed",
    "points",
    "scattered-terrain",
    "soup",
    "sphere",
    "terrain",
    "torus",
];

/// The generated mesh `name` of about `size` vertices (exactly `size` for terrains and point clouds), or `None` where the name is not known.
pub fn by_name(name: &str, size: u32, seed: u64) -> Option<Mesh> {
    let side = (f64::from(size).sqrt() as u32).max(3);
    // A subdivision into n parts a side has 10·n² + 2 vertices.
    let frequency = (f64::from(size.saturating_sub(2)) / 10.0).sqrt().round().max(1.0) as u32;
    Some(match name {
        "asteroid" => asteroid(frequency, seed),
        "crumbs" => crumbs((size / 3).max(1), seed),
        "cylinder" => cylinder(side, side, side, seed),
        "fan-book" => fan_book((size / 4).clamp(3, 64), size / 256 + 1, seed),
        "mixed" => mixed(side, side, seed),
        "points" => point_cloud(size, seed),
        "scattered-terrain" => scattered_terrain(size, seed),
        "soup" => soup(size, size.saturating_mul(2), seed),
        "sphere" => sphere(frequency, 0.02, seed),
        "terrain" => terrain(size, seed),
        "torus" => torus(side, side),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_gives_a_valid_mesh_of_about_the_size_asked_for() {
        for name in NAMES {
            for size in [1, 20, 1000, 5000] {
                let mesh = by_name(name, size, 7).unwrap();
                mesh.validate().unwrap_or_else(|error| panic!("{name} {size}: {error}"));
                let n = mesh.vertex_count() as u32;
                assert!(size < 1000 || (n > size / 2 && n < size * 2), "{name}: {n} vertices instead of {size}");
                assert_eq!(mesh, by_name(name, size, 7).unwrap());
            }
        }
        assert_eq!(by_name("cube", 8, 0), None);
    }

    #[test]
    fn closed_shapes_are_closed_and_all_vertices_are_used() {
        for (name, mesh) in [("sphere", sphere(5, 0.01, 1)), ("torus", torus(7, 5)), ("asteroid", asteroid(4, 1))] {
            let mut edges = std::collections::HashMap::new();
            for face in mesh.faces() {
                for i in 0..face.len() {
                    *edges.entry((face[i], face[(i + 1) % face.len()])).or_insert(0) += 1;
                }
            }
            for (&(a, b), &count) in &edges {
                assert_eq!((count, edges.get(&(b, a))), (1, Some(&1)), "{name}: edge {a} {b}");
            }
            let euler = mesh.vertex_count() as i64 - edges.len() as i64 / 2 + mesh.face_count() as i64;
            assert_eq!(euler, if name == "torus" { 0 } else { 2 }, "{name}");
        }
    }

    #[test]
    fn terrain_has_exactly_the_vertices_asked_for() {
        for n in [1, 2, 3, 4, 5, 10, 11, 99, 100, 101, 1000] {
            assert_eq!(terrain(n, 1).vertex_count(), n as usize);
        }
        let mesh = terrain(101, 1);
        let mut used = [false; 101];
        mesh.corners.iter().for_each(|&v| used[v as usize] = true);
        assert!(used.iter().all(|&u| u));
    }
}
