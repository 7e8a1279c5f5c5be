//! Curves as SVG.

use super::page::escape;
use std::fmt::Write as _;

/// One curve.
pub struct Series {
    pub name: String,
    pub colour: &'static str,
    /// x, y and what to say about the point.
    pub points: Vec<(f64, f64, String)>,
}

/// How y runs.
#[derive(Clone, Copy, PartialEq)]
pub enum Scale {
    Log,
    Linear,
}

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 360.0;
const LEFT: f64 = 74.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 46.0;

/// Curves over a logarithmic x axis.
pub fn curves(title: &str, x_label: &str, scale: Scale, series: &[Series]) -> String {
    let shown = |p: &&(f64, f64, String)| p.0 > 0.0 && p.1.is_finite() && (scale == Scale::Linear || p.1 > 0.0);
    let all: Vec<&(f64, f64, String)> = series.iter().flat_map(|s| s.points.iter().filter(shown)).collect();
    if all.is_empty() {
        return String::new();
    }
    let range = |f: fn(&(f64, f64, String)) -> f64| {
        all.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), p| (lo.min(f(p)), hi.max(f(p))))
    };
    let (x_range, y_range) = (range(|p| p.0), range(|p| p.1));
    let x_ticks = log_ticks(x_range);
    let y_ticks = if scale == Scale::Log { log_ticks(y_range) } else { linear_ticks(y_range) };
    let ends = |ticks: &[f64], range: (f64, f64)| {
        (ticks.first().map_or(range.0, |t| t.min(range.0)), ticks.last().map_or(range.1, |t| t.max(range.1)))
    };
    let (x_ends, y_ends) = (ends(&x_ticks, x_range), ends(&y_ticks, y_range));
    let part = |value: f64, (lo, hi): (f64, f64)| if hi > lo { (value - lo) / (hi - lo) } else { 0.5 };
    let ln = |(lo, hi): (f64, f64)| (lo.ln(), hi.ln());
    let x = |v: f64| LEFT + (WIDTH - LEFT - RIGHT) * part(v.ln(), ln(x_ends));
    let y = |v: f64| {
        let t = if scale == Scale::Log { part(v.ln(), ln(y_ends)) } else { part(v, y_ends) };
        HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * t
    };
    let mut out = String::new();
    // Writing into a string cannot fail, here and below.
    let _ = write!(
        out,
        "<figure><svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{0}\"><text x=\"{LEFT}\" y=\"20\" class=\"t\">{0}</text>",
        escape(title)
    );
    for &tick in &x_ticks {
        let at = x(tick);
        let _ = write!(
            out,
            "<line class=\"g\" x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{TOP}\" y2=\"{:.1}\"/><text class=\"l\" x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            HEIGHT - BOTTOM,
            HEIGHT - BOTTOM + 17.0,
            number(tick)
        );
    }
    for &tick in &y_ticks {
        let at = y(tick);
        let _ = write!(
            out,
            "<line class=\"g\" x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/><text class=\"l\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            WIDTH - RIGHT,
            LEFT - 7.0,
            at + 4.0,
            number(tick)
        );
    }
    let _ = write!(
        out,
        "<text class=\"l\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
        0.5 * (LEFT + WIDTH - RIGHT),
        HEIGHT - 8.0,
        escape(x_label)
    );
    for s in series {
        let points: Vec<&(f64, f64, String)> = s.points.iter().filter(shown).collect();
        let path: Vec<String> = points.iter().map(|p| format!("{:.1},{:.1}", x(p.0), y(p.1))).collect();
        let _ = write!(
            out,
            "<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"2\" points=\"{}\"/>",
            s.colour,
            path.join(" ")
        );
        for p in points {
            let _ = write!(
                out,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3.6\" fill=\"{}\"><title>{}: {}</title></circle>",
                x(p.0),
                y(p.1),
                s.colour,
                escape(&s.name),
                escape(&p.2)
            );
        }
    }
    out.push_str("</svg></figure>\n");
    out
}

