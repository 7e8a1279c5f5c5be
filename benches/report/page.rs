//! The report as one page that needs nothing beside itself.

use crate::measure::{LevelRow, Measured};
use lodestream::page::chart::{Scale, Series, curves};
use lodestream::page::{page, thousands};
use maud::{Markup, html};
use serde_json::Value;

/// The whole page.
pub fn html(report: &Value, rows: &[Measured]) -> String {
    let skipped: Vec<&str> = report["skipped"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let sampled = |r: &&Measured| r.levels.iter().any(|l| l.measured.is_some());
    let content = html! {
        h1 { "lodestream: bench report" }
        (introduction(report))
        (sizes(rows))
        @if !skipped.is_empty() { p.dim { "Skipped, not found: " (skipped.join(", ")) } }
        (scaling(rows))
        (precisions(rows))
        h2 { "Error of the levels" }
        p.dim {
            "Distance to the input in units of the model against bits per vertex of the full mesh, both logarithmic. Solid: measured by \
             sampling; dashed: the bound that the file states."
        }
        div.charts {
            @for r in rows.iter().filter(|r| r.levels.iter().filter(|l| l.measured.is_some()).count() > 2) { (chart(r)) }
        }
        h2 { "Levels that were measured" }
        @for row in rows.iter().filter(sampled) { (levels(row)) }
    };
    page("lodestream: bench report", &content)
}

fn introduction(report: &Value) -> Markup {
    let draco = report["draco"].as_str().map_or("not installed".to_string(), |v| format!("{v}, -cl 10 -qp 12"));
    html! {
        p.dim {
            "Run: " (report["mode"].as_str().unwrap_or("")) ", " (report["cores"].to_string()) " cores. Draco: " (draco)
            ". Times are the best of a few runs, beside whatever else the machine was doing."
        }
        p.dim {
            "Size, must, aim and Draco: bits per vertex in use (vertices of no face do not count where there are faces), whole file, at 12 bits \
             per coordinate (scaling: up to 15). At 10 %: bits per vertex of the full mesh until the coarsest level with a tenth of the vertices. \
             Speeds in thousands of vertices a second, reading and writing left out. Memory: peak of the process in bytes per vertex, for meshes \
             of 20,000 vertices and more. Draco has one level only, and leaves out or splits some of what is wrong with a mesh, so on defective \
             ones its sizes are those of another mesh."
        }
    }
}

/// Sizes, speeds and memory, a row for each dataset.
fn sizes(rows: &[Measured]) -> Markup {
    const HEADS: [&str; 14] = [
        "dataset",
        "vertices",
        "faces",
        "bytes",
        "size",
        "must",
        "aim",
        "Draco",
        "at 10 %",
        "encode kv/s",
        "decode kv/s",
        "Draco decode",
        "encode B/v",
        "decode B/v",
    ];
    let place = |row: &Measured| {
        let (folder, name) = row.name.split_once('/').unwrap_or(("", &row.name));
        (folder.to_string(), name.to_string())
    };
    let cell = |value: Option<f64>, digits: usize| value.map_or("–".to_string(), |v| format!("{v:.digits$}"));
    let cells = |row: &Measured| {
        let goal = crate::target(&row.name);
        let draco_speed =
            row.draco.as_ref().and_then(|d| d.decode_ms).filter(|ms| *ms > 0.0).map(|ms| row.vertices as f64 / ms);
        [
            cell(goal.map(|g| g.0), 1),
            cell(goal.map(|g| g.1), 1),
            cell(row.draco.as_ref().map(|d| d.rate(row)), 2),
            cell(row.prefix_rate().map(|p| p.1), 2),
            cell(row.encode_speed().map(|s| s / 1e3), 0),
            cell(row.decode_speed().map(|s| s / 1e3), 0),
            cell(draco_speed, 0),
            cell(row.encode_memory_per_vertex(), 0),
            cell(row.decode_memory_per_vertex(), 0),
        ]
    };
    let class = |row: &Measured| {
        crate::target(&row.name).map_or("", |(must, _)| if row.rate() <= must { "good" } else { "bad" })
    };
    let groups: Vec<&[Measured]> = rows.chunk_by(|a, b| place(a).0 == place(b).0).collect();
    html! {
        div.wide {
            table {
                tr { @for head in HEADS { th { (head) } } }
                @for group in groups {
                    tr.group { td colspan="14" { (place(&group[0]).0) } }
                    @for row in group {
                        tr {
                            td { (place(row).1) }
                            @for n in [row.vertices as u64, row.faces as u64, row.bytes] { td { (thousands(n)) } }
                            td class=(class(row)) { (format!("{:.2}", row.rate())) }
                            @for cell in cells(row) { td { (cell) } }
                        }
                    }
                }
            }
        }
    }
}

/// Cost per vertex as size grows.
fn scaling(rows: &[Measured]) -> Markup {
    let (series, costs) = crate::scaling(rows);
    if series.len() < 2 {
        return html! {};
    }
    html! {
        h2 { "Cost per vertex as size grows" }
        table {
            tr { th {} @for row in series { th { (row.name) ", " (row.bits) " bits" } } }
            @for (name, costs) in costs {
                tr { td { (name) } @for cost in costs { td { (crate::digits(cost)) } } }
            }
        }
    }
}

fn precisions(rows: &[Measured]) -> Markup {
    let rows: Vec<&Measured> = rows.iter().filter(|r| r.by_bits.len() > 1).collect();
    let Some(first) = rows.first() else { return html! {} };
    html! {
        h2 { "Other precisions, ours / Draco" }
        table {
            tr { th { "dataset" } @for b in &first.by_bits { th { (b.bits) " bits" } } }
            @for row in &rows {
                @let rate = |bytes: u64| format!("{:.2}", 8.0 * bytes as f64 / row.in_use as f64);
                tr {
                    td { (row.name) }
                    @for b in &row.by_bits { td { (rate(b.bytes)) " / " (b.draco.map_or("–".to_string(), rate)) } }
                }
            }
        }
    }
}

/// Error over rate.
fn chart(row: &Measured) -> Markup {
    // Small levels share a chunk: of those that come with the same bytes the finest counts.
    let mut shown: Vec<&LevelRow> = row.levels.iter().filter(|l| l.measured.is_some()).collect();
    shown.reverse();
    shown.dedup_by_key(|l| l.bytes);
    shown.reverse();
    let series = |name: &str, colour, dashed, error: fn(&LevelRow) -> Option<f64>| {
        let rate = |l: &LevelRow| 8.0 * l.bytes as f64 / row.vertices.max(1) as f64;
        let point = |l: &&LevelRow| {
            error(l).map(|e| (rate(l), e, format!("level {}, {:.2} bits per vertex: {e:.3e}", l.level, rate(l))))
        };
        Series { name: name.to_string(), colour, dashed, points: shown.iter().filter_map(point).collect() }
    };
    let all = [series("bound", "#8b96a5", true, |l| l.bound), series("measured", "#1f6feb", false, |l| l.measured)];
    curves(&row.name, "bits per vertex", Scale::Log, &all)
}

fn levels(row: &Measured) -> Markup {
    let error = |e: Option<f64>| e.map_or("?".to_string(), |e| format!("{e:.3e}"));
    html! {
        details {
            summary { (row.name) }
            table {
                tr { @for head in ["level", "vertices", "faces", "bytes", "bound", "measured"] { th { (head) } } }
                @for l in row.levels.iter().filter(|l| l.measured.is_some()) {
                    tr {
                        td { (l.level) }
                        @for n in [l.vertices, l.faces, l.bytes] { td { (thousands(n)) } }
                        @for e in [l.bound, l.measured] { td { (error(e)) } }
                    }
                }
            }
        }
    }
}
