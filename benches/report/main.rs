//! The report: size, speed, memory and error of every dataset, with Draco on the same geometry in the same run.
//!
//! ```text
//! cargo bench                      the classic, polygon, defective and point datasets that are at hand
//! cargo bench -- --smoke           a few small ones, for CI
//! cargo bench -- --full            the large ones and the scaling series too
//! cargo bench -- horse scaling     only datasets whose names hold one of these words
//! ```
//!
//! A table goes to the terminal; `report.json` and `report.html` (one page, nothing to fetch) go to `bench-report` in the
//! target folder. Encoding and peak memory are measured in child processes of the program itself, decoding in a
//! child of this bench that stops at the full level in memory. Times are the best of a few runs.

#[path = "../../tests/suite/common/datasets.rs"]
#[allow(dead_code, reason = "shared with the tests, which use other parts")]
mod datasets;
mod draco;
mod measure;
mod page;

use datasets::Dataset;
use measure::Measured;
use serde_json::{Value, json};
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// What to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Smoke,
    Standard,
    Full,
}

/// Bits per vertex in use of the whole file at 12 bits that must be reached, that are aimed at, and that a prototype or rival has.
const TARGETS: [(&str, f64, f64); 7] = [
    ("classic/horse", 16.5, 14.3),
    ("classic/armadillo", 18.5, 16.8),
    ("classic/bimba_original", 24.5, 22.4),
    ("classic/dragon_vrip", 14.5, 11.2),
    ("classic/hippo", 18.2, 15.7),
    ("classic/rocker-arm", 21.6, 19.6),
    ("classic/bun_zipper", 20.0, 16.8),
];

/// Datasets of the smoke run.
const SMOKE: [&str; 5] =
    ["generated/asteroid", "generated/crumbs", "generated/mixed", "generated/points", "classic/rocker-arm"];

/// Datasets that are also measured at 10, 14 and 16 bits.
const MORE_BITS: [&str; 6] = [
    "classic/horse",
    "classic/armadillo",
    "classic/bimba_original",
    "classic/hippo",
    "classic/rocker-arm",
    "classic/bun_zipper",
];

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [command, file] = &arguments[..]
        && command == "--child-decode"
    {
        return measure::child_decode(Path::new(file));
    }
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("bench: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &[String]) -> Result<(), String> {
    let (mut mode, mut words) = (Mode::Standard, Vec::new());
    for argument in arguments {
        match argument.as_str() {
            // What cargo adds.
            "--bench" => {}
            "--smoke" => mode = Mode::Smoke,
            "--full" => mode = Mode::Full,
            "--help" | "-h" => {
                println!("cargo bench -- [--smoke | --full] [WORD…]: see benches/report/main.rs");
                return Ok(());
            }
            word if !word.starts_with('-') => words.push(word),
            other => return Err(format!("unknown option {other}; known are --smoke and --full")),
        }
    }
    let chosen = |d: &Dataset| {
        let by_mode = match mode {
            Mode::Smoke => SMOKE.contains(&d.name.as_str()),
            Mode::Standard => {
                !d.large
                    && d.name != "classic/dragon_vrip"
                    && ["classic", "polygon", "bad", "points", "generated"].iter().any(|g| d.name.starts_with(g))
            }
            Mode::Full => true,
        };
        if words.is_empty() { by_mode } else { words.iter().any(|w| d.name.contains(w)) }
    };
    let folder = out_folder()?;
    let (wanted, missing): (Vec<_>, Vec<_>) =
        datasets::all().into_iter().filter(chosen).partition(|d| d.is_available());
    datasets::report_missing(&missing);
    let draco = draco::find();
    if draco.is_none() {
        eprintln!("draco_encoder and draco_decoder are not installed: no comparison");
    }
    let mut rows = Vec::new();
    println!("{}", head());
    for dataset in &wanted {
        if io::stderr().is_terminal() {
            eprint!("{} …\r", dataset.name);
        }
        let more_bits = mode != Mode::Smoke && MORE_BITS.contains(&dataset.name.as_str());
        let repeats = if mode == Mode::Smoke || dataset.large { 1 } else { 3 };
        match measure::dataset(dataset, &folder, draco.as_ref(), more_bits, repeats) {
            Ok(row) => {
                println!("{}", line(&row));
                rows.push(row);
            }
            Err(error) => return Err(format!("{}: {error}", dataset.name)),
        }
    }
    println!("\nsize and Draco: bits per vertex in use (vertices of no face do not count where there are faces);");
    println!("at 10 %: bits per vertex of the full mesh until the coarsest level with a tenth of the vertices;");
    println!("bound/measured: smallest ratio over the levels measured (above 1: the bound holds).");
    print_levels(&rows);
    print_bits(&rows);
    print_scaling(&rows);
    let report = json!({
        "mode": format!("{mode:?}").to_lowercase(),
        "cores": std::thread::available_parallelism().map_or(0, usize::from),
        "draco": draco.as_ref().map(|d| d.version.clone()),
        "skipped": missing.iter().map(|d| d.name.clone()).collect::<Vec<_>>(),
        "datasets": rows.iter().map(Measured::json).collect::<Vec<Value>>(),
    });
    let write = |name: &str, text: String| {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display())).map(|()| path)
    };
    write("report.json", serde_json::to_string_pretty(&report).map_err(|e| e.to_string())?)?;
    let page = write("report.html", page::html(&report, &rows))?;
    println!("\nwritten: {} (and report.json beside it)", page.display());
    Ok(())
}

