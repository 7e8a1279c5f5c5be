//! Round trips of attributes: random wedges on random complexes, charts on smooth surfaces, materials, values of degenerate faces and
//! of isolated vertices. Compared through the vertex map, by integers, apart from the codec.

use lodestream::encode::{EncodeOptions, encode};
use lodestream::format::decoder::{DecodeOptions, Decoder, Step};
use lodestream::mesh::{Appearance, Image, Layer, LayerKind, Mesh, NO_VALUE, Stored};
use lodestream::samples;
use proptest::prelude::*;

/// All that a file tells of a mesh, in a form that does not depend on its numbering: faces with the values at their corners and
/// their material, and values of isolated vertices.
type Face = (u32, Vec<(u32, Vec<Option<Vec<i64>>>)>);

fn integers(layer: &Layer, like: &lodestream::format::container::LayerHeader, i: u32) -> Option<Vec<i64>> {
    (i != NO_VALUE).then(|| like.quantizer.quantize(like.kind, layer.value(i)).iter().map(|&x| x as i64).collect())
}

fn told(
    mesh: &Mesh,
    layers: &[lodestream::format::container::LayerHeader],
    map: &dyn Fn(u32) -> u32,
) -> (Vec<Face>, Vec<Face>) {
    let mut faces: Vec<Face> = Vec::new();
    for f in 0..mesh.face_count() {
        let range = mesh.face_start[f] as usize..mesh.face_start[f + 1] as usize;
        let corners: Vec<_> = range
            .map(|c| {
                let values = mesh.layers.iter().zip(layers).map(|(l, h)| integers(l, h, l.corners[c])).collect();
                (map(mesh.corners[c]), values)
            })
            .collect();
        let least = (0..corners.len()).map(|r| [&corners[r..], &corners[..r]].concat()).min().unwrap();
        faces.push((mesh.material.get(f).copied().unwrap_or(NO_VALUE), least));
    }
    faces.sort();
    let mut extra: Vec<Face> = Vec::new();
    for (l, layer) in mesh.layers.iter().enumerate() {
        for &[v, i] in &layer.isolated {
            extra.push((l as u32, vec![(map(v), vec![integers(layer, &layers[l], i)])]));
        }
    }
    extra.sort();
    (faces, extra)
}

fn check(mesh: &Mesh, options: &EncodeOptions) -> Result<f64, TestCaseError> {
    prop_assert_eq!(mesh.validate(), Ok(()));
    let encoded = encode(mesh, options).map_err(|e| TestCaseError::fail(e.to_string()))?;
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(&encoded.bytes);
    loop {
        match decoder.next_level() {
            Ok(Step::Level(_)) => {
                let level = decoder.to_mesh();
                prop_assert_eq!(level.validate(), Ok(()));
            }
            Ok(Step::Full) => break,
            other => prop_assert!(false, "{other:?}"),
        }
    }
    prop_assert!(decoder.finish().is_ok());
    let layers = decoder.index().unwrap().unwrap().header().attributes.layers.clone();
    let back = decoder.to_mesh();
    let (faces, extra) = told(&back, &layers, &|v| v);
    let (wanted, wanted_lone) = told(mesh, &layers, &|v| encoded.map[v as usize]);
    prop_assert_eq!(faces.len(), wanted.len());
    for (a, b) in faces.iter().zip(&wanted) {
        prop_assert_eq!(a, b);
    }
    prop_assert_eq!(extra, wanted_lone);
    prop_assert_eq!(&back.appearance, &mesh.appearance);
    for (a, b) in back.layers.iter().zip(&mesh.layers) {
        prop_assert_eq!((&a.name, a.kind, a.width, a.stored), (&b.name, b.kind, b.width, b.stored));
    }
    Ok(encoded.report.bits.attributes)
}

