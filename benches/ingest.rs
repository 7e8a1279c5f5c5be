//! What `lodestream ingest` reaches: throughput against single runs, memory against prediction, many tiny files, reading.
//!
//! `cargo bench --bench ingest -- [throughput] [memory] [tiny] [reading] [--files N] [--largest V] [--tiny N]`. Without a
//! word all four run on the full set: 500 files from 1,000 to 500,000 vertices, generated and, with `LODESTREAM_DATA`, real.
//! Everything starts the real program. Ratios of two runs on one machine mean something there even when it is busy;
//! seconds alone do not.

use lodestream::io::read::{DropSet, Format, ReadOptions, read_bytes, survey};
use lodestream::io::write::{WriteOptions, write_path, write_to};
use lodestream::mesh::{Layer, LayerKind, Mesh, Stored};
use lodestream::samples;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

struct Options {
    files: u32,
    largest: u32,
    tiny: u32,
    words: Vec<String>,
}

fn main() {
    let mut o = Options { files: 500, largest: 500_000, tiny: 100_000, words: Vec::new() };
    let mut arguments = std::env::args().skip(1);
    while let Some(a) = arguments.next() {
        let mut number = || arguments.next().and_then(|n| n.parse().ok()).expect("a number follows");
        match a.as_str() {
            "--files" => o.files = number(),
            "--largest" => o.largest = number(),
            "--tiny" => o.tiny = number(),
            "--smoke" => (o.files, o.largest, o.tiny) = (8, 4000, 300),
            // Cargo's own.
            "--bench" | "--full" => {}
            word => o.words.push(word.to_string()),
        }
    }
    let asked = |word: &str| o.words.is_empty() || o.words.iter().any(|w| w == word);
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("ingest-bench");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the bench");
    if asked("reading") {
        reading(o.largest);
    }
    if asked("tiny") {
        tiny(&folder, o.tiny);
    }
    if asked("throughput") || asked("memory") {
        let files = make(&folder.join("raw"), o.files, o.largest);
        if asked("memory") {
            memory(&folder, &files);
        }
        if asked("throughput") {
            throughput(&folder, &files);
        }
    }
    let _ = std::fs::remove_dir_all(&folder);
}

fn program(folder: &Path, words: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_lodestream")).args(words).current_dir(folder).output().expect("the program starts")
}

/// Sizes from 1,000 to `largest`, each step by the same factor; shapes and formats in turn. Real meshes join in.
fn make(folder: &Path, count: u32, largest: u32) -> Vec<PathBuf> {
    std::fs::create_dir_all(folder).expect("a folder for the set");
    let mut files: Vec<PathBuf> = real(largest);
    let shapes = ["asteroid", "terrain", "mixed", "torus", "crumbs", "sphere", "cylinder", "points"];
    let formats = ["ply", "obj", "glb", "stl"];
    let generated = count.saturating_sub(files.len() as u32);
    for i in 0..generated {
        let share = f64::from(i) / f64::from(generated.max(2) - 1);
        let size = 1000.0 * (f64::from(largest) / 1000.0).powf(share);
        let shape = shapes[i as usize % shapes.len()];
        let mut mesh = samples::by_name(shape, size as u32, u64::from(i)).expect("a known shape");
        if i % 4 == 3 {
            with_attributes(&mut mesh, 1 + i / 4 % 7);
        }
        // Points and dangling edges have no place in STL.
        let format = if shape == "points" || shape == "crumbs" { "ply" } else { formats[(i / 3) as usize % 4] };
        let path = folder.join(format!("{i:03}-{shape}.{format}"));
        write_path(&path, &mesh, None, &WriteOptions::default()).expect("the file is written");
        files.push(path);
    }
    println!("set: {} files, {} of them real", files.len(), files.len() - generated as usize);
    files
}

/// Give a mesh attributes that say nothing new: texture coordinates, normals, colours, a bit of `which` each.
fn with_attributes(mesh: &mut Mesh, which: u32) {
    let mut alone = vec![true; mesh.positions.len()];
    mesh.corners.iter().for_each(|&v| alone[v as usize] = false);
    let isolated: Vec<[u32; 2]> = (0..alone.len() as u32).filter(|&v| alone[v as usize]).map(|v| [v, v]).collect();
    for (bit, name, kind, width) in
        [(1, "uv", LayerKind::Uv, 2), (2, "normal", LayerKind::Normal, 3), (4, "color", LayerKind::Color, 3)]
    {
        if which & bit == 0 {
            continue;
        }
        let value = |p: &[f64; 3]| {
            let length = p.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-9);
            let unit = p.map(|x| x / length);
            if kind == LayerKind::Normal { unit } else { unit.map(|x| 0.5 + 0.5 * x) }
        };
        let values = mesh.positions.iter().flat_map(|p| value(p).into_iter().take(width)).collect();
        mesh.layers.push(Layer {
            name: name.to_string(),
            kind,
            width: width as u8,
            stored: Stored::F32,
            values,
            corners: mesh.corners.clone(),
            isolated: isolated.clone(),
        });
    }
}

