//! The materials that an OBJ uses, out of its libraries.

use std::collections::BTreeMap;

use serde_json::json;

use super::super::appearance::Files;
use super::super::build::{Builder, Kind};
use super::super::mtl;
use super::super::warning::Warning;
use crate::io::beside::Folder;
use crate::io::name::shown;

/// Libraries beyond this number are not looked at: a file that names more is no mesh but an attack.
pub(super) const MAX_LIBRARIES: usize = 1000;

/// Materials by their names, out of the libraries.
pub(super) fn load_materials(
    b: &mut Builder,
    base: Option<&Folder>,
    libraries: &[String],
    materials: &[String],
) -> Result<(), Kind> {
    let mut files = Files::new(base);
    let mut records: BTreeMap<String, mtl::Record> = BTreeMap::new();
    let mut take = |bytes: &[u8]| {
        for record in mtl::records(bytes) {
            records.entry(record.name.clone()).or_insert(record);
        }
    };
    for library in libraries {
        // Several names stand on one line, or one name with blanks.
        let whole = library.trim_matches('"');
        if let Some(bytes) = files.text(b, whole)? {
            take(&bytes);
            continue;
        }
        let parts: Vec<&str> = library.split_whitespace().collect();
        for part in &parts {
            match files.text(b, part)? {
                Some(bytes) => take(&bytes),
                None if parts.len() > 1 && !part.to_ascii_lowercase().ends_with(".mtl") => {
                    files.miss("material library", whole);
                    break;
                }
                None => files.miss("material library", part),
            }
        }
    }
    let mut undescribed = (0, Vec::new());
    let mut textures: BTreeMap<(u32, bool), usize> = BTreeMap::new();
    for name in materials {
        let Some(record) = records.get(name) else {
            undescribed.0 += 1;
            if undescribed.1.len() < 8 {
                undescribed.1.push(shown(name));
            }
            b.appearance.materials.push(json!({ "name": name }).to_string());
            continue;
        };
        let mut asked = Vec::new();
        let first = textures.len();
        let texture = |image: u32, clamp: bool| {
            let next = textures.len();
            *textures.entry((image, clamp)).or_insert_with(|| {
                asked.push((image, clamp));
                next
            })
        };
        let material = mtl::material(record, |file| files.image(b, file), texture)?.to_string();
        b.budget.take(2 * material.len() as u64)?;
        b.appearance.materials.push(material);
        debug_assert_eq!(first + asked.len(), textures.len());
        for (image, clamp) in asked {
            let texture = if clamp { json!({"source": image, "sampler": 0}) } else { json!({ "source": image }) };
            if clamp && b.appearance.samplers.is_empty() {
                b.appearance.samplers.push(json!({"wrapS": 33071, "wrapT": 33071}).to_string());
            }
            b.appearance.textures.push(texture.to_string());
        }
    }
    files.report(b);
    let (count, names) = undescribed;
    if count > 0 {
        b.tally.others.push(Warning::UnknownMaterials { count, names });
    }
    Ok(())
}
