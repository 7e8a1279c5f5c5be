//! What of a glTF material is drawn: base colour, its texture, and how alpha cuts.
//!
//! Metal, roughness, normal maps and emission are left out: they are lit by what a program has around the object, and would only add
//! what no codec touches. `BLEND` is cut at one half, so that pictures do not depend on the order of faces.

use super::texture::Wrap;
use crate::mesh::Appearance;
use serde_json::Value;

/// What is drawn of a material.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Material {
    /// Linear red, green, blue and alpha, times the texture.
    pub(super) factor: [f32; 4],
    pub(super) texture: Option<TextureUse>,
    /// Where alpha below it is not drawn.
    pub(super) cutoff: Option<f32>,
}

/// Which image lies how on the faces.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TextureUse {
    /// Of the images of the mesh.
    pub(super) image: usize,
    /// The layer of texture coordinates, counted among those.
    pub(super) layer: usize,
    pub(super) wrap: [Wrap; 2],
    /// Columns of the map from texture coordinates (v downwards) to the image, `None` for the identity.
    pub(super) transform: Option<[[f32; 2]; 3]>,
}

impl Default for Material {
    fn default() -> Self {
        Material { factor: [1.0; 4], texture: None, cutoff: None }
    }
}

impl Material {
    /// Material `index` of a mesh; what cannot be read counts as not said.
    pub(super) fn new(appearance: &Appearance, index: usize) -> Self {
        let json: Value = parse(&appearance.materials, index);
        let pbr = &json["pbrMetallicRoughness"];
        let glossy = &json["extensions"]["KHR_materials_pbrSpecularGlossiness"];
        let (factor, texture) = if pbr["baseColorTexture"].is_object() || glossy.is_null() {
            (&pbr["baseColorFactor"], &pbr["baseColorTexture"])
        } else {
            (&glossy["diffuseFactor"], &glossy["diffuseTexture"])
        };
        let factor = std::array::from_fn(|k| factor[k].as_f64().unwrap_or(1.0).clamp(0.0, 1.0) as f32);
        let cutoff = match json["alphaMode"].as_str() {
            Some("MASK") => Some(json["alphaCutoff"].as_f64().unwrap_or(0.5) as f32),
            // What is wholly transparent is not seen at all.
            Some("BLEND") => Some(0.5f32.min(0.5 * factor[3]).max(f32::MIN_POSITIVE)),
            _ => None,
        };
        Material { factor, texture: texture_use(appearance, texture), cutoff }
    }
}

fn parse(texts: &[String], index: usize) -> Value {
    texts.get(index).and_then(|text| serde_json::from_str(text).ok()).unwrap_or(Value::Null)
}

fn texture_use(appearance: &Appearance, reference: &Value) -> Option<TextureUse> {
    let number = |value: &Value| value.as_u64().map(|n| n as usize);
    let texture = parse(&appearance.textures, number(&reference["index"])?);
    let image = number(&texture["source"]).filter(|&i| i < appearance.images.len())?;
    let sampler = number(&texture["sampler"]).map_or(Value::Null, |i| parse(&appearance.samplers, i));
    let wrap = ["wrapS", "wrapT"].map(|name| Wrap::from_number(sampler[name].as_u64().unwrap_or(0)));
    let moved = &reference["extensions"]["KHR_texture_transform"];
    let layer = number(&moved["texCoord"]).or(number(&reference["texCoord"])).unwrap_or(0);
    let transform = moved.is_object().then(|| {
        let pair = |name: &str, usual: f64| [0, 1].map(|k| moved[name][k].as_f64().unwrap_or(usual) as f32);
        let (offset, scale) = (pair("offset", 0.0), pair("scale", 1.0));
        let (sin, cos) = (moved["rotation"].as_f64().unwrap_or(0.0) as f32).sin_cos();
        [[cos * scale[0], sin * scale[0]], [-sin * scale[1], cos * scale[1]], offset]
    });
    Some(TextureUse { image, layer, wrap, transform })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Image;

    #[test]
    fn materials_are_read_as_gltf_says() {
        let appearance = Appearance {
            materials: vec![
                r#"{"pbrMetallicRoughness":{"baseColorFactor":[1,0.5,0,1],"baseColorTexture":{"index":1,"texCoord":1,
                    "extensions":{"KHR_texture_transform":{"offset":[0.5,0],"scale":[2,3]}}}},"alphaMode":"MASK"}"#
                    .into(),
                r#"{"extensions":{"KHR_materials_pbrSpecularGlossiness":{"diffuseFactor":[0,0,1,1]}}}"#.into(),
                "no JSON".into(),
                r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":7}},"alphaMode":"BLEND"}"#.into(),
            ],
            textures: vec![r#"{"source":9}"#.into(), r#"{"source":0,"sampler":0}"#.into()],
            samplers: vec![r#"{"wrapS":33071,"wrapT":33648}"#.into()],
            images: vec![Image::default()],
        };
        let first = Material::new(&appearance, 0);
        assert_eq!((first.factor, first.cutoff), ([1.0, 0.5, 0.0, 1.0], Some(0.5)));
        assert_eq!(
            first.texture,
            Some(TextureUse {
                image: 0,
                layer: 1,
                wrap: [Wrap::Clamp, Wrap::Mirror],
                transform: Some([[2.0, 0.0], [0.0, 3.0], [0.5, 0.0]]),
            })
        );
        assert_eq!(Material::new(&appearance, 1).factor, [0.0, 0.0, 1.0, 1.0]);
        assert_eq!(Material::new(&appearance, 2), Material::default());
        assert_eq!(Material::new(&appearance, 3), Material { cutoff: Some(0.5), ..Material::default() });
    }
}
