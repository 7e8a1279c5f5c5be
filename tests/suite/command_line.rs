//! The program as a user starts it: options, JSON fields, files and exit codes.

use crate::common::{Scratch, lodestream, lodestream_with};
use lodestream::io::read::{self, ReadOptions};
use lodestream::io::write::{self, WriteOptions};
use lodestream::mesh::{Image, Layer, LayerKind, Mesh, Stored};
use lodestream::samples;
use serde_json::Value;
use std::path::Path;

fn save(mesh: &Mesh, path: &Path) {
    write::write_path(path, mesh, None, &WriteOptions::default()).unwrap();
}

fn load(path: &Path) -> Mesh {
    read::read_path(path, &ReadOptions::default()).unwrap().mesh
}

/// A folder with `rock.ply` and `rock.lods` in it.
fn rock(name: &str) -> Scratch {
    let scratch = Scratch::new(name);
    save(&samples::ringed_asteroid(12, 60, 1), &scratch.path("rock.ply"));
    lodestream(scratch.folder(), "encode rock.ply -o rock.lods").ok();
    scratch
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is not a number"))
}

#[test]
fn encode_accounts_for_itself_in_json() {
    let scratch = rock("encode-json");
    let run = lodestream(scratch.folder(), "encode rock.ply -o again.lods --json --threads 2 --device auto");
    let json = run.json();
    for field in
        ["vertices", "faces", "components", "bytes", "bits_per_vertex", "levels", "peak_memory_bytes", "threads"]
    {
        assert!(number(&json[field]) > 0.0 || field == "peak_memory_bytes", "{field}: {}", json[field]);
    }
    for field in ["read", "weigh", "select", "collapse", "encode", "write", "total"] {
        assert!(number(&json["seconds"][field]) >= 0.0, "{field}");
    }
    for field in ["connectivity", "geometry", "header"] {
        assert!(number(&json["bytes_by_kind"][field]) > 0.0, "{field}");
    }
    assert_eq!(json["device"], "cpu");
    assert_eq!(json["threads"], 2);
    let mesh = load(&scratch.path("rock.ply"));
    assert_eq!(json["vertices"], mesh.vertex_count());
    assert_eq!(json["faces"], mesh.face_count());
    assert_eq!(json["components"], 61);
    let bytes = std::fs::read(scratch.path("again.lods")).unwrap();
    assert_eq!(json["bytes"], bytes.len());
    assert_eq!(bytes, std::fs::read(scratch.path("rock.lods")).unwrap(), "any thread count gives the same bytes");
    let kinds = json["bytes_by_kind"].as_object().unwrap();
    let sum: f64 = kinds.values().map(number).sum();
    assert!((sum - bytes.len() as f64).abs() < 0.02 * bytes.len() as f64 + 64.0, "{kinds:?} is not {}", bytes.len());
    assert_eq!(run.stderr, "");
}

#[test]
fn info_tells_the_lattice_the_levels_and_the_chunks() {
    let scratch = rock("info");
    let json = lodestream(scratch.folder(), "info rock.lods --json").json();
    assert_eq!(json["quantization"]["bits"], 12);
    assert!(number(&json["quantization"]["step"]) > 0.0);
    assert_eq!(json["quantization"]["origin"].as_array().unwrap().len(), 3);
    let levels = json["levels"].as_array().unwrap();
    let (mut vertices, mut bytes) = (0.0, 0.0);
    for (i, level) in levels.iter().enumerate() {
        assert_eq!(level["level"], i);
        assert!(number(&level["vertices"]) >= vertices && number(&level["prefix_bytes"]) >= bytes, "level {i}");
        (vertices, bytes) = (number(&level["vertices"]), number(&level["prefix_bytes"]));
        assert!(level["error"].is_number() || level["error"].is_null());
        assert!(level["faces"].is_number());
    }
    let mesh = load(&scratch.path("rock.ply"));
    let last = levels.last().unwrap();
    assert_eq!((&last["vertices"], &last["faces"]), (&mesh.vertex_count().into(), &mesh.face_count().into()));
    let size = std::fs::metadata(scratch.path("rock.lods")).unwrap().len();
    assert_eq!(last["prefix_bytes"], size);
    let chunks = json["chunks"].as_array().unwrap();
    let payload: f64 = chunks.iter().map(|c| number(&c["length"])).sum();
    assert_eq!(payload + number(&json["front_bytes"]), size as f64);

    let text = lodestream(scratch.folder(), "info rock.lods --chunks").ok().stdout;
    assert!(text.contains("12 bits") && text.contains("prefix bytes") && text.contains("checksum"), "{text}");
}

