//! Small PLY files, right and wrong.

use super::super::{Format, ReadMesh, ReadOptions, Warning, read_bytes};
use crate::mesh::{LayerKind, NO_VALUE, Stored};

fn ply(bytes: &[u8]) -> ReadMesh {
    read_bytes(bytes, Format::Ply, None, &ReadOptions::default()).unwrap()
}

fn error(bytes: &[u8]) -> String {
    read_bytes(bytes, Format::Ply, None, &ReadOptions::default()).unwrap_err().to_string()
}

fn faces(m: &ReadMesh) -> Vec<Vec<u32>> {
    m.mesh.faces().map(<[u32]>::to_vec).collect()
}

const ASCII: &str = "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty uchar mark\n\
property double y\nproperty float z\nproperty float quality\nelement camera 1\nproperty list uchar float view\n\
property int id\nelement face 5\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n\
element edge 2\nproperty int vertex1\nproperty int vertex2\nelement tristrips 1\nproperty list int int vertex_indices\n\
end_header\n0 9 0 0 .5\n1 9 0 0 .5\n1 9 1 0 .5\n0 9 1e0 0.25 .5\n3 1 2 3 7\n4 0 1 2 3 0\n3 0 1 2 6 0 0 0 0 0 0\n2 0 3 0\n\
1 2 0\n0 0\n3 1\n2 2\n7 0 1 2 3 -1 1 2\n";

#[test]
fn ascii_with_everything() {
    let m = ply(ASCII.as_bytes());
    assert_eq!(m.mesh.positions[3], [0.0, 1.0, 0.25]);
    let expected: [&[u32]; 6] = [&[0, 1, 2, 3], &[0, 1, 2], &[0, 3], &[3, 1], &[0, 1, 2], &[2, 1, 3]];
    assert_eq!(faces(&m), expected);
    let texts: Vec<_> = m.warnings.iter().map(ToString::to_string).collect();
    assert_eq!(
        texts,
        [
            "2 faces with fewer than three corners were read as edges or points",
            "1 face without corners was left out",
            "1 edge from a vertex to itself was read as a point",
            "1 PLY element `camera` skipped",
        ]
    );
    let of = |name: &str| m.mesh.layers.iter().find(|l| l.name == name).unwrap();
    assert_eq!((of("quality").kind, of("quality").value(1)), (LayerKind::Scalar, &[0.5][..]));
    let uv = of("uv");
    // The quad has an empty list, the triangle one of six zeros: one value.
    assert_eq!((uv.len(), &uv.corners[..7]), (3, &[NO_VALUE, NO_VALUE, NO_VALUE, NO_VALUE, 0, 1, 2][..]));
    let crlf = ASCII.replace('\n', "\r\n");
    assert_eq!(ply(crlf.as_bytes()), m);
}

/// A binary file with the given types, in both byte orders.
fn binary(big: bool, real: &str, index: &str, count: &str) -> Vec<u8> {
    let order = if big { "big" } else { "little" };
    let mut out = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty {real} x\nproperty {real} y\nproperty {real} z\n\
         property uchar flag\nelement face 2\nproperty short group\nproperty list {count} {index} vertex_index\n\
         property float area\nend_header\n"
    )
    .into_bytes();
    let put = |out: &mut Vec<u8>, name: &str, value: f64| {
        let mut bytes = match name {
            "char" => (value as i8).to_le_bytes().to_vec(),
            "uchar" | "uint8" => (value as u8).to_le_bytes().to_vec(),
            "short" => (value as i16).to_le_bytes().to_vec(),
            "ushort" => (value as u16).to_le_bytes().to_vec(),
            "int" => (value as i32).to_le_bytes().to_vec(),
            "uint" => (value as u32).to_le_bytes().to_vec(),
            "int64" => (value as i64).to_le_bytes().to_vec(),
            "uint64" => (value as u64).to_le_bytes().to_vec(),
            "float" => (value as f32).to_le_bytes().to_vec(),
            _ => value.to_le_bytes().to_vec(),
        };
        if big {
            bytes.reverse();
        }
        out.extend(bytes);
    };
    for p in [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0], [6.0, 7.0, 8.0], [9.0, 10.0, 100.0]] {
        for x in p {
            put(&mut out, real, x);
        }
        out.push(10);
    }
    for face in [&[0, 1, 2][..], &[3, 2, 1, 0]] {
        put(&mut out, "short", 513.0);
        put(&mut out, count, face.len() as f64);
        for &v in face {
            put(&mut out, index, f64::from(v));
        }
        put(&mut out, "float", 0.5);
    }
    out
}

#[test]
fn binary_of_every_type_in_both_orders() {
    for big in [false, true] {
        for real in ["float", "double", "short", "int64", "uchar"] {
            for index in ["int", "uint", "ushort", "char", "uint64", "double", "float"] {
                for count in ["uchar", "int", "uint8", "short", "double"] {
                    let m = ply(&binary(big, real, index, count));
                    assert_eq!(m.mesh.positions[3], [9.0, 10.0, 100.0], "{big} {real} {index} {count}");
                    assert_eq!(faces(&m), [vec![0, 1, 2], vec![3, 2, 1, 0]]);
                    let flag = &m.mesh.layers[0];
                    assert_eq!((flag.name.as_str(), flag.stored, flag.value(3)), ("flag", Stored::U8, &[10.0][..]));
                    let skipped = "PLY properties of `face` skipped (2 records): group, area";
                    assert_eq!(m.warnings[0].to_string(), skipped);
                }
            }
        }
    }
}

