//! Manifests: which files, and how each is to be encoded. CSV, JSON lines or TOML, by the extension of the file.
//!
//! A manifest is read and checked as a whole before any work starts; every error names its line. Fields, the same in all
//! three: `source` (needed), `output`, `position_bits`, `position_step`, `origin`, `uv_bits`, `uv_step`, `normal_bits`,
//! `color_bits`, `scalar_bits`, `lock_borders`, `exact_images`, `schedule`, `texture`, `previews`, `weld`, `isolated`, `drop`. What an entry leaves out is as the command line says; TOML has a table `[defaults]` in between, and one `[[job]]` for each file.

use super::error::IngestError;
use super::location::is_staged;
use super::location::{is_plain, output_name};
use super::settings::{DROP_NAMES, Settings, drop_set};
use crate::image::jpeg::Exactness;
use crate::image::recompress::Textures;
use crate::io::files::read_regular;
use crate::mesh::lattice::Quantization;
use crate::mesh::quantizer::Precision;
use serde::Deserialize;
use std::collections::HashMap;
use std::path::Path;

/// A line of a manifest that is sound.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// The line of the manifest, from 1.
    pub line: u64,
    /// The source: a URL, or a path.
    pub source: String,
    /// The output, relative to the destination.
    pub output: String,
    /// How to encode.
    pub settings: Settings,
}

/// An entry as it is written.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    source: Option<String>,
    output: Option<String>,
    position_bits: Option<i64>,
    position_step: Option<f64>,
    origin: Option<Point>,
    uv_bits: Option<i64>,
    uv_step: Option<f64>,
    normal_bits: Option<i64>,
    color_bits: Option<i64>,
    scalar_bits: Option<i64>,
    lock_borders: Option<bool>,
    exact_images: Option<bool>,
    schedule: Option<String>,
    texture: Option<String>,
    previews: Option<String>,
    weld: Option<bool>,
    isolated: Option<String>,
    drop: Option<Words>,
}

/// Three numbers, or the text `x,y,z`.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
enum Point {
    Numbers([f64; 3]),
    Text(String),
}

/// A list of words, or a text with commas.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
enum Words {
    List(Vec<String>),
    Text(String),
}

/// The errors that are told; a manifest of the wrong kind has one on each line.
const MOST: usize = 20;

/// Read and check a manifest file.
///
/// # Errors
/// [`IngestError::Setup`] when it cannot be read, [`IngestError::Manifest`] with all that is wrong, each with its line.
pub fn read(path: &Path, base: &Settings) -> Result<Vec<Job>, IngestError> {
    let name = path.display().to_string();
    let bytes = read_regular(path).map_err(|e| IngestError::Setup(super::Failure::reading(&name, &e).message))?;
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    parse(&name, &extension, &bytes, base)
}

/// Read and check a manifest of the kind `extension`: `csv`, `jsonl` or `toml`.
///
/// # Errors
/// As [`read`].
pub fn parse(name: &str, extension: &str, bytes: &[u8], base: &Settings) -> Result<Vec<Job>, IngestError> {
    let mut errors = Errors { name, list: Vec::new(), more: 0 };
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text.strip_prefix('\u{feff}').unwrap_or(text),
        Err(e) => {
            let line = 1 + bytes[..e.valid_up_to()].iter().filter(|b| **b == b'\n').count() as u64;
            errors.add(line, "this is not UTF-8; save it as UTF-8".to_string());
            return Err(errors.done());
        }
    };
    let entries = match extension {
        "csv" => csv_entries(text, &mut errors),
        "jsonl" | "ndjson" => json_entries(text, &mut errors),
        "toml" => toml_entries(text, &mut errors),
        _ => {
            let known = "known are .csv, .jsonl and .toml";
            return Err(IngestError::Usage(format!("{name}: this is no manifest by its extension; {known}")));
        }
    };
    let mut jobs = Vec::with_capacity(entries.len());
    let mut outputs: HashMap<String, (u64, String)> = HashMap::new();
    for (line, entry) in entries {
        match job(line, entry, base) {
            Err(problem) => errors.add(line, problem),
            // Some disks do not know upper from lower case.
            Ok(job) => match outputs.insert(job.output.to_lowercase(), (line, job.output.clone())) {
                Some((first, spelt)) => {
                    let output = &job.output;
                    let case = if spelt == *output { "" } else { ", case aside" };
                    let what = format!("the output {output:?} is that of line {first} already{case}; name another");
                    errors.add(line, what);
                }
                None => jobs.push(job),
            },
        }
    }
    if !errors.list.is_empty() {
        return Err(errors.done());
    }
    if jobs.is_empty() {
        errors.add(1, "there is no job in it".to_string());
        return Err(errors.done());
    }
    Ok(jobs)
}