fn real(largest: u32) -> Vec<PathBuf> {
    let Ok(data) = std::env::var("LODESTREAM_DATA") else {
        println!("LODESTREAM_DATA is not set: generated meshes only");
        return Vec::new();
    };
    let names = [
        "classic/horse.ply",
        "classic/armadillo.obj",
        "classic/bimba_original.off",
        "classic/hippo.ply",
        "classic/rocker-arm.obj",
        "classic/bun_zipper.ply",
        "classic/beast.obj.gz",
        "bad/cycloidal.ply",
        "bad/busted.STL",
        "textured/DamagedHelmet.glb",
        "instanced/2CylinderEngine.glb",
        "polygon/polygon_mesh.off",
        "points/b9_training.ply.gz",
        "classic/dragon_vrip.ply.gz",
        "points/rangemap_lato000.ply",
        "colour/livingroom1_fragment_002.ply",
        "colour/rgb_nefertiti.off",
        "colour/colored_airplane.ply",
        "textured/SciFiHelmet/SciFiHelmet.gltf",
        "textured/FlightHelmet/FlightHelmet.gltf",
        "textured/ToyCar/ToyCar.gltf",
        "textured/Avocado/Avocado.gltf",
        "textured/YcbBanana/textured_simple_reoriented.obj",
        "textured/bunny10k/bunny10k_textured.obj",
        "textured/openmvs_scene_mesh_texture.ply",
    ];
    let small = |name: &&&str| largest >= 400_000 || !name.contains("dragon");
    names.iter().filter(small).map(|n| Path::new(&data).join(n)).filter(|p| p.is_file()).collect()
}

fn report(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("a report")).expect("JSON")
}

/// Every file in a run of its own: what it was expected to take, and what it took.
fn memory(folder: &Path, files: &[PathBuf]) {
    println!("\npredicted and measured peak memory, MB, each file in a run of its own");
    let mut offs: Vec<f64> = Vec::new();
    // One in so many is enough to see the formula: shapes, formats and sizes all step with different periods.
    let step = (files.len() / 60).max(1);
    let wanted = files.iter().enumerate().filter(|(i, f)| i % step == 0 || !f.starts_with(folder));
    for (_, file) in wanted {
        let name = file.to_string_lossy();
        let run = program(folder, &["ingest", &name, "-o", "memory", "--jobs", "1", "--report", "memory.json"]);
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        let json = report(&folder.join("memory.json"));
        let number = |v: &Value| v.as_f64().unwrap_or(0.0) / 1e6;
        let (foreseen, took) = (number(&json["summary"]["predicted_bytes"]), number(&json["summary"]["peak_bytes"]));
        let f = &json["files"][0];
        offs.push(foreseen / took - 1.0);
        let format = Format::from_path(file).expect("a known format");
        let told = survey(std::fs::File::open(file).expect("the file"), format).expect("its survey");
        let values = told.carried(DropSet::NONE);
        println!(
            "{:36} {:>7} v {:>7} f {:>7} c {:>2} layers {:>8} numbers  predicted {foreseen:8.1}  measured {took:8.1}  {:+6.1} %",
            file.file_name().unwrap_or_default().to_string_lossy(),
            f["vertices"],
            f["faces"],
            told.corners,
            values.layers,
            values.numbers,
            100.0 * (foreseen / took - 1.0)
        );
    }
    let within = |x: f64| offs.iter().filter(|o| o.abs() <= x).count();
    let worst = offs.iter().fold(0.0f64, |a, o| if o.abs() > a.abs() { *o } else { a });
    println!(
        "within 10 %: {} of {}, within 25 %: {}; worst {:+.1} %",
        within(0.1),
        offs.len(),
        within(0.25),
        100.0 * worst
    );
}

