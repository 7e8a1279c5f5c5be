//! The images of a mesh, decoded once for many pictures.

use super::material::Material;
use super::texture::{Texture, decode};
use crate::mesh::Appearance;
use crate::parallel;
use std::sync::Arc;

/// A decoded image in all sizes; clones share it.
#[derive(Clone)]
pub struct Drawable(Arc<Texture>);

impl Drawable {
    /// Decode a PNG or JPEG file.
    ///
    /// # Errors
    /// See [`decode`].
    pub fn new(bytes: &[u8]) -> Result<Self, String> {
        Ok(Drawable(Arc::new(Texture::new(&decode(bytes)?))))
    }

    /// Bytes of memory that it takes.
    pub fn memory(&self) -> usize {
        // Eight bytes a texel, and a third more for the smaller sizes.
        self.0.texels() as usize * 32 / 3
    }
}

/// What materials paint with: for each image of an appearance the decoded one, where it is shown and could be read.
#[derive(Clone)]
pub struct Textures {
    images: Arc<Vec<Option<Drawable>>>,
    warnings: Vec<String>,
}

impl Textures {
    /// Decode the images of an appearance that pictures show.
    pub fn new(appearance: &Appearance) -> Self {
        let shown = Textures::shown(appearance);
        let decoded = parallel::map((0..shown.len()).filter(|&i| shown[i]).collect(), |i| {
            (i, Drawable::new(&appearance.images[i].bytes))
        });
        let mut images: Vec<Option<Drawable>> = vec![None; shown.len()];
        let mut warnings = Vec::new();
        for (i, result) in decoded {
            match result {
                Ok(image) => images[i] = Some(image),
                Err(why) => {
                    let name = &appearance.images[i].name;
                    let name = if name.is_empty() { format!("image {i}") } else { name.clone() };
                    warnings.push(format!("{name}: {why}; its faces are drawn without it"));
                }
            }
        }
        Textures { images: Arc::new(images), warnings }
    }

    /// Images that were decoded before, by their numbers in the appearance; `None` for those that are not there.
    pub fn of(images: Vec<Option<Drawable>>) -> Self {
        Textures { images: Arc::new(images), warnings: Vec::new() }
    }

    /// For each image of an appearance whether pictures show it: those of base colours.
    pub fn shown(appearance: &Appearance) -> Vec<bool> {
        let mut shown = vec![false; appearance.images.len()];
        let materials = (0..appearance.materials.len()).map(|i| Material::new(appearance, i));
        materials.filter_map(|m| m.texture).for_each(|t| shown[t.image] = true);
        shown
    }

    /// What could not be decoded, one line each.
    pub(super) fn warnings(&self) -> &[String] {
        &self.warnings
    }

    pub(super) fn get(&self, image: usize) -> Option<&Texture> {
        self.images.get(image)?.as_ref().map(|image| image.0.as_ref())
    }
}
