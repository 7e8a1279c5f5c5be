//! The report as one page that needs nothing beside itself.

use crate::measure::{LevelRow, Measured};
use serde_json::Value;
use std::fmt::Write as _;

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:1200px;padding:0 1rem;color:#1c2430;background:#fff}\
h1{font-size:1.6rem}h2{font-size:1.15rem;margin-top:2.2rem}table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}\
th,td{padding:.25rem .6rem;text-align:right;border-bottom:1px solid #dde3ea}th:first-child,td:first-child{text-align:left}\
.group td{font-weight:600;padding-top:.9rem;color:#4a5666}details{margin:.3rem 0}summary{cursor:pointer}.wide{overflow-x:auto}\
th{font-weight:600;color:#4a5666;border-bottom:2px solid #b8c2cf}.good{color:#08743c}.bad{color:#b3261e}.note{color:#5a6675}\
.charts{display:grid;grid-template-columns:repeat(auto-fill,minmax(340px,1fr));gap:1rem}svg{width:100%;height:auto;background:#f7f9fb}\
svg text{font:11px system-ui,sans-serif;fill:#4a5666}\
@media(prefers-color-scheme:dark){body{background:#14181e;color:#dbe2ea}th,.group td{color:#a9b5c3}th,td{border-color:#2b333d}svg{background:#1b2129}svg text{fill:#a9b5c3}\
.good{color:#59c98b}.bad{color:#f08a80}.note{color:#94a1b0}}";

/// The whole page.
pub fn html(report: &Value, rows: &[Measured]) -> String {
    let mut out = String::new();
    let draco = report["draco"].as_str().map_or("not installed".to_string(), |v| format!("{v}, -cl 10 -qp 12"));
    // Writing into a string cannot fail, here and below.
    let _ = write!(
        out,
        "<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content='width=device-width'>\
         <title>lodestream: bench report</title><style>{STYLE}</style><h1>lodestream: bench report</h1>\
         <p class=note>Run: {}, {} cores. Draco: {}. Times are the best of a few runs, beside whatever else the machine was doing.</p>\
         <p class=note>Size, must, aim and Draco: bits per vertex in use (vertices of no face do not count where there are faces), whole file, at 12 \
         bits per coordinate (scaling: up to 15). At 10 %: bits per vertex of the full mesh until the coarsest level with a tenth of the vertices. Speeds in thousands \
         of vertices a second, reading and writing left out. Memory: peak of the process in bytes per vertex, for meshes of 20,000 vertices and more. Draco \
         has one level only, and leaves out or splits some of what is wrong with a mesh, so on defective ones its sizes are those of another mesh.</p>",
        escape(report["mode"].as_str().unwrap_or("")),
        report["cores"],
        escape(&draco)
    );
    out.push_str(
        "<div class=wide><table><tr><th>dataset<th>vertices<th>faces<th>bytes<th>size<th>must<th>aim<th>Draco<th>at 10 %<th>encode<br>kv/s\
         <th>decode<br>kv/s<th>Draco<br>decode<th>encode<br>B/v<th>decode<br>B/v</tr>",
    );
    let mut group = "";
    for row in rows {
        let (folder, name) = row.name.split_once('/').unwrap_or(("", &row.name));
        if folder != group {
            let _ = write!(out, "<tr class=group><td colspan=14>{}</tr>", escape(folder));
            group = folder;
        }
        let goal = crate::target(&row.name);
        let class = goal.map_or("", |(must, _)| if row.rate() <= must { "good" } else { "bad" });
        let cell = |value: Option<f64>, digits: usize| value.map_or("–".to_string(), |v| format!("{v:.digits$}"));
        let draco_speed =
            row.draco.as_ref().and_then(|d| d.decode_ms).filter(|ms| *ms > 0.0).map(|ms| row.vertices as f64 / ms);
        let _ = write!(
            out,
            "<tr><td>{}<td>{}<td>{}<td>{}<td class='{class}'>{:.2}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}</tr>",
            escape(name),
            thousands(row.vertices as u64),
            thousands(row.faces as u64),
            thousands(row.bytes),
            row.rate(),
            cell(goal.map(|g| g.0), 1),
            cell(goal.map(|g| g.1), 1),
            cell(row.draco.as_ref().map(|d| d.rate(row)), 2),
            cell(row.prefix_rate().map(|p| p.1), 2),
            cell(row.encode_speed().map(|s| s / 1e3), 0),
            cell(row.decode_speed().map(|s| s / 1e3), 0),
            cell(draco_speed, 0),
            cell(row.encode_memory_per_vertex(), 0),
            cell(row.decode_memory_per_vertex(), 0),
        );
    }
    out.push_str("</table></div>");
    let skipped: Vec<&str> = report["skipped"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    if !skipped.is_empty() {
        let _ = write!(out, "<p class=note>Skipped, not found: {}</p>", escape(&skipped.join(", ")));
    }
    scaling(&mut out, rows);
    let bits: Vec<&Measured> = rows.iter().filter(|r| r.by_bits.len() > 1).collect();
    if !bits.is_empty() {
        out.push_str("<h2>Other precisions, ours / Draco</h2><table><tr><th>dataset");
        bits[0].by_bits.iter().for_each(|b| {
            let _ = write!(out, "<th>{} bits", b.bits);
        });
        for row in bits {
            let rate = |bytes: u64| 8.0 * bytes as f64 / row.in_use as f64;
            let _ = write!(out, "<tr><td>{}", escape(&row.name));
            for b in &row.by_bits {
                let draco = b.draco.map_or("–".to_string(), |bytes| format!("{:.2}", rate(bytes)));
                let _ = write!(out, "<td>{:.2} / {draco}", rate(b.bytes));
            }
        }
        out.push_str("</table>");
    }
    out.push_str(
        "<h2>Error of the levels</h2><p class=note>Distance to the input in units of the model against bits per vertex of the full mesh, both \
         logarithmic. Solid: measured by sampling; dashed: the bound that the file states.</p><div class=charts>",
    );
    rows.iter()
        .filter(|r| r.levels.iter().filter(|l| l.measured.is_some()).count() > 2)
        .for_each(|r| chart(&mut out, r));
    out.push_str("</div><h2>Levels that were measured</h2>");
    for row in rows.iter().filter(|r| r.levels.iter().any(|l| l.measured.is_some())) {
        let _ = write!(
            out,
            "<details><summary>{}</summary><table><tr><th>level<th>vertices<th>faces<th>bytes<th>bound<th>measured</tr>",
            escape(&row.name)
        );
        for l in row.levels.iter().filter(|l| l.measured.is_some()) {
            let shown = |e: Option<f64>| e.map_or("?".to_string(), |e| format!("{e:.3e}"));
            let _ = write!(
                out,
                "<tr><td>{}<td>{}<td>{}<td>{}<td>{}<td>{}</tr>",
                l.level,
                thousands(l.vertices),
                thousands(l.faces),
                thousands(l.bytes),
                shown(l.bound),
                shown(l.measured)
            );
        }
        out.push_str("</table></details>");
    }
    out.push_str("</html>\n");
    out
}

/// Cost per vertex as size grows.
fn scaling(out: &mut String, rows: &[Measured]) {
    let (series, costs) = crate::scaling(rows);
    if series.len() < 2 {
        return;
    }
    out.push_str("<h2>Cost per vertex as size grows</h2><table><tr><th>");
    for row in series {
        let _ = write!(out, "<th>{}, {} bits", escape(&row.name), row.bits);
    }
    for (name, costs) in costs {
        let _ = write!(out, "<tr><td>{name}");
        for cost in costs {
            let _ = write!(out, "<td>{}", crate::digits(cost));
        }
    }
    out.push_str("</table>");
}

/// Error over rate.
fn chart(out: &mut String, row: &Measured) {
    let [width, height, left, bottom] = [340.0f64, 230.0, 46.0, 30.0];
    let n = row.vertices.max(1) as f64;
    let point =
        |bytes: u64, error: Option<f64>| Some(((8.0 * bytes as f64 / n).ln(), error.filter(|e| *e > 0.0)?.ln()));
    // Small levels share a chunk: of those that come with the same bytes the finest counts.
    let mut shown: Vec<&LevelRow> = row.levels.iter().filter(|l| l.measured.is_some()).collect();
    shown.reverse();
    shown.dedup_by_key(|l| l.bytes);
    shown.reverse();
    let measured: Vec<(f64, f64)> =
        shown.iter().filter_map(|l| point(l.bytes, l.measured)).filter(|p| p.0.is_finite()).collect();
    let bounds: Vec<(f64, f64)> =
        shown.iter().filter_map(|l| point(l.bytes, l.bound)).filter(|p| p.0.is_finite()).collect();
    let all = || measured.iter().chain(&bounds);
    let range = |f: fn(&(f64, f64)) -> f64| {
        let (lo, hi) = all().map(f).fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| (lo.min(x), hi.max(x)));
        (lo, (hi - lo).max(1e-9))
    };
    let ((x0, dx), (y0, dy)) = (range(|p| p.0), range(|p| p.1));
    let place = |&(x, y): &(f64, f64)| {
        (left + (x - x0) / dx * (width - left - 14.0), height - bottom - (y - y0) / dy * (height - bottom - 34.0))
    };
    let line = |points: &[(f64, f64)]| {
        points.iter().map(place).map(|(x, y)| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
    };
    let _ =
        write!(out, "<svg viewBox='0 0 {width} {height}' role=img><text x={left} y=18>{}</text>", escape(&row.name));
    let _ = write!(
        out,
        "<polyline points='{}' fill=none stroke=#8b96a5 stroke-dasharray='4 3'/><polyline points='{}' fill=none stroke=#1f6feb stroke-width=2 />",
        line(&bounds),
        line(&measured)
    );
    for (x, y) in measured.iter().map(place) {
        let _ = write!(out, "<circle cx={x:.1} cy={y:.1} r=2.5 fill=#1f6feb />");
    }
    let _ = write!(
        out,
        "<text x={left} y={0}>{1:.2}</text><text x={2} y={0} text-anchor=end>{3:.2} bits per vertex</text>\
         <text x=4 y={4}>{5:.1e}</text><text x=4 y=38>{6:.1e}</text></svg>",
        height - 8.0,
        x0.exp(),
        width - 8.0,
        (x0 + dx).exp(),
        height - bottom,
        y0.exp(),
        (y0 + dy).exp(),
    );
}

/// `1234567` as `1,234,567`.
fn thousands(n: u64) -> String {
    let digits = n.to_string();
    let head = digits.len() % 3;
    let groups = (head..digits.len()).step_by(3).map(|i| &digits[i..i + 3]);
    let head = (head > 0).then_some(&digits[..head]);
    head.into_iter().chain(groups).collect::<Vec<_>>().join(",")
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