/// The sum of single runs on one core against one run on all, in time and in memory.
fn throughput(folder: &Path, files: &[PathBuf]) {
    let list: String = files
        .iter()
        .enumerate()
        .fold("source,output\n".to_string(), |list, (i, f)| list + &format!("\"{}\",{i}\n", f.display()));
    std::fs::write(folder.join("jobs.csv"), list).expect("a manifest");
    let mut single = 0.0;
    for file in files {
        let clock = Instant::now();
        let run = program(folder, &["encode", &file.to_string_lossy(), "-o", "single.lods", "--threads", "1"]);
        single += clock.elapsed().as_secs_f64();
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    }
    let clock = Instant::now();
    let run =
        program(folder, &["ingest", "-o", "all", "--manifest", "jobs.csv", "--memory", "2GiB", "--report", "all.json"]);
    let together = clock.elapsed().as_secs_f64();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let s = &report(&folder.join("all.json"))["summary"];
    println!("\n{}", String::from_utf8_lossy(&run.stdout));
    println!("one after another on one core {single:.1} s, ingest {together:.1} s: {:.2} ×", single / together);
    println!("peak memory {} of {} allowed, {} foreseen", s["peak_bytes"], s["memory"], s["predicted_bytes"]);
}

/// A folder of tiny files: when the first output is there, how long all take, how much memory.
fn tiny(folder: &Path, count: u32) {
    let raw = folder.join("tiny");
    std::fs::create_dir_all(&raw).expect("a folder");
    for i in 0..count {
        let mesh = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 {}\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 1 3 4\n", 1 + i % 97);
        std::fs::write(raw.join(format!("{i:06}.obj")), mesh).expect("a file");
    }
    let out = folder.join("tiny-out");
    let clock = Instant::now();
    let mut child = Command::new(env!("CARGO_BIN_EXE_lodestream"))
        .args(["ingest", "tiny", "-o", "tiny-out", "--report", "tiny.json"])
        .current_dir(folder)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .expect("the program starts");
    let is_output = |e: std::fs::DirEntry| e.path().extension().is_some_and(|x| x == "lods");
    while !std::fs::read_dir(&out).is_ok_and(|mut d| d.any(|e| e.is_ok_and(is_output)))
        && clock.elapsed().as_secs() < 60
    {
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let first = clock.elapsed().as_secs_f64();
    assert!(child.wait().expect("it ends").success());
    let s = &report(&folder.join("tiny.json"))["summary"];
    println!(
        "\n{count} tiny files: first output after {first:.2} s, all after {} s, peak {} bytes",
        s["seconds"], s["peak_bytes"]
    );
}

/// Seconds that this thread has been on a core, which others' work lengthens less than the clock; the clock where the
/// system does not tell.
fn cpu_seconds() -> f64 {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = told.and_then(|t| t.split_whitespace().next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| std::time::UNIX_EPOCH.elapsed().map_or(0.0, |d| d.as_secs_f64()), |n| n / 1e9)
}

/// Bytes of file for each second of a core, read into a mesh; the best of five.
fn reading(size: u32) {
    println!(
        "\nreading on one core, a terrain of {size} vertices and, with LODESTREAM_DATA, dragon (welded where the format repeats vertices)"
    );
    let dragon = std::env::var("LODESTREAM_DATA").ok().and_then(|d| {
        let path = Path::new(&d).join("classic/dragon_vrip.ply.gz");
        Some(lodestream::io::read::read_path(path, &ReadOptions::default()).ok()?.mesh)
    });
    let terrain = samples::terrain(size, 1);
    for (what, mesh) in [("terrain", Some(&terrain)), ("dragon", dragon.as_ref())] {
        let Some(mesh) = mesh else { continue };
        for (name, format) in [("OBJ", Format::Obj), ("PLY", Format::Ply), ("GLB", Format::Glb), ("STL", Format::Stl)] {
            let mut bytes = Vec::new();
            write_to(&mut bytes, format, mesh, None).expect("written");
            let best = (0..5)
                .map(|_| {
                    let clock = cpu_seconds();
                    let read = read_bytes(&bytes, format, None, &ReadOptions::default()).expect("read");
                    std::hint::black_box(&read);
                    cpu_seconds() - clock
                })
                .fold(f64::INFINITY, f64::min);
            println!(
                "{what:8} {name}: {:7.0} MB/s of {:.1} MB",
                bytes.len() as f64 / 1e6 / best,
                bytes.len() as f64 / 1e6
            );
        }
    }
}