#[test]
fn decode_accounts_for_itself_in_json_and_keeps_polygons() {
    let scratch = Scratch::new("decode-json");
    let mesh = samples::mixed(20, 20, 3);
    save(&mesh, &scratch.path("in.obj"));
    lodestream(scratch.folder(), "encode in.obj -o in.lods").ok();
    let size = std::fs::metadata(scratch.path("in.lods")).unwrap().len();
    for extension in ["obj", "ply", "glb", "stl"] {
        let json = lodestream(scratch.folder(), &format!("decode in.lods -o out.{extension} --json")).json();
        assert_eq!(json["vertices"], mesh.vertex_count());
        assert_eq!(json["faces"], mesh.face_count());
        assert_eq!(json["bytes_read"], size);
        assert_eq!(number(&json["level"]) + 1.0, number(&json["levels"]));
        for field in ["read", "decode", "write", "total"] {
            assert!(number(&json["seconds"][field]) >= 0.0, "{field}");
        }
        assert!(json["peak_memory_bytes"].is_u64());
        let back = load(&scratch.path(&format!("out.{extension}")));
        if ["obj", "ply"].contains(&extension) {
            let mut degrees = [mesh.faces(), back.faces()].map(|faces| faces.map(<[u32]>::len).collect::<Vec<_>>());
            degrees.iter_mut().for_each(|d| d.sort_unstable());
            assert_eq!(degrees[0], degrees[1], "{extension}");
        }
    }
    // What was decoded encodes to the same quantized mesh: OBJ and PLY read back to the same lattice points.
    for extension in ["obj", "ply"] {
        lodestream(scratch.folder(), &format!("verify in.lods --against out.{extension}")).ok();
    }
}

#[test]
fn levels_are_chosen_by_number_vertices_bytes_and_error() {
    let scratch = rock("choice");
    let info = lodestream(scratch.folder(), "info rock.lods --json").json();
    let levels = info["levels"].as_array().unwrap();
    let full = levels.len() - 1;
    let pick = |options: &str| {
        let json = lodestream(scratch.folder(), &format!("decode rock.lods -o out.ply --json {options}")).json();
        assert_eq!(json["vertices"], levels[json["level"].as_u64().unwrap() as usize]["vertices"]);
        json["level"].as_u64().unwrap() as usize
    };
    assert_eq!(pick(""), full);
    assert_eq!(pick("--level 3"), 3);
    let middle = full / 2;
    let vertices = levels[middle]["vertices"].as_u64().unwrap();
    let at_most = |field: &str, n: u64| levels.iter().rposition(|l| l[field].as_u64().unwrap() <= n).unwrap();
    assert_eq!(pick(&format!("--max-vertices {vertices}")), at_most("vertices", vertices));
    let bytes = levels[middle]["prefix_bytes"].as_u64().unwrap();
    assert_eq!(pick(&format!("--max-bytes {bytes}")), at_most("prefix_bytes", bytes));
    let error = number(&levels[middle]["error"]);
    let first = levels.iter().position(|l| l["error"].as_f64().is_some_and(|e| e <= error)).unwrap();
    assert_eq!(pick(&format!("--max-error {error}")), first);
    // No more is read than the level takes.
    let json = lodestream(scratch.folder(), "decode rock.lods -o out.ply --json --level 0").json();
    assert_eq!(json["bytes_read"], levels[0]["prefix_bytes"]);

    let refused = |options: &str| {
        let run = lodestream(scratch.folder(), &format!("decode rock.lods -o no.ply {options}"));
        assert_eq!((run.code, run.stdout.as_str()), (1, ""));
        assert!(!scratch.path("no.ply").exists());
        run.stderr
    };
    let text = refused("--level 1000");
    assert_eq!(
        text,
        format!("lodestream: rock.lods: there is no level 1000: the levels are 0 to {full}; see lodestream info\n")
    );
    assert!(refused("--max-vertices 0").contains("more than 0; allow more"));
    assert!(refused("--max-bytes 10").contains("more than 10; allow more"));
    assert!(refused("--max-error 0").contains("not even the full level"));
}

#[test]
fn a_map_makes_verification_complete() {
    let scratch = Scratch::new("map");
    let mesh = samples::fan_book(9, 5, 2);
    save(&mesh, &scratch.path("book.obj"));
    lodestream(scratch.folder(), "encode book.obj -o book.lods --map book.map").ok();
    let map: Vec<usize> =
        std::fs::read_to_string(scratch.path("book.map")).unwrap().lines().map(|l| l.parse().unwrap()).collect();
    assert_eq!(map.len(), mesh.vertex_count());
    let json = lodestream(scratch.folder(), "verify book.lods --against book.obj --map book.map --json").json();
    assert_eq!((&json["equal"], &json["test"]), (&true.into(), &"complete, through the vertex map".into()));
    let json = lodestream(scratch.folder(), "verify book.lods --against book.obj --json").json();
    assert_eq!((&json["equal"], &json["test"]), (&true.into(), &"by position".into()));
    let json = lodestream(scratch.folder(), "verify book.lods --json").json();
    assert_eq!((&json["equal"], &json["sound"]), (&Value::Null, &true.into()));

    // Turn one face round: exit code 3, and the face is named.
    let mut other = Mesh { positions: mesh.positions.clone(), ..Mesh::default() };
    for (f, face) in mesh.faces().enumerate() {
        let mut face = face.to_vec();
        if f == 4 {
            face.reverse();
        }
        other.push_face(&face);
    }
    save(&other, &scratch.path("other.obj"));
    for options in ["", "--map book.map"] {
        let run = lodestream(scratch.folder(), &format!("verify book.lods --against other.obj {options}"));
        assert_eq!(run.code, 3, "{}", run.stderr);
        assert!(run.stderr.starts_with("lodestream: book.lods differs from other.obj: the face "), "{}", run.stderr);
        assert!(run.stdout.contains("NOT equal"));
    }
}

