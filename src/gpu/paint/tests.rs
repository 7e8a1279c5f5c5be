//! Shaders and their layout; both twins on the same scenes; windows, tiles, and a device that is lost.
//!
//! Twins may differ by rounding: see [`AT_MOST`]. On lavapipe and the scenes below they differ much less.

use proptest::prelude::*;

use super::upload::{FRAME, HAS_COLOURS, HAS_UVS, PAINT, ROW, TRIANGLE};
use super::*;
use crate::gpu::DeviceOptions;
use crate::gpu::shader::compose;
use crate::gpu::tests::{bindings, layout, test_device, validated};
use crate::mesh::{Appearance, Image, Layer, LayerKind, Mesh, NO_VALUE, Stored};
use crate::quality::picture::Shading;
use crate::samples::{self, Random};

/// Levels of 255 that rounding may move a channel: a step of light where the code of a dark one is steepest, and one more.
const LEVELS: u8 = 2;
/// Pixels of a thousand in which more may differ: samples where two surfaces meet, and those on an edge that a driver's coordinates round to
/// the other side of it.
const AT_MOST: f64 = 2.0;

fn renderer(memory: Option<u64>) -> Option<GpuRenderer> {
    let device = test_device(DeviceOptions { memory, ..DeviceOptions::default() })?;
    Some(GpuRenderer::new(device).unwrap())
}

/// Pixels of a thousand that differ by more than rounding, and the largest difference.
fn difference(a: &Picture, b: &Picture) -> (f64, u8) {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let pixels = a.rgb.as_chunks::<3>().0.iter().zip(b.rgb.as_chunks::<3>().0);
    let far: Vec<u8> = pixels.map(|(a, b)| (0..3).map(|k| a[k].abs_diff(b[k])).max().unwrap()).collect();
    let beyond = far.iter().filter(|&&d| d > LEVELS).count();
    (1000.0 * beyond as f64 / far.len() as f64, far.into_iter().max().unwrap())
}

/// Draw by both twins; fail unless they agree.
fn agree(gpu: &GpuRenderer, what: &str, scene: &Scene, views: &[View], [width, height]: [u32; 2]) {
    let pictures = Mutex::new(Vec::new());
    gpu.draw_each(scene, views, width, height, &|i, picture| pictures.lock().unwrap().push((i, picture)));
    assert_eq!(gpu.failure(), None, "{what}");
    let pictures = pictures.into_inner().unwrap();
    assert_eq!(pictures.len(), views.len());
    for (i, picture) in pictures {
        let expected = Cpu.draw(scene, &views[i], width, height);
        let (beyond, worst) = difference(&picture, &expected);
        println!("{what}, view {i}: {beyond:.2} of a thousand pixels differ, the most by {worst}");
        assert!(beyond <= AT_MOST, "{what}, view {i}: {beyond} of a thousand pixels differ, the most by {worst}");
    }
}

fn sides(mesh: &Mesh) -> Vec<View> {
    vec![
        View::front(mesh),
        View::around(mesh, [0.3, -0.8, 0.5]).perspective(30.0),
        View::around(mesh, [-0.5, 0.2, -0.9]).perspective(90.0),
    ]
}

