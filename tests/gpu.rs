//! Devices as a user meets them: choosing one, losing one in the middle of a job, having none.
//!
//! Needs software Vulkan (`llvmpipe`, Debian's `mesa-vulkan-drivers`) for some tests; where it is missing they say that they were
//! skipped, and with `CI=true` fail.
#![cfg(feature = "gpu")]

#[path = "suite/common/mod.rs"]
mod common;

use common::{Scratch, lodestream_in};
use lodestream::encode::cost::{Cpu, Engine, EvaluateError, Evaluator, Fixed, Task};
use lodestream::encode::trace::Trace;
use lodestream::encode::{Control, EncodeOptions, encode, encode_with};
use lodestream::gpu::{Device, DeviceChoice, DeviceOptions, GpuWeights};
use lodestream::io::write::{self, WriteOptions};
use lodestream::samples;

/// The name of software Vulkan, if it is there.
fn software(test: &str) -> Option<Device> {
    match Device::open(&DeviceChoice::Named("llvmpipe".to_string()), DeviceOptions::default()) {
        Ok(device) => Some(device),
        Err(error) => {
            assert!(std::env::var_os("CI").is_none(), "{test}: {error}");
            eprintln!("skipped: {test}: {error}");
            None
        }
    }
}

/// Weighs so many levels, then is lost; leaves rubbish behind.
#[derive(Debug)]
struct LostAfter(Box<dyn Evaluator>, u32);

impl Evaluator for LostAfter {
    fn name(&self) -> String {
        "test device".to_string()
    }

    fn beside(&self) -> bool {
        true
    }

    fn weigh(&mut self, task: &Task, out: &mut [Fixed]) -> Result<u64, EvaluateError> {
        let weighed = self.0.weigh(task, out)?;
        if self.1 == 0 {
            out.fill(Fixed::ILLEGAL);
            return Err(EvaluateError("gone at batch n".into()));
        }
        self.1 -= 1;
        Ok(weighed)
    }
}

#[test]
fn a_device_lost_at_any_level_changes_no_byte() {
    let mesh = samples::ringed_asteroid(10, 20, 1);
    let whole = encode(&mesh, &EncodeOptions::default()).unwrap();
    assert_eq!((whole.report.weighed_by.as_str(), &whole.report.fallback), ("cpu", &None));
    for levels in [0, 1, 2, 5, 11, 1000] {
        let engine = Engine { evaluator: Box::new(LostAfter(Box::new(Cpu), levels)), trace: Trace::off() };
        let encoded = encode_with(&mesh, &EncodeOptions::default(), engine, Control::new()).unwrap();
        assert!(encoded.bytes == whole.bytes && encoded.map == whole.map, "lost after {levels} levels");
        let (by, why) =
            if levels == 1000 { ("test device", None) } else { ("cpu", Some("gone at batch n".to_string())) };
        assert_eq!((encoded.report.weighed_by.as_str(), encoded.report.fallback), (by, why));
    }
}

#[test]
fn software_vulkan_makes_the_same_file() {
    let Some(device) = software("software_vulkan_makes_the_same_file") else { return };
    let name = device.info().name.clone();
    let mesh = samples::ringed_asteroid(12, 60, 1);
    let whole = encode(&mesh, &EncodeOptions::default()).unwrap();
    let trace = Trace::on();
    let engine = Engine { evaluator: Box::new(GpuWeights::new(device).unwrap()), trace: trace.clone() };
    let encoded = encode_with(&mesh, &EncodeOptions::default(), engine, Control::new()).unwrap();
    assert!(encoded.bytes == whole.bytes, "twins agree bit for bit on this device, so files do");
    assert_eq!((encoded.report.weighed_by, encoded.report.fallback), (name, None));
    assert_eq!(encoded.report.edges_weighed, whole.report.edges_weighed);
    let json: serde_json::Value = serde_json::from_str(&trace.to_json()).unwrap();
    let names: Vec<&str> = json["traceEvents"].as_array().unwrap().iter().filter_map(|e| e["name"].as_str()).collect();
    for name in [
        "upload level",
        "upload changes",
        "upload edges",
        "wait for edge_weight",
        "make integers",
        "collapse",
        "bound errors",
    ] {
        assert!(names.contains(&name), "{name}");
    }
}

