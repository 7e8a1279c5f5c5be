//! Pictures and scores by both renderers, as a user meets them; on real models where `LODESTREAM_DATA` is set.
//!
//! Needs software Vulkan (`llvmpipe`, Debian's `mesa-vulkan-drivers`) for most tests; where it is missing they say that they were
//! skipped, and with `CI=true` fail.
#![cfg(feature = "gpu")]

use crate::common::{Scratch, datasets, lodestream_in};
use lodestream::gpu::{Device, DeviceChoice, DeviceOptions, GpuRenderer};
use lodestream::io::write::{self, WriteOptions};
use lodestream::mesh::Mesh;
use lodestream::quality::picture::{Cpu, Picture, Shading};
use lodestream::quality::{Snapshots, ViewOptions};
use lodestream::samples;

/// By how much scores of one renderer may differ from those of the other. Their pictures differ in a few of a thousand pixels, by rounding; a
/// mean over views of means over pixels hardly moves.
const SCORE: f64 = 1e-4;
/// Levels of 255 that rounding may move a channel.
const LEVELS: u8 = 2;
/// Pixels of a thousand in which more may differ.
const AT_MOST: f64 = 2.0;

/// The renderer on software Vulkan, if it is there.
fn software(test: &str) -> Option<GpuRenderer> {
    let choice = DeviceChoice::Named("llvmpipe".to_string());
    match Device::open(&choice, DeviceOptions::default()).and_then(GpuRenderer::new) {
        Ok(gpu) => Some(gpu),
        Err(error) => {
            assert!(std::env::var_os("CI").is_none(), "{test}: {error}");
            eprintln!("skipped: {test}: {error}");
            None
        }
    }
}

/// Pixels of a thousand in which pictures differ by more than rounding.
fn beyond(a: &[Picture], b: &[Picture]) -> f64 {
    let (mut far, mut all) = (0usize, 0usize);
    for (a, b) in a.iter().zip(b) {
        for (a, b) in a.rgb.as_chunks::<3>().0.iter().zip(b.rgb.as_chunks::<3>().0) {
            far += usize::from((0..3).any(|k| a[k].abs_diff(b[k]) > LEVELS));
            all += 1;
        }
    }
    1000.0 * far as f64 / all as f64
}

/// The same with its vertices on a grid of so many steps.
fn rounded(mesh: &Mesh, steps: f64) -> Mesh {
    let (lo, hi) = mesh.bounds().unwrap();
    let step = (0..3).map(|k| hi[k] - lo[k]).fold(0.0, f64::max) / steps;
    let mut other = mesh.clone();
    other.positions.iter_mut().for_each(|p| *p = p.map(|c| (c / step).round() * step));
    other
}

/// Pictures and scores of a mesh and of coarser ones by both renderers.
fn agree(gpu: &GpuRenderer, name: &str, mesh: &Mesh) {
    let options = ViewOptions { views: 4, size: 256, shading: Shading::Smooth };
    let by_cpu = Snapshots::new(mesh, &Cpu, &options).unwrap();
    let by_gpu = Snapshots::new(mesh, gpu, &options).unwrap();
    let far = beyond(by_cpu.pictures(), by_gpu.pictures());
    assert!(far <= AT_MOST, "{name}: {far} of a thousand pixels differ");
    for steps in [200.0, 40.0] {
        let other = rounded(mesh, steps);
        let (a, b) = (by_cpu.compare(&other, &Cpu).unwrap(), by_gpu.compare(&other, gpu).unwrap());
        let apart = (a.ms_ssim - b.ms_ssim).abs();
        println!("{name}: {far:.3} of a thousand pixels; {:.6} at {steps} steps, {apart:.1e} apart", a.ms_ssim);
        assert!(apart <= SCORE, "{name}: {} by the processor, {} by the device", a.ms_ssim, b.ms_ssim);
    }
    assert_eq!(gpu.failure(), None, "{name}");
}

#[test]
fn scores_do_not_depend_on_the_renderer() {
    let Some(gpu) = software("scores_do_not_depend_on_the_renderer") else { return };
    agree(&gpu, "asteroid", &samples::asteroid(20, 4));
    agree(&gpu, "mixed", &samples::mixed(30, 30, 4));
    let names = [
        "classic/fandisk",
        "textured/avocado",
        "textured/bunny10k_textured",
        "textured/damagedhelmet",
        "textured/duck",
        "textured/spot",
        "textured/textured_simple_reoriented",
    ];
    for dataset in datasets::available(|d| names.contains(&d.name.as_str())) {
        agree(&gpu, &dataset.name, &dataset.load(None).unwrap());
    }
}