/// A layer whose corners choose among few values, so that some agree and some do not.
fn random_layer(mesh: &Mesh, kind: LayerKind, width: u8, palette: u32, seed: u64) -> Layer {
    let mut x = seed.wrapping_mul(2).wrapping_add(1);
    let mut next = move |n: u32| {
        x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((x >> 33) % n as u64) as u32
    };
    let mut layer = Layer { name: format!("l{seed}"), kind, width, stored: Stored::F32, ..Layer::default() };
    layer.values = (0..palette * width as u32).map(|_| next(2001) as f64 / 1000.0 - 1.0).collect();
    if kind == LayerKind::Color {
        layer.values.iter_mut().for_each(|v| *v = (*v * 0.5 + 0.5).clamp(0.0, 1.0));
    }
    for f in 0..mesh.face_count() {
        let none = next(5) == 0;
        let same = next(3) == 0;
        let one = next(palette);
        for _ in mesh.face(f) {
            layer.corners.push(if none {
                NO_VALUE
            } else if same {
                one
            } else {
                next(palette)
            });
        }
    }
    let mut used = vec![false; mesh.positions.len()];
    mesh.corners.iter().for_each(|&v| used[v as usize] = true);
    for v in 0..used.len() as u32 {
        if !used[v as usize] && next(2) == 0 {
            layer.isolated.push([v, next(palette)]);
        }
    }
    layer
}

fn materials(mesh: &mut Mesh, count: u32, seed: u64) {
    let pick = random_layer(mesh, LayerKind::Scalar, 1, count.max(1), seed);
    mesh.material = (0..mesh.face_count()).map(|f| pick.corners[mesh.face_start[f] as usize]).collect();
    mesh.appearance = Appearance {
        materials: (0..count.max(1)).map(|i| format!("{{\"name\":\"m{i}\"}}")).collect(),
        textures: vec!["{\"source\":0}".into()],
        samplers: vec![],
        images: vec![Image {
            name: "a b.png".into(),
            mime: "image/png".into(),
            bytes: vec![1, 2, 3, 0, 255],
            previews: Vec::new(),
        }],
    };
}

