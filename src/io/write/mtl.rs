//! MTL, the materials of OBJ.
//!
//! A material that came from MTL keeps its record, and that is written line by line, with the names of images as they are
//! now. Any other is translated from glTF as far as MTL has words for it.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use serde_json::Value;

use crate::io::read::mtl::map_line;
use crate::mesh::Appearance;

/// The library, the names of its materials, and how many of them lost something.
pub(super) fn library(appearance: &Appearance, images: &[String]) -> (String, Vec<String>, u64) {
    let mut text = String::from("# lodestream\n");
    let mut names: Vec<String> = Vec::with_capacity(appearance.materials.len());
    let mut taken = BTreeSet::new();
    let mut simplified = 0;
    for (number, material) in appearance.materials.iter().enumerate() {
        let material: Value = serde_json::from_str(material).unwrap_or_default();
        let plain = match material["name"].as_str() {
            // A record keeps its name, blanks and all; a line break it cannot have.
            Some(name) if !name.trim().is_empty() => name.trim().replace(char::is_control, "_"),
            _ => format!("material_{number}"),
        };
        let mut name = plain.clone();
        let mut attempt = number;
        while !taken.insert(name.clone()) {
            attempt += 1;
            name = format!("{plain}_{attempt}");
        }
        let _ = writeln!(text, "\nnewmtl {name}");
        names.push(name);
        match material["extras"]["mtl"].as_array() {
            Some(lines) => {
                lines.iter().filter_map(Value::as_str).for_each(|line| restored(&mut text, line, appearance, images))
            }
            None => simplified += u64::from(!translated(&mut text, &material, appearance, images)),
        }
    }
    (text, names, simplified)
}

/// A line of a record, with the name that its image has now.
fn restored(text: &mut String, line: &str, appearance: &Appearance, images: &[String]) {
    // One line stays one line of this record, whatever a file has put there.
    let line = line.replace(char::is_control, " ");
    let line = line.trim_end_matches(['\\', ' ']).to_string();
    if line.split_whitespace().next().is_some_and(|word| word.eq_ignore_ascii_case("newmtl")) {
        return;
    }
    let known = map_line(&line).and_then(|map| {
        let number = appearance.images.iter().position(|image| image.name == map.file)?;
        // Without its bytes the image stays where it was.
        let name = images.get(number).filter(|_| !appearance.images[number].bytes.is_empty())?;
        Some((map.before, name))
    });
    let _ = match known {
        Some((before, name)) => writeln!(text, "{before}{name}"),
        None => writeln!(text, "{line}"),
    };
}

/// A glTF material in the words of MTL. False where it has more to say.
fn translated(text: &mut String, material: &Value, appearance: &Appearance, images: &[String]) -> bool {
    let mut complete = true;
    let empty = serde_json::Map::new();
    let object = material.as_object().unwrap_or(&empty);
    let said = ["name", "pbrMetallicRoughness", "normalTexture", "emissiveFactor", "emissiveTexture", "doubleSided"];
    complete &= object.keys().all(|k| said.contains(&k.as_str()) || (k == "alphaMode" && material[k] != "MASK"));
    let pbr = &material["pbrMetallicRoughness"];
    let factor = |value: &Value, k: usize, default: f64| value[k].as_f64().unwrap_or(default);
    let base = &pbr["baseColorFactor"];
    let [r, g, b, a] = std::array::from_fn(|k| factor(base, k, 1.0));
    let _ = writeln!(text, "Kd {r} {g} {b}");
    let _ = writeln!(text, "d {a}");
    let glow: [f64; 3] = std::array::from_fn(|k| factor(&material["emissiveFactor"], k, 0.0));
    if glow != [0.0; 3] {
        let _ = writeln!(text, "Ke {} {} {}", glow[0], glow[1], glow[2]);
    }
    let _ = writeln!(text, "Pr {}", pbr["roughnessFactor"].as_f64().unwrap_or(1.0));
    let _ = writeln!(text, "Pm {}", pbr["metallicFactor"].as_f64().unwrap_or(1.0));
    let _ = writeln!(text, "illum 2");
    for (keywords, info) in [
        (&["map_Kd"][..], &pbr["baseColorTexture"]),
        (&["map_Pr", "map_Pm"], &pbr["metallicRoughnessTexture"]),
        (&["map_Ke"], &material["emissiveTexture"]),
        (&["map_Bump"], &material["normalTexture"]),
    ] {
        if !info.is_object() {
            continue;
        }
        let Some(name) = image_of(info, appearance).and_then(|i| images.get(i)) else {
            complete = false;
            continue;
        };
        complete &= factor_of(info, "texCoord", 0.0) == 0.0;
        let mut options = String::new();
        let transform = &info["extensions"]["KHR_texture_transform"];
        if transform.is_object() {
            complete &= transform["rotation"].as_f64().unwrap_or(0.0) == 0.0;
            let scale = [factor(&transform["scale"], 0, 1.0), factor(&transform["scale"], 1, 1.0)];
            let offset = [factor(&transform["offset"], 0, 0.0), factor(&transform["offset"], 1, 0.0)];
            let _ = write!(options, "-s {} {} 1 ", scale[0], scale[1]);
            // Upwards there, downwards here.
            let _ = write!(options, "-o {} {} 0 ", offset[0], 1.0 - scale[1] - offset[1]);
        }
        if keywords == ["map_Bump"] {
            let scale = factor_of(info, "scale", 1.0);
            if scale != 1.0 {
                let _ = write!(options, "-bm {scale} ");
            }
        }
        for keyword in keywords {
            let _ = writeln!(text, "{keyword} {options}{name}");
        }
    }
    complete
}

fn factor_of(value: &Value, key: &str, default: f64) -> f64 {
    value[key].as_f64().unwrap_or(default)
}

/// The image that a `textureInfo` leads to.
pub(super) fn image_of(info: &Value, appearance: &Appearance) -> Option<usize> {
    let texture = appearance.textures.get(info["index"].as_u64()? as usize)?;
    let texture: Value = serde_json::from_str(texture).ok()?;
    let source = texture["source"].as_u64().or_else(|| {
        let extensions = texture["extensions"].as_object()?;
        extensions.values().find_map(|e| e["source"].as_u64())
    })?;
    (source < appearance.images.len() as u64).then_some(source as usize)
}
