//! The page: one HTML file with its pictures and curves inside.

use super::Args;
use super::measure::{Measured, Subject};
use crate::shared;
use anyhow::Result;
use base64::Engine;
use lodestream::page::chart::{self, Point, Row, Scale, Series, number};
use lodestream::page::page;
use maud::{Markup, html};

/// Colours of the files' curves, told apart by most eyes (Okabe and Ito), darkened where white is behind.
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9", "#666666"];

/// The page of all files.
///
/// # Errors
/// Where a picture cannot be written.
pub fn html(subjects: &[Subject], args: &Args) -> Result<String> {
    let per_vertex = |s: &Subject| s.kinds.iter().map(|k| (k.0, k.1 / s.vertices.max(1) as f64)).collect();
    let kinds: Vec<Row> = subjects.iter().map(|s| (s.name.clone(), per_vertex(s))).collect();
    let stages: Vec<Row> = subjects.iter().map(|s| (s.name.clone(), s.stages.clone())).collect();
    let strips: Vec<Markup> = subjects.iter().map(strip).collect::<Result<_>>()?;
    let content = html! {
        h1 { "What each prefix is worth" }
        (introduction(args))
        (key(subjects))
        @for (s, warning) in subjects.iter().flat_map(|s| s.warnings.iter().map(move |w| (s, w))) {
            p.dim { (s.name) ": " (warning) }
        }
        (charts(subjects))
        (chart::bars("Bits by kind", "bits per vertex", &kinds))
        (chart::bars("Time by stage", "seconds", &stages))
        @for (s, strip) in subjects.iter().zip(&strips) { (strip) (table(s)) }
    };
    Ok(page("lodestream report", &content))
}

fn introduction(args: &Args) -> Markup {
    let samples = shared::thousands(args.sampling.options().samples as u64);
    html! {
        p.dim {
            "lodestream " (env!("CARGO_PKG_VERSION")) "; distances are the larger of both directions, as parts of the bounding box's diagonal, from "
            (samples) " samples on faces, as many along edges, and vertices; size is of all bytes from the beginning of the file"
            @if args.looks.views > 0 {
                "; MS-SSIM is the mean of " (args.looks.views) " views of " (args.looks.size) " pixels"
            }
            "."
        }
    }
}

fn key(subjects: &[Subject]) -> Markup {
    html! {
        p.key {
            @for (i, s) in subjects.iter().enumerate() {
                span {
                    i style=(format!("background:{}", colour(i))) {}
                    (s.name) " "
                    em {
                        (shared::thousands(s.vertices as u64)) " vertices, " (shared::human_bytes(s.bytes)) ", "
                        (format!("{:.2}", s.rate(s.bytes))) " bits per vertex"
                    }
                }
            }
        }
    }
}

fn charts(subjects: &[Subject]) -> Markup {
    type Value = fn(&Subject, &Measured) -> Option<f64>;
    let curves: [(&str, Scale, Value); 4] = [
        ("Mean distance", Scale::Log, |s, l| Some(s.relative(l.geometry.mean()))),
        ("Root mean square distance", Scale::Log, |s, l| Some(s.relative(l.geometry.rms()))),
        ("Largest distance", Scale::Log, |s, l| Some(s.relative(l.geometry.max()))),
        ("MS-SSIM", Scale::Linear, |_, l| l.ms_ssim),
    ];
    let series = |(i, s): (usize, &Subject), value: Value| {
        let points = s.levels.iter().filter_map(|l| Some(point(s, l, value(s, l)?)));
        Series { name: s.name.clone(), colour: colour(i), dashed: false, points: points.collect() }
    };
    html! {
        div.charts {
            @for (title, scale, value) in curves {
                @let series: Vec<Series> = subjects.iter().enumerate().map(|s| series(s, value)).collect();
                (chart::curves(title, "bits per vertex of the full mesh", scale, &series))
            }
        }
    }
}

fn colour(i: usize) -> &'static str {
    COLOURS[i % COLOURS.len()]
}

fn point(s: &Subject, l: &Measured, value: f64) -> Point {
    let text = format!(
        "level {}, {} vertices{}, {} ({:.2} bits per vertex): {}",
        l.level,
        shared::thousands(l.vertices as u64),
        images(s, l),
        shared::human_bytes(l.bytes),
        s.rate(l.bytes),
        number(value)
    );
    (s.rate(l.bytes), value, text)
}

fn strip(s: &Subject) -> Result<Markup> {
    let picture = |l: &Measured| {
        let mut png = Vec::new();
        l.picture.write_png(&mut png)?;
        Ok(base64::engine::general_purpose::STANDARD.encode(&png))
    };
    let pictures: Vec<String> = s.levels.iter().map(picture).collect::<Result<_>>()?;
    Ok(html! {
        h2 { (s.name) }
        div.strip {
            @for (l, picture) in s.levels.iter().zip(&pictures).rev() {
                div {
                    img alt=(format!("level {}", l.level)) src=(format!("data:image/png;base64,{picture}"));
                    "level " (l.level) ": " (shared::thousands(l.vertices as u64)) " vertices" (images(s, l))
                    br;
                    em { (shared::human_bytes(l.bytes)) ", " (format!("{:.2}", s.rate(l.bytes))) " bits per vertex" }
                }
            }
        }
    })
}

/// How much of the images is there, where there are any.
fn images(s: &Subject, l: &Measured) -> String {
    match s.images {
        0 => String::new(),
        all => format!(", {} of {} of images", shared::human_bytes(l.images), shared::human_bytes(all)),
    }
}

fn table(s: &Subject) -> Markup {
    const HEADS: [&str; 12] = [
        "level",
        "vertices",
        "faces",
        "bytes",
        "of images",
        "bits/vertex",
        "mean × 10⁴",
        "rms × 10⁴",
        "max × 10⁴",
        "bound × 10⁴",
        "MS-SSIM",
        "decoded after",
    ];
    let parts = |d: f64| number(1e4 * s.relative(d));
    let cells = |l: &Measured| {
        [
            l.level.to_string(),
            shared::thousands(l.vertices as u64),
            shared::thousands(l.faces as u64),
            shared::thousands(l.bytes),
            shared::thousands(l.images),
            format!("{:.2}", s.rate(l.bytes)),
            parts(l.geometry.mean()),
            parts(l.geometry.rms()),
            parts(l.geometry.max()),
            l.bound.map_or("?".into(), parts),
            l.ms_ssim.map_or(String::new(), |m| format!("{m:.4}")),
            format!("{:.3} s", l.decode_seconds),
        ]
    };
    html! {
        div.wide {
            table {
                tr { @for head in HEADS { th { (head) } } }
                @for l in &s.levels { tr { @for cell in cells(l) { td { (cell) } } } }
            }
        }
    }
}
