//! Levels against quadric simplification with as many vertices: `cargo bench --bench quadrics [-- MESH… [--bits B]]`.
//!
//! For every level from a hundredth of the vertices on: the mean distance to the source (the larger of both directions, all samples alike),
//! over that of what `meshopt` makes of the source with as many vertices. It makes two things: `simplify` keeps a part of the vertices
//! where they are, as streams of levels do it; `with update` also moves those that stay to where their quadrics are least, anywhere in
//! space. Both start from the source in `f32`, and no lattice takes anything away from them; ours lie on one of 12 bits, so the same is
//! told of `simplify` with its vertices on that lattice.
//!
//! With `LODESTREAM_DATA` it takes horse, bunny and armadillo, else (or with `--smoke`) a generated mesh; MESH is any file.
#![allow(missing_docs)]

use lodestream::encode::{EncodeOptions, encode};
use lodestream::format::decoder::{DecodeOptions, Decoder, Step};
use lodestream::io::read::{ReadOptions, read_path};
use lodestream::mesh::Mesh;
use lodestream::mesh::lattice::{Lattice, Quantization};
use lodestream::quality::{self, SampleOptions, Sampled, Weights};
use lodestream::samples;
use meshopt::{SimplifyOptions, VertexDataAdapter};
use std::path::{Path, PathBuf};

/// Levels with a smaller share of the vertices are not compared.
const COARSEST: f64 = 0.01;

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let smoke = args.iter().any(|a| a == "--smoke" || a == "--test");
    let bits = args.iter().position(|a| a == "--bits").and_then(|i| args.get(i + 1)?.parse().ok()).unwrap_or(12);
    let mut meshes: Vec<PathBuf> = args.iter().filter(|a| a.contains('.')).map(PathBuf::from).collect();
    if let (Some(data), true, false) = (std::env::var_os("LODESTREAM_DATA"), meshes.is_empty(), smoke) {
        let names = ["classic/horse.ply", "classic/bun_zipper.ply", "classic/armadillo.obj"];
        meshes = names.iter().map(|n| Path::new(&data).join(n)).collect();
    }
    println!("| mesh | vertices | share | mean / diagonal | × simplify | on the lattice | × with update |");
    println!("|---|---|---|---|---|---|---|");
    let mut worst = [0.0f64; 2];
    if meshes.is_empty() {
        worst = compare("generated", &samples::asteroid(if smoke { 24 } else { 80 }, 1), bits);
    }
    for path in meshes {
        let name = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        match read_path(&path, &ReadOptions::default()) {
            Ok(read) => {
                let of_mesh = compare(&name, &in_use(&read.mesh), bits);
                worst = [0, 1].map(|k| worst[k].max(of_mesh[k]));
            }
            Err(error) => println!("{}: skipped, {error}", path.display()),
        }
    }
    println!("\nat {bits} bits; worst over simplify: {:.2}, on the lattice: {:.2} (must: 2.5)", worst[0], worst[1]);
}

/// The largest ratios over `simplify`, as it is and with its vertices on the lattice.
fn compare(name: &str, source: &Mesh, bits: u8) -> [f64; 2] {
    let options = EncodeOptions::default().quantization(Quantization::Bits(bits));
    let encoded = encode(source, &options).expect("it is a sound mesh");
    let sampled = Sampled::new(source);
    let quadrics = Quadrics::new(source);
    let sampling = SampleOptions { weights: Weights::Samples, ..SampleOptions::default() };
    let error = |mesh: &Mesh| quality::geometry_of(&sampled, &Sampled::new(mesh), &sampling).mean();
    let diagonal = quality::diagonal(source);
    let all = source.vertex_count();
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(&encoded.bytes);
    let lattice = Lattice::choose(options.quantization, &source.positions).expect("it was encoded");
    let mut worst = [0.0f64; 2];
    while let Step::Level(_) = decoder.next_level().expect("it was encoded just now") {
        let level = decoder.to_mesh();
        let share = level.vertex_count() as f64 / all as f64;
        if !(COARSEST..1.0).contains(&share) {
            continue;
        }
        let ours = error(&level);
        let fixed = quadrics.simplified(level.vertex_count(), level.face_count(), false);
        let moved = quadrics.simplified(level.vertex_count(), level.face_count(), true);
        let mut rounded = fixed.clone();
        let points = lattice.quantize(&rounded.positions).expect("they are vertices of the source");
        rounded.positions = points.into_iter().map(|q| lattice.point(q)).collect();
        let [over_fixed, over_rounded, over_moved] = [&fixed, &rounded, &moved].map(|mesh| ours / error(mesh));
        println!(
            "| {name} | {} | {:.1} % | {:.3e} | {over_fixed:.2} | {over_rounded:.2} | {over_moved:.2} |",
            level.vertex_count(),
            100.0 * share,
            ours / diagonal
        );
        worst = [worst[0].max(over_fixed), worst[1].max(over_rounded)];
    }
    worst
}

