//! What ran when: spans of work for `--trace`, in the Chrome trace format that `chrome://tracing` and Perfetto open.
//!
//! A [`Trace`] that is off (the default) costs a comparison for each span. Spans may end on any thread; a track is a
//! name, shown as one row.

use std::fmt::Write;
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Spans that are kept; later ones are counted and left out.
const MOST: usize = 1 << 20;

/// A place where spans go. Clones share it.
#[derive(Clone, Debug, Default)]
pub struct Trace(Option<Arc<Inner>>);

#[derive(Debug)]
struct Inner {
    start: Instant,
    spans: Mutex<(Vec<Done>, usize)>,
}

#[derive(Debug)]
struct Done {
    track: String,
    name: &'static str,
    from: u64,
    to: u64,
    items: u64,
}

/// A span of work; it ends when dropped.
#[derive(Debug)]
pub struct Span<'a> {
    inner: Option<&'a Inner>,
    track: Option<&'static str>,
    name: &'static str,
    from: u64,
    items: u64,
}

impl Trace {
    /// Nothing is kept.
    pub fn off() -> Self {
        Trace(None)
    }

    /// Spans are kept from now on.
    pub fn on() -> Self {
        Trace(Some(Arc::new(Inner { start: Instant::now(), spans: Mutex::default() })))
    }

    /// Begin a span on a track of its own.
    pub fn span(&self, track: &'static str, name: &'static str) -> Span<'_> {
        self.begin(Some(track), name)
    }

    /// Begin a span on the track of the worker thread that runs it.
    pub fn work(&self, name: &'static str) -> Span<'_> {
        self.begin(None, name)
    }

    fn begin(&self, track: Option<&'static str>, name: &'static str) -> Span<'_> {
        let inner = self.0.as_deref();
        Span { inner, track, name, from: inner.map_or(0, Inner::now), items: 0 }
    }

    /// Name, number of spans, microseconds and items of all spans that have ended, by name, in order of first appearance.
    pub fn sums(&self) -> Vec<(&'static str, u64, u64, u64)> {
        let mut sums: Vec<(&'static str, u64, u64, u64)> = Vec::new();
        let Some(inner) = &self.0 else { return sums };
        let Ok(spans) = inner.spans.lock() else { return sums };
        for s in &spans.0 {
            let at = sums.iter().position(|x| x.0 == s.name).unwrap_or_else(|| {
                sums.push((s.name, 0, 0, 0));
                sums.len() - 1
            });
            sums[at].1 += 1;
            sums[at].2 += s.to - s.from;
            sums[at].3 += s.items;
        }
        sums
    }

    /// All spans that have ended, as a Chrome trace: times in microseconds since the trace began.
    pub fn to_json(&self) -> String {
        let mut out = String::from("{\"displayTimeUnit\":\"ms\",\"traceEvents\":[");
        if let Some(inner) = &self.0
            && let Ok(spans) = inner.spans.lock()
        {
            let mut tracks: Vec<&str> = spans.0.iter().map(|s| s.track.as_str()).collect();
            tracks.sort_unstable();
            tracks.dedup();
            let mut comma = "";
            for (i, track) in tracks.iter().enumerate() {
                let _ = write!(
                    out,
                    "{comma}\n{{\"ph\":\"M\",\"name\":\"thread_name\",\"pid\":1,\"tid\":{i},\"args\":{{\"name\":\"{track}\"}}}}"
                );
                comma = ",";
            }
            for s in &spans.0 {
                let tid = tracks.binary_search(&s.track.as_str()).unwrap_or(0);
                let _ = write!(
                    out,
                    "{comma}\n{{\"ph\":\"X\",\"name\":\"{}\",\"pid\":1,\"tid\":{tid},\"ts\":{},\"dur\":{},\"args\":{{\"items\":{}}}}}",
                    s.name,
                    s.from,
                    s.to - s.from,
                    s.items
                );
                comma = ",";
            }
            if spans.1 > 0 {
                let _ = write!(
                    out,
                    "{comma}\n{{\"ph\":\"M\",\"name\":\"process_labels\",\"pid\":1,\"args\":{{\"labels\":\"{} later spans left out\"}}}}",
                    spans.1
                );
            }
        }
        out.push_str("\n]}\n");
        out
    }
}

impl Inner {
    fn now(&self) -> u64 {
        self.start.elapsed().as_micros() as u64
    }
}

impl Span<'_> {
    /// Say how many items (edges, vertices, bytes) the span was about.
    pub fn items(&mut self, items: u64) {
        self.items = items;
    }
}

impl Drop for Span<'_> {
    fn drop(&mut self) {
        let Some(inner) = self.inner else { return };
        let to = inner.now();
        let track = match (self.track, rayon::current_thread_index()) {
            (Some(track), _) => track.to_string(),
            (None, Some(worker)) => format!("worker {worker}"),
            (None, None) => "main".to_string(),
        };
        let Ok(mut spans) = inner.spans.lock() else { return };
        if spans.0.len() < MOST {
            spans.0.push(Done { track, name: self.name, from: self.from, to: to.max(self.from), items: self.items });
        } else {
            spans.1 += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_listed_by_track_and_off_costs_nothing() {
        let trace = Trace::on();
        {
            let mut span = trace.span("device", "weigh");
            span.items(7);
            let _inner = trace.span("gather", "mark");
        }
        let json = trace.to_json();
        assert!(json.contains("\"name\":\"weigh\"") && json.contains("\"args\":{\"items\":7}"), "{json}");
        assert!(json.contains("\"args\":{\"name\":\"gather\"}"), "{json}");
        assert_eq!(trace.sums().iter().map(|s| (s.0, s.1, s.3)).collect::<Vec<_>>(), [("mark", 1, 0), ("weigh", 1, 7)]);
        drop(Trace::off().work("nothing"));
        assert_eq!(Trace::off().to_json(), "{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n]}\n");
    }
}
