//! Speed of each kernel and stage, the processor and every device side by side: `cargo bench --bench weigh`.
//!
//! With `LODESTREAM_DATA` it takes the dragon, else a noisy sphere; `--smoke` a small one. Beside the table on the terminal it
//! writes `weigh.json` and `weigh.html` (one page, nothing to fetch) to `bench-report` in the target folder. Rates are by the wall
//! clock, and by the processor time of the whole program, which other work on the machine disturbs less: a software
//! device spends it too.
#![allow(missing_docs)]

use std::time::Instant;

use lodestream::encode::cost::{BoundScratch, Class, EdgeList, Gatherer, Patch, WeighInput, Weigher, hausdorff_bound};
use lodestream::encode::cost::{Cpu, Engine, Evaluator, Fixed, Scale, SeamPatch, Task, seam_displacement};
use lodestream::encode::simplify::{SelectInput, SelectOptions, select};
use lodestream::encode::trace::Trace;
use lodestream::encode::{Control, EncodeOptions, encode_with};
use lodestream::format::complex::{Faces, Star};
use lodestream::gpu::{
    Device, DeviceChoice, DeviceOptions, Distances, GpuWeights, devices, distances, seam_displacements,
};
use lodestream::io::read::{ReadOptions, read_path};
use lodestream::mesh::Mesh;
use lodestream::samples;
use serde_json::{Value, json};

/// Time this thread spent on a core, where the system says so (others may share the machine), else time that passed.
struct Clock(Option<u64>, Instant);

impl Clock {
    fn busy() -> Option<u64> {
        std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse().ok()
    }

    fn now() -> Self {
        Clock(Clock::busy(), Instant::now())
    }

    fn seconds(&self) -> f64 {
        match (self.0, Clock::busy()) {
            (Some(from), Some(to)) => (to - from) as f64 * 1e-9,
            _ => self.1.elapsed().as_secs_f64(),
        }
    }
}

/// One line of the report.
struct Row {
    mesh: String,
    what: &'static str,
    device: String,
    items: u64,
    unit: &'static str,
    seconds: f64,
    cpu_seconds: f64,
}

impl Row {
    fn rate(&self) -> f64 {
        self.items as f64 / self.seconds.max(1e-9)
    }

    fn per_cpu(&self) -> Option<f64> {
        (self.cpu_seconds > 0.015).then(|| self.items as f64 / self.cpu_seconds)
    }

    fn json(&self) -> Value {
        json!({
            "mesh": self.mesh, "what": self.what, "device": self.device, "items": self.items, "unit": self.unit,
            "seconds": self.seconds, "cpu_seconds": self.cpu_seconds, "per_second": self.rate(),
            "per_cpu_second": self.per_cpu(),
        })
    }
}

/// Processor time of this program so far, all threads, where the system says so; in hundredths of a second.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<f64> = stat.rsplit(')').next().unwrap_or("").split(' ').filter_map(|f| f.parse().ok()).collect();
    // Fields 14 and 15 of the line; the name in parentheses, the state and 10 numbers are before them.
    fields.get(10..12).map_or(0.0, |t| (t[0] + t[1]) / 100.0)
}

/// The least wall time, and the least processor time, of a few runs.
fn best(runs: usize, mut work: impl FnMut()) -> (f64, f64) {
    let mut best = (f64::INFINITY, f64::INFINITY);
    for _ in 0..runs {
        let (clock, cpu) = (Instant::now(), cpu_seconds());
        work();
        best = (best.0.min(clock.elapsed().as_secs_f64()), best.1.min(cpu_seconds() - cpu));
    }
    best
}

