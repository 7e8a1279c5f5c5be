//! MTL, the materials of OBJ, as glTF materials.
//!
//! Follows the MTL part of the OBJ specification and its extension for physically based shading (`Pr`, `Pm`, `norm`).
//! Colours are taken as the numbers they are: MTL does not say whether they are linear, and a transfer function would
//! lose their exactness. `Tr` is the opposite of `d` by the book, but scanning programs (OpenMVS, mvs-texturing, old
//! MeshLab) have written it for `d` itself: it counts only where there is no `d`, and 1, which would be an invisible
//! surface, is opaque. `Kd 0 0 0` beside a `map_Kd` is written for "see the image" and would make it black. What glTF
//! has no word for stays in `extras.mtl`, which holds every line of the record.

use serde_json::{Map, Value, json};

use crate::io::name;

/// A `newmtl` record: its name and its lines.
#[derive(Debug, Default)]
pub(crate) struct Record {
    pub name: String,
    pub lines: Vec<String>,
}

/// The records of a library. Lines before the first are no part of any; blank lines and comments are left out.
pub(crate) fn records(bytes: &[u8]) -> Vec<Record> {
    let text = name::from_bytes(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)).replace('\r', "\n");
    let mut records: Vec<Record> = Vec::new();
    for line in text.replace("\\\n", " ").lines() {
        let line = line.trim();
        let (keyword, rest) = split(line);
        if keyword == "newmtl" {
            records.push(Record { name: rest.to_string(), lines: Vec::new() });
        } else if let (false, Some(record)) = (line.is_empty() || line.starts_with('#'), records.last_mut()) {
            record.lines.push(line.to_string());
        }
    }
    records
}

/// The keyword of a line and what follows it.
fn split(line: &str) -> (&str, &str) {
    let line = line.trim();
    let end = line.find(char::is_whitespace).unwrap_or(line.len());
    (&line[..end], line[end..].trim())
}

/// A statement that names an image.
#[derive(Debug, PartialEq)]
pub(crate) struct MapLine<'a> {
    /// The keyword in lower case.
    pub keyword: String,
    /// Name of the image file, without quotes.
    pub file: &'a str,
    /// All of the line before the name.
    pub before: &'a str,
    /// `-o`, `-s`: offset and scale of texture coordinates, in the first two directions.
    pub offset: [f64; 2],
    pub scale: [f64; 2],
    /// `-bm`
    pub bump: f64,
    /// `-clamp on`
    pub clamp: bool,
}

/// The image statement on a line, if it is one.
pub(crate) fn map_line(line: &str) -> Option<MapLine<'_>> {
    let (keyword, _) = split(line);
    let keyword = keyword.to_ascii_lowercase();
    let known = keyword.starts_with("map_") || matches!(keyword.as_str(), "bump" | "norm" | "disp" | "decal" | "refl");
    if !known || keyword == "map_aat" {
        return None;
    }
    let mut rest = line.trim_start();
    rest = rest[rest.find(char::is_whitespace).unwrap_or(rest.len())..].trim();
    let (offset, scale, bump, clamp) = ([0.0; 2], [1.0; 2], 1.0, false);
    let mut map = MapLine { keyword, file: "", before: "", offset, scale, bump, clamp };
    while let Some(option) = rest.strip_prefix('-') {
        let (name, mut after) = split(option);
        // Numbers that may follow, and words that must.
        let (numbers, words) = match name.to_ascii_lowercase().as_str() {
            "o" | "s" | "t" => (3, 0),
            "mm" => (2, 0),
            "bm" | "boost" | "texres" => (1, 0),
            "blendu" | "blendv" | "clamp" | "cc" | "imfchan" | "type" | "colorspace" => (0, 1),
            // Not an option: a file whose name begins with a dash.
            _ => break,
        };
        let mut values = [None; 3];
        for value in values.iter_mut().take(numbers) {
            let (word, behind) = split(after);
            // The last word is the file, even if it looks like a number.
            match word.parse::<f64>() {
                Ok(x) if !behind.is_empty() => *value = Some(x).filter(|x| x.is_finite()),
                _ => break,
            }
            after = behind;
        }
        let mut word = "";
        if words == 1 {
            (word, after) = split(after);
        }
        match name.to_ascii_lowercase().as_str() {
            "o" => map.offset = [values[0].unwrap_or(0.0), values[1].unwrap_or(0.0)],
            "s" => map.scale = [values[0].unwrap_or(1.0), values[1].or(values[0]).unwrap_or(1.0)],
            "bm" => map.bump = values[0].unwrap_or(1.0),
            "clamp" => map.clamp = word.eq_ignore_ascii_case("on"),
            _ => {}
        }
        rest = after;
    }
    let line = line.trim();
    map.before = &line[..line.len() - rest.len()];
    map.file = rest.strip_prefix('"').and_then(|r| r.strip_suffix('"')).unwrap_or(rest);
    (!map.file.is_empty()).then_some(map)
}