/// Bars of parts, one under the other; the parts keep their colours.
pub fn bars(title: &str, unit: &str, rows: &[(String, Vec<(&'static str, f64)>)]) -> String {
    const COLOURS: [&str; 7] = ["#4e79a7", "#f28e2b", "#59a14f", "#b07aa1", "#9c755f", "#e15759", "#76b7b2"];
    let rows: Vec<&(String, Vec<(&'static str, f64)>)> = rows.iter().filter(|r| !r.1.is_empty()).collect();
    let mut names: Vec<&'static str> = Vec::new();
    rows.iter().flat_map(|r| &r.1).for_each(|p| {
        if !names.contains(&p.0) {
            names.push(p.0);
        }
    });
    let sum = |r: &(String, Vec<(&'static str, f64)>)| r.1.iter().map(|p| p.1).sum::<f64>();
    let most = rows.iter().map(|r| sum(r)).fold(0.0, f64::max);
    if most <= 0.0 {
        return String::new();
    }
    let colour = |name: &str| COLOURS[names.iter().position(|n| *n == name).unwrap_or(0) % COLOURS.len()];
    let mut out = format!("<section class=\"bars\"><h2>{}</h2><p class=\"key\">", escape(title));
    for name in &names {
        let _ = write!(out, "<span><i style=\"background:{}\"></i>{}</span>", colour(name), escape(name));
    }
    out.push_str("</p>");
    for row in rows {
        let _ = write!(out, "<div class=\"row\"><b>{}</b><div class=\"bar\">", escape(&row.0));
        for (name, value) in &row.1 {
            let _ = write!(
                out,
                "<span style=\"width:{:.2}%;background:{}\" title=\"{}: {} {unit}\"></span>",
                100.0 * value / most,
                colour(name),
                escape(name),
                number(*value)
            );
        }
        let _ = write!(out, "</div><em>{} {unit}</em></div>", number(sum(row)));
    }
    out.push_str("</section>\n");
    out
}

/// 1, 2 and 5 times powers of ten inside a range and one step beyond, thinned to at most eight.
fn log_ticks((lo, hi): (f64, f64)) -> Vec<f64> {
    let (from, to) = (lo.log10().floor() as i32, hi.log10().ceil() as i32);
    let all: Vec<f64> = (from..=to).flat_map(|e| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(e))).collect();
    let first = all.iter().rposition(|&t| t <= lo * 1.0001).unwrap_or(0);
    let last = all.iter().position(|&t| t >= hi * 0.9999).unwrap_or(all.len() - 1);
    let near = all[first..=last.max(first)].to_vec();
    if near.len() <= 8 { near } else { (from..=to).map(|e| 10f64.powi(e)).collect() }
}

fn linear_ticks((lo, hi): (f64, f64)) -> Vec<f64> {
    let span = (hi - lo).max(1e-6);
    let raw = span / 5.0;
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|&s| s >= raw).unwrap_or(raw);
    let first = (lo / step).floor() as i64;
    (first..=(hi / step).ceil() as i64).map(|i| i as f64 * step).collect()
}

/// A number with three digits that count.
pub fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let size = value.abs().log10().floor();
    if !(-3.0..6.0).contains(&size) {
        return format!("{value:.2e}").replace(".00e", "e");
    }
    let digits = (2.0 - size).max(0.0) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_enclose_what_is_shown() {
        assert_eq!(log_ticks((0.3, 7.0)), [0.2, 0.5, 1.0, 2.0, 5.0, 10.0]);
        assert!(log_ticks((1e-7, 3.0)).len() <= 9);
        let ticks = linear_ticks((0.62, 0.999));
        assert!(ticks[0] <= 0.62 && ticks[ticks.len() - 1] >= 0.999 && ticks.len() < 9, "{ticks:?}");
    }

    #[test]
    fn numbers_are_short() {
        let all = [0.0, 1.0, 0.00123456, 12.3456, 123456.0, 1e-7, 2.5e9].map(number);
        assert_eq!(all, ["0", "1", "0.00123", "12.3", "123456", "1e-7", "2.50e9"]);
    }

    #[test]
    fn a_chart_says_what_its_points_are() {
        let series = [Series { name: "a<b".into(), colour: "#123456", points: vec![(1.0, 0.5, "x & y".into())] }];
        let svg = curves("Title", "bits", Scale::Linear, &series);
        assert!(svg.contains("a&lt;b: x &amp; y") && svg.matches("<circle").count() == 1);
        assert_eq!(curves("Nothing", "bits", Scale::Log, &[]), "");
    }
}