#[test]
fn shaders_are_valid_and_laid_out_as_rust_assumes() {
    let named = |words: &[(&str, u32)]| words.iter().map(|(n, w)| (n.to_string(), 4 * w)).collect::<Vec<_>>();
    for name in ["raster.wgsl", "shade.wgsl"] {
        let module = validated(name);
        let frame = [
            ("left", 0),
            ("top", 1),
            ("width", 2),
            ("height", 3),
            ("first", 4),
            ("count", 5),
            ("triangles", 6),
            ("pad0", 7),
            ("lamp", 8),
        ];
        assert_eq!(layout(&module, "Frame"), (named(&frame), 4 * FRAME as u32));
        assert_eq!(layout(&module, "Seen"), (named(&[("x", 0), ("y", 1), ("z", 2), ("near", 3)]), 16));
        let triangle = [("a", 0), ("b", 1), ("c", 2), ("paint", 3), ("normals", 4), ("uvs", 13), ("texels", 19)];
        assert_eq!(layout(&module, "Triangle"), (named(&triangle), 4 * TRIANGLE as u32));
        let paint = [
            ("factor", 0),
            ("cutoff", 4),
            ("plain", 5),
            ("wraps", 6),
            ("levels", 7),
            ("width", 8),
            ("height", 9),
            ("row", 10),
            ("pad0", 11),
        ];
        assert_eq!(layout(&module, "Paint"), (named(&paint), 4 * PAINT as u32));
        let list = bindings(&module);
        let strides: Vec<(&str, u32)> = list.iter().map(|(_, n, s)| (n.as_str(), *s)).collect();
        for expected in [
            ("frame", 0),
            ("seen", 16),
            ("triangles", 4 * TRIANGLE as u32),
            ("colours", 4),
            ("paints", 4 * PAINT as u32),
        ] {
            assert!(strides.contains(&expected), "{name}: {strides:?}");
        }
    }
    let module = validated("raster.wgsl");
    assert_eq!(layout(&module, "Plot"), (named(&[("place", 0), ("z", 1), ("id", 2)]), 12));
    let module = validated("finish.wgsl");
    let tile = named(&[("width", 0), ("height", 1), ("triangles", 2), ("pad0", 3)]);
    assert_eq!(layout(&module, "Tile"), (tile, 16));
    let list = bindings(&module);
    let names: Vec<(u32, &str, u32)> = list.iter().map(|(i, n, s)| (*i, n.as_str(), *s)).collect();
    let expected =
        [(0, "tile", 0), (1, "ids", 0), (2, "light", 16), (3, "others", 16), (4, "codes", 4), (5, "pixels", 4)];
    assert_eq!(names, expected);
    for name in ["shade.wgsl", "finish.wgsl"] {
        assert_eq!(validated(name).entry_points[0].workgroup_size, [pipelines::GROUP, pipelines::GROUP, 1]);
    }
    let text = compose("raster.wgsl") + &compose("finish.wgsl");
    for line in [
        format!("const HAS_UVS: u32 = {HAS_UVS:#010x}u;"),
        format!("const HAS_COLOURS: u32 = {HAS_COLOURS:#010x}u;"),
        format!("const ROW: u32 = {ROW}u;"),
        format!("const EMPTY: u32 = {:#x}u;", crate::quality::picture::screen::EMPTY),
        format!("const DANGLING: u32 = {:#x}u;", crate::quality::picture::screen::DANGLING),
        format!("const CODES: f32 = {}.0;", crate::quality::picture::screen::CODES),
        format!("const PARTS: i32 = {};", crate::quality::picture::screen::PARTS),
    ] {
        assert!(text.lines().any(|l| l == line), "{line}");
    }
}

#[test]
fn twins_draw_the_same_shapes() {
    let Some(gpu) = renderer(None) else { return };
    for name in samples::NAMES {
        let mesh = samples::by_name(name, 900, 3).unwrap();
        for shading in [Shading::Smooth, Shading::Flat, Shading::Wire] {
            agree(&gpu, &format!("{name} {shading:?}"), &Scene::new(&mesh, shading), &sides(&mesh), [120, 90]);
        }
    }
    let empty = Mesh::default();
    agree(&gpu, "nothing", &Scene::new(&empty, Shading::Smooth), &[View::front(&empty)], [9, 7]);
    // Coordinates that single precision cannot tell apart.
    let mut far = samples::asteroid(12, 3);
    far.positions.iter_mut().for_each(|p| *p = [p[0] + 4.5e6, p[1] + 5.5e6, p[2]]);
    agree(&gpu, "far", &Scene::new(&far, Shading::Flat), &sides(&far), [100, 100]);
}

