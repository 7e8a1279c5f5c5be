//! `compare`, `render` and `report` as a user starts them.

use crate::common::rock::{load, number, rock, save};
use crate::common::{Scratch, lodestream};
use lodestream::mesh::{Image, Layer, LayerKind, Stored};
use lodestream::samples;
use serde_json::Value;

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
        ("compare rock.ply rock.ply --max-error 2", "rock.ply: levels are in .lods files; leave --max-error out"),
        ("render rock.ply -o no.png --max-bytes 2", "rock.ply: levels are in .lods files; leave --max-bytes out"),
        ("render rock.lods -o no.png --max-vertices 0", "rock.lods: level 0 has "),
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
    // One set of options chooses a level everywhere.
    let info = lodestream(scratch.folder(), "info rock.lods --json").json();
    let middle = &info["levels"][3];
    let [vertices, bytes] = ["vertices", "prefix_bytes"].map(|field| middle[field].as_u64().unwrap());
    let error = number(&middle["error"]);
    for choice in [
        "--level 3".to_string(),
        format!("--max-vertices {vertices}"),
        format!("--max-bytes {bytes}"),
        format!("--max-error {error}"),
    ] {
        let compared = format!("compare rock.ply rock.lods {choice} --samples 100 --views 0 --json");
        let compared = lodestream(scratch.folder(), &compared).json();
        let decoded = lodestream(scratch.folder(), &format!("decode rock.lods -o f.ply --json {choice}")).json();
        assert_eq!(compared["b"]["level"], decoded["level"], "{choice}");
        lodestream(scratch.folder(), &format!("render rock.lods -o f.png --size 64 {choice}")).ok();
    }
    let bad = lodestream(scratch.folder(), "render rock.lods -o e.png --level 1 --max-bytes 2");
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
