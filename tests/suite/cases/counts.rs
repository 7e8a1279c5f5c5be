//! Counts that sizes disprove, and files without anything.

use std::io::Write as _;

use lodestream::io::read::{Format, ReadErrorKind, ReadOptions, read_bytes, read_path};

use super::{case, case_path, faces, read, warnings};
use crate::common::{Scratch, lodestream};

fn stl(count: u32, records: usize, behind: usize) -> Vec<u8> {
    let whole = case("stl-count-zero/leg.stl");
    let mut out = whole[..80].to_vec();
    out.extend(count.to_le_bytes());
    out.extend(whole[84..].chunks(50).cycle().take(records).flatten());
    out.resize(out.len() + behind, 1);
    out
}

#[test]
fn sizes_are_believed_before_counts_where_they_are_whole() {
    let m = read(case("stl-count-zero/leg.stl"), Format::Stl).unwrap();
    assert_eq!(faces(&m).len(), 4);
    assert_eq!(warnings(&m), ["the header announces 0 triangles, the size of the file tells 4; these were read"]);
    for announced in [0, 2, 5, 1000, u32::MAX] {
        let m = read(stl(announced, 4, 0), Format::Stl).unwrap();
        assert_eq!((faces(&m).len(), m.warnings.len()), (4, 1), "{announced}");
    }
    assert_eq!(warnings(&read(stl(4, 4, 0), Format::Stl).unwrap()), [""; 0]);
    assert_eq!(warnings(&read(stl(4, 4, 7), Format::Stl).unwrap()), ["7 bytes behind the end of the mesh ignored"]);
    for announced in [0, 5, u32::MAX] {
        let error = read(stl(announced, 4, 7), Format::Stl).unwrap_err();
        assert!(matches!(error.kind, ReadErrorKind::Count { count, .. } if count == u64::from(announced)), "{error}");
    }
}

#[test]
fn nothing_is_an_error_of_its_own_in_every_format() {
    let allow = ReadOptions { allow_empty: true, ..ReadOptions::default() };
    let ply =
        "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(b"").unwrap();
    let packed = packed.finish().unwrap();
    for (bytes, format, valid) in [
        (&b""[..], Format::Obj, true),
        (b"", Format::Ply, false),
        (b"", Format::Stl, false),
        (b"", Format::Off, false),
        (b"", Format::Gltf, false),
        (b" \n", Format::Glb, false),
        (b"# nothing\n", Format::Obj, true),
        (ply.as_bytes(), Format::Ply, true),
        (&[0; 84], Format::Stl, true),
        (b"solid a\nendsolid a\n", Format::Stl, true),
        (b"OFF\n0 0 0\n", Format::Off, true),
        (br#"{"asset":{"version":"2.0"}}"#, Format::Gltf, true),
        (&case("empty-file/scene.glb"), Format::Glb, true),
        (&packed, Format::Obj, true),
        (&packed, Format::Ply, false),
        (&case("empty-file/packed.obj.gz"), Format::Obj, true),
    ] {
        let error = read(bytes, format).unwrap_err();
        assert_eq!(error.kind, ReadErrorKind::Empty, "{format:?} {bytes:?}");
        let allowed = read_bytes(bytes, format, None, &allow);
        assert_eq!(allowed.is_ok_and(|m| m.mesh.vertex_count() == 0), valid, "{format:?} {bytes:?}");
    }
    for name in ["empty.obj", "empty.stl", "packed.obj.gz", "scene.glb"] {
        let error = read_path(case_path("empty-file").join(name), &ReadOptions::default()).unwrap_err();
        assert_eq!(error.kind, ReadErrorKind::Empty, "{name}");
    }
    assert_eq!(
        read("", Format::Obj).unwrap_err().to_string(),
        "input: there is no vertex in it; fetch or export the file again, or allow empty meshes (--allow-empty)"
    );
}

#[test]
fn the_program_lets_nothing_pass_only_where_it_is_asked_to() {
    let s = Scratch::new("nothing");
    std::fs::create_dir(s.path("in")).unwrap();
    s.write("in/empty.obj", "");
    s.write("in/full.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let refused = lodestream(s.folder(), "encode in/empty.obj -o o.lods");
    assert_eq!(refused.code, 1);
    assert!(refused.stderr.contains("in/empty.obj: there is no vertex in it"), "{}", refused.stderr);
    lodestream(s.folder(), "encode in/empty.obj -o o.lods --allow-empty").ok();
    let run = lodestream(s.folder(), "ingest in -o out --report r.json");
    assert_eq!(run.code, 3, "{}", run.stderr);
    assert_eq!(
        std::fs::read_dir(s.path("out"))
            .unwrap()
            .filter(|e| e.as_ref().unwrap().path().extension().is_some_and(|e| e == "lods"))
            .count(),
        1
    );
    lodestream(s.folder(), "ingest in -o out --resume --allow-empty").ok();
    assert!(s.path("out/empty.lods").exists());
}