struct Errors<'a> {
    name: &'a str,
    list: Vec<String>,
    more: usize,
}

impl Errors<'_> {
    fn add(&mut self, line: u64, problem: String) {
        if self.list.len() < MOST {
            self.list.push(format!("{}, line {line}: {problem}", self.name));
        } else {
            self.more += 1;
        }
    }

    fn done(mut self) -> IngestError {
        if self.more > 0 {
            self.list.push(format!("and {} more", self.more));
        }
        IngestError::Manifest(self.list)
    }
}

/// What one entry means.
fn job(line: u64, entry: Entry, base: &Settings) -> Result<Job, String> {
    let mut settings = base.clone();
    let source = entry.source.map(|s| s.trim().to_string()).filter(|s| !s.is_empty());
    let Some(source) = source else { return Err("there is no source; name the mesh".to_string()) };
    match (entry.position_bits, entry.position_step) {
        (Some(_), Some(_)) => return Err("position_bits and position_step exclude each other; give one".to_string()),
        (Some(n), None) => settings.encode.quantization = Quantization::Bits(bits("position_bits", n, 1, 21)?),
        (None, Some(step)) if step > 0.0 && step.is_finite() => {
            settings.encode.quantization = Quantization::Step { step, origin: None };
        }
        (None, Some(_)) => return Err("position_step is a positive number, as in 0.001".to_string()),
        (None, None) => {}
    }
    if let Some(point) = entry.origin {
        let point = match point {
            Point::Numbers(p) => Some(p),
            Point::Text(text) => {
                let numbers: Result<Vec<f64>, _> =
                    text.split([',', ' ']).filter(|w| !w.is_empty()).map(str::parse).collect();
                numbers.ok().and_then(|n| n.try_into().ok())
            }
        };
        let point = point.filter(|p: &[f64; 3]| p.iter().all(|c| c.is_finite()));
        let point = point.ok_or("origin is three numbers, as in 512000,5403000,0".to_string())?;
        match &mut settings.encode.quantization {
            Quantization::Step { origin, .. } => *origin = Some(point),
            Quantization::Bits(_) => return Err("origin needs position_step; add it".to_string()),
        }
    }
    match (entry.uv_bits, entry.uv_step) {
        (Some(_), Some(_)) => return Err("uv_bits and uv_step exclude each other; give one".to_string()),
        (Some(n), None) => settings.encode.uv = Precision::Bits(bits("uv_bits", n, 1, 24)?),
        (None, Some(step)) if step > 0.0 && step.is_finite() => settings.encode.uv = Precision::Step(step),
        (None, Some(_)) => return Err("uv_step is a positive number, as in 0.000244140625".to_string()),
        (None, None) => {}
    }
    if let Some(n) = entry.normal_bits {
        settings.encode.normal_bits = bits("normal_bits", n, 2, 16)?;
    }
    if let Some(n) = entry.color_bits {
        settings.encode.color_bits = bits("color_bits", n, 1, 16)?;
    }
    if let Some(n) = entry.scalar_bits {
        settings.encode.scalar_bits = bits("scalar_bits", n, 1, 24)?;
    }
    if let Some(lock) = entry.lock_borders {
        settings.encode.lock_borders = lock;
    }
    if let Some(exact) = entry.exact_images {
        settings.encode.images = if exact { Exactness::Bytes } else { Exactness::Coefficients };
        // Who asks for the very bytes means all images, and may still say otherwise below.
        if exact {
            settings.textures = Textures::Keep;
        }
    }
    if let Some(schedule) = entry.schedule {
        settings.set_order(schedule.trim().parse().map_err(|e: String| format!("schedule: {e}"))?);
    }
    if let Some(texture) = entry.texture {
        settings.textures = texture.trim().parse().map_err(|e: String| format!("texture: {e}"))?;
    }
    if let Some(previews) = entry.previews {
        settings.previews = previews.trim().parse().map_err(|e: String| format!("previews: {e}"))?;
    }
    settings.weld = entry.weld.or(settings.weld);
    match entry.isolated.as_deref().map(str::trim) {
        None => {}
        Some("keep") => settings.drop_isolated = false,
        Some("drop") => settings.drop_isolated = true,
        Some(other) => return Err(format!("isolated is keep or drop, not {other:?}")),
    }
    if let Some(words) = entry.drop {
        let words = match words {
            Words::List(list) => list,
            Words::Text(text) => text.split([',', ' ']).filter(|w| !w.is_empty()).map(str::to_string).collect(),
        };
        settings.drop = drop_set(words.iter().map(String::as_str))
            .map_err(|word| format!("drop knows no {word:?}; it knows {}", DROP_NAMES.join(", ")))?;
    }
    let output = match entry.output.map(|o| o.trim().to_string()).filter(|o| !o.is_empty()) {
        Some(output) => {
            let output = if output.ends_with(".lods") { output } else { format!("{output}.lods") };
            if !is_plain(&output) {
                return Err(format!("the output {output:?} has to be a relative path without . and .."));
            }
            if is_staged(Path::new(&output)) {
                return Err(format!("the output {output:?} lies among files on their way; choose another folder"));
            }
            output
        }
        None => {
            let path = source.split_once("://").map_or(source.as_str(), |(_, rest)| rest);
            let plain =
                if is_plain(path) && path == source { path } else { path.rsplit(['/', '\\']).next().unwrap_or(path) };
            output_name(plain).map_err(|f| f.message)?
        }
    };
    Ok(Job { line, source, output, settings })
}

