//! A bucket on loopback: as much of the S3 protocol as `object_store` speaks, in memory, with faults on request.
//!
//! Lists (version 2, in pages), heads, gets with ranges and `If-Match`, puts, multipart uploads. Signatures are not looked at.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// What is to go wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Every `n`-th request is answered with this status.
    Status(u16, u64),
    /// Every `n`-th body is cut in its middle, and the connection with it.
    Cut(u64),
    /// This part of every multipart upload is answered with this status.
    Part(u32, u16),
    /// The answer to the first upload that is completed breaks off in its body.
    Completion,
    /// Bodies come in small pieces, each after so many milliseconds.
    Slow(u64),
}

#[derive(Default)]
struct Inner {
    objects: BTreeMap<String, Vec<u8>>,
    uploads: BTreeMap<String, (String, BTreeMap<u32, Vec<u8>>)>,
    faults: Vec<Fault>,
    /// Keys that are always answered with a status.
    refused: BTreeMap<String, u16>,
    requests: u64,
    bodies: u64,
    log: Vec<String>,
}

/// A running server.
pub struct Bucket {
    inner: Arc<Mutex<Inner>>,
    port: u16,
    stop: Arc<AtomicBool>,
}

impl Bucket {
    /// An empty bucket, called `scans`.
    pub fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let inner = Arc::new(Mutex::new(Inner::default()));
        let stop = Arc::new(AtomicBool::new(false));
        let (shared, stopped) = (inner.clone(), stop.clone());
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                if stopped.load(Ordering::Relaxed) {
                    return;
                }
                let Ok(stream) = stream else { continue };
                let shared = shared.clone();
                // A client that goes away in the middle is no concern of the server's.
                std::thread::spawn(move || while serve(&stream, &shared).unwrap_or(false) {});
            }
        });
        Bucket { inner, port, stop }
    }

    /// The environment that leads a program here.
    pub fn environment(&self) -> Vec<(&'static str, String)> {
        vec![
            ("AWS_ENDPOINT", format!("http://127.0.0.1:{}", self.port)),
            ("AWS_ALLOW_HTTP", "true".to_string()),
            ("AWS_REGION", "us-east-1".to_string()),
            ("AWS_ACCESS_KEY_ID", "test".to_string()),
            ("AWS_SECRET_ACCESS_KEY", "test".to_string()),
        ]
    }

    pub fn put(&self, key: &str, bytes: Vec<u8>) {
        self.inner.lock().unwrap().objects.insert(key.to_string(), bytes);
    }

    pub fn objects(&self) -> BTreeMap<String, Vec<u8>> {
        self.inner.lock().unwrap().objects.clone()
    }

    /// Uploads that were begun and neither completed nor aborted.
    pub fn open_uploads(&self) -> usize {
        self.inner.lock().unwrap().uploads.len()
    }

    pub fn requests(&self) -> Vec<String> {
        self.inner.lock().unwrap().log.clone()
    }

    pub fn fault(&self, fault: Fault) {
        self.inner.lock().unwrap().faults.push(fault);
    }

    pub fn heal(&self) {
        let mut inner = self.inner.lock().unwrap();
        inner.faults.clear();
        inner.refused.clear();
    }

    pub fn refuse(&self, key: &str, status: u16) {
        self.inner.lock().unwrap().refused.insert(key.to_string(), status);
    }
}

impl Drop for Bucket {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = TcpStream::connect(("127.0.0.1", self.port));
    }
}

fn decode(text: &str) -> String {
    // In queries a plus is a blank; no key of the tests has a plus.
    let text = &text.replace('+', " ");
    let (mut out, bytes, mut i) = (Vec::new(), text.as_bytes(), 0);
    while i < bytes.len() {
        if bytes[i] == b'%' {
            out.push(u8::from_str_radix(&text[i + 1..i + 3], 16).unwrap());
            i += 3;
        } else {
            out.push(bytes[i]);
            i += 1;
        }
    }
    String::from_utf8(out).unwrap()
}

fn tag(bytes: &[u8]) -> String {
    format!("\"{:08x}-{}\"", crc32fast::hash(bytes), bytes.len())
}

struct Answer {
    status: u16,
    headers: Vec<(String, String)>,
    body: Vec<u8>,
}