/// `bench-report` in the target folder.
fn out_folder() -> Result<PathBuf, String> {
    let temporary = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let folder = temporary.parent().unwrap_or(temporary).join("bench-report");
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    Ok(folder)
}

/// What must be reached and what is aimed at for a dataset.
pub fn target(name: &str) -> Option<(f64, f64)> {
    TARGETS.iter().find(|t| t.0 == name).map(|t| (t.1, t.2))
}

fn head() -> String {
    format!(
        "{:<32} {:>9} {:>9} {:>8} {:>12} {:>7} {:>7} {:>12} {:>9} {:>9} {:>9} {:>9} {:>9}",
        "dataset",
        "vertices",
        "bytes",
        "size",
        "must/aim",
        "Draco",
        "at 10 %",
        "bound/meas.",
        "enc kv/s",
        "per cpu s",
        "dec kv/s",
        "enc B/v",
        "dec B/v"
    )
}

fn line(row: &Measured) -> String {
    let number = |value: Option<f64>, digits: usize| value.map_or("–".to_string(), |v| format!("{v:.digits$}"));
    let goal = target(&row.name).map_or(String::new(), |(must, aim)| format!("{must}/{aim}"));
    format!(
        "{:<32} {:>9} {:>9} {:>8} {goal:>12} {:>7} {:>7} {:>12} {:>9} {:>9} {:>9} {:>9} {:>9}",
        row.name,
        row.vertices,
        row.bytes,
        number(Some(row.rate()), 2),
        number(row.draco.as_ref().map(|d| d.rate(row)), 2),
        number(row.prefix_rate().map(|p| p.1), 2),
        number(row.bound_over_measured(), 2),
        number(row.encode_speed().map(|s| s / 1e3), 0),
        number(row.encode_cpu_speed().map(|s| s / 1e3), 0),
        number(row.decode_speed().map(|s| s / 1e3), 0),
        number(row.encode_memory_per_vertex(), 0),
        number(row.decode_memory_per_vertex(), 0),
    )
}

/// The levels that were measured, for the meshes with names in the issue's tables.
fn print_levels(rows: &[Measured]) {
    for row in rows.iter().filter(|r| target(&r.name).is_some()) {
        println!("\n{}: bytes, vertices, bound and measured error of its levels (units of the model)", row.name);
        for level in row.levels.iter().filter(|l| l.measured.is_some()) {
            let measured = level.measured.unwrap_or(0.0);
            let bound = level.bound.map_or("?".to_string(), |b| format!("{b:.3e}"));
            println!(
                "  {:>4} {:>9} B {:>8} v  {bound:>10}  {measured:>10.3e}",
                level.level, level.bytes, level.vertices
            );
        }
    }
}

/// Sizes at other numbers of bits.
fn print_bits(rows: &[Measured]) {
    let mut first = true;
    for row in rows.iter().filter(|r| r.by_bits.len() > 1) {
        if std::mem::take(&mut first) {
            println!("\nbits per vertex in use at other precisions, ours / Draco");
        }
        let cells: Vec<String> = row
            .by_bits
            .iter()
            .map(|b| {
                let rate = |bytes: u64| 8.0 * bytes as f64 / row.in_use as f64;
                let draco = b.draco.map_or("–".to_string(), |bytes| format!("{:.2}", rate(bytes)));
                format!("{} bits {:.2} / {draco}", b.bits, rate(b.bytes))
            })
            .collect();
        println!("{:<32} {}", row.name, cells.join("   "));
    }
}

/// A row of the scaling table: what is counted per vertex, and its values along the series.
pub type Cost = (&'static str, Vec<Option<f64>>);

/// Cost per vertex as size grows, and the series it was measured on; empty where there is no series.
pub fn scaling(rows: &[Measured]) -> (Vec<&Measured>, Vec<Cost>) {
    let series: Vec<&Measured> = rows.iter().filter(|r| r.name.contains("/terrain-")).collect();
    let microseconds =
        |speed: fn(&Measured) -> Option<f64>| series.iter().map(|r| speed(r).map(|s| 1e6 / s)).collect::<Vec<_>>();
    let bytes = |memory: fn(&Measured) -> Option<f64>| series.iter().map(|r| memory(r)).collect::<Vec<_>>();
    let costs = vec![
        ("encode, µs", microseconds(Measured::encode_speed)),
        ("encode, µs of processor time", microseconds(Measured::encode_cpu_speed)),
        ("decode, µs", microseconds(Measured::decode_speed)),
        ("decode, µs of processor time", microseconds(Measured::decode_cpu_speed)),
        ("encode, bytes of memory", bytes(Measured::encode_memory_per_vertex)),
        ("decode, bytes of memory", bytes(Measured::decode_memory_per_vertex)),
    ];
    (series, costs)
}

/// A cost in as many digits as it deserves.
pub fn digits(cost: Option<f64>) -> String {
    cost.map_or("–".to_string(), |c| if c < 100.0 { format!("{c:.2}") } else { format!("{c:.0}") })
}

fn print_scaling(rows: &[Measured]) {
    let (series, costs) = scaling(rows);
    if series.len() < 2 {
        return;
    }
    println!("\nscaling, per vertex");
    let names: Vec<String> = series.iter().map(|r| format!("{:>24}", format!("{}, {} bits", r.name, r.bits))).collect();
    println!("  {:<32}{}", "", names.join(""));
    for (name, costs) in costs {
        let cells: Vec<String> = costs.into_iter().map(|c| format!("{:>24}", digits(c))).collect();
        println!("  {name:<32}{}", cells.join(""));
    }
}