#[test]
fn welding_is_per_format_and_can_be_chosen() {
    let scratch = Scratch::new("weld");
    save(&samples::sphere(3, 0.1, 1), &scratch.path("ball.stl"));
    let vertices = |options: &str| {
        let json =
            lodestream(scratch.folder(), &format!("encode ball.stl -o ball.lods --map ball.map --json {options}"))
                .json();
        lodestream(scratch.folder(), "verify ball.lods --against ball.stl --map ball.map").ok();
        lodestream(scratch.folder(), "verify ball.lods --against ball.stl").ok();
        json["vertices"].as_u64().unwrap()
    };
    assert_eq!((vertices(""), vertices("--weld"), vertices("--no-weld")), (92, 92, 540));
}

#[test]
fn lattices_can_be_given_so_that_tiles_share_borders() {
    let scratch = Scratch::new("tiles");
    // One sheet cut in two; both halves have the seam's vertices.
    let sheet = samples::mixed(16, 8, 3);
    for (name, keep) in [("left", [-1.0, 0.5]), ("right", [0.5, 2.0])] {
        let mut half = Mesh { positions: sheet.positions.clone(), ..Mesh::default() };
        let inside = |v: u32| (keep[0]..=keep[1]).contains(&sheet.positions[v as usize][0]);
        sheet.faces().filter(|f| f.iter().all(|&v| inside(v))).for_each(|f| half.push_face(f));
        half.positions = half.positions.iter().map(|p| [p[0] + 512_000.0, p[1] + 5_403_000.0, p[2]]).collect();
        save(&half, &scratch.path(&format!("{name}.obj")));
        let options = "--position-step 0.001 --origin 512000,5403000,-10 --lock-borders --json";
        lodestream(scratch.folder(), &format!("encode {name}.obj -o {name}.lods {options}")).json();
        let json = lodestream(scratch.folder(), &format!("info {name}.lods --json")).json();
        assert_eq!(json["quantization"]["origin"], serde_json::json!([512000.0, 5403000.0, -10.0]));
        assert_eq!((number(&json["quantization"]["step"]), &json["quantization"]["bits"]), (0.001, &Value::Null));
        lodestream(scratch.folder(), &format!("verify {name}.lods --against {name}.obj")).ok();
    }
}

#[test]
fn standard_input_is_a_dash() {
    let scratch = rock("dash");
    let ply = std::fs::read(scratch.path("rock.ply")).unwrap();
    let lods = std::fs::read(scratch.path("rock.lods")).unwrap();
    lodestream_with(scratch.folder(), "encode - --format ply -o piped.lods", Some(&ply)).ok();
    assert_eq!(std::fs::read(scratch.path("piped.lods")).unwrap(), lods);
    lodestream_with(scratch.folder(), "decode - -o piped.ply", Some(&lods)).ok();
    lodestream_with(scratch.folder(), "info -", Some(&lods)).ok();
    lodestream_with(scratch.folder(), "verify - --against rock.ply", Some(&lods)).ok();
    lodestream_with(scratch.folder(), "verify rock.lods --against - --format ply", Some(&ply)).ok();
    let run = lodestream_with(scratch.folder(), "encode - -o no.lods", Some(&ply));
    assert_eq!(run.code, 1);
    assert_eq!(
        run.stderr,
        "lodestream: standard input: its format is not known; name it with --format, as in --format ply\n"
    );
    let run = lodestream_with(scratch.folder(), "encode - --format obj -o no.lods", Some(b"v 0 0 zero\n"));
    assert_eq!(run.code, 1);
    assert!(run.stderr.starts_with("lodestream: standard input, line 1: "), "{}", run.stderr);
}

#[test]
fn a_cut_file_gives_its_best_whole_level_and_says_so() {
    let scratch = rock("cut");
    let lods = std::fs::read(scratch.path("rock.lods")).unwrap();
    let info = lodestream(scratch.folder(), "info rock.lods --json").json();
    let prefixes: Vec<usize> =
        info["levels"].as_array().unwrap().iter().map(|l| l["prefix_bytes"].as_u64().unwrap() as usize).collect();
    for cut in [prefixes[0], prefixes[0] + 1, (prefixes[0] + lods.len()) / 2, lods.len() - 1] {
        scratch.write("cut.lods", &lods[..cut]);
        let best = prefixes.iter().rposition(|&p| p <= cut).unwrap();
        let run = lodestream(scratch.folder(), "decode cut.lods -o cut.ply --json");
        let json = run.json();
        assert_eq!(json["level"], best, "cut at {cut}");
        assert_eq!(json["warnings"].as_array().unwrap().len(), 1);
        assert_eq!(
            run.stderr,
            format!(
                "lodestream: warning: cut.lods: the file is cut: {cut} bytes of {}, levels up to {best} are whole; fetch the rest of it\n",
                lods.len()
            )
        );
        std::fs::remove_file(scratch.path("cut.ply")).unwrap();
        let run = lodestream(scratch.folder(), "decode cut.lods -o cut.ply --strict");
        assert_eq!(run.code, 1);
        assert!(run.stderr.starts_with("lodestream: cut.lods: the file is cut: "), "{}", run.stderr);
        assert!(!scratch.path("cut.ply").exists());
        assert_eq!(lodestream(scratch.folder(), "verify cut.lods").code, 1);
        // A level that is whole is not touched by what is missing behind it.
        lodestream(scratch.folder(), "decode cut.lods -o cut.ply --level 0 --strict").ok();
    }
    for cut in [0, 1, 8, 9, 30, prefixes[0] - 1] {
        scratch.write("cut.lods", &lods[..cut]);
        let run = lodestream(scratch.folder(), "decode cut.lods -o none.ply");
        assert_eq!(run.code, 1, "cut at {cut}");
        assert!(run.stderr.contains("cut") && run.stderr.contains("no level is whole"), "{}", run.stderr);
        assert!(!scratch.path("none.ply").exists());
    }
}

