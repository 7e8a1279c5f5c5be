//! What the header says of each level's error is true: no point measured is farther than the bound, and the bound is not
//! idle talk.

use crate::common::datasets;
use crate::common::distance::{Surface, symmetric};
use lodestream::encode::{EncodeOptions, encode};
use lodestream::format::container::Header;
use lodestream::format::decoder::{DecodeOptions, Decoder, Step};
use lodestream::mesh::Mesh;
use lodestream::mesh::lattice::{Lattice, Quantization};
use lodestream::samples;

/// What was measured at one level.
struct Row {
    vertices: usize,
    bound: f64,
    found: f64,
}

/// Every `stride`-th level, and the two finest, against the input: no sample may be above the bound.
fn measure(name: &str, mesh: &Mesh, options: &EncodeOptions, stride: u32) -> Vec<Row> {
    let bytes = encode(mesh, options).unwrap_or_else(|e| panic!("{name}: {e}")).bytes;
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(&bytes);
    let header: Header = decoder.index().unwrap().unwrap().header().clone();
    let input = Surface::new(mesh);
    let extent = mesh.positions.iter().flatten().fold(0.0f64, |m, c| m.max(c.abs()));
    let mut rows = Vec::new();
    while let Step::Level(level) = decoder.next_level().unwrap() {
        if level % stride != 0 && level + 2 <= header.full_level() {
            continue;
        }
        let shown = decoder.to_mesh();
        let found = symmetric(&Surface::new(&shown), &input, (2 * input.triangles.len()).clamp(2000, 20_000));
        let bound = header.error(level).unwrap();
        rows.push(Row { vertices: shown.vertex_count(), bound, found });
        if std::env::var_os("LEVELS_TABLE").is_some() {
            let step = header.lattice.step;
            let shift = header.levels[level as usize].shift;
            println!(
                "{name}: level {level} shift {shift} {:7} v  bound {:9.3}  found {:9.3} steps  ratio {:.2}",
                shown.vertex_count(),
                bound / step,
                found / step,
                bound / found
            );
        }
        assert!(
            found <= bound + 1e-12 * extent,
            "{name}, level {level} of {}: found {found}, above the bound {bound} ({} and {} steps)",
            header.full_level(),
            found / header.lattice.step,
            bound / header.lattice.step
        );
    }
    let full = rows.last().map_or(0.0, |r| r.bound);
    assert!(full <= 0.9 * header.lattice.step, "{name}: the full level states {full}");
    rows
}

fn bits(b: u8) -> EncodeOptions {
    EncodeOptions::default().quantization(Quantization::Bits(b))
}

#[test]
fn no_level_of_a_generated_mesh_is_farther_than_stated() {
    for name in samples::NAMES {
        for (size, b, stride) in [(40, 5, 1), (200, 10, 2), (1500, 12, 5)] {
            // Everything meets everything there, which no grid makes fast.
            let tangled = name == "soup" || name == "fan-book";
            if size <= 200 || !tangled {
                let mesh = samples::by_name(name, size, u64::from(b)).unwrap();
                measure(name, &mesh, &bits(b), stride);
            }
        }
    }
    for seed in 0..40 {
        measure("a small soup", &samples::soup(12, 10, seed), &bits(6 + (seed % 6) as u8), 1);
    }
}

/// Data files by name: no level may break its bound; `loose` is how many times the measured distance it may be at levels of
/// at least 100 vertices.
fn real(name: &str, stride: u32, loose: f64) {
    let dataset = datasets::named(name);
    if !dataset.is_available() {
        return datasets::report_missing(&[dataset]);
    }
    let mesh = dataset.load(None).unwrap();
    for row in measure(name, &mesh, &bits(12), stride) {
        let ratio = row.bound / row.found;
        assert!(
            ratio <= loose || row.vertices < 100,
            "{name}: at {} vertices the bound is {ratio:.1} times the distance found",
            row.vertices
        );
    }
}

#[test]
fn bimba_original() {
    real("classic/bimba_original", 4, 10.0);
}

#[test]
fn rocker_arm() {
    real("classic/rocker-arm", 4, 10.0);
}

