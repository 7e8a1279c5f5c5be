//! Curves as SVG, bars as boxes.

use maud::{Markup, html};

/// x, y and what to say about the point.
pub type Point = (f64, f64, String);

/// One curve.
pub struct Series {
    /// What it is of.
    pub name: String,
    /// A colour of CSS.
    pub colour: &'static str,
    /// Drawn as dashes, without a mark at each point.
    pub dashed: bool,
    /// Its points, in order.
    pub points: Vec<Point>,
}

/// How y runs.
#[derive(Clone, Copy, PartialEq)]
pub enum Scale {
    /// By orders of size.
    Log,
    /// By steps.
    Linear,
}

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 360.0;
const LEFT: f64 = 74.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 46.0;

/// The place of values in a chart.
struct Axes {
    scale: Scale,
    x_ticks: Vec<f64>,
    y_ticks: Vec<f64>,
    /// The least and the largest value shown, or their logarithms.
    x_ends: (f64, f64),
    y_ends: (f64, f64),
}

impl Axes {
    /// For points of which there is at least one.
    fn new(scale: Scale, points: &[&Point]) -> Self {
        let range = |f: fn(&Point) -> f64| {
            points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), p| (lo.min(f(p)), hi.max(f(p))))
        };
        let (x_range, y_range) = (range(|p| p.0), range(|p| p.1));
        let x_ticks = log_ticks(x_range);
        let y_ticks = if scale == Scale::Log { log_ticks(y_range) } else { linear_ticks(y_range) };
        let ends = |ticks: &[f64], (lo, hi): (f64, f64)| {
            (ticks.first().map_or(lo, |t| t.min(lo)), ticks.last().map_or(hi, |t| t.max(hi)))
        };
        let ln = |(lo, hi): (f64, f64)| (lo.ln(), hi.ln());
        let x_ends = ln(ends(&x_ticks, x_range));
        let y_ends = ends(&y_ticks, y_range);
        let y_ends = if scale == Scale::Log { ln(y_ends) } else { y_ends };
        Axes { scale, x_ticks, y_ticks, x_ends, y_ends }
    }

    fn x(&self, value: f64) -> f64 {
        LEFT + (WIDTH - LEFT - RIGHT) * part(value.ln(), self.x_ends)
    }

    fn y(&self, value: f64) -> f64 {
        let value = if self.scale == Scale::Log { value.ln() } else { value };
        HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * part(value, self.y_ends)
    }

    fn lines(&self) -> Markup {
        let (right, floor) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
        html! {
            @for (tick, at) in self.x_ticks.iter().map(|&t| (t, self.x(t))) {
                line.g x1=(short(at)) x2=(short(at)) y1=(TOP) y2=(floor) {}
                text.l x=(short(at)) y=(floor + 17.0) text-anchor="middle" { (number(tick)) }
            }
            @for (tick, at) in self.y_ticks.iter().map(|&t| (t, self.y(t))) {
                line.g x1=(LEFT) x2=(right) y1=(short(at)) y2=(short(at)) {}
                text.l x=(LEFT - 7.0) y=(short(at + 4.0)) text-anchor="end" { (number(tick)) }
            }
        }
    }
}

/// Where `value` lies between two.
fn part(value: f64, (lo, hi): (f64, f64)) -> f64 {
    if hi > lo { (value - lo) / (hi - lo) } else { 0.5 }
}

/// A coordinate.
fn short(at: f64) -> String {
    format!("{at:.1}")
}

/// Curves over a logarithmic x axis; nothing where there is no point.
pub fn curves(title: &str, x_label: &str, scale: Scale, series: &[Series]) -> Markup {
    let shown = |p: &&Point| p.0 > 0.0 && p.1.is_finite() && (scale == Scale::Linear || p.1 > 0.0);
    let all: Vec<&Point> = series.iter().flat_map(|s| s.points.iter().filter(shown)).collect();
    if all.is_empty() {
        return html! {};
    }
    let axes = Axes::new(scale, &all);
    let path = |s: &Series| {
        let places = s.points.iter().filter(shown).map(|p| format!("{:.1},{:.1}", axes.x(p.0), axes.y(p.1)));
        places.collect::<Vec<_>>().join(" ")
    };
    html! {
        figure {
            svg viewBox=(format!("0 0 {WIDTH} {HEIGHT}")) role="img" aria-label=(title) {
                text.t x=(LEFT) y="20" { (title) }
                (axes.lines())
                text.l x=(0.5 * (LEFT + WIDTH - RIGHT)) y=(HEIGHT - 8.0) text-anchor="middle" { (x_label) }
                @for s in series {
                    @let dashes = s.dashed.then_some("4 3");
                    polyline fill="none" stroke=(s.colour) stroke-width="2" stroke-dasharray=[dashes] points=(path(s)) {}
                    @for p in s.points.iter().filter(|p| shown(p) && !s.dashed) {
                        circle cx=(short(axes.x(p.0))) cy=(short(axes.y(p.1))) r="3.6" fill=(s.colour) {
                            title { (s.name) ": " (p.2) }
                        }
                    }
                }
            }
        }
    }
}

/// A name and its parts.
pub type Row = (String, Vec<(&'static str, f64)>);

/// Bars of parts, one under the other; the parts keep their colours. Nothing where all are empty.
pub fn bars(title: &str, unit: &str, rows: &[Row]) -> Markup {
    const COLOURS: [&str; 7] = ["#4e79a7", "#f28e2b", "#59a14f", "#b07aa1", "#9c755f", "#e15759", "#76b7b2"];
    let rows: Vec<&Row> = rows.iter().filter(|r| !r.1.is_empty()).collect();
    let mut names: Vec<&'static str> = Vec::new();
    rows.iter().flat_map(|r| &r.1).for_each(|p| {
        if !names.contains(&p.0) {
            names.push(p.0);
        }
    });
    let sum = |r: &Row| r.1.iter().map(|p| p.1).sum::<f64>();
    let most = rows.iter().map(|r| sum(r)).fold(0.0, f64::max);
    if most <= 0.0 {
        return html! {};
    }
    let fill = |name: &str| {
        let at = names.iter().position(|n| *n == name).unwrap_or(0);
        format!("background:{}", COLOURS[at % COLOURS.len()])
    };
    html! {
        section.bars {
            h2 { (title) }
            p.key { @for name in &names { span { i style=(fill(name)) {} (name) } } }
            @for row in &rows {
                div.row {
                    b { (row.0) }
                    div.bar {
                        @for (name, value) in &row.1 {
                            span style=(format!("width:{:.2}%;{}", 100.0 * value / most, fill(name)))
                                title=(format!("{name}: {} {unit}", number(*value))) {}
                        }
                    }
                    em { (number(sum(row))) " " (unit) }
                }
            }
        }
    }
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
        let series = [Series {
            name: "a<b".into(),
            colour: "#123456",
            dashed: false,
            points: vec![(1.0, 0.5, "x & y".into()), (3.0, 0.7, "z".into())],
        }];
        let svg = curves("Title", "bits", Scale::Linear, &series).into_string();
        assert!(svg.contains("a&lt;b: x &amp; y") && svg.matches("<circle").count() == 2);
        assert_eq!(curves("Nothing", "bits", Scale::Log, &[]).into_string(), "");
    }
}