fn main() {
    let smoke = std::env::args().any(|a| a == "--smoke" || a == "--test");
    let mut mesh = samples::sphere(if smoke { 10 } else { 200 }, 0.02, 1);
    mesh.positions.iter_mut().for_each(|p| *p = p.map(|c| c * 2000.0));
    let mut meshes = vec![("noisy sphere", mesh)];
    if let Some(mesh) = dragon(smoke) {
        meshes = vec![("dragon", mesh)];
    }
    let threads = rayon::current_num_threads();
    let names: Vec<String> = match devices(&DeviceOptions::default()) {
        Ok(known) => known.into_iter().map(|d| d.name).collect(),
        Err(error) => {
            println!("no devices: {error}");
            Vec::new()
        }
    };
    if names.is_empty() {
        println!("no GPU and no software device here: the processor alone is measured");
    }
    let mut rows = Vec::new();
    for (name, mesh) in &meshes {
        let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.map(|c| c.round() as f32)).collect();
        let mut faces = Faces::new();
        for f in mesh.faces() {
            if (1..f.len()).all(|i| !f[..i].contains(&f[i])) {
                faces.push(f);
            }
        }
        measure(name, &faces, &positions, smoke);
        kernels(name, &faces, &positions, &names, smoke, &mut rows);
        stages(name, mesh, &names, &mut rows);
    }
    println!("processor: {}, {threads} threads", processor());
    let unit = |r: f64| if r >= 1e6 { format!("{:.2} M", r / 1e6) } else { format!("{:.1} k", r / 1e3) };
    println!(
        "{:<14} {:<26} {:<34} {:>12} {:>12} {:>14} {:>16}",
        "mesh", "kernel or stage", "on", "items", "a second", "a cpu second", "of the processor"
    );
    for r in &rows {
        println!(
            "{:<14} {:<26} {:<34} {:>12} {:>12} {:>14} {:>16}",
            r.mesh,
            r.what,
            r.device,
            r.items,
            unit(r.rate()),
            r.per_cpu().map_or("".to_string(), unit),
            beside(r, &rows).map_or(String::new(), |x| format!("{x:.2} x"))
        );
    }
    if let Err(error) = write_report(&rows, threads, &names) {
        println!("no report written: {error}");
    }
}

/// What the processor calls itself.
fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find_map(|l| l.strip_prefix("model name")?.split_once(": "));
    name.map_or(std::env::consts::ARCH, |(_, name)| name).to_string()
}

/// How a device does beside all threads of the processor, in the same run, by the wall clock.
fn beside(row: &Row, rows: &[Row]) -> Option<f64> {
    if row.device.starts_with("processor") {
        return None;
    }
    let same = |r: &&Row| r.mesh == row.mesh && r.what == row.what && r.device.starts_with("processor");
    rows.iter().filter(same).map(Row::rate).reduce(f64::max).map(|r| row.rate() / r)
}

fn open(name: &str) -> Option<Device> {
    match Device::open(&DeviceChoice::Named(name.to_string()), DeviceOptions::default()) {
        Ok(device) => Some(device),
        Err(error) => {
            println!("{name}: skipped, {error}");
            None
        }
    }
}