/// A number of bits within its range.
fn bits(name: &str, n: i64, least: u8, most: u8) -> Result<u8, String> {
    let found = u8::try_from(n).ok().filter(|b| (least..=most).contains(b));
    found.ok_or_else(|| format!("{name} is a number from {least} to {most}"))
}

fn csv_entries(text: &str, errors: &mut Errors<'_>) -> Vec<(u64, Entry)> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
    let mut entries = Vec::new();
    let headers = match reader.headers() {
        Ok(headers) => headers.clone(),
        Err(e) => {
            errors.add(1, csv_problem(&e));
            return entries;
        }
    };
    const KNOWN: [&str; 17] = [
        "source",
        "output",
        "position_bits",
        "position_step",
        "origin",
        "uv_bits",
        "uv_step",
        "normal_bits",
        "color_bits",
        "scalar_bits",
        "lock_borders",
        "exact_images",
        "schedule",
        "texture",
        "previews",
        "weld",
        "drop",
    ];
    for header in &headers {
        if !KNOWN.contains(&header) {
            errors.add(1, format!("the column {header:?} is not known; known are {}", KNOWN.join(", ")));
        }
    }
    if !headers.iter().any(|h| h == "source") {
        errors.add(1, "there is no column `source`; the first line names the columns".to_string());
    }
    if !errors.list.is_empty() {
        return entries;
    }
    // The reader says where it began to look for a record; comments and empty lines in between are not part of it.
    let (mut at, mut line) = (0, 1);
    let mut line_from = |byte: usize| {
        let bytes = text.as_bytes();
        let mut from = byte.max(at);
        while let Some(b @ (b'\r' | b'\n' | b'#')) = bytes.get(from) {
            from = if *b == b'#' {
                bytes[from..].iter().position(|b| *b == b'\n').map_or(bytes.len(), |n| from + n)
            } else {
                from + 1
            };
        }
        line += bytes[at..from].iter().filter(|b| **b == b'\n').count() as u64;
        at = from;
        line
    };
    for record in reader.records() {
        match record {
            Ok(record) => {
                let line = line_from(record.position().map_or(0, |p| p.byte() as usize));
                match csv_entry(&headers, &record) {
                    Ok(entry) => entries.push((line, entry)),
                    Err(problem) => errors.add(line, problem),
                }
            }
            Err(e) => errors.add(e.position().map_or(1, |p| line_from(p.byte() as usize)), csv_problem(&e)),
        }
    }
    entries
}

