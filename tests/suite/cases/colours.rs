//! The range of colours, their place on a line, and the opacity of materials.

use lodestream::io::read::Format;
use lodestream::mesh::{LayerKind, Stored};
use serde_json::{Value, json};

use super::{at_vertex, case, case_path, layer, read, read_file, warnings};
use crate::common::{Scratch, lodestream};

fn obj(lines: [&str; 3]) -> String {
    format!("v 0 0 0 {}\nv 1 0 0 {}\nv 0 1 0 {}\nf 1 2 3\n", lines[0], lines[1], lines[2])
}

#[test]
fn fractions_are_colours_of_zero_to_one() {
    for (name, format) in [("a.obj", Format::Obj), ("b.ply", Format::Ply)] {
        let m = read(case(&format!("colour-just-above-one/{name}")), format).unwrap();
        let first = at_vertex(&m, LayerKind::Color, 0);
        assert_eq!(first.iter().map(|x| (x * 1e4).round() / 1e4).collect::<Vec<_>>(), [1.0, 0.5, 0.25], "{name}");
        assert!(first.iter().all(|x| *x <= 1.0));
        assert_eq!(warnings(&m), ["1 number of `color` a little outside of 0..1 was cut off there"], "{name}");
    }
    let off = "COFF\n3 1 0\n0 0 0 1.02 .5 -.01 1\n1 0 0 .5 .5 .5 1\n0 1 0 .1 .1 .1 1\n3 0 1 2\n";
    let m = read(off, Format::Off).unwrap();
    assert_eq!(at_vertex(&m, LayerKind::Color, 0), [1.0, 0.5, 0.0, 1.0]);
    assert_eq!(warnings(&m), ["2 numbers of `color` a little outside of 0..1 were cut off there"]);
}

#[test]
fn whole_numbers_up_to_255_are_bytes_and_far_fractions_are_no_colours() {
    let m = read(obj(["255 0 0", "0 128 0", "0 0 64"]), Format::Obj).unwrap();
    assert_eq!(at_vertex(&m, LayerKind::Color, 1), [0.0, 128.0 / 255.0, 0.0]);
    assert_eq!(layer(&m, LayerKind::Color).stored, Stored::U8);
    let m = read(obj(["12.5 0.25 0", "0.5 0.5 0.5", "3.5 1 1"]), Format::Obj).unwrap();
    assert_eq!(at_vertex(&m, LayerKind::Scalar, 0), [12.5, 0.25, 0.0]);
    assert_eq!(
        warnings(&m),
        ["2 numbers of `color` far outside of 0..1: all of it is kept as numbers, not as colours"]
    );
}

#[test]
fn four_numbers_behind_a_vertex_are_a_colour_with_alpha() {
    let m = read(obj(["255 0 0 128", "0 255 0 255", "0 0 255 255"]), Format::Obj).unwrap();
    assert_eq!(at_vertex(&m, LayerKind::Color, 0), [1.0, 0.0, 0.0, 128.0 / 255.0]);
    let m = read(obj(["1 0 0 1", "0 1 0 1", "0 0 .5 1"]), Format::Obj).unwrap();
    assert_eq!(at_vertex(&m, LayerKind::Color, 2), [0.0, 0.0, 0.5, 1.0]);
    // A weight of 1 in front of the colour.
    let m = read(obj(["1 .25 0 0", "1 0 .5 0", "1 0 0 .75"]), Format::Obj).unwrap();
    assert_eq!(at_vertex(&m, LayerKind::Color, 2), [0.0, 0.0, 0.75]);
    // Colours of bytes, alpha of one.
    let m = read(obj(["200 0 0 1", "0 100 0 1", "0 0 50 1"]), Format::Obj).unwrap();
    assert_eq!(at_vertex(&m, LayerKind::Color, 0), [200.0 / 255.0, 0.0, 0.0, 1.0]);
    let m = read(obj(["1 2 3 4 5 6", "", ""]), Format::Obj).unwrap();
    assert_eq!(
        warnings(&m),
        ["further numbers behind the coordinates of vertices are not carried (1 record left out)"]
    );
}