fn answer(status: u16, body: impl Into<Vec<u8>>) -> Answer {
    Answer { status, headers: Vec::new(), body: body.into() }
}

/// One request; `false` when the connection is over.
fn serve(stream: &TcpStream, shared: &Mutex<Inner>) -> std::io::Result<bool> {
    let mut reader = BufReader::new(stream);
    let mut line = String::new();
    if reader.read_line(&mut line)? == 0 {
        return Ok(false);
    }
    let mut words = line.split_whitespace();
    let (method, target) = (words.next().unwrap_or("").to_string(), words.next().unwrap_or("").to_string());
    let mut headers = BTreeMap::new();
    loop {
        let mut line = String::new();
        reader.read_line(&mut line)?;
        let line = line.trim_end();
        if line.is_empty() {
            break;
        }
        if let Some((name, value)) = line.split_once(':') {
            headers.insert(name.to_ascii_lowercase(), value.trim().to_string());
        }
    }
    let length = headers.get("content-length").and_then(|l| l.parse().ok()).unwrap_or(0);
    let mut body = vec![0; length];
    reader.read_exact(&mut body)?;
    let (path, query) = target.split_once('?').unwrap_or((&target, ""));
    let query: BTreeMap<String, String> = query
        .split('&')
        .filter(|q| !q.is_empty())
        .map(|q| q.split_once('=').map_or((decode(q), String::new()), |(k, v)| (decode(k), decode(v))))
        .collect();
    let path = decode(path);
    let key = path.trim_start_matches('/').split_once('/').map_or("", |(_, key)| key).to_string();
    let (reply, cut, slow) = {
        let mut inner = shared.lock().unwrap();
        inner.requests += 1;
        inner.log.push(format!("{method} {target}"));
        let n = inner.requests;
        let failing = inner.faults.iter().find_map(|f| match f {
            Fault::Status(status, every) if n.is_multiple_of(*every) => Some(*status),
            _ => None,
        });
        let reply = match failing.or_else(|| inner.refused.get(&key).copied()) {
            Some(status) => answer(status, "<Error><Code>InternalError</Code></Error>"),
            None => inner.respond(&method, &key, &query, &headers, body),
        };
        let has_body = method == "GET" && reply.status < 300 && reply.body.len() > 1;
        inner.bodies += u64::from(has_body);
        let bodies = inner.bodies;
        let mut cut =
            has_body && inner.faults.iter().any(|f| matches!(f, Fault::Cut(every) if bodies.is_multiple_of(*every)));
        if method == "POST" && query.contains_key("uploadId") {
            let before = inner.faults.len();
            inner.faults.retain(|f| *f != Fault::Completion);
            cut |= inner.faults.len() < before;
        }
        let slow = inner.faults.iter().find_map(|f| if let Fault::Slow(ms) = f { Some(*ms) } else { None });
        (reply, cut, slow)
    };
    let mut out = stream;
    let mut head = format!("HTTP/1.1 {} X\r\n", reply.status);
    if !reply.headers.iter().any(|(name, _)| name == "Content-Length") {
        head += &format!("Content-Length: {}\r\n", reply.body.len());
    }
    for (name, value) in &reply.headers {
        head += &format!("{name}: {value}\r\n");
    }
    out.write_all((head + "\r\n").as_bytes())?;
    let body = if method == "HEAD" { &[][..] } else { &reply.body[..] };
    if cut {
        out.write_all(&body[..body.len() / 2])?;
        stream.shutdown(std::net::Shutdown::Both)?;
        return Ok(false);
    }
    match slow {
        None => out.write_all(body)?,
        Some(ms) => {
            for piece in body.chunks((body.len() / 4).max(1)) {
                std::thread::sleep(Duration::from_millis(ms));
                out.write_all(piece)?;
            }
        }
    }
    Ok(true)
}