#[test]
fn the_demo_leaves_a_mesh_a_file_and_pictures() {
    let scratch = Scratch::new("demo");
    let run = lodestream(scratch.folder(), "demo --vertices 2000 --output shown --threads 1").ok();
    assert!(run.stdout.contains("the full one equals the quantized source, vertex by vertex"), "{}", run.stdout);
    lodestream(scratch.folder(), "verify shown/asteroid.lods --against shown/asteroid.ply").ok();
    let png = std::fs::read(scratch.path("shown/levels.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG") && png.len() > 10_000);
}

#[test]
fn attributes_come_back_and_are_verified() {
    let scratch = Scratch::new("layers");
    let text = "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvt 0.25 0.5\n\
        usemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 3/4 2/2 4/1\n";
    scratch.write("t.obj", text);
    scratch.write("t.mtl", "newmtl a\nKd 1 0 0\nmap_Kd a.png\nnewmtl b\nKd 0 1 0\n");
    std::fs::write(scratch.path("a.png"), b"\x89PNG\r\n\x1a\n and so on").unwrap();
    let run = lodestream(scratch.folder(), "encode t.obj -o t.lods --map t.map --json");
    assert_eq!((run.code, run.stderr.as_str()), (0, ""));
    assert!(run.json()["bytes_by_kind"]["attributes"].as_f64().unwrap() > 0.0);
    let run = lodestream(scratch.folder(), "verify t.lods --against t.obj --map t.map").ok();
    assert!(run.stdout.contains("4 vertices and 2 faces, with 1 attribute layer are equal"), "{}", run.stdout);
    lodestream(scratch.folder(), "decode t.lods -o back.obj").ok();
    let back = std::fs::read_to_string(scratch.path("back.obj")).unwrap();
    assert!(back.contains("usemtl a") && back.contains("usemtl b") && back.contains("vt "), "{back}");
    lodestream(scratch.folder(), "verify t.lods --against back.obj").ok();
    // A coarse level has its materials and images too.
    lodestream(scratch.folder(), "decode t.lods -o base.glb --level 0").ok();
    let base = std::fs::read(scratch.path("base.glb")).unwrap();
    assert!(base.windows(9).any(|w| w == b"and so on"));

    // Another value somewhere is a difference that is named.
    scratch.write("u.obj", text.replace("0.25 0.5", "0.25 0.75"));
    let run = lodestream(scratch.folder(), "verify t.lods --against u.obj --map t.map");
    assert!(run.code != 0 && run.stderr.contains("uv"), "{}", run.stderr);

    // What was dropped is told, and no difference.
    lodestream(scratch.folder(), "encode t.obj -o bare.lods --drop all").ok();
    let run = lodestream(scratch.folder(), "verify bare.lods --against t.obj").ok();
    assert!(run.stdout.contains("not kept"), "{}", run.stdout);
}

