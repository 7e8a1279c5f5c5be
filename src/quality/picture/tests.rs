//! Pictures whose pixels are known.

use super::*;
use crate::mesh::{Appearance, Image, Layer, LayerKind, Mesh, Stored};
use crate::samples;

#[test]
fn a_sphere_is_a_bright_disc() {
    let mesh = samples::sphere(8, 0.0, 0);
    let view = View::front(&mesh);
    let picture = render(&mesh, &view, Shading::Smooth, 64, 64);
    let background = picture.pixel(0, 0);
    assert_ne!(picture.pixel(32, 32), background);
    let covered = (0..64 * 64).filter(|i| picture.pixel(i % 64, i / 64) != background).count() as f64 / (64.0 * 64.0);
    // A disc of 9/10 of the width covers 0.64 of the square.
    assert!((0.5..0.8).contains(&covered), "{covered}");
    for shading in [Shading::Flat, Shading::Wire] {
        assert_ne!(render(&mesh, &view, shading, 64, 64), picture);
    }
}

#[test]
fn edges_points_and_nothing_are_drawn_too() {
    for mesh in [samples::crumbs(40, 1), samples::point_cloud(50, 1), samples::fan_book(7, 2, 1)] {
        let picture = render(&mesh, &View::front(&mesh), Shading::Flat, 50, 40);
        let background = picture.pixel(0, 0);
        assert!((0..50 * 40).any(|i| picture.pixel(i % 50, i / 50) != background));
    }
    let empty = Mesh::default();
    render(&empty, &View::front(&empty), Shading::Flat, 8, 8);
}

#[test]
fn sheets_are_readable_png_files() {
    let tile = |n: u32| Tile { picture: Picture::new(n, n, [n as u8; 3]), caption: vec![format!("level {n}")] };
    let sheet = contact_sheet("three levels", &[tile(30), tile(60), tile(45)], 2);
    let mut bytes = Vec::new();
    sheet.write_png(&mut bytes).unwrap();
    let mut reader = png::Decoder::new(io::Cursor::new(&bytes)).read_info().unwrap();
    let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut rgb).unwrap();
    assert_eq!((info.width, info.height), (sheet.width, sheet.height));
    assert_eq!(rgb, sheet.rgb);
}