#[test]
fn off_has_colours_without_saying_so_and_in_either_order() {
    let m = read(case("off-colours-without-c/tin.off"), Format::Off).unwrap();
    assert_eq!(at_vertex(&m, LayerKind::Color, 0), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(at_vertex(&m, LayerKind::Color, 3), [1.0, 1.0, 0.0, 1.0]);
    assert_eq!(warnings(&m), [""; 0]);
    let ncoff = |lines: &str| {
        let lines: Vec<String> = (0..3).map(|k| format!("{k} {} 0 {lines}\n", k % 2)).collect();
        read(format!("NCOFF\n3 1 0\n{}3 0 1 2\n", lines.concat()), Format::Off).unwrap()
    };
    for lines in ["10 20 30 255 0 0.6 0.8", "0 0.6 0.8 10 20 30 255"] {
        let m = ncoff(lines);
        assert_eq!(at_vertex(&m, LayerKind::Normal, 1), [0.0, 0.6, 0.8], "{lines}");
        assert_eq!(at_vertex(&m, LayerKind::Color, 1), [10.0 / 255.0, 20.0 / 255.0, 30.0 / 255.0, 1.0], "{lines}");
    }
    let m = read("OFF\n3 1 0\n0 0 0 7 8\n1 0 0 x\n0 1 0\n3 0 1 2\n", Format::Off).unwrap();
    assert_eq!(
        warnings(&m),
        ["further numbers behind the coordinates of vertices are not carried (2 records left out)"]
    );
}

/// The glTF material that a library gives the one material of a mesh.
fn material(library: &str) -> Value {
    let s = Scratch::new(&format!("mtl-{}", library.len()));
    s.write("t.png", b"\x89PNG\r\n\x1a\n");
    s.write("a.mtl", format!("newmtl m\n{library}"));
    let mesh = s.write("a.obj", "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    serde_json::from_str(&read_file(&mesh).mesh.appearance.materials[0]).unwrap()
}

#[test]
fn tr_decides_only_where_it_cannot_mean_its_opposite() {
    let m = read_file(&case_path("mtl-tr-one-is-opaque/model.obj"));
    let found: Value = serde_json::from_str(&m.mesh.appearance.materials[0]).unwrap();
    assert_eq!(found["pbrMetallicRoughness"]["baseColorFactor"], json!([1.0, 1.0, 1.0, 1.0]));
    assert_eq!(found["alphaMode"], Value::Null);
    for (library, alpha) in [
        ("Tr 1\n", 1.0),
        ("Tr 0\n", 1.0),
        ("Tr 0.75\n", 0.25),
        ("d 1\nTr 1\n", 1.0),
        ("Tr 0\nd 0.5\n", 0.5),
        ("d 0.5\nTr 0.5000\n", 0.5),
    ] {
        let m = material(library);
        assert_eq!(m["pbrMetallicRoughness"]["baseColorFactor"][3], json!(alpha), "{library}");
        assert_eq!(m["alphaMode"] == "BLEND", alpha < 1.0, "{library}");
    }
}

#[test]
fn a_black_factor_under_an_image_is_none() {
    let factor = |library: &str| material(library)["pbrMetallicRoughness"]["baseColorFactor"].clone();
    assert_eq!(factor("Kd 0 0 0\nmap_Kd t.png\n"), json!([1.0, 1.0, 1.0, 1.0]));
    assert_eq!(factor("Kd 0 0 0\n"), json!([0.0, 0.0, 0.0, 1.0]));
    assert_eq!(factor("Kd .5 0 0\nmap_Kd t.png\n#x\n"), json!([0.5, 0.0, 0.0, 1.0]));
}

#[test]
fn pictures_follow_alpha() {
    let s = Scratch::new("alpha");
    s.write("a.mtl", "newmtl seen\nKd 1 0 0\nnewmtl gone\nKd 0 0 1\nd 0\n");
    for name in ["seen", "gone"] {
        s.write(
            &format!("{name}.obj"),
            format!(
                "mtllib a.mtl\nusemtl {name}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
            ),
        );
        lodestream(s.folder(), &format!("render {name}.obj -o {name}.png --size 32")).ok();
    }
    let (seen, gone) = (std::fs::read(s.path("seen.png")).unwrap(), std::fs::read(s.path("gone.png")).unwrap());
    // One colour everywhere packs to next to nothing.
    assert!(gone.len() < seen.len(), "{} {}", gone.len(), seen.len());
}