#[test]
fn textures_come_in_pieces() {
    let scratch = Scratch::new("textures");
    scratch
        .write("t.obj", "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n");
    scratch.write("t.mtl", "newmtl a\nmap_Kd a.jpg\n");
    let pixels: Vec<u8> =
        (0..200 * 200 * 3u32).map(|i| (i % 601 / 3 + i / 2411 + i % 23 * (i % 23) % 23) as u8).collect();
    let mut jpeg = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut jpeg, 90);
    encoder.encode(&pixels, 200, 200, jpeg_encoder::ColorType::Rgb).unwrap();
    std::fs::write(scratch.path("a.jpg"), &jpeg).unwrap();

    let run = lodestream(scratch.folder(), "encode t.obj -o t.lods").ok();
    assert!(run.stdout.contains("(1 made progressive without loss)"), "{}", run.stdout);
    lodestream(scratch.folder(), "verify t.lods --against t.obj").ok();
    let chunks = lodestream(scratch.folder(), "info t.lods --json").json()["chunks"].clone();
    let pieces: Vec<_> = chunks.as_array().unwrap().iter().filter(|c| c["kind"] == "image").collect();
    assert!(pieces.len() > 3 && pieces.iter().all(|c| c["image"] == 0), "{pieces:?}");
    // A prefix with some pieces: a picture of less detail, and a line that says so.
    let end = pieces[1]["offset"].as_u64().unwrap() + pieces[1]["length"].as_u64().unwrap();
    std::fs::create_dir(scratch.path("part")).unwrap();
    let run = lodestream(scratch.folder(), &format!("decode t.lods -o part/t.obj --max-bytes {}", end + 5));
    assert_eq!(run.code, 0);
    assert_eq!(run.stderr, "lodestream: warning: t.lods: 1 of 1 images are there in part and lack detail\n");
    let part = std::fs::read(scratch.path("part/a.jpg")).unwrap();
    assert!(part.len() < jpeg.len() && part.ends_with(&[0xFF, 0xD9]));

    // The very bytes, where asked for.
    lodestream(scratch.folder(), "encode t.obj -o exact.lods --exact-images --schedule texture-first").ok();
    std::fs::create_dir(scratch.path("exact")).unwrap();
    lodestream(scratch.folder(), "decode exact.lods -o exact/t.obj").ok();
    assert!(std::fs::read(scratch.path("exact/a.jpg")).unwrap() == jpeg);

    // By what prefixes look like.
    let run = lodestream(scratch.folder(), "encode t.obj -o best.lods --schedule quality --schedule-effort low").ok();
    assert!(run.stdout.contains("order       by quality: MS-SSIM 0.95 after "), "{}", run.stdout);
    lodestream(scratch.folder(), "verify best.lods --against t.obj").ok();
    let json = lodestream(scratch.folder(), "encode t.obj -o best.lods --schedule quality --json").json();
    assert!(number(&json["schedule"]["areas"]["quality"]) >= number(&json["schedule"]["areas"]["linear"]));
    assert_eq!(number(&json["bytes"]), std::fs::metadata(scratch.path("best.lods")).unwrap().len() as f64);
    let run = lodestream(scratch.folder(), "encode t.obj -o bare.lods --schedule quality --drop images").ok();
    assert!(run.stdout.contains("order       as it was: no image that is drawn"), "{}", run.stdout);

    // What is damaged stays as it is, and a line says why.
    std::fs::write(scratch.path("a.jpg"), &jpeg[..jpeg.len() - 9]).unwrap();
    let run = lodestream(scratch.folder(), "encode t.obj -o odd.lods");
    let says = "lodestream: warning: t.obj: a.jpg: kept as it is: it is cut: its end marker is missing\n";
    assert_eq!((run.code, run.stderr.as_str()), (0, says));
    let run = lodestream(scratch.folder(), "encode t.obj -o odd.lods --schedule last");
    assert!(
        run.code == 2 && run.stderr.contains("use mesh-first, texture-first or linear, or quality"),
        "{}",
        run.stderr
    );
}

#[test]
fn previews_are_shown_until_images_come() {
    let scratch = Scratch::new("previews");
    scratch
        .write("t.obj", "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n");
    scratch.write("t.mtl", "newmtl a\nmap_Kd a.png\nmap_Ke glow.png\n");
    for (name, color) in [("a.png", png::ColorType::Rgb), ("glow.png", png::ColorType::Rgba)] {
        let n = 400 * color.samples() as u32;
        let mut noise = 7u32;
        let mut pixel = |i: u32| {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (i % n / 10 + i / (4 * n) + (noise >> 29)) as u8
        };
        let pixels: Vec<u8> = (0..400 * n).map(&mut pixel).collect();
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 400, 400);
        encoder.set_color(color);
        encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
        std::fs::write(scratch.path(name), &bytes).unwrap();
    }
    let account = lodestream(scratch.folder(), "encode t.obj -o t.lods --texture keep --json").json();
    let sizes = |i: usize| account["images"][i]["previews"].as_array().unwrap().iter().map(number).collect::<Vec<_>>();
    assert!(!sizes(0).is_empty() && !sizes(1).is_empty(), "{account}");
    assert_eq!(number(&account["bytes_by_kind"]["previews"]), sizes(0).iter().chain(&sizes(1)).sum::<f64>());
    lodestream(scratch.folder(), "verify t.lods --against t.obj").ok();
    let chunks = lodestream(scratch.folder(), "info t.lods --json").json()["chunks"].clone();
    let end = |kind: &str| {
        let last = chunks.as_array().unwrap().iter().rfind(|c| c["kind"] == kind).unwrap();
        number(&last["offset"]) + number(&last["length"])
    };
    // All previews and no image: files are named by what they are.
    std::fs::create_dir(scratch.path("part")).unwrap();
    for to in ["t.obj", "t.glb"] {
        let command = format!("decode t.lods -o part/{to} --max-bytes {}", end("preview"));
        let run = lodestream(scratch.folder(), &command);
        assert_eq!(
            (run.code, run.stderr.as_str()),
            (0, "lodestream: warning: t.lods: 2 of 2 images are there in part and lack detail\n")
        );
    }
    assert!(std::fs::read(scratch.path("part/a.jpg")).unwrap().starts_with(&[0xFF, 0xD8]));
    assert!(std::fs::read(scratch.path("part/glow.png")).unwrap().starts_with(b"\x89PNG"));
    let library = std::fs::read_to_string(scratch.path("part/t.mtl")).unwrap();
    assert!(library.contains("map_Kd a.jpg\nmap_Ke glow.png\n"), "{library}");
    let glb = std::fs::read(scratch.path("part/t.glb")).unwrap();
    let glb = String::from_utf8_lossy(&glb);
    assert_eq!(glb.matches("\"mimeType\":\"image/jpeg\"").count(), 1);
    assert_eq!(glb.matches("\"mimeType\":\"image/png\"").count(), 1);

    // Without them it decodes to the same.
    lodestream(scratch.folder(), "encode t.obj -o bare.lods --texture keep --previews none").ok();
    lodestream(scratch.folder(), "verify bare.lods --against t.obj").ok();
    assert!(!lodestream(scratch.folder(), "info bare.lods --json").stdout.contains("preview"));
    for (file, folder) in [("t.lods", "with"), ("bare.lods", "without")] {
        std::fs::create_dir(scratch.path(folder)).unwrap();
        lodestream(scratch.folder(), &format!("decode {file} -o {folder}/t.obj")).ok();
    }
    for name in ["t.obj", "t.mtl", "a.png", "glow.png"] {
        let [with, without] = ["with", "without"].map(|f| std::fs::read(scratch.path(&format!("{f}/{name}"))).unwrap());
        assert!(with == without, "{name}");
    }
    let run = lodestream(scratch.folder(), "encode t.obj -o t.lods --previews some");
    assert!(run.code == 2 && run.stderr.contains("\"some\" is not auto or none"), "{}", run.stderr);
}