fn soup() -> impl Strategy<Value = Mesh> {
    (1..40usize, 0..60usize).prop_flat_map(|(n, faces)| {
        let face = prop::collection::vec(0..n as u32, 2..6);
        let position = prop::array::uniform3(-20f64..20.0);
        (prop::collection::vec(position, n), prop::collection::vec(face, faces)).prop_map(|(positions, faces)| {
            let mut mesh = Mesh { positions, ..Mesh::default() };
            for f in faces {
                mesh.push_face(&f);
            }
            mesh
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_wedges_on_random_complexes_come_back(mesh in soup(), palette in 1u32..9, layers in 0usize..4, seed in any::<u64>(), count in 0u32..4) {
        let mut mesh = mesh;
        for l in 0..layers {
            let kinds = [(LayerKind::Uv, 2), (LayerKind::Scalar, 1), (LayerKind::Color, 4), (LayerKind::Normal, 3)];
            let (kind, width) = kinds[l];
            let layer = random_layer(&mesh, kind, width, palette, seed.wrapping_add(l as u64));
            mesh.layers.push(layer);
        }
        if count > 0 {
            materials(&mut mesh, count, seed);
        }
        check(&mesh, &EncodeOptions::default())?;
    }

    #[test]
    fn random_wedges_on_surfaces_come_back(size in 8u32..200, which in 0usize..5, palette in 1u32..5, seed in any::<u64>()) {
        let name = ["sphere", "torus", "cylinder", "mixed", "terrain"][which];
        let Some(mut mesh) = samples::by_name(name, size, seed) else { return Ok(()) };
        let layer = random_layer(&mesh, LayerKind::Uv, 2, palette, seed);
        mesh.layers.push(layer);
        materials(&mut mesh, 2, seed);
        check(&mesh, &EncodeOptions::default())?;
    }
}

/// Texture coordinates from positions, in charts cut by a function of the face.
fn charts(mesh: &Mesh, chart: &dyn Fn([f64; 3]) -> u32) -> Layer {
    let mut layer = Layer { name: "uv".into(), kind: LayerKind::Uv, width: 2, ..Layer::default() };
    for f in 0..mesh.face_count() {
        let names = mesh.face(f);
        let centre: [f64; 3] = std::array::from_fn(|k| {
            names.iter().map(|&v| mesh.positions[v as usize][k]).sum::<f64>() / names.len() as f64
        });
        let c = chart(centre);
        for &v in names {
            let p = mesh.positions[v as usize];
            let uv = match c % 3 {
                0 => [p[0], p[1]],
                1 => [p[1] + 3.0, p[2]],
                _ => [p[2], p[0] + 5.0],
            };
            layer.corners.push((layer.values.len() / 2) as u32);
            layer.values.extend_from_slice(&uv);
        }
    }
    layer
}

#[test]
fn charts_on_a_sphere_come_back_and_cost_little() {
    let plain = samples::sphere(22, 0.0, 1);
    let vertices = plain.positions.len() as f64;
    let mut one = plain.clone();
    one.layers.push(charts(&plain, &|_| 0));
    let smooth = check(&one, &EncodeOptions::default()).unwrap() / vertices;
    let mut many = plain.clone();
    many.layers.push(charts(&plain, &|p| {
        let a = p.map(f64::abs);
        if a[0] > a[1] && a[0] > a[2] {
            1
        } else if a[1] > a[2] {
            2
        } else {
            0
        }
    }));
    let seamed = check(&many, &EncodeOptions::default()).unwrap() / vertices;
    let mut still = plain.clone();
    still.layers.push(Layer::per_vertex(
        "uv",
        LayerKind::Uv,
        2,
        Stored::F32,
        vec![0.25; 2 * plain.positions.len()],
        &plain.corners,
        plain.positions.len(),
    ));
    let constant = check(&still, &EncodeOptions::default()).unwrap() / vertices;
    eprintln!("bits per vertex: smooth {smooth:.3}, seamed {seamed:.3}, constant {constant:.4}");
    assert!(smooth < 8.0, "{smooth}");
    assert!(seamed < smooth + 3.0, "{seamed}");
    assert!(constant < 0.05, "{constant}");
}

/// Textured and coloured meshes of the data folder, with the least number of layers that their readers find.
#[cfg(feature = "formats")]
const REAL: [(&str, usize); 18] = [
    ("textured/Avocado/Avocado.gltf", 3),
    ("textured/CesiumMilkTruck.glb", 2),
    ("textured/DamagedHelmet.glb", 2),
    ("textured/Duck.glb", 2),
    ("textured/Fox.glb", 1),
    ("textured/IridescenceAbalone/IridescenceAbalone.gltf", 2),
    ("textured/SciFiHelmet/SciFiHelmet.gltf", 3),
    ("textured/WaterBottle/WaterBottle.gltf", 3),
    ("textured/YcbBanana/textured_simple_reoriented.obj", 2),
    ("textured/bunny10k/bunny10k_textured.obj", 1),
    ("textured/egyptian_cat.glb", 3),
    ("textured/knot/texturedknot.obj", 1),
    ("textured/knot/texturedknot.ply", 1),
    ("textured/openmvs_scene_mesh_texture.ply", 1),
    ("textured/spot/spot.obj", 2),
    ("colour/colored_airplane.ply", 2),
    ("colour/greySnapper_vertColor.glb", 4),
    ("colour/rgb_nefertiti.off", 1),
];

#[cfg(feature = "formats")]
#[test]
fn real_attributes_come_back() {
    let Some(folder) = std::env::var_os("LODESTREAM_DATA").map(std::path::PathBuf::from) else {
        eprintln!("skipped: {} meshes, because LODESTREAM_DATA names no folder", REAL.len());
        return;
    };
    for (name, layers) in REAL {
        let read = lodestream::io::read::read_path(folder.join(name), &Default::default()).unwrap();
        assert_eq!(read.mesh.layers.len(), layers, "{name}");
        // Images too, byte by byte.
        let options = EncodeOptions::default().images(lodestream::image::jpeg::Exactness::Bytes);
        check(&read.mesh, &options).unwrap_or_else(|e| panic!("{name}: {e}"));
    }
}