#[test]
fn triangles_in_each_other_show_the_first() {
    let Some(gpu) = renderer(None) else { return };
    let mut mesh = samples::asteroid(9, 5);
    let faces: Vec<Vec<u32>> = mesh.faces().map(<[u32]>::to_vec).collect();
    let count = mesh.positions.len() as u32;
    mesh.positions.extend_from_within(..);
    // Turned round, begun elsewhere, with vertices of their own.
    faces.iter().for_each(|f| mesh.push_face(&[f[2], f[1], f[0]]));
    faces.iter().for_each(|f| mesh.push_face(&[f[1] + count, f[2] + count, f[0] + count]));
    mesh.validate().unwrap();
    agree(&gpu, "three times", &Scene::new(&mesh, Shading::Flat), &sides(&mesh), [150, 150]);
}

/// An image of noise with holes in it.
fn noise(random: &mut Random, width: u32, height: u32) -> Image {
    let rgba: Vec<u8> = (0..width * height)
        .flat_map(|_| {
            let [r, g, b, a, ..] = random.bits().to_le_bytes();
            [r, g, b, if a < 60 { 0 } else { 255 }]
        })
        .collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header().unwrap().write_image_data(&rgba).unwrap();
    Image { name: "noise.png".into(), mime: "image/png".into(), bytes, previews: Vec::new() }
}

