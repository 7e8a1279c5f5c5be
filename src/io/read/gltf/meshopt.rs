//! `EXT_meshopt_compression` and `KHR_meshopt_compression`: buffer views packed by meshoptimizer.
//!
//! The library checks the stream against the sizes that it is given; here these sizes are checked against the document
//! and the memory limit.

use draco_gltf::meshopt::{MeshoptFilter, MeshoptMode, decode_buffer_view};
use serde_json::Value;

use super::super::build::Budget;
use super::super::error::{At, Fail, Place, ReadErrorKind};
use super::buffer::Buffers;
use super::json::{needed, text};

/// The names of the extension; the second also stands for the newer version of the streams.
pub(super) const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// The name and the object of the extension on a buffer view.
pub(super) fn extension(view: &Value) -> Option<(&'static str, &Value)> {
    let extensions = view.get("extensions")?;
    NAMES.into_iter().find_map(|name| Some((name, extensions.get(name)?)))
}

/// Whether a buffer only stands for data that are packed elsewhere.
pub(super) fn stands_in(buffer: &Value) -> bool {
    extension(buffer).is_some_and(|(_, e)| e.get("fallback").and_then(Value::as_bool) == Some(true))
}

/// The items of a view, which has at least `length` bytes; `packed` is the object of the extension.
pub(super) fn unpack(
    buffers: &mut Buffers<'_>,
    json: &Value,
    packed: &Value,
    length: u64,
    at: impl Fn() -> Place,
    budget: &mut Budget,
) -> Result<Vec<u8>, Fail> {
    let syntax = |message: String| ReadErrorKind::Syntax(message);
    let unknown = |what: &str, word: &str| {
        let what = format!("the {what} {:?} of meshopt compression", word.chars().take(24).collect::<String>());
        ReadErrorKind::Unsupported { what, advice: UNPACK }
    };
    let count = needed(packed, "count").at(&at)?;
    let stride = needed(packed, "byteStride").at(&at)?;
    let mode = text(packed, "mode").at(&at)?.unwrap_or_default();
    let mode = MeshoptMode::from_name(mode).map_err(|_| unknown("mode", mode)).at(&at)?;
    let filter = text(packed, "filter").at(&at)?.unwrap_or("NONE");
    let filter = MeshoptFilter::from_name(filter).map_err(|_| unknown("filter", filter)).at(&at)?;
    let bytes = count.saturating_mul(stride);
    if bytes < length {
        let short = format!("{count} items of {stride} bytes do not fill a view of {length} bytes; mend the document");
        return Err(syntax(short)).at(&at);
    }
    let mut out = Vec::new();
    let size = usize::try_from(bytes).unwrap_or(usize::MAX);
    budget.reserve(&mut out, size).at(&at)?;
    let source = buffers.packed(json, packed, budget)?;
    // Equal items of four bytes take a byte for each 256 of them; beyond that the count is a lie.
    if bytes / 1024 > source.len() as u64 {
        let (what, bytes) = (format!("items of {stride} bytes"), source.len() as u64);
        return Err(ReadErrorKind::Count { what, count, bytes }).at(&at);
    }
    out.resize(size, 0);
    decode_buffer_view(&mut out, source, mode, filter, count as usize, stride as usize)
        .map_err(|e| syntax(format!("the meshopt data is damaged: {e}; fetch or export the file again")))
        .at(&at)?;
    Ok(out)
}

/// What to do about compression that cannot be read.
pub(super) const UNPACK: &str = "unpack the file with `gltf-transform copy IN.glb OUT.glb`";