#[test]
fn a_level_stays_on_the_device_from_batch_to_batch() {
    let Some(device) = software("a_level_stays_on_the_device_from_batch_to_batch") else { return };
    let options = EncodeOptions::default();
    let (mut whole, mut changes) = (0, 0);
    // One evaluator for all: nothing of one mesh may be left for the next.
    let mut evaluator: Box<dyn Evaluator> = Box::new(GpuWeights::new(device).unwrap());
    for name in ["mixed", "soup", "crumbs", "torus"] {
        let mesh = samples::by_name(name, 3000, 7).unwrap();
        let by_cpu = encode(&mesh, &options).unwrap();
        let trace = Trace::on();
        let lent = Lent::new(evaluator);
        let engine = Engine { evaluator: Box::new(lent.clone()), trace: trace.clone() };
        let encoded = encode_with(&mesh, &options, engine, Control::new()).unwrap();
        evaluator = lent.back();
        assert!(encoded.bytes == by_cpu.bytes && encoded.report.fallback.is_none(), "{name}");
        let count = |what: &str| trace.to_json().matches(&format!("\"{what}\"")).count();
        whole += count("upload level");
        changes += count("upload changes");
    }
    assert!(whole >= 4 && changes > 4 * whole, "{whole} {changes}");
}

/// An evaluator that can be had back.
#[derive(Clone, Debug)]
struct Lent(std::sync::Arc<std::sync::Mutex<Option<Box<dyn Evaluator>>>>);

impl Lent {
    fn new(evaluator: Box<dyn Evaluator>) -> Self {
        Lent(std::sync::Arc::new(std::sync::Mutex::new(Some(evaluator))))
    }

    fn back(&self) -> Box<dyn Evaluator> {
        self.0.lock().unwrap().take().unwrap()
    }
}

impl Evaluator for Lent {
    fn name(&self) -> String {
        "lent".to_string()
    }

    fn beside(&self) -> bool {
        true
    }

    fn weigh(&mut self, task: &Task, out: &mut [Fixed]) -> Result<u64, EvaluateError> {
        self.0.lock().unwrap().as_mut().unwrap().weigh(task, out)
    }
}

fn rock(name: &str) -> Scratch {
    let scratch = Scratch::new(name);
    write::write_path(scratch.path("rock.ply"), &samples::ringed_asteroid(12, 60, 1), None, &WriteOptions::default())
        .unwrap();
    lodestream_in(scratch.folder(), "encode rock.ply -o cpu.lods --device cpu", &[]).ok();
    scratch
}

#[test]
fn the_program_goes_on_without_its_device() {
    let scratch = rock("gpu-lost");
    let same = |out: &str| {
        let (a, b) = (std::fs::read(scratch.path(out)).unwrap(), std::fs::read(scratch.path("cpu.lods")).unwrap());
        assert!(a == b, "{out}");
    };
    // No driver at all.
    let none = [
        ("VK_ICD_FILENAMES", "/there/is/no/driver.json".to_string()),
        ("VK_DRIVER_FILES", "/there/is/no/driver.json".to_string()),
    ];
    let run = lodestream_in(scratch.folder(), "encode rock.ply -o none.lods --device gpu:llvmpipe --json", &none).ok();
    let warning = "lodestream: warning: no device is called \"llvmpipe\"; there is none; the processor weighs the edges instead\n";
    assert_eq!(run.stderr.replace("lodestream: warning: no GPU found; the", "lodestream: the"), warning);
    assert_eq!(run.json()["device"], "cpu");
    same("none.lods");
    // `auto` has nothing to say about it.
    let run = lodestream_in(scratch.folder(), "encode rock.ply -o auto.lods --json", &none).ok();
    assert_eq!(run.stderr, "");
    same("auto.lods");
    let devices = lodestream_in(scratch.folder(), "devices --json", &none).json();
    assert_eq!(devices["devices"].as_array().map(Vec::len), Some(0));
    assert_eq!(devices["auto"], "cpu");

    // A device that is lost on the way.
    if software("the_program_goes_on_without_its_device").is_none() {
        return;
    }
    let line =
        |text: &str| text.lines().filter(|l| l.starts_with("lodestream:")).map(str::to_string).collect::<Vec<_>>();
    let lost = [("LODESTREAM_LOSE_DEVICE", "3".to_string())];
    let words = "encode rock.ply -o lost.lods --device gpu:lavapipe --gpu-memory 1MB --trace trace.json --json";
    let run = lodestream_in(scratch.folder(), words, &lost).ok();
    let lines = line(&run.stderr);
    assert_eq!(lines.len(), 1, "{}", run.stderr);
    assert!(lines[0].starts_with("lodestream: warning: llvmpipe"), "{lines:?}");
    assert!(lines[0].ends_with("LODESTREAM_LOSE_DEVICE says so; the processor weighs the edges instead"), "{lines:?}");
    assert_eq!(run.json()["device"], "cpu");
    same("lost.lods");
    lodestream_in(scratch.folder(), "verify lost.lods --against rock.ply", &[]).ok();
    let trace: serde_json::Value = serde_json::from_slice(&std::fs::read(scratch.path("trace.json")).unwrap()).unwrap();
    assert!(trace["traceEvents"].as_array().is_some_and(|e| e.len() > 20));
    // And one that is not.
    let run = lodestream_in(scratch.folder(), "encode rock.ply -o gpu.lods --device gpu:lavapipe --json", &[]).ok();
    assert!(line(&run.stderr).is_empty(), "{}", run.stderr);
    assert!(run.json()["device"].as_str().is_some_and(|d| d.starts_with("llvmpipe")));
    same("gpu.lods");
    let text = lodestream_in(scratch.folder(), "devices", &[]).ok().stdout;
    assert!(text.contains("gpu:llvmpipe") && text.contains("software by vulkan"), "{text}");
}