#[test]
fn camelhead() {
    real("classic/camelhead", 4, 10.0);
}

#[test]
fn hippo() {
    real("classic/hippo", 6, 10.0);
}

#[test]
fn fertility_quad() {
    real("polygon/fertility_quad", 4, 10.0);
}

#[test]
fn bunny_poly() {
    real("polygon/bunny_poly", 4, f64::INFINITY);
}

#[test]
fn office_chair() {
    real("bad/office_chair", 4, f64::INFINITY);
}

#[test]
fn truck() {
    real("bad/truck", 4, f64::INFINITY);
}

/// A strip of a bumpy sheet, cut by hand: columns `from..=to` of a grid, so that neighbours share a column of points.
fn tile(from: u32, to: u32, rows: u32) -> Mesh {
    let mut random = samples::Random::new(5);
    let heights: Vec<f64> = (0..101 * 101).map(|_| 0.6 * random.unit()).collect();
    let mut mesh = Mesh::default();
    for x in from..=to {
        for y in 0..=rows {
            mesh.positions.push([f64::from(x), f64::from(y), heights[(x * 101 + y) as usize]]);
        }
    }
    let at = |x: u32, y: u32| (x - from) * (rows + 1) + y;
    for x in from..to {
        for y in 0..rows {
            mesh.push_face(&[at(x, y), at(x + 1, y), at(x + 1, y + 1)]);
            mesh.push_face(&[at(x, y), at(x + 1, y + 1), at(x, y + 1)]);
        }
    }
    mesh
}

/// At each level the lattice points for which `on_border` holds.
fn borders(mesh: &Mesh, options: &EncodeOptions, on_border: impl Fn([f64; 3]) -> bool) -> Vec<Vec<[u64; 3]>> {
    let bytes = encode(mesh, options).unwrap().bytes;
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(&bytes);
    let mut levels = Vec::new();
    while let Step::Level(_) = decoder.next_level().unwrap() {
        let points = decoder.positions().into_iter().filter(|&p| on_border(p)).map(|p| p.map(f64::to_bits));
        let mut points: Vec<_> = points.collect();
        points.sort_unstable();
        levels.push(points);
    }
    levels
}

#[test]
fn tiles_with_locked_borders_fit_at_every_level() {
    let step = 1.0 / 256.0;
    let options = EncodeOptions::default()
        .quantization(Quantization::Step { step, origin: Some([0.0, 0.0, 0.0]) })
        .lock_borders(true);
    let shared = |p: [f64; 3]| p[0] == 30.0;
    let left = borders(&tile(0, 30, 40), &options, shared);
    let right = borders(&tile(30, 70, 40), &options, shared);
    assert!(left.len() > 5 && right.len() > 5, "{} and {} levels", left.len(), right.len());
    assert_eq!(left[0].len(), 41);
    for (l, points) in left.iter().chain(&right).enumerate() {
        assert_eq!(*points, left[0], "the {l}th level of the two tiles");
    }
}

#[test]
fn locked_borders_stay_where_they_are() {
    let mesh = samples::cylinder(30, 40, 30, 3);
    let mut edges = std::collections::HashMap::new();
    for f in mesh.faces() {
        for i in 0..f.len() {
            let (a, b) = (f[i], f[(i + 1) % f.len()]);
            *edges.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
        }
    }
    let mut border: Vec<u32> = edges.iter().filter(|e| *e.1 == 1).flat_map(|e| *e.0).collect();
    border.sort_unstable();
    border.dedup();
    let options = bits(14).lock_borders(true);
    let lattice = Lattice::choose(options.quantization, &mesh.positions).unwrap();
    let points = lattice.quantize(&mesh.positions).unwrap();
    let bits = |v: &u32| lattice.point(points[*v as usize]).map(f64::to_bits);
    let wanted: std::collections::HashSet<_> = border.iter().map(bits).collect();
    assert!(wanted.len() > 100);
    let levels = borders(&mesh, &options, |p| wanted.contains(&p.map(f64::to_bits)));
    assert!(levels.len() > 5);
    for points in levels {
        assert!(points.len() >= wanted.len(), "a vertex of the border has moved");
    }
}