/// Each kernel on one thread, on all, and on every device.
fn kernels(mesh: &str, faces: &Faces, positions: &[[f32; 3]], names: &[String], smoke: bool, rows: &mut Vec<Row>) {
    let runs = if smoke { 1 } else { 3 };
    let star = Star::build(positions.len(), faces);
    let edges = EdgeList::build(faces, &star);
    let (scale, trace) = (Scale::new(4000.0), Trace::off());
    let task = Task::first(WeighInput { faces, star: &star, positions, locked: None }, &edges, &scale, &trace);
    let mut push = |what, device: &str, items: usize, unit, (seconds, cpu_seconds)| {
        let (mesh, device, items) = (mesh.to_string(), device.to_string(), items as u64);
        rows.push(Row { mesh, what, device, items, unit, seconds, cpu_seconds });
    };
    let Ok(one) = rayon::ThreadPoolBuilder::new().num_threads(1).build() else { return };
    let all = format!("processor, {} threads", rayon::current_num_threads());
    let mut by_cpu = vec![Fixed::ILLEGAL; edges.len()];
    let weigh = |e: &mut dyn Evaluator, out: &mut [Fixed]| {
        if let Err(error) = e.weigh(&task, out) {
            println!("{}: {error}", e.name());
        }
    };
    push(
        "edge_weight",
        "processor, 1 thread",
        edges.len(),
        "edges",
        best(runs, || one.install(|| weigh(&mut Cpu, &mut by_cpu))),
    );
    push("edge_weight", &all, edges.len(), "edges", best(runs, || weigh(&mut Cpu, &mut by_cpu)));
    // Each vertex against the triangles around three of its neighbours, in the order of elements.
    let triangles: Vec<[[f32; 3]; 3]> =
        faces.iter().map(|f| [f[0], f[1], f[f.len() - 1]].map(|v| positions[v as usize])).collect();
    let (mut start, mut candidates) = (vec![0u32], Vec::new());
    for v in 0..positions.len() as u32 {
        for &w in edges.larger(v).iter().take(3) {
            candidates.extend_from_slice(star.get(w));
        }
        start.push(candidates.len() as u32);
    }
    let input = Distances { points: positions, start: &start, candidates: &candidates, triangles: &triangles };
    push(
        "hausdorff",
        "processor, 1 thread",
        candidates.len(),
        "pairs",
        best(runs, || drop(one.install(|| input.on_cpu()))),
    );
    push("hausdorff", &all, candidates.len(), "pairs", best(runs, || drop(input.on_cpu())));
    let patches: Vec<SeamPatch> = (0..edges.len().min(1 << 20) as u32)
        .map(|e| {
            let (a, b) = edges.ends(e);
            let (p, q) = (positions[a as usize], positions[b as usize]);
            let half: [f32; 3] = std::array::from_fn(|k| (q[k] - p[k]) * 0.5);
            let ring = [-1.0, 3.0].map(|s| half.map(|c| c * s + 1.0)).to_vec();
            SeamPatch { half, torn: false, on_seam: true, ring }
        })
        .collect();
    let on_cpu = || patches.iter().map(seam_displacement).fold(0f32, f32::max);
    push("seam_displacement", "processor, 1 thread", patches.len(), "edges", best(runs, || assert!(on_cpu() >= 0.0)));
    for name in names {
        let Some(device) = open(name) else { continue };
        match GpuWeights::new(device.clone()) {
            Ok(mut gpu) => {
                let mut out = vec![Fixed::ILLEGAL; edges.len()];
                // The first dispatch compiles; it does not count.
                weigh(&mut gpu, &mut out);
                push("edge_weight", name, edges.len(), "edges", best(runs, || weigh(&mut gpu, &mut out)));
                let differ = out.iter().zip(&by_cpu).filter(|(a, b)| a != b).count();
                println!("{name}: {differ} of {} weights differ from the processor's", out.len());
            }
            Err(error) => println!("{error}"),
        }
        let said = |e| println!("{e}");
        push(
            "hausdorff",
            name,
            candidates.len(),
            "pairs",
            best(runs, || distances(&device, &input).map(drop).unwrap_or_else(said)),
        );
        push(
            "seam_displacement",
            name,
            patches.len(),
            "edges",
            best(runs, || {
                seam_displacements(&device, &patches).map(drop).unwrap_or_else(said);
            }),
        );
    }
}

/// Whole encodings, by stage as their trace tells.
fn stages(mesh_name: &str, mesh: &Mesh, names: &[String], rows: &mut Vec<Row>) {
    for name in std::iter::once(None).chain(names.iter().map(Some)) {
        let trace = Trace::on();
        let mut engine = Engine { trace: trace.clone(), ..Engine::default() };
        if let Some(name) = name {
            let Some(Ok(gpu)) = open(name).map(GpuWeights::new) else { continue };
            engine.evaluator = Box::new(gpu);
        }
        let (clock, cpu) = (Instant::now(), cpu_seconds());
        let Ok(encoded) = encode_with(mesh, &EncodeOptions::default(), engine, Control::new()) else { continue };
        let device = name.map_or("processor".to_string(), String::clone);
        let mut push = |what, items, unit, seconds, cpu_seconds| {
            let (mesh, device) = (mesh_name.to_string(), device.clone());
            rows.push(Row { mesh, what, device, items, unit, seconds, cpu_seconds });
        };
        let vertices = mesh.vertex_count() as u64;
        push("encode", vertices, "vertices", clock.elapsed().as_secs_f64(), cpu_seconds() - cpu);
        push("all weighings", encoded.report.edges_weighed, "edges", encoded.report.weigh_seconds, 0.0);
        // Spans of several threads add up: seconds of thread, not of the clock.
        for (what, _, micros, items) in trace.sums() {
            push(
                what,
                if items > 0 { items } else { vertices },
                if items > 0 { "items" } else { "vertices" },
                micros as f64 * 1e-6,
                0.0,
            );
        }
    }
}

