//! What a mesh names: found by one rule, inside the folder of the mesh, and what it is called there.

use std::fs;

use lodestream::io::read::{Format, ReadErrorKind, ReadMesh, ReadOptions, read_path};
use lodestream::io::write::{WriteOptions, write_path};
use lodestream::mesh::Mesh;
use serde_json::{Value, json};

use super::{case_path, faces, read_file, warnings};
use crate::common::{Scratch, lodestream};

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

#[test]
fn buffers_are_looked_for_as_images_are() {
    let m = read_file(&case_path("gltf-uri-backslash/scene.gltf"));
    assert_eq!((faces(&m).len(), warnings(&m)), (2, Vec::new()));
    let s = Scratch::new("buffers");
    let data: Vec<u8> = [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    s.write("My Data%20.bin", &data);
    let read = |uri: &str| {
        let doc = json!({
            "asset": {"version": "2.0"}, "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [{"componentType": 5126, "count": 3, "type": "VEC3", "bufferView": 0}],
            "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36, "uri": uri}]
        });
        read_path(s.write("a.gltf", doc.to_string()), &ReadOptions::default())
    };
    for uri in ["My Data%20.bin", "my%20data%2520.BIN", "D:\\export\\My Data%2520.bin", "/home/x/My%20Data%2520.bin"] {
        assert_eq!(read(uri).unwrap().mesh.face_count(), 1, "{uri}");
    }
    for uri in ["other.bin", "../../etc/passwd"] {
        assert!(matches!(read(uri).unwrap_err().kind, ReadErrorKind::Buffer { .. }), "{uri}");
    }
}

#[test]
fn names_are_told_apart_by_their_bytes() {
    let m = read_file(&case_path("mtl-names-in-gbk/model.obj"));
    let colour = |m: &Mesh, i: usize| {
        let material: Value = serde_json::from_str(&m.appearance.materials[i]).unwrap();
        material["pbrMetallicRoughness"]["baseColorFactor"].clone()
    };
    assert_eq!((m.mesh.appearance.materials.len(), warnings(&m)), (2, Vec::new()));
    assert_eq!(colour(&m.mesh, 0), json!([1.0, 1.0, 1.0, 1.0]));
    assert_eq!(colour(&m.mesh, 1), json!([0.0, 0.0, 0.0, 1.0]));
    assert_eq!(m.mesh.material, [0, 0, 1, 1]);
    // They come out with the bytes with which they went in, through a `.lods` file too.
    let s = Scratch::new("gbk");
    write_path(s.path("out.obj"), &m.mesh, None, &WriteOptions::default()).unwrap();
    for name in ["model.obj", "model.mtl"] {
        fs::copy(case_path("mtl-names-in-gbk").join(name), s.path(name)).unwrap();
    }
    lodestream(s.folder(), "encode model.obj -o m.lods").ok();
    lodestream(s.folder(), "decode m.lods -o decoded.obj").ok();
    let names = |path: &str, keyword: &[u8]| -> Vec<Vec<u8>> {
        let bytes = fs::read(s.path(path)).unwrap();
        bytes.split(|b| *b == b'\n').filter_map(|l| Some(l.strip_prefix(keyword)?.to_vec())).collect()
    };
    let wanted = names("model.mtl", b"newmtl ");
    let sorted = |mut names: Vec<Vec<u8>>| {
        names.sort();
        names.dedup();
        names
    };
    for (obj, mtl) in [("out.obj", "out.mtl"), ("decoded.obj", "decoded.mtl")] {
        // Faces come out in another order, and name their material anew where it changes.
        assert_eq!(sorted(names(obj, b"usemtl ")), sorted(wanted.clone()));
        assert_eq!(names(mtl, b"newmtl "), wanted);
    }
}

/// An OBJ in `in/`, with a texture, a library and a link outside of it.
fn scene(name: &str) -> Scratch {
    let s = Scratch::new(name);
    fs::create_dir_all(s.path("in")).unwrap();
    fs::create_dir_all(s.path("secret")).unwrap();
    s.write("secret/t.png", PNG);
    s.write("secret/notes.png", "plain text that is no image");
    s
}

fn with_image(s: &Scratch, image: &str, options: &ReadOptions) -> ReadMesh {
    s.write("in/a.mtl", format!("newmtl m\nmap_Kd {image}\n"));
    read_path(s.write("in/a.obj", format!("mtllib a.mtl\nusemtl m\n{TRIANGLE}")), options).unwrap()
}

#[test]
fn a_mesh_carries_away_nothing_from_outside_its_folder() {
    let s = scene("outside");
    let absolute = s.path("secret/t.png").display().to_string();
    #[cfg(unix)]
    std::os::unix::fs::symlink(s.path("secret/t.png"), s.path("in/link.png")).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink(s.path("secret"), s.path("in/folder")).unwrap();
    let root = ReadOptions { asset_root: Some(s.folder().to_path_buf()), ..ReadOptions::default() };
    for image in ["../secret/t.png", "..\\secret\\t.png", "%2e%2e/secret/t.png", &absolute, "link.png", "folder/t.png"]
    {
        let m = with_image(&s, image, &ReadOptions::default());
        assert_eq!(m.mesh.appearance.images[0].bytes, b"", "{image}");
        assert!(warnings(&m)[0].starts_with("1 image file not found: "), "{image}");
        assert_eq!(with_image(&s, image, &root).mesh.appearance.images[0].bytes, PNG, "{image}");
    }
    // What an absolute path ends with, lies beside the mesh.
    s.write("in/t.png", PNG);
    assert_eq!(with_image(&s, &absolute, &ReadOptions::default()).mesh.appearance.images[0].bytes, PNG);
    // Text is no image, whatever it is called.
    let m = with_image(&s, "../secret/notes.png", &root);
    assert_eq!((m.mesh.appearance.images[0].bytes.len(), m.warnings.len()), (0, 1));
}

#[test]
#[cfg(unix)]
fn pipes_and_devices_are_not_read() {
    let s = scene("pipes");
    let pipe = |name: &str| {
        assert!(std::process::Command::new("mkfifo").arg(s.path(name)).status().unwrap().success());
    };
    pipe("in/pipe.png");
    pipe("in/pipe.mtl");
    pipe("in/pipe.obj");
    assert_eq!(with_image(&s, "pipe.png", &ReadOptions::default()).mesh.appearance.images[0].bytes, b"");
    assert_eq!(with_image(&s, "/dev/zero", &ReadOptions::default()).mesh.appearance.images[0].bytes, b"");
    let mesh = s.write("in/b.obj", format!("mtllib pipe.mtl\nusemtl m\n{TRIANGLE}"));
    assert_eq!(warnings(&read_file(&mesh))[0], "1 material library not found: pipe.mtl");
    let error = read_path(s.path("in/pipe.obj"), &ReadOptions::default()).unwrap_err();
    assert_eq!(error.kind, ReadErrorKind::NotRegular);
    for words in ["encode in/pipe.obj -o o.lods", "encode in/pipe.obj --format obj -o o.lods"] {
        let run = lodestream(s.folder(), words);
        assert_eq!(run.code, 1, "{words}");
        assert!(["pipe", "regular file"].iter().all(|word| run.stderr.contains(word)), "{}", run.stderr);
    }
}

#[test]
fn images_are_known_by_their_bytes() {
    let s = scene("bytes");
    let tga = [&[0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 1, 0, 24, 0][..], &[1, 2, 3]].concat();
    for (name, bytes, there) in [
        ("a.tga", &tga[..], true),
        ("b.ppm", b"P6\n# by hand\n1 1\n255\nabc", true),
        ("c.jpg", b"\xff\xd8\xff\xe0", true),
        ("d.webp", b"RIFF\x04\0\0\0WEBPVP8 ", true),
        ("e.ktx2", b"\xabKTX 20\xbb\r\n\x1a\n", true),
        ("f.tga", b"root:x:0:0:root:/root:/bin/bash\n", false),
        ("g.ppm", b"Passwords: 1 2 3\n", false),
        ("h.png", b"", false),
    ] {
        s.write(&format!("in/{name}"), bytes);
        let m = with_image(&s, name, &ReadOptions::default());
        assert_eq!(!m.mesh.appearance.images[0].bytes.is_empty(), there, "{name}");
    }
}

#[test]
fn one_library_under_many_spellings_is_read_once_and_many_missing_names_cost_one_listing() {
    let s = scene("spellings");
    s.write("in/a.mtl", "newmtl m\nKd 1 0 0\n".repeat(20_000));
    let spellings: String = (0..300).map(|k| format!("mtllib {}a.mtl\n", "./".repeat(k))).collect();
    let mesh = s.write("in/a.obj", format!("{spellings}usemtl m\n{TRIANGLE}"));
    let m = read_file(&mesh);
    assert_eq!((m.mesh.appearance.materials.len(), warnings(&m)), (1, Vec::new()));
    for k in 0..3000 {
        s.write(&format!("in/other{k}.txt"), "");
    }
    let library: String = (0..2000).map(|k| format!("newmtl m{k}\nmap_Kd missing{k}.png\n")).collect();
    s.write("in/b.mtl", library);
    let uses: String = (0..2000).map(|k| format!("usemtl m{k}\nf 1 2 3\n")).collect();
    let m = read_file(&s.write("in/b.obj", format!("mtllib b.mtl\n{TRIANGLE}{uses}")));
    assert!(warnings(&m)[0].starts_with("2000 image files not found: missing0.png"), "{:?}", warnings(&m));
}

#[test]
fn extras_inject_no_material() {
    let mut mesh: Mesh = super::read(TRIANGLE, Format::Obj).unwrap().mesh;
    mesh.material = vec![0];
    mesh.appearance.materials =
        vec![json!({"name": "a", "extras": {"mtl": ["Kd 1 0 0", " newmtl b", "NEWMTL c", "Ns 1\nnewmtl d", "illum 1\\", "d 1"]}}).to_string()];
    let s = Scratch::new("inject");
    write_path(s.path("a.obj"), &mesh, None, &WriteOptions::default()).unwrap();
    let text = fs::read_to_string(s.path("a.mtl")).unwrap();
    assert_eq!(text, "# lodestream\n\nnewmtl a\nKd 1 0 0\nNs 1 newmtl d\nillum 1\nd 1\n");
}

#[test]
fn textures_in_other_formats_go_through_as_they_are() {
    let webp = b"RIFF\x0c\0\0\0WEBPVP8 ";
    let ktx = b"\xabKTX 20\xbb\r\n\x1a\n and so on";
    let s = Scratch::new("other-textures");
    s.write("a.webp", webp);
    s.write("b.ktx2", ktx);
    let doc = json!({
        "asset": {"version": "2.0"},
        "extensionsUsed": ["EXT_texture_webp", "KHR_texture_basisu", "KHR_texture_transform"],
        "extensionsRequired": ["EXT_texture_webp", "KHR_texture_basisu", "KHR_texture_transform"],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}},
            "emissiveTexture": {"index": 1}
        }],
        "textures": [{"extensions": {"EXT_texture_webp": {"source": 0}}}, {"extensions": {"KHR_texture_basisu": {"source": 1}}}],
        "images": [{"uri": "a.webp"}, {"uri": "b.ktx2"}],
        "accessors": [{"componentType": 5126, "count": 3, "type": "VEC3", "bufferView": 0}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]
    });
    s.write("a.gltf", doc.to_string());
    lodestream(s.folder(), "encode a.gltf -o a.lods").ok();
    lodestream(s.folder(), "decode a.lods -o a.glb").ok();
    let m = read_file(&s.path("a.glb"));
    let images = &m.mesh.appearance.images;
    assert_eq!((&images[0].bytes[..], &images[1].bytes[..]), (&webp[..], &ktx[..]));
    assert_eq!((&images[0].mime[..], &images[1].mime[..]), ("image/webp", "image/ktx2"));
    let glb = String::from_utf8_lossy(&fs::read(s.path("a.glb")).unwrap()).into_owned();
    for part in [
        "\"EXT_texture_webp\":{\"source\":0}",
        "\"KHR_texture_basisu\":{\"source\":1}",
        "\"scale\":[2,2]",
        "extensionsRequired",
    ] {
        assert!(glb.contains(part), "{part}");
    }
}
