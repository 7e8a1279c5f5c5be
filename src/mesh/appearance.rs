//! Materials, textures and images: what corners' values are for.
//!
//! There is one form for all formats, that of glTF 2.0: a material is a glTF material object as JSON text. What another format says beyond
//! that travels in `extras` (the reader of OBJ keeps the lines of its MTL record there), so that a writer of the same format gives it
//! back. The codec carries all this as it is.

/// Materials and what they refer to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Appearance {
    /// glTF material objects as JSON text. Their texture numbers count [`textures`](Self::textures); `texCoord` counts the layers of texture coordinates.
    pub materials: Vec<String>,
    /// glTF texture objects as JSON text; `source` counts [`images`](Self::images), `sampler` [`samplers`](Self::samplers).
    pub textures: Vec<String>,
    /// glTF sampler objects as JSON text.
    pub samplers: Vec<String>,
    /// The images.
    pub images: Vec<Image>,
}

impl Appearance {
    /// Whether there is nothing.
    pub fn is_empty(&self) -> bool {
        self.materials.is_empty() && self.textures.is_empty() && self.samplers.is_empty() && self.images.is_empty()
    }
}

/// An image file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Image {
    /// Its name: the path as the referring file wrote it, or empty for one that was embedded without a name.
    pub name: String,
    /// Its media type, such as `image/jpeg`; empty when unknown.
    pub mime: String,
    /// Its bytes as they were; empty when the file was not there. A decoder that has no more shows the finest preview here.
    pub bytes: Vec<u8>,
    /// Small pictures, whole JPEG or PNG files, that an encoder puts in front of the image, coarse before fine. A decoder leaves this empty.
    pub previews: Vec<Vec<u8>>,
}