#[test]
fn textures_become_jpeg_where_nobody_sees_it_or_asks_for_it() {
    let scratch = Scratch::new("recompressed");
    scratch
        .write("t.obj", "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n");
    scratch.write("t.mtl", "newmtl a\nmap_Kd a.png\nnorm n.png\nmap_Ke glow.png\n");
    let png = |name: &str, color: png::ColorType| {
        let channels = color.samples() as u32;
        let mut noise = 7u32;
        let mut pixel = |i: u32| {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (i % (200 * channels) / 5 + i / (1000 * channels) + (noise >> 29)) as u8
        };
        let pixels: Vec<u8> = (0..200 * 200 * channels).map(&mut pixel).collect();
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 200, 200);
        encoder.set_color(color);
        encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
        std::fs::write(scratch.path(name), &bytes).unwrap();
        bytes
    };
    png("a.png", png::ColorType::Rgb);
    png("n.png", png::ColorType::Rgb);
    let glow = png("glow.png", png::ColorType::Rgba);

    // By itself at a quality that looks the same, and it says so; not where exactness is asked for.
    let run = lodestream(scratch.folder(), "encode t.obj -o fine.lods").ok();
    let lines: Vec<&str> = run.stderr.lines().collect();
    assert_eq!(lines.len(), 2, "{}", run.stderr);
    for (line, (name, what)) in lines.iter().zip([("a.png", "colour (4:2:0)"), ("n.png", "data (4:4:4)")]) {
        let begin = format!("lodestream: warning: t.obj: {name}: a JPEG of {what} now, not exact: ");
        assert!(line.starts_with(&begin) && line.ends_with("; --texture keep carries it as it is"), "{line}");
    }
    for exact in ["--texture keep", "--exact-images"] {
        let run = lodestream(scratch.folder(), &format!("encode t.obj -o exact.lods {exact}")).ok();
        assert_eq!(run.stderr, "");
        let run = lodestream(scratch.folder(), "verify exact.lods --against t.obj").ok();
        assert!(!run.stdout.contains("not kept"), "{}", run.stdout);
    }

    let run = lodestream(scratch.folder(), "encode t.obj -o t.lods --texture jpeg:90");
    assert_eq!(
        (run.code, run.stderr.as_str()),
        (0, "lodestream: warning: t.obj: glow.png: kept as it is: it has alpha\n")
    );
    assert!(run.stdout.contains("2 of 3 that were no JPEG are one now, not exact: "), "{}", run.stdout);
    let told =
        lodestream(scratch.folder(), "encode t.obj -o t.lods --texture jpeg:90 --json").json()["recompressed"].clone();
    let rows: Vec<_> =
        told.as_array().unwrap().iter().map(|r| (&r["name"], &r["sampling"], &r["kept_because"])).collect();
    assert_eq!(rows[0], (&"a.png".into(), &"4:2:0".into(), &serde_json::Value::Null));
    assert_eq!(rows[1], (&"n.png".into(), &"4:4:4".into(), &serde_json::Value::Null));
    assert_eq!(rows[2], (&"glow.png".into(), &serde_json::Value::Null, &"it has alpha".into()));
    let run = lodestream(scratch.folder(), "verify t.lods --against t.obj").ok();
    let says = "the pixels of \"a.png\", which is a JPEG now, the pixels of \"n.png\", which is a JPEG now";
    assert!(run.stdout.contains(says), "{}", run.stdout);

    // Files are named by what they are, and materials name them so.
    std::fs::create_dir(scratch.path("out")).unwrap();
    lodestream(scratch.folder(), "decode t.lods -o out/t.obj").ok();
    assert!(std::fs::read(scratch.path("out/a.jpg")).unwrap().starts_with(&[0xFF, 0xD8]));
    assert_eq!(std::fs::read(scratch.path("out/glow.png")).unwrap(), glow);
    let library = std::fs::read_to_string(scratch.path("out/t.mtl")).unwrap();
    assert!(library.contains("map_Kd a.jpg\nnorm n.jpg\nmap_Ke glow.png\n"), "{library}");

    let run = lodestream(scratch.folder(), "encode t.obj -o t.lods --texture jpg");
    assert!(run.code == 2 && run.stderr.contains("is not keep, jpeg, or jpeg:QUALITY from 1 to 100"), "{}", run.stderr);
}

