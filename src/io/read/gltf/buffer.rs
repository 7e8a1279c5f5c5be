//! Buffers: the binary chunk, data URIs and files beside the document, taken when first used.

use std::borrow::Cow;
use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use base64::Engine as _;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use serde_json::Value;

use super::super::build::{Budget, Kind};
use super::super::error::{At, Fail, Place, ReadErrorKind};
use super::json::{in_range, list, needed, text, uint};
use super::top;

const BASE64: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

pub(super) struct Buffers<'a> {
    chunk: Option<&'a [u8]>,
    base_dir: Option<PathBuf>,
    loaded: Vec<Option<Cow<'a, [u8]>>>,
    /// Bytes of the document and of all buffers loaded so far.
    pub bytes: u64,
}

impl<'a> Buffers<'a> {
    pub fn new(json: &Value, chunk: Option<&'a [u8]>, base_dir: Option<&Path>, document: usize) -> Result<Self, Fail> {
        let loaded = list(json, "buffers").at(top)?.iter().map(|_| None).collect();
        Ok(Buffers { chunk, base_dir: base_dir.map(Path::to_path_buf), loaded, bytes: document as u64 })
    }

    /// Make buffer `i`, which is there, ready for [`Buffers::get`].
    pub fn load(&mut self, json: &Value, i: usize, budget: &mut Budget) -> Result<(), Fail> {
        if matches!(self.loaded.get(i), Some(Some(_))) {
            return Ok(());
        }
        let at = || Place::Item(format!("buffers[{i}]"));
        let buffer = &list(json, "buffers").at(top)?[i];
        let length = needed(buffer, "byteLength").at(at)?;
        let data: Cow<'a, [u8]> = match text(buffer, "uri").at(at)? {
            None => match self.chunk {
                Some(chunk) if i == 0 => Cow::Borrowed(chunk),
                _ => {
                    let none = "the buffer has neither a URI nor a binary chunk; export the file again".to_string();
                    return Err(ReadErrorKind::Syntax(none)).at(at);
                }
            },
            Some(uri) => {
                let data = match uri.strip_prefix("data:") {
                    Some(data) => decode(data, budget).at(at)?,
                    None => self.file(uri, length, budget).at(at)?,
                };
                self.bytes += data.len() as u64;
                Cow::Owned(data)
            }
        };
        let found = data.len() as u64;
        if found < length {
            let what = "the buffer".to_string();
            return Err(ReadErrorKind::Truncated { what, missing: Some(length - found) }).at(at);
        }
        self.loaded[i] = Some(data);
        Ok(())
    }

    /// The bytes of a buffer that has been loaded.
    pub fn get(&self, i: usize) -> &[u8] {
        self.loaded.get(i).and_then(Option::as_deref).unwrap_or_default()
    }

    /// The bytes of buffer view `i`.
    pub fn view(&mut self, json: &Value, i: u64, budget: &mut Budget) -> Result<&[u8], Fail> {
        let at = || Place::Item(format!("bufferViews[{i}]"));
        let views = list(json, "bufferViews").at(top)?;
        let view = &views[in_range(i, views.len(), "bufferViews").at(at)?];
        let buffer = needed(view, "buffer").at(at)?;
        let buffer = in_range(buffer, self.loaded.len(), "buffers").at(at)?;
        self.load(json, buffer, budget)?;
        let start = uint(view, "byteOffset").at(at)?.unwrap_or(0);
        let end = start.saturating_add(needed(view, "byteLength").at(at)?);
        let held = self.get(buffer);
        if end > held.len() as u64 {
            let outside = format!("it ends at byte {end} of a buffer of {} bytes; mend the document", held.len());
            return Err(ReadErrorKind::Syntax(outside)).at(at);
        }
        Ok(&held[start as usize..end as usize])
    }

    fn file(&self, uri: &str, length: u64, budget: &mut Budget) -> Result<Vec<u8>, Kind> {
        let problem = |problem: &str| {
            let mut uri: String = uri.chars().take(80).collect();
            uri.retain(|c| !c.is_control());
            ReadErrorKind::Buffer { uri, problem: problem.to_string() }
        };
        let path = PathBuf::from(percent_decode(uri).ok_or_else(|| problem("is not a proper reference; mend it"))?);
        let inside = path.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
        let scheme = uri.split('/').next().is_some_and(|first| first.contains(':'));
        if !inside || scheme {
            // A document from elsewhere must not reach into the rest of the machine.
            return Err(problem(
                "does not lie in the folder of the document; copy it there and name it without a path",
            ));
        }
        let Some(base) = &self.base_dir else {
            return Err(problem(
                "lies outside the document, whose folder is not known; read it by its path or use GLB",
            ));
        };
        let path = base.join(path);
        let meta = std::fs::metadata(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => problem("is missing; copy it beside the document"),
            _ => problem(&format!("cannot be read: {e}")),
        })?;
        if !meta.is_file() {
            return Err(problem("is not a file; copy the data beside the document"));
        }
        if meta.len() < length {
            let cut = format!("is too short ({} of {length} bytes); it was cut, fetch it again", meta.len());
            return Err(problem(&cut));
        }
        let mut data = Vec::new();
        budget.reserve(&mut data, usize::try_from(length).unwrap_or(usize::MAX))?;
        let read = File::open(&path).and_then(|f| f.take(length).read_to_end(&mut data));
        read.map_err(|e| problem(&format!("cannot be read: {e}")))?;
        Ok(data)
    }
}

/// `[type];base64,…`
pub(super) fn decode(data: &str, budget: &mut Budget) -> Result<Vec<u8>, Kind> {
    let Some((_, digits)) = data.split_once(";base64,") else {
        let what = "a data URI without base64".to_string();
        return Err(ReadErrorKind::Unsupported { what, advice: "export the file as GLB" });
    };
    budget.take(digits.len() as u64 / 4 * 3)?;
    BASE64
        .decode(digits)
        .map_err(|e| ReadErrorKind::Syntax(format!("the data URI is damaged: {e}; export the file again")))
}

/// A reference as a path.
pub(crate) fn percent_decode(uri: &str) -> Option<String> {
    let mut out = Vec::with_capacity(uri.len());
    let mut bytes = uri.bytes();
    while let Some(byte) = bytes.next() {
        out.push(if byte == b'%' {
            let digit = |b: u8| char::from(b).to_digit(16);
            let (high, low) = (digit(bytes.next()?)?, digit(bytes.next()?)?);
            (16 * high + low) as u8
        } else {
            byte
        });
    }
    String::from_utf8(out).ok().filter(|s| !s.contains('\0'))
}
