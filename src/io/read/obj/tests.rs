//! Small files, right and wrong.

use super::super::{Format, ReadMesh, ReadOptions, Warning, read_bytes};

fn obj(text: &str) -> ReadMesh {
    read_bytes(text.as_bytes(), Format::Obj, None, &ReadOptions::default()).unwrap()
}

fn error(text: &str) -> String {
    read_bytes(text.as_bytes(), Format::Obj, None, &ReadOptions::default()).unwrap_err().to_string()
}

fn faces(m: &ReadMesh) -> Vec<Vec<u32>> {
    m.mesh.faces().map(<[u32]>::to_vec).collect()
}

#[test]
fn polygons_lines_points_and_continuations() {
    let m = obj("# a comment \\\nstill a comment\r\nmtllib a.mtl\r\no thing\nv 0 0 0\nv 1 0 \\\r\n0\nv 1 1 0 1.0\n\
         v 0 1 0 0.5 0.5 0.5\nv .5 1.5e0 0 # top\nvt 0 0\nvn 0 0 1\ng a b\nusemtl m\nf 1/1/1 2//1 3/1 5 4 # a face\n\
         f -5 -4 \\\n -1\nl 1 3 5\np 2 3\nf 1 1 2\n\tf 1 2\nf 3\nf 4 4\n  f  5 4 3");
    assert_eq!(m.mesh.positions.len(), 5);
    assert_eq!(m.mesh.positions[4], [0.5, 1.5, 0.0]);
    let expected: [&[u32]; 7] = [&[0, 1, 2, 4, 3], &[0, 1, 4], &[0, 2], &[2, 4], &[0, 0, 1], &[0, 1], &[4, 3, 2]];
    assert_eq!(faces(&m), expected);
    assert_eq!(m.map, [0, 1, 2, 3, 4]);
    let texts: Vec<_> = m.warnings.iter().map(ToString::to_string).collect();
    assert_eq!(
        texts,
        [
            "2 faces with fewer than three corners were read as edges or points",
            "1 edge from a vertex to itself was read as a point",
            "texture coordinates are not carried (1 record left out)",
            "normals are not carried (1 record left out)",
            "colours are not carried (1 record left out)",
            "names of groups and objects are not carried (2 records left out)",
            "1 material library not found: a.mtl",
            "1 material is used but not described; the name is kept: m",
            "1 face has values of `uv` at some corners only; they were left out",
            "1 face has values of `normal` at some corners only; they were left out",
            "2 faces have values of `color` at some corners only; they were left out",
        ]
    );
}

#[test]
fn forward_references_and_old_line_ends() {
    let m = obj("f 1 2 3\rv 0 0 0\rv 1 0 0\rv 0 1 0\r");
    assert_eq!(faces(&m), [[0, 1, 2]]);
    assert!(m.warnings.is_empty());
}

#[test]
fn empty_files_and_unknown_statements() {
    for text in ["", "# nothing\n", "mtllib a.mtl\n"] {
        assert!(error(text).starts_with("input: there is no vertex in it"), "{text}");
        let options = ReadOptions { allow_empty: true, ..Default::default() };
        assert_eq!(read_bytes(text.as_bytes(), Format::Obj, None, &options).unwrap().mesh.vertex_count(), 0);
    }
    let m = obj("v 0 0 0\nfrob 1\nfrob 2\n");
    let first = "frob".to_string();
    assert_eq!(m.warnings, [Warning::UnknownStatements { count: 2, first, line: 2 }]);
    assert_eq!(m.warnings[0].to_string(), "2 lines with an unknown statement skipped (the first: `frob` on line 2)");
}

#[test]
fn welding_on_demand() {
    let options = ReadOptions { weld: Some(true), ..Default::default() };
    let text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 0\nf 4 2 3\nl 1 4\nl 1 2";
    let m = read_bytes(text, Format::Obj, None, &options).unwrap();
    assert_eq!(faces(&m), [vec![0, 1, 2], vec![0, 1]]);
    assert_eq!(m.map, [0, 1, 2, 0]);
    assert_eq!(m.warnings, [Warning::PointEdges { count: 1 }]);
}

#[test]
fn errors_say_where_what_and_what_to_do() {
    let v = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    assert_eq!(
        error(&format!("{v}f 1 2 9\n")),
        "input, line 4: a face names vertex 9, but the file has 3 vertices, numbered from 1; mend the index or add the vertex"
    );
    assert_eq!(
        error(&format!("{v}f 1 2 0\n")),
        "input, line 4: a face names vertex 0, but the file has 3 vertices, numbered from 1; mend the index or add the vertex"
    );
    assert_eq!(
        error(&format!("{v}l 1 -4\n")),
        "input, line 4: a line names vertex -4, but the file has 3 vertices, numbered from 1; mend the index or add the vertex"
    );
    assert_eq!(
        error("v 0 0 0\nv 0 nan 1\n"),
        "input, line 2: vertex 1 (counted from 0) has a coordinate that is not a finite number (NaN); mend or remove the vertex, or drop all such (--invalid drop)"
    );
    assert_eq!(
        error("v 0 0 1e999\n"),
        "input, line 1: vertex 0 (counted from 0) has a coordinate that is not a finite number (inf); mend or remove the vertex, or drop all such (--invalid drop)"
    );
    assert_eq!(error("v 0 0\n"), "input, line 1: the line ends where a coordinate belongs; complete it");
    assert_eq!(error("v 0 0 zero\n"), "input, line 1: \"zero\" stands where a coordinate belongs; mend it");
    assert_eq!(error(&format!("{v}f 1 2 x\n")), "input, line 4: \"x\" stands where a vertex number belongs; mend it");
    assert_eq!(
        error(&format!("{v}f 1 2 3x\n")),
        "input, line 4: \"x\" stands where the end of a vertex number belongs; mend it"
    );
    assert_eq!(
        error("v 0 0"),
        "input, line 1: the file ends inside a line, before a coordinate; it was cut, fetch it again"
    );
    assert_eq!(
        error("\u{7f}ELF hello\n"),
        "input: this is not an OBJ file: \"\\x7fELF hello\" stands where a line such as `v 0 0 0` belongs; check the file or name its true format"
    );
}