/// `weigh.json` and `weigh.html`.
fn write_report(rows: &[Row], threads: usize, devices: &[String]) -> std::io::Result<()> {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or("target".into(), std::path::PathBuf::from);
    let folder = target.join("bench-report");
    std::fs::create_dir_all(&folder)?;
    let with_ratio = |r: &Row| {
        let mut row = r.json();
        row["of_the_processor"] = json!(beside(r, rows));
        row
    };
    let list: Vec<Value> = rows.iter().map(with_ratio).collect();
    let all = json!({ "processor": processor(), "threads": threads, "devices": devices, "rows": list });
    std::fs::write(folder.join("weigh.json"), format!("{all:#}\n"))?;
    let mut page = String::from(
        "<!doctype html><meta charset=utf-8><title>lodestream: kernels and stages</title>\
         <style>body{font:15px sans-serif;margin:2em;max-width:70em}td,th{padding:.2em .8em;text-align:left}\
         td.n{text-align:right}svg{display:block}</style><h1>Kernels and stages</h1>",
    );
    let text = |s: &str| s.replace('&', "&amp;").replace('<', "&lt;");
    page +=
        &format!("<p>Processor: {}, {threads} threads; devices: {}.", text(&processor()), text(&devices.join(", ")));
    if !devices.iter().any(|d| !d.contains("llvmpipe")) {
        page += " No real GPU was at hand.";
    }
    let mut kinds: Vec<&str> = Vec::new();
    rows.iter().for_each(|r| {
        if !kinds.contains(&r.what) {
            kinds.push(r.what)
        }
    });
    for what in kinds {
        let these: Vec<&Row> = rows.iter().filter(|r| r.what == what).collect();
        let most = these.iter().map(|r| r.rate()).fold(0.0, f64::max).max(1e-9);
        page += &format!("<h2>{}</h2><svg width=900 height={}>", text(what), 24 * these.len());
        for (i, r) in these.iter().enumerate() {
            let (y, width) = (24 * i, 400.0 * r.rate() / most);
            page += &format!(
                "<rect x=320 y={} width={width:.0} height=18 fill=#47a /><text x=0 y={} font-size=13>{}</text>\
                 <text x={:.0} y={} font-size=13>{:.3} M {}/s</text>",
                y + 3,
                y + 17,
                text(&r.device),
                326.0 + width,
                y + 17,
                r.rate() / 1e6,
                r.unit
            );
        }
        page += "</svg>";
    }
    page += "<h2>All</h2><table><tr><th>mesh<th>what<th>on<th>items<th>seconds<th>a second<th>a second of processor time<th>of the \
         processor";
    for r in rows {
        page += &format!(
            "<tr><td>{}<td>{}<td>{}<td class=n>{}<td class=n>{:.3}<td class=n>{:.0}<td class=n>{}<td class=n>{}",
            text(&r.mesh),
            text(r.what),
            text(&r.device),
            r.items,
            r.seconds,
            r.rate(),
            r.per_cpu().map_or(String::new(), |c| format!("{c:.0}")),
            beside(r, rows).map_or(String::new(), |x| format!("{x:.2} ×"))
        );
    }
    page += "</table>\n";
    std::fs::write(folder.join("weigh.html"), page)?;
    println!("report: {}", folder.join("weigh.html").display());
    Ok(())
}