#[test]
fn help_has_examples() {
    let scratch = Scratch::new("help");
    for words in ["--help", "encode --help", "decode --help", "info --help", "verify --help", "demo --help"] {
        let run = lodestream(scratch.folder(), words).ok();
        assert!(run.stdout.contains("Examples:\n  lodestream "), "{words}");
    }
    assert!(lodestream(scratch.folder(), "--version").ok().stdout.starts_with("lodestream "));
    let run = lodestream(scratch.folder(), "encode a.obj");
    assert_eq!((run.code, run.stdout.as_str()), (2, ""));
    assert_eq!(run.stderr.lines().count(), 1);
}

#[test]
fn compare_measures_distances_and_looks() {
    let scratch = rock("compare");
    let json =
        lodestream(scratch.folder(), "compare rock.ply rock.lods --samples 5000 --views 3 --size 176 --json").json();
    let step = number(&lodestream(scratch.folder(), "info rock.lods --json").json()["quantization"]["step"]);
    let diagonal = number(&json["geometry"]["diagonal"]);
    for way in ["forward", "backward"] {
        let way = &json["geometry"][way];
        let [mean, rms, max] = ["mean", "rms", "max"].map(|field| number(&way[field]));
        assert!(0.0 < mean && mean < rms && rms < max && max < step, "{way}");
        assert!((number(&way["relative"]["mean"]) * diagonal - mean).abs() < 1e-12);
        assert_eq!(way["samples"]["faces"], 5000);
    }
    assert!(number(&json["appearance"]["ms_ssim"]) > 0.99);
    assert_eq!(json["appearance"]["views"].as_array().unwrap().len(), 3);
    assert!(json["texture_coordinates"].is_null());
    assert_eq!(json["geometry"]["sampling"]["weights"], "area");

    let coarse = "compare rock.ply rock.lods --level 3 --samples 5000 --weigh samples --views 0 --json";
    let far = lodestream(scratch.folder(), coarse).json();
    assert!(number(&far["geometry"]["forward"]["mean"]) > number(&json["geometry"]["forward"]["mean"]));
    assert!(far["appearance"].is_null());
    assert_eq!(far["b"]["level"], 3);

    let table = lodestream(scratch.folder(), "compare rock.ply rock.ply --samples 100 --views 1 --size 161").ok();
    assert!(table.stdout.contains("A to B    mean 0.000000"), "{}", table.stdout);
    assert!(table.stdout.contains("MS-SSIM   1.00000"), "{}", table.stdout);
}

#[test]
fn compare_paints_distances() {
    let scratch = rock("heat");
    for name in ["heat.ply", "heat.png"] {
        lodestream(scratch.folder(), &format!("compare rock.ply rock.lods --samples 500 --views 0 --heatmap {name}"))
            .ok();
    }
    let heat = load(&scratch.path("heat.ply"));
    assert_eq!(heat.face_count(), load(&scratch.path("rock.ply")).face_count());
    assert!(std::fs::read(scratch.path("heat.png")).unwrap().starts_with(b"\x89PNG"));
    let run = lodestream(scratch.folder(), "compare rock.ply rock.lods --heatmap heat.jpg");
    assert_eq!(run.stderr, "lodestream: heat.jpg: a heatmap is a .ply file or a .png picture\n");
    assert_eq!(run.code, 1);
}

#[test]
fn compare_and_render_say_what_is_wrong() {
    let scratch = rock("compare-errors");
    scratch.write("nothing.obj", "");
    for (words, says) in [
        ("compare rock.ply nothing.obj", "nothing.obj: there is nothing to compare: it has no vertices"),
        ("compare rock.ply rock.ply --level 2", "rock.ply: levels are in .lods files; leave --level out"),
        ("compare rock.ply rock.lods --level 999", "rock.lods: there is no level 999: the levels are 0 to "),
        ("render rock.ply -o rock.gif", "rock.gif: pictures are written as .png"),
        ("render gone.ply -o rock.png", "gone.ply: "),
    ] {
        let run = lodestream(scratch.folder(), words);
        assert_eq!(run.code, 1, "{words}");
        assert!(run.stderr.starts_with(&format!("lodestream: {says}")), "{words}: {}", run.stderr);
        assert_eq!(run.stderr.lines().count(), 1);
    }
    assert_eq!(scratch.names(), ["nothing.obj", "rock.lods", "rock.ply"]);
}

#[test]
fn render_draws_levels() {
    let scratch = rock("render");
    for (words, out) in [
        ("render rock.ply --size 64", "a.png"),
        ("render rock.lods --size 64", "b.png"),
        ("render rock.lods --level 2 --size 80x60 --view -40,10 --up z --perspective 40 --shading wire", "c.png"),
        ("render rock.lods --view top --shading flat --size 64", "d.png"),
    ] {
        lodestream(scratch.folder(), &format!("{words} -o {out}")).ok();
        assert!(std::fs::read(scratch.path(out)).unwrap().starts_with(b"\x89PNG"), "{words}");
    }
    let bad = lodestream(scratch.folder(), "render rock.ply -o e.png --view sideways");
    assert_eq!(bad.code, 2);
}