#[test]
fn jobs_share_a_device_and_go_on_without_it() {
    if software("jobs_share_a_device_and_go_on_without_it").is_none() {
        return;
    }
    let scratch = Scratch::new("gpu-ingest");
    std::fs::create_dir(scratch.path("in")).unwrap();
    let names = ["a", "b", "c", "d", "e"];
    for (i, name) in names.iter().enumerate() {
        let mesh = samples::ringed_asteroid(8, 30 + i as u32, i as u64);
        write::write_path(scratch.path(&format!("in/{name}.ply")), &mesh, None, &WriteOptions::default()).unwrap();
    }
    let ingest = |out: &str, rest: &str, environment: &[(&str, String)]| {
        let words = format!("ingest in -o {out} --jobs 2 --threads 2 --report {out}.json --log-format json {rest}");
        let run = lodestream_in(scratch.folder(), &words, environment).ok();
        let report: serde_json::Value =
            serde_json::from_slice(&std::fs::read(scratch.path(&format!("{out}.json"))).unwrap()).unwrap();
        let files: Vec<serde_json::Value> = report["files"].as_array().unwrap().clone();
        assert_eq!(files.len(), names.len());
        let warnings = run.stderr.lines().filter(|l| l.contains("\"WARN\"")).count();
        (files, warnings)
    };
    let same = |out: &str| {
        for name in names {
            let read = |folder: &str| std::fs::read(scratch.path(&format!("{folder}/{name}.lods"))).unwrap();
            assert!(read(out) == read("cpu"), "{out}/{name}");
        }
    };
    let on = |files: &[serde_json::Value], device: &str| {
        files.iter().filter(|f| f["device"].as_str().is_some_and(|d| d.starts_with(device))).count()
    };
    let (files, warnings) = ingest("cpu", "--device cpu", &[]);
    assert_eq!((on(&files, "cpu"), warnings), (5, 0));
    // Small files are left to the processor.
    let (files, warnings) = ingest("auto", "", &[]);
    assert_eq!((on(&files, "cpu"), warnings), (5, 0));
    let (files, warnings) = ingest("gpu", "--device gpu:llvmpipe --gpu-memory 64MB", &[]);
    assert_eq!((on(&files, "llvmpipe"), warnings), (5, 0));
    same("gpu");
    let (files, warnings) =
        ingest("lost", "--device gpu:llvmpipe --verify", &[("LODESTREAM_LOSE_DEVICE", "2".to_string())]);
    assert_eq!((on(&files, "cpu"), warnings), (5, 5));
    same("lost");
    let none = [
        ("VK_ICD_FILENAMES", "/there/is/no/driver.json".to_string()),
        ("VK_DRIVER_FILES", "/there/is/no/driver.json".to_string()),
    ];
    let (files, warnings) = ingest("none", "--device gpu", &none);
    assert_eq!((on(&files, "cpu"), warnings), (5, 1));
    same("none");
}