/// The dragon at 12 bits an axis.
fn dragon(smoke: bool) -> Option<Mesh> {
    let Some(folder) = std::env::var_os("LODESTREAM_DATA").filter(|_| !smoke) else {
        println!("dragon: skipped, LODESTREAM_DATA is not set or this is a smoke run");
        return None;
    };
    let path = std::path::Path::new(&folder).join("classic/dragon_vrip.ply.gz");
    let mut mesh = match read_path(&path, &ReadOptions::default()) {
        Ok(read) => read.mesh,
        Err(error) => {
            println!("dragon: skipped, {error}");
            return None;
        }
    };
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for p in &mesh.positions {
        for k in 0..3 {
            (low[k], high[k]) = (low[k].min(p[k]), high[k].max(p[k]));
        }
    }
    let side = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
    mesh.positions.iter_mut().for_each(|p| *p = [0, 1, 2].map(|k| (p[k] - low[k]) / side * 4095.0));
    Some(mesh)
}

fn measure(name: &str, faces: &Faces, positions: &[[f32; 3]], smoke: bool) {
    let star = Star::build(positions.len(), faces);
    let started = Clock::now();
    let edges = EdgeList::build(faces, &star);
    let build = started.seconds();
    println!("{name}: {} vertices, {} edges; edge list in {:.1} ms", positions.len(), edges.len(), build * 1e3);

    let (mut gatherer, mut patch) = (Gatherer::new(), Patch::default());
    for round in 0..if smoke { 1 } else { 3 } {
        let started = Clock::now();
        let mut ring = 0;
        for a in 0..positions.len() as u32 {
            for &b in edges.larger(a) {
                gatherer.read(faces, &star, positions, a, b, &mut patch);
                ring += patch.ring.len();
            }
        }
        let gather = started.seconds();
        gatherer.forget();
        gatherer.forget();
        let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(1).build() else { return };
        let (seconds, mean, folds) = pool.install(|| {
            let mut weigher = Weigher::new(4000.0);
            let started = Clock::now();
            weigher.weigh(WeighInput { faces, star: &star, positions, locked: None }, None);
            let seconds = started.seconds();
            let ordinary = || weigher.weights().iter().filter(|w| w.class() == Class::Ordinary && !w.folds());
            let sum: u64 = ordinary().map(|w| u64::from(w.value())).sum();
            let mean = weigher.scale().length(1) * sum as f64 / ordinary().count() as f64;
            (seconds, mean, weigher.weights().iter().filter(|w| w.folds()).count())
        });
        println!(
            "  round {round}: {:.2} M edges/s on one core (gathering alone {:.2} M/s); mean {mean:.4}, folds {folds}, ring {:.2}",
            edges.len() as f64 / seconds / 1e6,
            edges.len() as f64 / gather / 1e6,
            ring as f64 / edges.len() as f64,
        );
    }

    let mut bounds = BoundScratch::default();
    let started = Clock::now();
    let (mut measured, mut tight, mut sum) = (0, 0, 0.0);
    for a in (0..positions.len() as u32).step_by(8) {
        for &b in edges.larger(a) {
            gatherer.read(faces, &star, positions, a, b, &mut patch);
            let length = 2.0 * patch.half.iter().map(|&c| f64::from(c * c)).sum::<f64>().sqrt();
            let bound = hausdorff_bound(&patch, [0.0; 3], 0.0, &mut bounds);
            measured += 1;
            sum += bound;
            tight += u32::from(bound < 0.25 * length);
        }
    }
    let each = started.seconds() / f64::from(measured);
    println!(
        "  guaranteed bounds: {:.2} µs each, mean {:.4}, {:.1} % below half the motion",
        each * 1e6,
        sum / f64::from(measured),
        100.0 * f64::from(tight) / f64::from(measured)
    );
    gatherer.forget();

    let started = Instant::now();
    let mut weigher = Weigher::new(4000.0);
    weigher.weigh(WeighInput { faces, star: &star, positions, locked: None }, None);
    let weigh = started.elapsed().as_secs_f64();
    let slots: Vec<u32> = (0..positions.len() as u32).collect();
    let started = Instant::now();
    let input = SelectInput { faces, star: &star, edges: weigher.edges(), weights: weigher.weights(), slots: &slots };
    let chosen = select(input, &SelectOptions::default());
    println!(
        "  all threads: weigh {:.1} ms, select {:.1} ms: {} edges",
        weigh * 1e3,
        started.elapsed().as_secs_f64() * 1e3,
        chosen.len()
    );
}
