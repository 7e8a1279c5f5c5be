//! The page: one HTML file with its pictures and curves inside.

use super::Args;
use super::chart::{self, Scale, Series, number};
use super::measure::{Measured, Subject};
use crate::shared;
use anyhow::Result;
use base64::Engine;
use std::fmt::Write as _;

/// Colours of the files' curves, told apart by most eyes (Okabe and Ito), darkened where white is behind.
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9", "#666666"];

/// Text in HTML.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

const HEAD: &str = r#"<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>lodestream report</title>
<style>
:root{color-scheme:light dark;--ink:#1c1f24;--dim:#667;--paper:#fff;--line:#dde;--card:#f6f7f9}
@media(prefers-color-scheme:dark){:root{--ink:#dee2e9;--dim:#99a;--paper:#181a1f;--line:#334;--card:#22252b}}
body{font:15px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:1200px;margin:0 auto;padding:1.5rem}
h1{font-size:1.5rem;margin:0}h2{font-size:1.1rem;margin:2rem 0 .5rem}p{margin:.3rem 0}.dim,em{color:var(--dim);font-style:normal}
.charts{display:grid;grid-template-columns:repeat(auto-fit,minmax(420px,1fr));gap:1rem}
figure{margin:0;background:var(--card);border-radius:8px;padding:.5rem}svg{width:100%;height:auto}
svg text{fill:var(--ink);font:12px system-ui,sans-serif}svg .t{font-size:14px;font-weight:600}svg .l{fill:var(--dim)}.g{stroke:var(--line)}
.key span{margin-right:1.2rem;white-space:nowrap}.key i{display:inline-block;width:.8rem;height:.8rem;border-radius:2px;margin-right:.4rem;vertical-align:-1px}
.strip{display:flex;gap:.7rem;overflow-x:auto;padding-bottom:.5rem}.strip div{flex:none;width:180px;font-size:13px}.strip img{width:180px;border-radius:6px;display:block}
.row{display:grid;grid-template-columns:minmax(8rem,14rem) 1fr 11rem;gap:.8rem;align-items:center;margin:.3rem 0}.row b{font-weight:500;overflow:hidden;text-overflow:ellipsis}
.bar{display:flex;height:1.3rem;background:var(--card);border-radius:3px;overflow:hidden}.bar span{display:block}
.wide{overflow-x:auto}table{border-collapse:collapse;font-variant-numeric:tabular-nums}th,td{text-align:right;padding:.2rem .7rem;border-bottom:1px solid var(--line)}th:first-child,td:first-child{text-align:left}
</style></head><body>
"#;

/// The page of all files.
///
/// # Errors
/// Where a picture cannot be written.
pub fn html(subjects: &[Subject], args: &Args) -> Result<String> {
    let mut out = String::from(HEAD);
    // Writing into a string cannot fail, here and below.
    let _ = writeln!(
        out,
        "<h1>What each prefix is worth</h1><p class=\"dim\">lodestream {}; distances are the larger of both directions, as parts of the \
         bounding box's diagonal, from {} samples on faces, as many along edges, and vertices; size is of all bytes from the beginning of the file{}.</p>",
        env!("CARGO_PKG_VERSION"),
        shared::thousands(args.sampling.options().samples as u64),
        if args.looks.views > 0 {
            format!("; MS-SSIM is the mean of {} views of {} pixels", args.looks.views, args.looks.size)
        } else {
            String::new()
        }
    );
    out.push_str("<p class=\"key\">");
    for (i, s) in subjects.iter().enumerate() {
        let _ = write!(
            out,
            "<span><i style=\"background:{}\"></i>{} <em>{} vertices, {}, {:.2} bits per vertex</em></span>",
            colour(i),
            escape(&s.name),
            shared::thousands(s.vertices as u64),
            shared::human_bytes(s.bytes),
            s.rate(s.bytes)
        );
    }
    out.push_str("</p>\n");
    for (s, warning) in subjects.iter().flat_map(|s| s.warnings.iter().map(move |w| (s, w))) {
        let _ = writeln!(out, "<p class=\"dim\">{}: {}</p>", escape(&s.name), escape(warning));
    }
    out.push_str("<div class=\"charts\">\n");
    type Value = fn(&Subject, &Measured) -> Option<f64>;
    let curves: [(&str, Scale, Value); 4] = [
        ("Mean distance", Scale::Log, |s, l| Some(s.relative(l.geometry.mean()))),
        ("Root mean square distance", Scale::Log, |s, l| Some(s.relative(l.geometry.rms()))),
        ("Largest distance", Scale::Log, |s, l| Some(s.relative(l.geometry.max()))),
        ("MS-SSIM", Scale::Linear, |_, l| l.ms_ssim),
    ];
    for (title, scale, value) in curves {
        let series: Vec<Series> = subjects
            .iter()
            .enumerate()
            .map(|(i, s)| Series {
                name: s.name.clone(),
                colour: colour(i),
                points: s
                    .levels
                    .iter()
                    .filter_map(|l| Some((s.rate(l.bytes), value(s, l)?, point(s, l, value(s, l)?))))
                    .collect(),
            })
            .collect();
        out.push_str(&chart::curves(title, "bits per vertex of the full mesh", scale, &series));
    }
    out.push_str("</div>\n");
    let per_vertex = |s: &Subject| s.kinds.iter().map(|k| (k.0, k.1 / s.vertices.max(1) as f64)).collect();
    let rows: Vec<_> = subjects.iter().map(|s| (s.name.clone(), per_vertex(s))).collect();
    out.push_str(&chart::bars("Bits by kind", "bits per vertex", &rows));
    let rows: Vec<_> = subjects.iter().map(|s| (s.name.clone(), s.stages.clone())).collect();
    out.push_str(&chart::bars("Time by stage", "seconds", &rows));
    for s in subjects {
        strip(&mut out, s)?;
        table(&mut out, s);
    }
    out.push_str("</body></html>\n");
    Ok(out)
}

fn colour(i: usize) -> &'static str {
    COLOURS[i % COLOURS.len()]
}

fn point(s: &Subject, l: &Measured, value: f64) -> String {
    format!(
        "level {}, {} vertices{}, {} ({:.2} bits per vertex): {}",
        l.level,
        shared::thousands(l.vertices as u64),
        images(s, l),
        shared::human_bytes(l.bytes),
        s.rate(l.bytes),
        number(value)
    )
}

fn strip(out: &mut String, s: &Subject) -> Result<()> {
    let _ = write!(out, "<h2>{}</h2><div class=\"strip\">", escape(&s.name));
    for l in s.levels.iter().rev() {
        let mut png = Vec::new();
        l.picture.write_png(&mut png)?;
        let _ = write!(
            out,
            "<div><img alt=\"level {0}\" src=\"data:image/png;base64,{1}\">level {0}: {2} vertices{5}<br><em>{3}, {4:.2} bits per vertex</em></div>",
            l.level,
            base64::engine::general_purpose::STANDARD.encode(&png),
            shared::thousands(l.vertices as u64),
            shared::human_bytes(l.bytes),
            s.rate(l.bytes),
            images(s, l)
        );
    }
    out.push_str("</div>\n");
    Ok(())
}

/// How much of the images is there, where there are any.
fn images(s: &Subject, l: &Measured) -> String {
    match s.images {
        0 => String::new(),
        all => format!(", {} of {} of images", shared::human_bytes(l.images), shared::human_bytes(all)),
    }
}

fn table(out: &mut String, s: &Subject) {
    out.push_str(
        "<div class=\"wide\"><table><tr><th>level</th><th>vertices</th><th>faces</th><th>bytes</th><th>of images</th><th>bits/vertex</th>\
         <th>mean × 10⁴</th><th>rms × 10⁴</th><th>max × 10⁴</th><th>bound × 10⁴</th><th>MS-SSIM</th><th>decoded after</th></tr>\n",
    );
    for l in &s.levels {
        let parts = |d: f64| number(1e4 * s.relative(d));
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.2}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.3} s</td></tr>",
            l.level,
            shared::thousands(l.vertices as u64),
            shared::thousands(l.faces as u64),
            shared::thousands(l.bytes),
            shared::thousands(l.images),
            s.rate(l.bytes),
            parts(l.geometry.mean()),
            parts(l.geometry.rms()),
            parts(l.geometry.max()),
            l.bound.map_or("?".into(), parts),
            l.ms_ssim.map_or("".into(), |m| format!("{m:.4}")),
            l.decode_seconds
        );
    }
    out.push_str("</table></div>\n");
}
