//! Files that a mesh file refers to: images and material libraries.
//!
//! Where they are, [`Folder`] knows. A file that is not there is a warning, and so is one that is no image by its
//! bytes.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use super::build::{Builder, Kind};
use super::error::ReadErrorKind;
use super::warning::Warning;
use crate::image::signature;
use crate::io::beside::{Folder, read_regular};
use crate::io::name::shown;
use crate::mesh::Image;

/// The most bytes of an image file.
const LARGEST_IMAGE: u64 = 1 << 30;

/// The most files that are looked for: looking for one that is missing reads a folder.
const MOST_FILES: usize = 4096;

/// How many names a warning lists.
const LISTED: usize = 8;

/// The folder of the mesh file, and what was found there so far.
pub(super) struct Files<'a> {
    folder: Option<&'a Folder>,
    /// By the name that stands in the mesh file.
    images: BTreeMap<String, u32>,
    /// By path, for names that differ and mean the same file.
    paths: BTreeMap<PathBuf, u32>,
    /// Text files that have been read.
    texts: BTreeSet<PathBuf>,
    missing: BTreeMap<&'static str, (u64, Vec<String>)>,
    asked: usize,
}

impl<'a> Files<'a> {
    pub fn new(folder: Option<&'a Folder>) -> Self {
        let (images, paths, texts, missing) = Default::default();
        Files { folder, images, paths, texts, missing, asked: 0 }
    }

    /// The number of the image of that name, which is read when it is first asked for.
    pub fn image(&mut self, b: &mut Builder, name: &str) -> Result<u32, Kind> {
        if let Some(&i) = self.images.get(name) {
            return Ok(i);
        }
        b.budget.take(2 * name.len() as u64 + 128)?;
        let path = self.path(b, name);
        if let Some(&i) = path.as_ref().and_then(|p| self.paths.get(p)) {
            self.images.insert(name.to_string(), i);
            return Ok(i);
        }
        let bytes = self.bytes(b, path.as_deref(), name)?;
        let next = b.appearance.images.len() as u32;
        b.appearance.images.push(Image {
            name: name.to_string(),
            mime: media_type(name, &bytes).to_string(),
            bytes,
            previews: Vec::new(),
        });
        self.images.insert(name.to_string(), next);
        if let Some(path) = path {
            self.paths.insert(path, next);
        }
        Ok(next)
    }

    /// Where the image of that name is, if its bytes are wanted.
    pub fn path(&mut self, b: &Builder, name: &str) -> Option<PathBuf> {
        self.asked += 1;
        if b.drop.images || self.asked > MOST_FILES { None } else { self.find(name) }
    }

    /// The bytes of an image file; none, and a warning, where it is missing.
    pub fn bytes(&mut self, b: &mut Builder, path: Option<&Path>, name: &str) -> Result<Vec<u8>, Kind> {
        if b.drop.images {
            return Ok(Vec::new());
        }
        let bytes = match path {
            Some(path) => read_image(b, path, name)?,
            None => None,
        };
        if bytes.is_none() {
            self.miss("image file", name);
        }
        Ok(bytes.unwrap_or_default())
    }

    /// The bytes of a text file such as a material library: `None` where it is not there, none at all where it has been
    /// read before, under whatever name.
    pub fn text(&mut self, b: &mut Builder, name: &str) -> Result<Option<Vec<u8>>, Kind> {
        self.asked += 1;
        let found = if self.asked > MOST_FILES { None } else { self.find(name) };
        let Some(path) = found else { return Ok(None) };
        if self.texts.contains(&path) {
            return Ok(Some(Vec::new()));
        }
        let Ok(meta) = fs::metadata(&path) else { return Ok(None) };
        if meta.len() > LARGEST_IMAGE {
            return Err(size(name, meta.len()));
        }
        // The text, and what is made of it.
        b.budget.take(meta.len().saturating_mul(4))?;
        let mut bytes = Vec::new();
        if read_regular(&path, &mut bytes).is_err() {
            return Ok(None);
        }
        self.texts.insert(path);
        Ok(Some(bytes))
    }

    /// A file that the warning at the end will name.
    pub fn miss(&mut self, what: &'static str, name: &str) {
        let (count, names) = self.missing.entry(what).or_default();
        *count += 1;
        if names.len() < LISTED {
            names.push(shown(name));
        }
    }

    /// Where a file of that name is.
    fn find(&self, name: &str) -> Option<PathBuf> {
        self.folder?.find(name)
    }

    /// Say what was not found.
    pub fn report(self, b: &mut Builder) {
        for (what, (count, names)) in self.missing {
            b.tally.others.push(Warning::MissingFiles { what, count, names });
        }
    }
}

fn size(name: &str, bytes: u64) -> Kind {
    ReadErrorKind::ImageSize { name: shown(name), bytes, limit: LARGEST_IMAGE }
}

/// The bytes of an image file; `None` for what cannot be read or is no image.
fn read_image(b: &mut Builder, path: &Path, name: &str) -> Result<Option<Vec<u8>>, Kind> {
    let Ok(meta) = fs::metadata(path) else { return Ok(None) };
    if meta.len() > LARGEST_IMAGE {
        return Err(size(name, meta.len()));
    }
    let mut bytes = Vec::new();
    b.budget.reserve(&mut bytes, meta.len() as usize)?;
    // What it is called says nothing: a mesh could name any file.
    let good = read_regular(path, &mut bytes).is_ok() && !media_type("", &bytes).is_empty();
    if !good {
        b.budget.release(meta.len());
    }
    Ok(good.then_some(bytes))
}

/// The media type of an image: by its first bytes, else by its extension; empty where neither tells.
pub(crate) fn media_type(name: &str, bytes: &[u8]) -> &'static str {
    if let Some(media) = signature::media_type(bytes) {
        return media;
    }
    let extension = name.rsplit(['.', '/', '\\']).next().unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "png" => "image/png",
        "jpg" | "jpeg" | "jpe" => "image/jpeg",
        "webp" => "image/webp",
        "bmp" => "image/bmp",
        "gif" => "image/gif",
        "tga" => "image/x-tga",
        "tif" | "tiff" => "image/tiff",
        "dds" => "image/vnd-ms.dds",
        "ktx" => "image/ktx",
        "ktx2" | "basis" => "image/ktx2",
        "avif" => "image/avif",
        "hdr" => "image/vnd.radiance",
        "exr" => "image/x-exr",
        "ppm" | "pgm" | "pnm" | "pbm" => "image/x-portable-anymap",
        "rgb" | "sgi" | "pcx" | "psd" | "iff" | "jp2" => "image/unknown",
        _ => "",
    }
}