fn csv_problem(e: &csv::Error) -> String {
    match e.kind() {
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("{len} fields where the first line names {expected_len} columns; quote fields that hold commas")
        }
        _ => format!("this is no CSV: {e}"),
    }
}

fn csv_entry(headers: &csv::StringRecord, record: &csv::StringRecord) -> Result<Entry, String> {
    let mut entry = Entry::default();
    for (header, field) in headers.iter().zip(record) {
        // An empty field is one that is not given.
        if field.is_empty() {
            continue;
        }
        let number = || format!("{header} is a number, not {field:?}");
        let flag = || match field.to_ascii_lowercase().as_str() {
            "true" | "yes" | "1" => Ok(true),
            "false" | "no" | "0" => Ok(false),
            _ => Err(format!("{header} is true or false, not {field:?}")),
        };
        match header {
            "source" => entry.source = Some(field.to_string()),
            "output" => entry.output = Some(field.to_string()),
            "position_bits" => entry.position_bits = Some(field.parse().map_err(|_| number())?),
            "position_step" => entry.position_step = Some(field.parse().map_err(|_| number())?),
            "origin" => entry.origin = Some(Point::Text(field.to_string())),
            "uv_bits" => entry.uv_bits = Some(field.parse().map_err(|_| number())?),
            "uv_step" => entry.uv_step = Some(field.parse().map_err(|_| number())?),
            "normal_bits" => entry.normal_bits = Some(field.parse().map_err(|_| number())?),
            "color_bits" => entry.color_bits = Some(field.parse().map_err(|_| number())?),
            "scalar_bits" => entry.scalar_bits = Some(field.parse().map_err(|_| number())?),
            "lock_borders" => entry.lock_borders = Some(flag()?),
            "exact_images" => entry.exact_images = Some(flag()?),
            "schedule" => entry.schedule = Some(field.to_string()),
            "texture" => entry.texture = Some(field.to_string()),
            "previews" => entry.previews = Some(field.to_string()),
            "weld" => entry.weld = Some(flag()?),
            _ => entry.drop = Some(Words::Text(field.to_string())),
        }
    }
    Ok(entry)
}

fn json_entries(text: &str, errors: &mut Errors<'_>) -> Vec<(u64, Entry)> {
    let mut entries = Vec::new();
    for (i, line) in text.lines().enumerate() {
        if line.trim().is_empty() {
            continue;
        }
        match serde_json::from_str::<Entry>(line) {
            Ok(entry) => entries.push((i as u64 + 1, entry)),
            Err(e) => {
                // Each entry is a line of its own: the position that the parser gives counts from its start.
                let text = e.to_string();
                let text = text.rsplit_once(" at line ").map_or(text.as_str(), |(head, _)| head);
                errors.add(i as u64 + 1, format!("column {}: {text}", e.column()));
            }
        }
    }
    entries
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    defaults: Option<toml::Spanned<Entry>>,
    #[serde(default)]
    job: Vec<toml::Spanned<Entry>>,
}