impl Inner {
    fn respond(
        &mut self,
        method: &str,
        key: &str,
        query: &BTreeMap<String, String>,
        headers: &BTreeMap<String, String>,
        body: Vec<u8>,
    ) -> Answer {
        let upload = query.get("uploadId").cloned();
        match (method, upload) {
            ("GET", None) if key.is_empty() => self.list(query),
            ("GET" | "HEAD", None) => self.get(key, headers),
            ("POST", None) if query.contains_key("uploads") => {
                let id = format!("upload-{}", self.requests);
                self.uploads.insert(id.clone(), (key.to_string(), BTreeMap::new()));
                answer(
                    200,
                    format!(
                        "<InitiateMultipartUploadResult><Bucket>scans</Bucket><Key>{key}</Key><UploadId>{id}</UploadId></InitiateMultipartUploadResult>"
                    ),
                )
            }
            ("PUT", Some(id)) => {
                let number = query["partNumber"].parse().unwrap();
                let refused = self.faults.iter().find_map(|f| match f {
                    Fault::Part(part, status) if *part == number => Some(*status),
                    _ => None,
                });
                if let Some(status) = refused {
                    return answer(status, "<Error><Code>InternalError</Code></Error>");
                }
                let Some((_, parts)) = self.uploads.get_mut(&id) else { return answer(404, "") };
                let mut reply = answer(200, "");
                reply.headers.push(("ETag".to_string(), tag(&body)));
                parts.insert(number, body);
                reply
            }
            ("POST", Some(id)) => {
                let Some((key, parts)) = self.uploads.remove(&id) else { return answer(404, "") };
                let whole: Vec<u8> = parts.into_values().flatten().collect();
                let tag = tag(&whole).replace('"', "&quot;");
                self.objects.insert(key.clone(), whole);
                answer(
                    200,
                    format!(
                        "<CompleteMultipartUploadResult><Location>x</Location><Bucket>scans</Bucket><Key>{key}</Key><ETag>{tag}</ETag></CompleteMultipartUploadResult>"
                    ),
                )
            }
            ("DELETE", Some(id)) => {
                self.uploads.remove(&id);
                answer(204, "")
            }
            ("PUT", None) => {
                let mut reply = answer(200, "");
                reply.headers.push(("ETag".to_string(), tag(&body)));
                self.objects.insert(key.to_string(), body);
                reply
            }
            _ => answer(400, ""),
        }
    }

    fn get(&self, key: &str, headers: &BTreeMap<String, String>) -> Answer {
        let Some(bytes) = self.objects.get(key) else {
            return answer(404, "<Error><Code>NoSuchKey</Code></Error>");
        };
        let tag = tag(bytes);
        if headers.get("if-match").is_some_and(|t| *t != tag) {
            return answer(412, "");
        }
        let mut reply = answer(200, bytes.clone());
        if let Some(range) = headers.get("range").and_then(|r| r.strip_prefix("bytes=")?.split_once('-')) {
            let from: usize = range.0.parse().unwrap();
            let to: usize = range.1.parse::<usize>().map_or(bytes.len(), |to| (to + 1).min(bytes.len()));
            if from >= bytes.len() {
                return answer(416, "");
            }
            reply = answer(206, &bytes[from..to]);
            reply.headers.push(("Content-Range".to_string(), format!("bytes {from}-{}/{}", to - 1, bytes.len())));
        }
        reply.headers.push(("ETag".to_string(), tag));
        reply.headers.push(("Last-Modified".to_string(), "Wed, 01 Jan 2025 00:00:00 GMT".to_string()));
        reply
    }

    /// Pages of seven, so that paging is part of every test.
    fn list(&self, query: &BTreeMap<String, String>) -> Answer {
        let prefix = query.get("prefix").map_or("", String::as_str);
        let after = query.get("continuation-token").map_or("", String::as_str);
        let mut keys = self.objects.iter().filter(|(k, _)| k.starts_with(prefix) && k.as_str() > after);
        let page: Vec<_> = keys.by_ref().take(7).collect();
        let more = keys.next().is_some();
        let mut xml = format!("<ListBucketResult><Name>scans</Name><IsTruncated>{more}</IsTruncated>");
        for (key, bytes) in &page {
            xml += &format!(
                "<Contents><Key>{key}</Key><LastModified>2025-01-01T00:00:00.000Z</LastModified><ETag>{}</ETag><Size>{}</Size></Contents>",
                tag(bytes).replace('"', "&quot;"),
                bytes.len()
            );
        }
        if let (true, Some((key, _))) = (more, page.last()) {
            xml += &format!("<NextContinuationToken>{key}</NextContinuationToken>");
        }
        answer(200, xml + "</ListBucketResult>")
    }
}
