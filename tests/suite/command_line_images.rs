//! The program on meshes with attributes, materials and images: what comes back, in pieces, in previews, as JPEG.

use crate::common::rock::number;
use crate::common::{Scratch, lodestream};

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