fn toml_entries(text: &str, errors: &mut Errors<'_>) -> Vec<(u64, Entry)> {
    let line_at = |byte: usize| 1 + text.as_bytes().iter().take(byte).filter(|b| **b == b'\n').count() as u64;
    let document: Document = match toml::from_str(text) {
        Ok(document) => document,
        Err(e) => {
            errors.add(e.span().map_or(1, |s| line_at(s.start)), e.message().to_string());
            return Vec::new();
        }
    };
    let base = match document.defaults {
        Some(defaults) => {
            let line = line_at(defaults.span().start);
            let defaults = defaults.into_inner();
            if defaults.source.is_some() || defaults.output.is_some() {
                errors.add(line, "source and output belong to a job, not to the defaults".to_string());
            }
            defaults
        }
        None => Entry::default(),
    };
    let mut entries = Vec::with_capacity(document.job.len());
    for job in document.job {
        let line = line_at(job.span().start);
        let mut entry = job.into_inner();
        // A job's own lattice replaces the default one as a whole.
        if entry.position_bits.is_none() && entry.position_step.is_none() {
            entry.position_bits = base.position_bits;
            entry.position_step = base.position_step;
            entry.origin = entry.origin.or_else(|| base.origin.clone());
        }
        // So does its own precision of texture coordinates.
        if entry.uv_bits.is_none() && entry.uv_step.is_none() {
            (entry.uv_bits, entry.uv_step) = (base.uv_bits, base.uv_step);
        }
        entry.normal_bits = entry.normal_bits.or(base.normal_bits);
        entry.color_bits = entry.color_bits.or(base.color_bits);
        entry.scalar_bits = entry.scalar_bits.or(base.scalar_bits);
        entry.lock_borders = entry.lock_borders.or(base.lock_borders);
        entry.exact_images = entry.exact_images.or(base.exact_images);
        entry.schedule = entry.schedule.or_else(|| base.schedule.clone());
        entry.texture = entry.texture.or_else(|| base.texture.clone());
        entry.previews = entry.previews.or_else(|| base.previews.clone());
        entry.weld = entry.weld.or(base.weld);
        entry.drop = entry.drop.or_else(|| base.drop.clone());
        entries.push((line, entry));
    }
    entries
}

#[cfg(test)]
mod tests {
    use super::*;