/// A unit square in the plane z = 0, seen from above, with a texture of two by two texels: red and green above, blue and white below.
fn painted(material: &str, alpha: [u8; 4]) -> Mesh {
    let mut mesh = Mesh {
        positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
        material: vec![0, 0],
        ..Mesh::default()
    };
    mesh.push_face(&[0, 1, 2]);
    mesh.push_face(&[0, 2, 3]);
    let values = mesh.positions.iter().flat_map(|p| [p[0], p[1]]).collect();
    mesh.layers.push(Layer::per_vertex("uv", LayerKind::Uv, 2, Stored::F32, values, &mesh.corners, 4));
    let texels = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]];
    let rgba: Vec<u8> = texels.iter().zip(alpha).flat_map(|(t, a)| [t[0], t[1], t[2], a]).collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 2);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header().unwrap().write_image_data(&rgba).unwrap();
    mesh.appearance = Appearance {
        materials: vec![material.into()],
        textures: vec![r#"{"source":0,"sampler":0}"#.into()],
        samplers: vec![r#"{"wrapS":33071,"wrapT":33071}"#.into()],
        images: vec![Image { name: "four.png".into(), mime: "image/png".into(), bytes, previews: Vec::new() }],
    };
    mesh.validate().unwrap();
    mesh
}

const TEXTURED: &str = r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#;

/// Seen along -z, nothing around it.
fn from_above(mesh: &Mesh) -> Picture {
    render(mesh, &View::from_angles(mesh, 0.0, 0.0), Shading::Smooth, 100, 100)
}

#[test]
fn textures_lie_the_right_way_round() {
    let picture = from_above(&painted(TEXTURED, [255; 4]));
    let [red, green, blue, white] = [[12, 12], [88, 12], [12, 88], [88, 88]].map(|[x, y]| picture.pixel(x, y));
    assert!(red[0] > 90 && red[1] < 9 && red[2] < 9, "{red:?}");
    assert!(green[1] > 90 && green[0] < 9 && blue[2] > 90 && blue[0] < 9, "{green:?} {blue:?}");
    assert!(white.iter().all(|&c| c == red[0]), "{white:?}");
    // No sample is missed along the diagonal.
    let background = picture.pixel(0, 0);
    assert!((8..92).all(|i| picture.pixel(i, i) != background && picture.pixel(i, 99 - i) != background));
    // Turned by a quarter through the material.
    let turned = TEXTURED
        .replace(r#""index":0"#, r#""index":0,"extensions":{"KHR_texture_transform":{"offset":[1,0],"scale":[-1,1]}}"#);
    let picture = from_above(&painted(&turned, [255; 4]));
    assert_eq!((picture.pixel(12, 12), picture.pixel(88, 12)), (green, red));
}

#[test]
fn alpha_cuts_holes() {
    let material = TEXTURED.replace(r#"{"pbr"#, r#"{"alphaMode":"MASK","pbr"#);
    let picture = from_above(&painted(&material, [255, 0, 255, 255]));
    assert_eq!(picture.pixel(88, 12), picture.pixel(0, 0));
    assert_ne!(picture.pixel(12, 12), picture.pixel(0, 0));
    let solid = from_above(&painted(TEXTURED, [255, 0, 255, 255]));
    assert_ne!(solid.pixel(88, 12), solid.pixel(0, 0));
}

#[test]
fn colours_and_normals_of_the_file_are_used() {
    let mut mesh = painted("{}", [255; 4]);
    mesh.layers.clear();
    let plain = from_above(&mesh).pixel(50, 50);
    assert_eq!(plain[0], plain[1]);
    let layer = |kind, width, values: Vec<f64>| {
        Layer::per_vertex("", kind, width, Stored::F32, values.repeat(4), &mesh.corners, 4)
    };
    let red = Mesh { layers: vec![layer(LayerKind::Color, 3, vec![1.0, 0.0, 0.0])], ..mesh.clone() };
    let pixel = from_above(&red).pixel(50, 50);
    assert!(pixel[0] == plain[0] && pixel[1] < 9, "{pixel:?}");
    // Towards the light, and away from it.
    let [lit, dark] = [1.0, -1.0].map(|s| {
        let tilted = Mesh { layers: vec![layer(LayerKind::Normal, 3, vec![-0.6 * s, 0.6 * s, 0.5])], ..mesh.clone() };
        from_above(&tilted).pixel(50, 50)[0]
    });
    assert!(lit > plain[0] && dark < plain[0], "{lit} {plain:?} {dark}");
}

#[test]
fn what_cannot_be_drawn_is_said() {
    let mut mesh = painted(TEXTURED, [255; 4]);
    mesh.appearance.images[0].bytes = b"GIF89a".to_vec();
    let scene = Scene::new(&mesh, Shading::Smooth);
    assert_eq!(
        scene.warnings(),
        ["four.png: neither PNG nor JPEG; other images are not drawn; its faces are drawn without it"]
    );
    assert_ne!(draw(&scene, &View::front(&mesh), 20, 20).pixel(10, 10), [38, 42, 50]);
}

#[test]
fn the_nearer_face_hides_the_other_in_any_order() {
    for flip in [false, true] {
        for field in [None, Some(50.0)] {
            let mut mesh = Mesh::default();
            let mut values = Vec::new();
            for z in if flip { [1.0, 0.0] } else { [0.0, 1.0] } {
                let first = mesh.positions.len() as u32;
                mesh.positions.extend([[-1.0, -1.0, z], [1.0, -1.0, z], [1.0, 1.0, z], [-1.0, 1.0, z]]);
                mesh.push_face(&[first, first + 1, first + 2, first + 3]);
                values.extend([[z, 1.0 - z, 0.0]; 4].concat());
            }
            mesh.layers.push(Layer::per_vertex("", LayerKind::Color, 3, Stored::U8, values, &mesh.corners, 8));
            let mut view = View::from_angles(&mesh, 0.0, 0.0);
            if let Some(field) = field {
                view = view.perspective(field);
            }
            let pixel = render(&mesh, &view, Shading::Flat, 30, 30).pixel(15, 15);
            assert!(pixel[0] > 100 && pixel[1] < 9, "{pixel:?}");
        }
    }
}

#[test]
fn a_closed_surface_shows_no_holes_and_one_thread_draws_the_same() {
    let mesh = samples::sphere(20, 0.0, 0);
    for (i, view) in [View::front(&mesh), View::around(&mesh, [0.3, -0.8, 0.5]).perspective(35.0)].iter().enumerate() {
        let picture = render(&mesh, view, Shading::Smooth, 90, 90);
        for y in 30..60 {
            for x in 30..60 {
                // The inner side has a warm tint, the background is dark.
                let [r, _, b] = picture.pixel(x, y);
                assert!(b > r && b > 60, "view {i}, {x}, {y}: {:?}", picture.pixel(x, y));
            }
        }
        #[cfg(feature = "parallel")]
        {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            assert_eq!(pool.install(|| render(&mesh, view, Shading::Smooth, 90, 90)), picture);
        }
    }
}

#[test]
fn isolated_vertices_have_their_own_colours() {
    let mut mesh = Mesh { positions: vec![[0.0; 3], [1.0, 1.0, 0.0]], ..Mesh::default() };
    let plain = from_above(&mesh);
    mesh.layers.push(Layer {
        kind: LayerKind::Color,
        width: 3,
        stored: Stored::U8,
        values: vec![0.0, 0.0, 1.0],
        isolated: vec![[0, 0]],
        ..Layer::default()
    });
    mesh.validate().unwrap();
    let coloured = from_above(&mesh);
    let changed: Vec<usize> =
        (0..100 * 100).filter(|i| plain.rgb[3 * i..][..3] != coloured.rgb[3 * i..][..3]).collect();
    assert!(!changed.is_empty() && changed.iter().all(|i| i / 100 > 50), "only the lower one: {changed:?}");
    assert!(changed.iter().any(|i| coloured.rgb[3 * i + 2] > coloured.rgb[3 * i]));
}