#[test]
fn body_that_begins_like_a_line_end() {
    // The first byte of the first coordinate is a line feed.
    let mut file = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty int x\nproperty int y\n\
        property int z\nend_header\n"
        .to_vec();
    file.extend([10, 0, 0, 0, 13, 0, 0, 0, 1, 0, 0, 0]);
    assert_eq!(ply(&file).mesh.positions, [[10.0, 13.0, 1.0]]);
}

#[test]
fn faces_may_come_before_vertices() {
    let m = ply(b"ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nelement vertex 3\n\
        property float x\nproperty float y\nproperty float z\nend_header\n3 0 1 2\n0 0 0 1 0 0 0 1 0");
    assert_eq!(faces(&m), [[0, 1, 2]]);
}

#[test]
fn texture_coordinates_on_vertices_weld() {
    let text = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        property float s\nproperty float t\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 0 0\n1 0 0 0 0\n0 1 0 0 0\n0 0 0 1 1\n3 0 1 2\n3 3 2 1\n";
    let m = ply(text);
    assert_eq!((m.mesh.vertex_count(), faces(&m)), (3, vec![vec![0, 1, 2], vec![0, 2, 1]]));
    let apart = ReadOptions { weld: Some(false), ..Default::default() };
    assert_eq!(read_bytes(text, Format::Ply, None, &apart).unwrap().mesh.vertex_count(), 4);
}

#[test]
fn errors_say_where_what_and_what_to_do() {
    let head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n";
    let ascii = |face: &str| error(format!("{head}{face}").as_bytes());
    assert_eq!(
        ascii("3 0 1 3\n"),
        "input, line 13: a face names vertex 3, but the file has 3 vertices, numbered from 0; mend the index or add the vertex"
    );
    assert_eq!(
        ascii("3 0 1 -1\n"),
        "input, line 13: a face names vertex -1, but the file has 3 vertices, numbered from 0; mend the index or add the vertex"
    );
    assert_eq!(
        ascii("3 0 1"),
        "input, line 13: the file ends inside a line, before a whole number; it was cut, fetch it again"
    );
    assert_eq!(ascii("3 0 1 x"), "input, line 13: \"x\" stands where a whole number belongs; mend it");
    assert_eq!(ascii("-3 0 1 2"), "input, line 13: a list of -3 items; mend the count");
    assert_eq!(
        error(head.replace("1 0 0\n", "1 inf 0\n").as_bytes()),
        "input, line 11: vertex 1 (counted from 0) has a coordinate that is not a finite number (inf); mend or remove the vertex, or drop all such (--invalid drop)"
    );
    assert_eq!(
        error(head.replace("vertex 3", "vertex 300000000000").as_bytes()),
        "input, line 3: 300000000000 elements `vertex` are announced, but the 18 bytes that follow cannot hold them; the count is wrong or the file was cut"
    );
    assert_eq!(
        error(head.replace("float y", "float q").as_bytes()),
        "input, line 3: the element `vertex` has no property `y`; add it to the header and the data"
    );
    assert_eq!(
        error(b"solid thing\n"),
        "input: this is not a PLY file: \"solid thing\" stands where `ply` belongs; check the file or name its true format"
    );
    assert_eq!(
        error(b""),
        "input: there is no vertex in it; fetch or export the file again, or allow empty meshes (--allow-empty)"
    );
    assert_eq!(
        error(b"ply\nformat ascii 1.0\nelement vertex 1\n"),
        "input, line 4: the file ends inside the header; it was cut, fetch it again"
    );
    assert_eq!(error(b"ply\nformat middle 1.0\n"), "input, line 2: \"middle\" is not a PLY encoding; mend the header");
    assert_eq!(
        error(b"ply\nend_header\n"),
        "input: the header has no `format` line; add one, such as `format ascii 1.0`"
    );
    let whole = binary(false, "float", "int", "uchar");
    assert_eq!(
        error(&whole[..whole.len() - 2]),
        "input, byte 299: the file ends inside the data (2 bytes missing); it was cut, fetch it again"
    );
    let at = whole.len() - 8;
    let mut bad = whole.clone();
    bad[at..at + 4].copy_from_slice(&7u32.to_le_bytes());
    assert_eq!(
        error(&bad),
        format!(
            "input, byte {at}: a face names vertex 7, but the file has 4 vertices, numbered from 0; mend the index or add the vertex"
        )
    );
}

#[test]
fn what_stands_behind_the_mesh_is_counted() {
    let mut file = binary(true, "double", "int", "uchar");
    file.extend([0; 5]);
    assert!(ply(&file).warnings.contains(&Warning::TrailingBytes { count: 5 }));
}
