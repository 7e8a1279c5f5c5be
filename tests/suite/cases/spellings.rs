//! Spellings that programs use and books do not have.

use std::io::Write as _;

use lodestream::io::read::Format;
use lodestream::mesh::{LayerKind, NO_VALUE};
use serde_json::json;

use super::{case, faces, layer, read, warnings};

const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

#[test]
fn keywords_of_off() {
    let body = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n";
    for head in ["OFF4 4 0\n", "OFF 4 4 6\n", "4 4 6\n", "# made by hand\n4 4\n", "off\n4 4 0\n"] {
        let m = read(format!("{head}{body}"), Format::Off).unwrap();
        assert_eq!(faces(&m), TETRAHEDRON, "{head}");
    }
    assert_eq!(faces(&read(case("off-keyword-glued/chair.off"), Format::Off).unwrap()), TETRAHEDRON);
    let m = read(
        "CSTOFF\n3 1 0\n0 0 0 255 0 0 255 .5 .25\n1 0 0 0 0 0 255 1 1\n0 1 0 0 0 0 255 0 0\n3 0 1 2\n",
        Format::Off,
    );
    let m = m.unwrap();
    assert_eq!(layer(&m, LayerKind::Uv).value(0), [0.5, 0.25]);
    assert_eq!(layer(&m, LayerKind::Color).value(0), [1.0, 0.0, 0.0, 1.0]);
}

#[test]
fn keywords_of_stl_in_two_words_and_names_of_solids() {
    let text = "solid left leg\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nend loop\n\
                end facet\nEnd Solid left leg\nsolid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0 1 0\n\
                vertex 0 0 1\nendloop\nendfacet\nendsolid\n";
    let m = read(text, Format::Stl).unwrap();
    assert_eq!(faces(&m), [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(warnings(&m), ["names of solids are not carried (1 record left out)"]);
}

#[test]
fn numbers_that_are_none() {
    let m = read(case("obj-vn-nan-ind/mesh.obj"), Format::Obj).unwrap();
    let normals = layer(&m, LayerKind::Normal);
    assert_eq!(normals.corners[..3].iter().map(|&i| normals.value(i)).collect::<Vec<_>>(), [[0.0, 0.0, -1.0]; 3]);
    assert_eq!(normals.corners[6..9], [NO_VALUE; 3]);
    for spelling in ["nan", "-nan(ind)", "1.#QNAN", "-1.#IND", "nan(snan)", "1.#INF"] {
        let m = read(
            format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 {spelling}\nvt 1 1\nf 1/1 2/1 3/1\nf 3/2 2/2 1/2\n"),
            Format::Obj,
        );
        let uvs = m.unwrap().mesh.layers[0].clone();
        assert_eq!(uvs.corners[..3], [NO_VALUE; 3], "{spelling}");
        assert_eq!(uvs.value(uvs.corners[3]), [1.0, 1.0], "{spelling}");
    }
}

#[test]
fn ends_of_edges_have_many_names() {
    let m = read(case("ply-edge-v0-v1/mesh.ply"), Format::Ply).unwrap();
    assert_eq!((faces(&m).len(), warnings(&m)), (10, Vec::new()));
    assert_eq!(faces(&m)[4..], [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]);
    let unknown = String::from_utf8(case("ply-edge-v0-v1/mesh.ply")).unwrap();
    let unknown = unknown.replace("int v0", "int weight").replace("int v1", "int kind");
    let m = read(unknown, Format::Ply).unwrap();
    assert_eq!((faces(&m).len(), warnings(&m)), (4, vec!["6 PLY elements `edge` skipped".to_string()]));
}

#[test]
fn values_out_of_range_are_counted() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\nf 1/7 2/8 3/-9\n";
    let m = read(text, Format::Obj).unwrap();
    assert_eq!(layer(&m, LayerKind::Uv).corners, [0, 1, 2, NO_VALUE, NO_VALUE, NO_VALUE]);
    assert_eq!(warnings(&m), ["3 corners name values of `uv` that the file does not have; they are read as without"]);
    let m = read("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1/1 2/1/1 3/1/1\n", Format::Obj).unwrap();
    assert_eq!(
        warnings(&m),
        [
            "3 corners name values of `uv` that the file does not have; they are read as without",
            "3 corners name values of `normal` that the file does not have; they are read as without"
        ]
    );
}

#[test]
fn what_gltf_says_beside_is_counted() {
    let doc = json!({
        "asset": {"version": "2.0"}, "extras": {"project": 7},
        "scenes": [{"nodes": [0, 1], "extras": 1}],
        "nodes": [{"mesh": 0, "name": "left wall", "extras": {"room": "hall"}}, {"camera": 0, "name": "view"}],
        "meshes": [{"name": "wall", "primitives": [{"attributes": {"POSITION": 0}, "extras": {}}]}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}],
        "accessors": [{"componentType": 5126, "count": 3, "type": "VEC3", "bufferView": 0}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]
    });
    assert_eq!(
        warnings(&read(doc.to_string(), Format::Gltf).unwrap()),
        [
            "names of nodes and meshes are not carried (3 records left out)",
            "cameras are not carried (1 record left out)",
            "extras of nodes, meshes and scenes are not carried (4 records left out)"
        ]
    );
}

#[test]
fn padding_behind_gzip_is_nothing() {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let mut packed = packed.finish().unwrap();
    packed.resize(packed.len() + 512, 0);
    let m = read(&packed, Format::Obj).unwrap();
    assert_eq!((faces(&m), warnings(&m)), (vec![vec![0, 1, 2]], Vec::new()));
    packed.push(1);
    assert!(read(&packed, Format::Obj).is_err());
}