#[test]
fn the_program_draws_where_it_is_told_to() {
    let scratch = Scratch::new("pictures");
    let options = WriteOptions::default();
    write::write_path(scratch.path("fine.ply"), &samples::asteroid(14, 4), None, &options).unwrap();
    write::write_path(scratch.path("coarse.ply"), &samples::asteroid(7, 4), None, &options).unwrap();
    let run = |words: &str, environment: &[(&str, String)]| lodestream_in(scratch.folder(), words, environment).ok();
    let lines =
        |text: &str| text.lines().filter(|l| l.starts_with("lodestream:")).map(str::to_string).collect::<Vec<_>>();
    let compare = "compare fine.ply coarse.ply --samples 1000 --views 12 --size 180 --json --device";
    let expected = run(&format!("{compare} cpu"), &[]).json();
    assert_eq!(expected["appearance"]["device"], "cpu");
    let score = &expected["appearance"]["ms_ssim"];
    // Little to draw, or nothing: `auto` does not even look for a device.
    assert_eq!(run(&format!("{compare} auto"), &[]).json()["appearance"]["ms_ssim"], *score);
    let blind = run("compare fine.ply coarse.ply --samples 1000 --views 0 --json --device gpu:llvmpipe", &[]);
    assert!(blind.json()["appearance"].is_null());

    let none = [
        ("VK_ICD_FILENAMES", "/there/is/no/driver.json".to_string()),
        ("VK_DRIVER_FILES", "/there/is/no/driver.json".to_string()),
    ];
    let without = run(&format!("{compare} gpu:llvmpipe"), &none);
    let warning = "lodestream: warning: no device is called \"llvmpipe\"; there is none; the processor draws instead";
    assert_eq!(lines(&without.stderr), [warning]);
    assert_eq!(without.json()["appearance"]["ms_ssim"], *score);
    assert_eq!(without.json()["appearance"]["device"], "cpu");

    if software("the_program_draws_where_it_is_told_to").is_none() {
        return;
    }
    let drawn = run(&format!("{compare} gpu:lavapipe --gpu-memory 64MB"), &[]);
    assert!(lines(&drawn.stderr).is_empty(), "{}", drawn.stderr);
    let look = &drawn.json()["appearance"];
    assert!(look["device"].as_str().is_some_and(|d| d.starts_with("llvmpipe")), "{look}");
    let (a, b) = (score.as_f64().unwrap(), look["ms_ssim"].as_f64().unwrap());
    assert!((a - b).abs() <= SCORE, "{a} {b}");

    // Lost while the first mesh is drawn, while the second one is: pictures of one renderer are never compared with the other's.
    for after in ["3", "17"] {
        let lost = run(&format!("{compare} gpu:llvmpipe"), &[("LODESTREAM_LOSE_DEVICE", after.to_string())]);
        let said = lines(&lost.stderr);
        assert_eq!(said.len(), 1, "{said:?}");
        assert!(said[0].starts_with("lodestream: warning: llvmpipe"), "{said:?}");
        assert!(said[0].ends_with("LODESTREAM_LOSE_DEVICE says so; the processor draws instead"), "{said:?}");
        assert_eq!(lost.json()["appearance"]["ms_ssim"], *score);
        assert_eq!(lost.json()["appearance"]["device"], "cpu");
    }

    let text = run("render fine.ply -o gpu.png --size 90x70 --device gpu:llvmpipe", &[]).stdout;
    assert!(text.lines().any(|l| l.starts_with("drawn by") && l.contains("llvmpipe")), "{text}");
    let text = run("render fine.ply -o cpu.png --size 90x70", &[]).stdout;
    assert!(text.lines().any(|l| l.starts_with("drawn by") && l.ends_with("cpu")), "{text}");
    let [a, b] = ["gpu.png", "cpu.png"].map(|name| {
        let bytes = std::fs::read(scratch.path(name)).unwrap();
        let pixels = lodestream::quality::picture::decode(&bytes).unwrap();
        let rgb = pixels.rgba.as_chunks::<4>().0.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
        Picture { width: pixels.width, height: pixels.height, rgb }
    });
    assert!(beyond(&[a], &[b]) <= AT_MOST);

    let words = "report fine.ply -o page --levels 3 --samples 1000 --views 2 --size 180 --json --device gpu:llvmpipe";
    let report = run(words, &[]).json();
    assert!(report["files"][0]["device"].as_str().is_some_and(|d| d.starts_with("llvmpipe")));
}