    fn errors(extension: &str, text: &str) -> Vec<String> {
        match parse("jobs", extension, text.as_bytes(), &Settings::default()) {
            Err(IngestError::Manifest(list)) => list,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn the_three_kinds_say_the_same() {
        let csv = "source,output,position_bits,position_step,origin,lock_borders,weld,drop,uv_bits,uv_step,normal_bits,color_bits,scalar_bits,exact_images,schedule,texture,previews\n\
                   a/one.ply,,14,,,,,,15,,,,,,,,\n\
                   # a comment\n\
                   two.obj,x/two,,0.001,\"1,2,3\",true,no,\"uvs,normals\",,0.5,12,10,20,yes,linear,jpeg:85,none\n";
        let jsonl = "{\"source\":\"a/one.ply\",\"position_bits\":14,\"uv_bits\":15}\n\n\n\
                     {\"source\":\"two.obj\",\"output\":\"x/two\",\"position_step\":0.001,\"origin\":[1,2,3],\
                     \"lock_borders\":true,\"weld\":false,\"drop\":[\"uvs\",\"normals\"],\
                     \"uv_step\":0.5,\"normal_bits\":12,\"color_bits\":10,\"scalar_bits\":20,\"exact_images\":true,\"schedule\":\"linear\",\"texture\":\"jpeg:85\",\"previews\":\"none\"}\n";
        let toml = "[[job]]\nsource = \"a/one.ply\"\nposition_bits = 14\nuv_bits = 15\n[[job]]\nsource = \"two.obj\"\noutput = \"x/two\"\n\
                    position_step = 0.001\norigin = [1.0, 2.0, 3.0]\nlock_borders = true\nweld = false\ndrop = \"uvs normals\"\n\
                    uv_step = 0.5\nnormal_bits = 12\ncolor_bits = 10\nscalar_bits = 20\nexact_images = true\nschedule = \"linear\"\ntexture = \"jpeg:85\"\npreviews = \"none\"\n";
        let read = |kind, text: &str| parse("jobs", kind, text.as_bytes(), &Settings::default()).unwrap();
        let jobs = read("csv", csv);
        assert_eq!(
            jobs.iter().map(|j| (j.line, j.output.as_str())).collect::<Vec<_>>(),
            [(2, "a/one.lods"), (4, "x/two.lods")]
        );
        assert_eq!(jobs[0].settings.encode.quantization, Quantization::Bits(14));
        let lattice = Quantization::Step { step: 0.001, origin: Some([1.0, 2.0, 3.0]) };
        assert_eq!(jobs[1].settings.encode.quantization, lattice);
        assert!(jobs[1].settings.encode.lock_borders && jobs[1].settings.weld == Some(false));
        assert_eq!(jobs[0].settings.encode.uv, Precision::Bits(15));
        let e = &jobs[1].settings.encode;
        assert_eq!((e.uv, e.normal_bits, e.color_bits, e.scalar_bits), (Precision::Step(0.5), 12, 10, 20));
        assert_eq!((e.images, e.schedule), (Exactness::Bytes, crate::encode::Schedule::Linear));
        assert_eq!(jobs[1].settings.textures, Textures::Jpeg(85));
        assert_eq!(jobs[1].settings.previews, crate::image::preview::Previews::None);
        assert_eq!(Ok(jobs[1].settings.drop), drop_set(["uvs", "normals"]));
        let strip = |jobs: Vec<Job>| jobs.into_iter().map(|j| Job { line: 0, ..j }).collect::<Vec<_>>();
        assert_eq!(strip(read("jsonl", jsonl)), strip(jobs.clone()));
        assert_eq!(strip(read("toml", toml)), strip(jobs));
    }

    #[test]
    fn defaults_of_toml_apply_to_jobs_that_say_nothing() {
        let text = "[defaults]\nposition_step = 0.5\norigin = \"0,0,0\"\n[[job]]\nsource = \"a.ply\"\n[[job]]\nsource = \"b.ply\"\nposition_bits = 10\n";
        let jobs = parse("jobs", "toml", text.as_bytes(), &Settings::default()).unwrap();
        let lattice = Quantization::Step { step: 0.5, origin: Some([0.0; 3]) };
        assert_eq!(jobs[0].settings.encode.quantization, lattice);
        assert_eq!(jobs[1].settings.encode.quantization, Quantization::Bits(10));
    }

    #[test]
    fn every_error_is_found_and_names_its_line() {
        let csv = "source,position_bits,position_step,output,drop\na.ply,22,,,\n,12,,,\nb.ply,12,0.1,,\nc.ply,x,,,\n\
                   d.ply,,,../up,\ne.ply,,,d,\nf.ply,,,d,\ng.ply,,,,everything\nh.ply,1\n";
        let list = errors("csv", csv);
        let expected = [
            "jobs, line 2: position_bits is a number from 1 to 21",
            "jobs, line 3: there is no source; name the mesh",
            "jobs, line 4: position_bits and position_step exclude each other; give one",
            "jobs, line 5: position_bits is a number, not \"x\"",
            "jobs, line 6: the output \"../up.lods\" has to be a relative path without . and ..",
            "jobs, line 8: the output \"d.lods\" is that of line 7 already; name another",
            "jobs, line 9: drop knows no \"everything\"; it knows all, normals, colors, uvs, images, materials, tangents, scalars",
            "jobs, line 10: 2 fields where the first line names 5 columns; quote fields that hold commas",
        ];
        for line in expected {
            assert!(list.iter().any(|e| e == line), "{line} is not among {list:#?}");
        }
        assert_eq!(list.len(), expected.len());
        assert_eq!(
            errors("csv", "file,bits\na,1\n")[0],
            "jobs, line 1: the column \"file\" is not known; known are source, output, position_bits, position_step, origin, uv_bits, uv_step, normal_bits, color_bits, scalar_bits, lock_borders, exact_images, schedule, texture, previews, weld, drop"
        );
        // Fields are read before they are understood: the order of the errors is not that of the lines.
        let mut list = errors(
            "csv",
            "source,uv_bits,uv_step,normal_bits,color_bits,scalar_bits,schedule,texture,previews\na.ply,25,,,,,,,\nb.ply,,-1,,,,,,\nc.ply,12,0.1,,,,,,\n\
                 d.ply,,,1,,,,,\ne.ply,,,,17,,,,\nf.ply,,,,,x,,,\ng.ply,,,,,,last,,\nh.ply,,,,,,,jpg,\ni.ply,,,,,,,,some\n",
        );
        list.sort();
        assert_eq!(
            list,
            [
                "jobs, line 10: previews: \"some\" is not auto or none",
                "jobs, line 2: uv_bits is a number from 1 to 24",
                "jobs, line 3: uv_step is a positive number, as in 0.000244140625",
                "jobs, line 4: uv_bits and uv_step exclude each other; give one",
                "jobs, line 5: normal_bits is a number from 2 to 16",
                "jobs, line 6: color_bits is a number from 1 to 16",
                "jobs, line 7: scalar_bits is a number, not \"x\"",
                "jobs, line 8: schedule: \"last\" is no order of chunks; use mesh-first, texture-first or linear, or quality",
                "jobs, line 9: texture: \"jpg\" is not keep, jpeg, or jpeg:QUALITY from 1 to 100, as in jpeg:90",
            ]
        );
    }

    #[test]
    fn json_and_toml_name_lines_too() {
        let list = errors("jsonl", "{\"source\":\"a.ply\"}\n{\"source\":\"b.ply\",\"bits\":3}\n{\"source\":\n{}\n");
        assert!(list[0].starts_with("jobs, line 2: column ") && list[0].contains("unknown field `bits`"), "{list:?}");
        assert!(list[1].starts_with("jobs, line 3: "), "{list:?}");
        assert_eq!(list[2], "jobs, line 4: there is no source; name the mesh");
        let list = errors("toml", "[[job]]\nsource = \"a.ply\"\n\n[[job]]\nsource = \"b.ply\"\nposition_bits = 99\n");
        assert_eq!(list, ["jobs, line 4: position_bits is a number from 1 to 21"]);
        let list = errors("toml", "[[job]]\nsource = \"a.ply\"\nstep = 1\n");
        assert!(list[0].starts_with("jobs, line 3: unknown field `step`"), "{list:?}");
        assert_eq!(errors("jsonl", "\n"), ["jobs, line 1: there is no job in it"]);
        let many = "{}\n".repeat(100);
        assert_eq!(errors("jsonl", &many).last().unwrap(), "and 80 more");
    }

    #[test]
    fn sources_elsewhere_give_their_last_name() {
        let text = "{\"source\":\"s3://bucket/deep/one.ply.gz\"}\n{\"source\":\"/abs/two.obj\"}\n{\"source\":\"../three.stl\"}\n";
        let jobs = parse("jobs", "jsonl", text.as_bytes(), &Settings::default()).unwrap();
        assert_eq!(jobs.iter().map(|j| j.output.as_str()).collect::<Vec<_>>(), ["one.lods", "two.lods", "three.lods"]);
    }
}