/// The numbers behind a keyword; a single one stands for all three.
fn numbers(rest: &str) -> Option<[f64; 3]> {
    let mut out = [0.0; 3];
    let mut count = 0;
    for (x, word) in out.iter_mut().zip(rest.split_whitespace()) {
        *x = word.parse().ok().filter(|x: &f64| x.is_finite())?;
        count += 1;
    }
    match count {
        1 => Some([out[0]; 3]),
        3 => Some(out),
        _ => None,
    }
}

/// The glTF material of a record. `image` gives the number of an image file, `texture` that of a texture of an image,
/// clamped or repeated.
pub(crate) fn material<E>(
    record: &Record,
    mut image: impl FnMut(&str) -> Result<u32, E>,
    mut texture: impl FnMut(u32, bool) -> usize,
) -> Result<Value, E> {
    let mut colour = None;
    let (mut dissolve, mut transparency) = (None, None);
    let (mut emission, mut metallic, mut roughness, mut shininess) = (None, None, None, None);
    let mut maps: Vec<(MapLine<'_>, u32)> = Vec::new();
    for line in &record.lines {
        let (keyword, rest) = split(line);
        let one = || rest.split_whitespace().last().and_then(|w| w.parse::<f64>().ok()).filter(|x| x.is_finite());
        let unit = || one().map(|x| x.clamp(0.0, 1.0));
        match keyword.to_ascii_lowercase().as_str() {
            "kd" => colour = numbers(rest).or(colour),
            "ke" => emission = numbers(rest).or(emission),
            "d" => dissolve = unit().or(dissolve),
            "tr" => transparency = unit().or(transparency),
            "pm" => metallic = unit().or(metallic),
            "pr" => roughness = unit().or(roughness),
            "ns" => shininess = one().or(shininess),
            _ => {
                if let Some(map) = map_line(line) {
                    let number = image(map.file)?;
                    maps.push((map, number));
                }
            }
        }
    }
    let alpha = dissolve.unwrap_or(match transparency {
        Some(t) if t < 1.0 => 1.0 - t,
        _ => 1.0,
    });
    let find = |names: &[&str]| maps.iter().rev().find(|(m, _)| names.contains(&m.keyword.as_str()));
    let mut reference = |(map, image): &(MapLine<'_>, u32)| info(map, texture(*image, map.clamp));
    let mut pbr = Map::new();
    let base = find(&["map_kd"]);
    let unit = |c: [f64; 3]| c.map(|x| x.clamp(0.0, 1.0));
    let colour = colour.filter(|c| base.is_none() || *c != [0.0; 3]);
    let [r, g, b] = unit(colour.unwrap_or([1.0; 3]));
    pbr.insert("baseColorFactor".into(), json!([r, g, b, alpha]));
    pbr.insert("metallicFactor".into(), json!(metallic.unwrap_or(0.0)));
    let from_shininess = |ns: f64| 1.0 - (ns.max(0.0).sqrt() / 30.0).min(1.0);
    pbr.insert("roughnessFactor".into(), json!(roughness.unwrap_or(shininess.map_or(1.0, from_shininess))));
    if let Some(found) = base {
        pbr.insert("baseColorTexture".into(), reference(found));
    }
    // glTF keeps both in one image; MTL may name one image for both.
    if let (Some(rough), Some(metal)) = (find(&["map_pr"]), find(&["map_pm"]))
        && rough.1 == metal.1
    {
        pbr.insert("metallicRoughnessTexture".into(), reference(rough));
    }
    let mut out = Map::new();
    out.insert("name".into(), json!(record.name));
    out.insert("pbrMetallicRoughness".into(), pbr.into());
    // MTL does not say; what is seen from one side only would surprise.
    out.insert("doubleSided".into(), json!(true));
    if let Some(found) = find(&["norm", "map_bump", "bump", "map_kn"]) {
        let mut info = reference(found);
        if found.0.bump != 1.0 {
            info["scale"] = json!(found.0.bump);
        }
        out.insert("normalTexture".into(), info);
    }
    let emissive = find(&["map_ke", "map_emissive"]);
    let mut glow = emission.unwrap_or([0.0; 3]).map(|x| x.max(0.0));
    if emissive.is_some() && glow == [0.0; 3] {
        glow = [1.0; 3];
    }
    let strength = glow.into_iter().fold(1.0, f64::max);
    if glow != [0.0; 3] {
        out.insert("emissiveFactor".into(), json!(glow.map(|x| x / strength)));
    }
    if let Some(found) = emissive {
        out.insert("emissiveTexture".into(), reference(found));
    }
    if strength > 1.0 {
        out.insert("extensions".into(), json!({"KHR_materials_emissive_strength": {"emissiveStrength": strength}}));
    }
    let cut_out = find(&["map_d"]).zip(base).is_some_and(|(d, kd)| d.1 == kd.1);
    if alpha < 1.0 || cut_out {
        out.insert("alphaMode".into(), json!("BLEND"));
    }
    out.insert("extras".into(), json!({"mtl": record.lines}));
    Ok(out.into())
}

/// A glTF `textureInfo`. MTL counts `v` upwards, glTF downwards, which turns the offset.
fn info(map: &MapLine<'_>, texture: usize) -> Value {
    let mut info = json!({ "index": texture });
    if map.offset != [0.0; 2] || map.scale != [1.0; 2] {
        let offset = [map.offset[0], 1.0 - map.scale[1] - map.offset[1]];
        info["extensions"] = json!({"KHR_texture_transform": {"offset": offset, "scale": map.scale}});
    }
    info
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_images_behind_any_options() {
        let map = |line| map_line(line).unwrap();
        assert_eq!(map("map_Kd a b.png").file, "a b.png");
        assert_eq!(map("map_Kd \"a b.png\"").file, "a b.png");
        let m = map("MAP_Kd -s 2 3 1 -o .5 0.25 -clamp on  dir\\my tex.PNG ");
        assert_eq!((m.file, m.scale, m.offset, m.clamp), ("dir\\my tex.PNG", [2.0, 3.0], [0.5, 0.25], true));
        assert_eq!(m.before, "MAP_Kd -s 2 3 1 -o .5 0.25 -clamp on  ");
        let m = map("map_Bump -bm 0.3 -imfchan l n.png");
        assert_eq!((m.file, m.bump), ("n.png", 0.3));
        assert_eq!(map("map_Kd -s 2 2").file, "2");
        assert_eq!(map("map_Kd -odd.png").file, "-odd.png");
        assert_eq!(map_line("map_Kd"), None);
        assert_eq!(map_line("Kd 1 1 1"), None);
    }

    #[test]
    fn records_become_materials() {
        let text =
            b"# x\r\nnewmtl a b\r\nKd 0.5 0.25 1\r\nd 0.5\r\n\r\nKe 4 0 2\nPm 0.75\nPr .5\nmap_Kd -o 0.25 0.5 t.png\n\
            norm -bm 2 n.png\nillum 2\nnewmtl\nKd nan 0 0\nTr 0.25\n";
        let records = records(text);
        assert_eq!((records.len(), records[0].name.as_str()), (2, "a b"));
        let image = |file: &str| Ok::<u32, ()>(u32::from(file == "n.png"));
        let texture = |image: u32, _: bool| image as usize;
        let m = material(&records[0], image, texture).unwrap();
        let expected = json!({
            "name": "a b", "doubleSided": true, "alphaMode": "BLEND",
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.5, 0.25, 1.0, 0.5], "metallicFactor": 0.75, "roughnessFactor": 0.5,
                "baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": {"offset": [0.25, -0.5], "scale": [1.0, 1.0]}}},
            },
            "normalTexture": {"index": 1, "scale": 2.0},
            "emissiveFactor": [1.0, 0.0, 0.5],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4.0}},
            "extras": {"mtl": [
                "Kd 0.5 0.25 1", "d 0.5", "Ke 4 0 2", "Pm 0.75", "Pr .5", "map_Kd -o 0.25 0.5 t.png", "norm -bm 2 n.png", "illum 2"
            ]}
        });
        assert_eq!(m, expected);
        let m = material(&records[1], image, texture).unwrap();
        assert_eq!(m["pbrMetallicRoughness"]["baseColorFactor"], json!([1.0, 1.0, 1.0, 0.75]));
    }
}
