//! Pages of HTML that need nothing beside themselves: one style and the charts of `report`, of `ingest --report` and of the benches.
//!
//! Written with `maud`: what stands in a page is escaped where it is put in. Charts are SVG of our own, with a word on each point and in the
//! page's colours, dark or light; the libraries for charts draw no such words (`plotters`), or bring a megabyte of JavaScript (`charming`).

pub mod chart;

use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1c1f24;--dim:#667;--paper:#fff;--line:#dde;--card:#f6f7f9;--good:#08743c;--bad:#b3261e}
@media(prefers-color-scheme:dark){:root{--ink:#dee2e9;--dim:#99a;--paper:#181a1f;--line:#334;--card:#22252b;--good:#59c98b;--bad:#f08a80}}
body{font:15px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:1200px;margin:0 auto;padding:1.5rem}
h1{font-size:1.5rem;margin:0}h2{font-size:1.1rem;margin:2rem 0 .5rem}p{margin:.3rem 0}
.dim,em,dt{color:var(--dim);font-style:normal}.good{color:var(--good)}.bad{color:var(--bad)}
.charts{display:grid;grid-template-columns:repeat(auto-fill,minmax(380px,1fr));gap:1rem}
figure{margin:0;background:var(--card);border-radius:8px;padding:.5rem}svg{width:100%;height:auto}
svg text{fill:var(--ink);font:12px system-ui,sans-serif}svg .t{font-size:14px;font-weight:600}svg .l{fill:var(--dim)}.g{stroke:var(--line)}
.key span{margin-right:1.2rem;white-space:nowrap}
.key i{display:inline-block;width:.8rem;height:.8rem;border-radius:2px;margin-right:.4rem;vertical-align:-1px}
.strip{display:flex;gap:.7rem;overflow-x:auto;padding-bottom:.5rem}.strip div{flex:none;width:180px;font-size:13px}
.strip img{width:180px;border-radius:6px;display:block}
.row{display:grid;grid-template-columns:minmax(8rem,14rem) 1fr 11rem;gap:.8rem;align-items:center;margin:.3rem 0}
.row b{font-weight:500;overflow:hidden;text-overflow:ellipsis}
.bar{display:flex;height:1.3rem;background:var(--card);border-radius:3px;overflow:hidden}.bar span{display:block}
.wide{overflow-x:auto}table{border-collapse:collapse;font-variant-numeric:tabular-nums}
th,td{text-align:right;padding:.2rem .7rem;border-bottom:1px solid var(--line)}
th:first-child,td:first-child,.w{text-align:left}.group td{font-weight:600;padding-top:.9rem;color:var(--dim)}
details{margin:.3rem 0}summary{cursor:pointer}
dl{display:grid;grid-template-columns:max-content 1fr;gap:.2rem 1.5rem}dd{margin:0}.failed{color:var(--bad)}.skipped{color:var(--dim)}
";

/// All that stands before the content of a page; [`END`] closes it.
pub fn head(title: &str) -> Markup {
    html! {
        (DOCTYPE)
        (PreEscaped("<html lang=\"en\">"))
        head {
            meta charset="utf-8";
            meta name="viewport" content="width=device-width";
            title { (title) }
            style { (PreEscaped(STYLE)) }
        }
        (PreEscaped("<body>\n"))
    }
}

/// The end of a page.
pub const END: &str = "</body></html>\n";

/// A whole page.
pub fn page(title: &str, content: &Markup) -> String {
    html! { (head(title)) (content) (PreEscaped(END)) }.into_string()
}

/// `1234567` as `1,234,567`.
pub fn thousands(n: u64) -> String {
    let digits = n.to_string();
    let head = digits.len() % 3;
    let groups = (head..digits.len()).step_by(3).map(|i| &digits[i..i + 3]);
    (head > 0).then_some(&digits[..head]).into_iter().chain(groups).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_are_whole_and_escape_what_they_hold() {
        let text = page("a <b>", &html! { p title=("\"") { "1 < 2 & 3" } });
        assert!(text.starts_with("<!DOCTYPE html><html lang=\"en\"><head>") && text.ends_with("</body></html>\n"));
        assert!(text.contains("<title>a &lt;b&gt;</title>"));
        assert!(text.contains("<p title=\"&quot;\">1 &lt; 2 &amp; 3</p>"), "{text}");
    }

    #[test]
    fn digits_come_in_threes() {
        assert_eq!([0, 999, 1000, 1_234_567].map(thousands), ["0", "999", "1,000", "1,234,567"]);
    }
}