/// Triangles and quads anywhere, with all that a face can have, or not.
fn random_mesh(seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let count = 12 + random.below(60);
    let mut mesh = Mesh { positions: (0..count).map(|_| random.point()).collect(), ..Mesh::default() };
    let faces = 6 + random.below(50);
    for _ in 0..faces {
        let mut face: Vec<u32> = Vec::new();
        let corners = [1, 2, 3, 3, 3, 4, 5][random.below(7) as usize];
        while face.len() < corners {
            let v = random.below(count - 4);
            if !face.contains(&v) {
                face.push(v);
            }
        }
        if face.len() > 1 {
            mesh.push_face(&face);
        }
    }
    let mut layer = |kind, width: u8, scale: f64, lowest: f64| {
        let values = (0..40 * u32::from(width)).map(|_| lowest + scale * random.unit()).collect();
        let mut corners = Vec::new();
        for face in mesh.faces() {
            let bare = random.below(12) == 0;
            corners.extend(face.iter().map(|_| if bare { NO_VALUE } else { random.below(40) }));
        }
        Layer { kind, width, stored: Stored::F32, values, corners, ..Layer::default() }
    };
    let all = [
        layer(LayerKind::Normal, 3, 2.0, -1.0),
        layer(LayerKind::Color, 4, 1.0, 0.0),
        layer(LayerKind::Uv, 2, 4.0, -2.0),
        layer(LayerKind::Uv, 2, 0.2, 0.0),
    ];
    mesh.layers = all.into_iter().filter(|_| random.below(4) > 0).collect();
    let materials = [
        r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}},"alphaMode":"MASK"}"#,
        r#"{"pbrMetallicRoughness":{"baseColorFactor":[0.9,0.5,1,0.4],"baseColorTexture":{"index":1,"texCoord":1}}}"#,
        r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":2,
            "extensions":{"KHR_texture_transform":{"offset":[0.3,0.1],"scale":[2,-3],"rotation":0.5}}}}}"#,
        r#"{"pbrMetallicRoughness":{"baseColorFactor":[0.2,0.7,0.1,1]},"alphaMode":"BLEND"}"#,
        r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":2}},"alphaMode":"BLEND"}"#,
    ];
    mesh.material = (0..mesh.face_count())
        .map(|_| if random.below(6) == 0 { NO_VALUE } else { random.below(materials.len() as u32) })
        .collect();
    mesh.appearance = Appearance {
        materials: materials.map(str::to_string).to_vec(),
        textures: (0..3).map(|i| format!(r#"{{"source":{i},"sampler":{i}}}"#)).collect(),
        samplers: [(10497, 10497), (33071, 33648), (33648, 10497)]
            .map(|(s, t)| format!(r#"{{"wrapS":{s},"wrapT":{t}}}"#))
            .to_vec(),
        images: vec![noise(&mut random, 37, 20), noise(&mut random, 256, 128), noise(&mut random, 1, 9)],
    };
    mesh.validate().unwrap();
    mesh
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

    #[test]
    fn twins_draw_the_same_soups(seed in any::<u64>(), direction in prop::array::uniform3(-1.0f64..1.0), field in 10.0f64..120.0) {
        let Some(gpu) = shared() else { return Ok(()) };
        let mesh = random_mesh(seed);
        let view = View::around(&mesh, direction);
        for shading in [Shading::Smooth, Shading::Wire] {
            agree(gpu, "soup", &Scene::new(&mesh, shading), &[view, view.perspective(field)], [128, 80]);
        }
    }
}

/// One renderer for many cases.
fn shared() -> Option<&'static GpuRenderer> {
    static GPU: std::sync::OnceLock<Option<GpuRenderer>> = std::sync::OnceLock::new();
    GPU.get_or_init(|| renderer(None)).as_ref()
}

#[test]
fn windows_and_tiles_make_the_same_picture() {
    // Two windows stay on the device, others take turns; the picture is drawn in tiles of 64 pixels.
    let Some(gpu) = renderer(Some(1 << 20)) else { return };
    let mut mesh = samples::by_name("mixed", 6000, 3).unwrap();
    let extra = samples::by_name("crumbs", 300, 3).unwrap();
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(extra.positions.iter());
    extra.faces().for_each(|f| mesh.push_face(&f.iter().map(|v| v + first).collect::<Vec<u32>>()));
    let scene = Scene::new(&mesh, Shading::Wire);
    assert!(scene.triangles() > 6000);
    agree(&gpu, "windows", &scene, &sides(&mesh), [150, 100]);
    agree(&gpu, "soup", &Scene::new(&random_mesh(8), Shading::Smooth), &sides(&random_mesh(8)), [200, 90]);
}

#[test]
fn what_does_not_fit_is_drawn_by_the_processor() {
    let Some(gpu) = renderer(Some(1 << 20)) else { return };
    let mut mesh = random_mesh(5);
    mesh.appearance.images[0] = noise(&mut Random::new(1), 300, 300);
    let scene = Scene::new(&mesh, Shading::Smooth);
    let view = View::front(&mesh);
    assert!(gpu.draw(&scene, &view, 40, 30) == Cpu.draw(&scene, &view, 40, 30));
    let says = gpu.failure().unwrap().to_string();
    assert!(says.contains("the device is too small: the memory for images, in bytes, is 524288, "), "{says}");
    assert_eq!(gpu.name(), "cpu");
}

#[test]
fn a_lost_device_leaves_the_rest_to_the_processor() {
    for lost in [0, 3, 8, 11] {
        let Some(mut gpu) = renderer(None) else { return };
        gpu.lose_after(lost);
        let mesh = samples::asteroid(6, 1);
        let scene = Scene::new(&mesh, Shading::Smooth);
        let views: Vec<View> = (0..12).map(|i| View::from_angles(&mesh, f64::from(i), 0.3)).collect();
        let drawn = Mutex::new(vec![0; views.len()]);
        gpu.draw_each(&scene, &views, 50, 40, &|i, picture| {
            let (beyond, _) = difference(&picture, &Cpu.draw(&scene, &views[i], 50, 40));
            assert!(beyond <= AT_MOST, "{i}");
            drawn.lock().unwrap()[i] += 1;
        });
        assert_eq!(drawn.into_inner().unwrap(), [1; 12], "each once, lost after {lost}");
        assert!(gpu.failure().unwrap().to_string().ends_with("the device was lost: LODESTREAM_LOSE_DEVICE says so"));
        assert_eq!(gpu.name(), "cpu");
    }
}
