//! Buffers: the binary chunk, data URIs and files beside the document, taken when first used; and buffer views.
//!
//! What is compressed is unpacked into buffers of our own, which are numbered behind those of the document, so that
//! whoever has a [`Span`] need not know.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Component, Path};

use base64::Engine as _;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use serde_json::Value;

use super::super::build::{Budget, Kind};
use super::super::error::{At, Fail, Place, ReadErrorKind};
use super::json::{in_range, list, needed, text, uint};
use super::{meshopt, top};
use crate::io::beside::{Folder, open_regular, percent_decode};

const BASE64: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// A buffer view, found and ready.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    /// For [`Buffers::get`].
    pub buffer: usize,
    pub start: usize,
    /// Bytes; all of them are there.
    pub length: usize,
    /// Bytes from one item to the next, where the view says so.
    pub stride: Option<u64>,
}

pub(super) struct Buffers<'a> {
    chunk: Option<&'a [u8]>,
    folder: Option<&'a Folder>,
    /// Those of the document, then those of our own.
    loaded: Vec<Option<Cow<'a, [u8]>>>,
    /// How many the document has.
    documented: usize,
    /// The buffer into which a compressed view was unpacked.
    unpacked: BTreeMap<usize, usize>,
    /// Bytes of the document and of all buffers loaded so far.
    pub bytes: u64,
}

impl<'a> Buffers<'a> {
    pub fn new(
        json: &Value,
        chunk: Option<&'a [u8]>,
        folder: Option<&'a Folder>,
        document: usize,
    ) -> Result<Self, Fail> {
        let loaded: Vec<_> = list(json, "buffers").at(top)?.iter().map(|_| None).collect();
        let (documented, bytes) = (loaded.len(), document as u64);
        Ok(Buffers { chunk, folder, loaded, documented, unpacked: BTreeMap::new(), bytes })
    }

    /// A buffer of our own; its bytes have been counted against the budget.
    pub fn add(&mut self, data: Vec<u8>) -> usize {
        self.bytes += data.len() as u64;
        self.loaded.push(Some(Cow::Owned(data)));
        self.loaded.len() - 1
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

    /// Buffer view `i`, loaded and, where it is compressed, unpacked.
    pub fn span(&mut self, json: &Value, i: u64, budget: &mut Budget) -> Result<Span, Fail> {
        let at = || Place::Item(format!("bufferViews[{i}]"));
        let views = list(json, "bufferViews").at(top)?;
        let number = in_range(i, views.len(), "bufferViews").at(at)?;
        let view = &views[number];
        // Zero is not allowed, but written for items without gaps.
        let stride = uint(view, "byteStride").at(at)?.filter(|&s| s > 0);
        let length = needed(view, "byteLength").at(at)?;
        let packed = meshopt::extension(view);
        if let Some((name, packed)) = packed
            && !self.has_plain(json, view, budget)
        {
            let buffer = match self.unpacked.get(&number) {
                Some(&buffer) => buffer,
                None => {
                    let inside = || Place::Item(format!("bufferViews[{i}].extensions.{name}"));
                    let data = meshopt::unpack(self, json, packed, length, inside, budget)?;
                    let buffer = self.add(data);
                    self.unpacked.insert(number, buffer);
                    buffer
                }
            };
            // Unpacking has made sure that there are as many.
            return Ok(Span { buffer, start: 0, length: length as usize, stride });
        }
        let buffer = in_range(needed(view, "buffer").at(at)?, self.documented, "buffers").at(at)?;
        self.load(json, buffer, budget)?;
        let (start, length) = self.within(buffer, view, length).at(at)?;
        Ok(Span { buffer, start, length, stride })
    }

    /// The part of a loaded buffer that begins at the `byteOffset` of an object.
    fn within(&self, buffer: usize, object: &Value, length: u64) -> Result<(usize, usize), Kind> {
        let start = uint(object, "byteOffset")?.unwrap_or(0);
        let (end, held) = (start.saturating_add(length), self.get(buffer).len());
        if end > held as u64 {
            let outside = format!("it ends at byte {end} of a buffer of {held} bytes; mend the document");
            return Err(ReadErrorKind::Syntax(outside));
        }
        Ok((start as usize, length as usize))
    }

    /// The bytes that the object of a compression extension names.
    pub fn packed(&mut self, json: &Value, object: &Value, budget: &mut Budget) -> Result<&[u8], Fail> {
        let number = in_range(needed(object, "buffer")?, self.documented, "buffers")?;
        self.load(json, number, budget)?;
        let (start, length) = self.within(number, object, needed(object, "byteLength")?)?;
        Ok(&self.get(number)[start..start + length])
    }

    /// Whether the data of a compressed view stand in the document as they are, too.
    fn has_plain(&mut self, json: &Value, view: &Value, budget: &mut Budget) -> bool {
        let buffers = list(json, "buffers").unwrap_or_default();
        let Some(number) = uint(view, "buffer").ok().flatten().and_then(|n| usize::try_from(n).ok()) else {
            return false;
        };
        let Some(buffer) = buffers.get(number) else { return false };
        // A stand-in has a length and no bytes; one with a URI may have been left behind.
        let there = buffer.get("uri").is_some() || (number == 0 && self.chunk.is_some() && !meshopt::stands_in(buffer));
        there && self.load(json, number, budget).is_ok()
    }

    /// The bytes of buffer view `i`.
    pub fn view(&mut self, json: &Value, i: u64, budget: &mut Budget) -> Result<&[u8], Fail> {
        let span = self.span(json, i, budget)?;
        Ok(&self.get(span.buffer)[span.start..span.start + span.length])
    }

    fn file(&self, uri: &str, length: u64, budget: &mut Budget) -> Result<Vec<u8>, Kind> {
        let problem = |problem: &str| {
            let mut uri: String = uri.chars().take(80).collect();
            uri.retain(|c| !c.is_control());
            ReadErrorKind::Buffer { uri, problem: problem.to_string() }
        };
        let Some(folder) = self.folder else {
            return Err(problem(
                "lies outside the document, whose folder is not known; read it by its path or use GLB",
            ));
        };
        let plain = percent_decode(uri).ok_or_else(|| problem("is not a proper reference; mend it"))?;
        let Some(path) = folder.find(&plain).or_else(|| folder.find(uri)) else {
            // A document from elsewhere must not reach into the rest of the machine.
            let slashes = plain.replace('\\', "/");
            let inside =
                Path::new(&slashes).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
            let scheme = uri.split('/').next().is_some_and(|first| first.contains(':'));
            return Err(problem(match inside && !scheme {
                true => "is missing or no regular file; copy it beside the document",
                false => {
                    "does not lie in the folder of the document; copy it there, or name a folder that holds both with --asset-root"
                }
            }));
        };
        let failed = |e: std::io::Error| problem(&format!("cannot be read: {e}"));
        let (file, size) = open_regular(&path).map_err(failed)?;
        if size < length {
            let cut = format!("is too short ({size} of {length} bytes); it was cut, fetch it again");
            return Err(problem(&cut));
        }
        let mut data = Vec::new();
        budget.reserve(&mut data, usize::try_from(length).unwrap_or(usize::MAX))?;
        file.take(length).read_to_end(&mut data).map_err(failed)?;
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
