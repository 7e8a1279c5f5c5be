//! The program as a user starts it: options, JSON fields, files and exit codes.

use crate::common::rock::{load, number, rock, save};
use crate::common::{Scratch, lodestream, lodestream_with};
use lodestream::mesh::Mesh;
use lodestream::samples;
use serde_json::Value;

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