/// A mesh as `meshopt` takes it.
struct Quadrics {
    positions: Vec<[f32; 3]>,
    /// What was taken off the positions, so that `f32` holds those of national grids.
    origin: [f64; 3],
    triangles: Vec<u32>,
}

impl Quadrics {
    fn new(mesh: &Mesh) -> Self {
        let origin = mesh.bounds().map_or([0.0; 3], |(low, _)| low);
        let positions = mesh.positions.iter().map(|p| [0, 1, 2].map(|k| (p[k] - origin[k]) as f32)).collect();
        let fans = mesh.faces().flat_map(|f| (2..f.len()).flat_map(|i| [f[0], f[i - 1], f[i]]));
        Quadrics { positions, origin, triangles: fans.collect() }
    }

    /// With as many vertices as asked for or a few fewer; `faces` is a first guess.
    fn simplified(&self, vertices: usize, faces: usize, moved: bool) -> Mesh {
        let (mut low, mut high) = (0, self.triangles.len() / 3);
        let mut guess = faces.min(high);
        let mut best = Mesh::default();
        // Its count of faces is what it aims at, ours of vertices what is compared.
        for _ in 0..24 {
            let mesh = self.to_faces(guess, moved);
            if mesh.vertex_count() <= vertices {
                low = guess;
                best = mesh;
            } else {
                high = guess;
            }
            if high - low <= 1 || best.vertex_count() == vertices {
                break;
            }
            guess = low.midpoint(high);
        }
        best
    }

    fn to_faces(&self, faces: usize, moved: bool) -> Mesh {
        let mut positions = self.positions.clone();
        let mut triangles = self.triangles.clone();
        if moved {
            let left = meshopt::simplify_with_update(
                &mut triangles,
                &mut positions,
                &mut [],
                &[],
                0,
                None,
                3 * faces,
                f32::MAX,
                SimplifyOptions::None,
                None,
            );
            triangles.truncate(left);
        } else {
            let bytes: Vec<u8> = positions.iter().flatten().flat_map(|c| c.to_ne_bytes()).collect();
            let adapter = VertexDataAdapter::new(&bytes, 12, 0).expect("twelve bytes a vertex");
            triangles = meshopt::simplify(&triangles, &adapter, 3 * faces, f32::MAX, SimplifyOptions::None, None);
        }
        let positions = positions.iter().map(|p| [0, 1, 2].map(|k| f64::from(p[k]) + self.origin[k])).collect();
        let mut mesh = Mesh { positions, ..Mesh::default() };
        triangles.chunks_exact(3).for_each(|t| mesh.push_face(t));
        in_use(&mesh)
    }
}

/// A mesh without the vertices that no face names.
fn in_use(mesh: &Mesh) -> Mesh {
    let mut number = vec![u32::MAX; mesh.vertex_count()];
    let mut out = Mesh::default();
    for face in mesh.faces() {
        let face: Vec<u32> = face
            .iter()
            .map(|&v| {
                let n = &mut number[v as usize];
                if *n == u32::MAX {
                    *n = out.positions.len() as u32;
                    out.positions.push(mesh.positions[v as usize]);
                }
                *n
            })
            .collect();
        out.push_face(&face);
    }
    out
}
