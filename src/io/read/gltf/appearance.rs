//! Materials, textures, samplers and images: all of the document, so that their numbers stay what they are.

use std::collections::BTreeSet;

use serde_json::Value;

use super::super::NO_MATERIAL;
use super::super::appearance::{Files, media_type};
use super::super::build::Builder;
use super::super::error::{At, Fail, Place};
use super::super::warning::Warning;
use super::buffer::decode;
use super::json::{list, text, uint};
use super::{Document, READ, top};
use crate::io::beside::{Folder, percent_decode};
use crate::mesh::Image;

pub(super) fn read(doc: &mut Document<'_>, b: &mut Builder, folder: Option<&Folder>) -> Result<(), Fail> {
    let json = doc.json;
    let mut kept = BTreeSet::new();
    if !b.drop.materials {
        for key in ["materials", "textures", "samplers"] {
            for item in list(json, key).at(top)? {
                extensions_in(item, &mut kept);
                let item = item.to_string();
                b.budget.take(item.len() as u64).at(top)?;
                match key {
                    "materials" => b.appearance.materials.push(item),
                    "textures" => b.appearance.textures.push(item),
                    _ => b.appearance.samplers.push(item),
                }
            }
        }
        // What the writer had to put there for faces without a material.
        let last = list(json, "materials").at(top)?.last();
        if last.is_some_and(|m| m.pointer("/extras/lodestream").and_then(Value::as_str) == Some(NO_MATERIAL)) {
            b.appearance.materials.pop();
        }
        let mut files = Files::new(folder);
        for (i, item) in list(json, "images").at(top)?.iter().enumerate() {
            let image = image(doc, b, &mut files, item, i)?;
            b.appearance.images.push(image);
        }
        files.report(b);
        let used = list(json, "extensionsUsed").at(top)?.iter().filter_map(Value::as_str);
        let skipped = used.filter(|name| {
            // What describes materials, textures and images is known even where it stands for the whole file.
            let appearance = ["KHR_materials_", "KHR_texture_", "EXT_texture_", "EXT_materials_", "MSFT_texture_"];
            let variants = *name == "KHR_materials_variants";
            !READ.contains(name)
                && !kept.contains(*name)
                && (variants || !appearance.iter().any(|p| name.starts_with(p)))
        });
        let names: BTreeSet<String> = skipped.map(|n| n.escape_debug().take(80).collect()).collect();
        if !names.is_empty() {
            b.tally.others.push(Warning::SkippedExtensions { names: names.into_iter().collect() });
        }
    }
    Ok(())
}

fn image(
    doc: &mut Document<'_>,
    b: &mut Builder,
    files: &mut Files<'_>,
    item: &Value,
    number: usize,
) -> Result<Image, Fail> {
    let at = || Place::Item(format!("images[{number}]"));
    let mut image = Image {
        name: text(item, "name").at(at)?.unwrap_or_default().to_string(),
        mime: text(item, "mimeType").at(at)?.unwrap_or_default().to_string(),
        bytes: Vec::new(),
        previews: Vec::new(),
    };
    b.budget.take(image.name.len() as u64 + 128).at(at)?;
    match (uint(item, "bufferView").at(at)?, text(item, "uri").at(at)?) {
        (Some(view), _) => {
            if !b.drop.images {
                let bytes = doc.buffers.view(doc.json, view, &mut b.budget)?;
                b.budget.reserve(&mut image.bytes, bytes.len()).at(at)?;
                image.bytes.extend_from_slice(bytes);
            }
        }
        (None, Some(uri)) => match uri.strip_prefix("data:") {
            Some(data) => {
                if let (true, Some((media, _))) = (image.mime.is_empty(), data.split_once([';', ','])) {
                    image.mime = media.to_string();
                }
                if !b.drop.images {
                    image.bytes = decode(data, &mut b.budget).at(at)?;
                }
            }
            None => {
                image.name = percent_decode(uri).unwrap_or_else(|| uri.to_string());
                let path = files.path(b, &image.name);
                image.bytes = files.bytes(b, path.as_deref(), &image.name).at(at)?;
            }
        },
        (None, None) => {}
    }
    let known = media_type(&image.name, &image.bytes);
    if image.mime.is_empty() || !(known.is_empty() || image.bytes.is_empty()) {
        image.mime = known.to_string();
    }
    Ok(image)
}

/// The names of all extensions within a value.
pub(crate) fn extensions_in(value: &Value, into: &mut BTreeSet<String>) {
    match value {
        Value::Object(object) => {
            for (key, inner) in object {
                if let ("extensions", Value::Object(extensions)) = (key.as_str(), inner) {
                    into.extend(extensions.keys().cloned());
                }
                // Extras may hold anything.
                if key != "extras" {
                    extensions_in(inner, into);
                }
            }
        }
        Value::Array(items) => items.iter().for_each(|item| extensions_in(item, into)),
        _ => {}
    }
}