#[test]
fn report_measures_pieces_of_images_too() {
    let scratch = Scratch::new("report-textured");
    let folder = scratch.folder();
    let mut mesh = samples::asteroid(8, 3);
    mesh.layers = vec![Layer {
        name: "TEXCOORD_0".into(),
        kind: LayerKind::Uv,
        width: 2,
        stored: Stored::F32,
        values: mesh.positions.iter().flat_map(|p| [0.5 + 0.4 * p[0], 0.5 + 0.4 * p[1]]).collect(),
        corners: mesh.corners.clone(),
        isolated: Vec::new(),
    }];
    mesh.material = vec![0; mesh.face_count()];
    let side = 320u32;
    let pixels = (0..side * side).flat_map(|i| {
        let (x, y) = (i % side, i / side);
        [(x * y / 97) as u8, (x / 3 + i * 7919 % 13) as u8, (128 + y / 4) as u8]
    });
    let pixels: Vec<u8> = pixels.collect();
    let mut bytes = Vec::new();
    jpeg_encoder::Encoder::new(&mut bytes, 92)
        .encode(&pixels, side as u16, side as u16, jpeg_encoder::ColorType::Rgb)
        .unwrap();
    mesh.appearance.materials = vec![r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#.into()];
    mesh.appearance.textures = vec![r#"{"source":0}"#.into()];
    mesh.appearance.images = vec![Image { name: "c".into(), mime: "image/jpeg".into(), bytes, ..Image::default() }];
    save(&mesh, &scratch.path("rock.glb"));
    let looks = "--samples 300 --views 2 --size 176 --levels 30 --json";
    for order in ["texture-first", "quality --schedule-effort low"] {
        let words = format!("report rock.glb -o out {looks} --schedule {order}");
        let json = lodestream(folder, &words).json();
        let file = &json["files"][0];
        let rows = file["levels"].as_array().unwrap();
        let all = number(&file["image_bytes"]);
        assert!(all > 0.0 && number(&rows[0]["image_bytes"]) == 0.0, "{file}");
        let last = rows.last().unwrap();
        assert_eq!((number(&last["image_bytes"]), number(&last["bytes"])), (all, number(&file["bytes"])));
        assert!(number(&last["ms_ssim"]) > 0.95, "{last}");
        // There are prefixes of one level that differ in their images alone; they have one shape.
        let pairs: Vec<_> = rows.windows(2).filter(|w| w[0]["level"] == w[1]["level"]).collect();
        assert!(pairs.iter().any(|w| number(&w[0]["image_bytes"]) < number(&w[1]["image_bytes"])), "{order}: {file}");
        assert!(pairs.iter().all(|w| w[0]["mean"] == w[1]["mean"]));
        assert!(number(&file["bits_by_kind"]["images"]) > 0.0);
        assert_eq!(file["seconds"]["order"].is_number(), order.starts_with("quality"));
        let page = std::fs::read_to_string(scratch.path("out/report.html")).unwrap();
        assert!(page.contains("of images,") || page.contains("of images<br>"), "the strip says what is there");
    }
}

#[test]
fn report_is_one_page_and_its_data() {
    let scratch = rock("report");
    let words = "report rock.ply rock.lods -o out --levels 4 --samples 500 --views 2 --size 176 --json";
    let json = lodestream(scratch.folder(), words).json();
    let files = json["files"].as_array().unwrap();
    assert_eq!((files[0]["name"].as_str(), files[1]["name"].as_str()), (Some("rock.ply"), Some("rock.lods")));
    for file in files {
        let levels = file["levels"].as_array().unwrap();
        assert!((2..=4).contains(&levels.len()), "{file}");
        let mut last = 0.0;
        for level in levels {
            assert!(number(&level["bytes"]) > last);
            last = number(&level["bytes"]);
            assert!(number(&level["max"]) >= number(&level["rms"]) && number(&level["rms"]) >= number(&level["mean"]));
            assert!(number(&level["max"]) <= number(&level["bound"]), "the bound holds: {level}");
            assert!((0.0..=1.0).contains(&number(&level["ms_ssim"])));
        }
        assert_eq!(last, number(&file["bytes"]));
        assert!(number(&file["seconds"]["decode"]) > 0.0);
    }
    assert!(number(&files[0]["bits_by_kind"]["geometry"]) > 0.0);
    let page = std::fs::read_to_string(scratch.path("out/report.html")).unwrap();
    assert_eq!(page.matches("<polyline").count(), 8, "four charts, two files");
    assert!(!page.contains("of images,") && page.contains("What each prefix is worth"));
    // Nothing is fetched from anywhere.
    assert!(!page.contains("http") && !page.contains("src=\"/") && page.contains("data:image/png;base64,"));
    let data: Value = serde_json::from_slice(&std::fs::read(scratch.path("out/report.json")).unwrap()).unwrap();
    assert_eq!(data["files"], json["files"]);
}
