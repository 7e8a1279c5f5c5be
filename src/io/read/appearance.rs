//! Files that a mesh file refers to: images and material libraries.
//!
//! A reference is followed as it stands, relative to the folder of the mesh file; then with `\` read as `/`, then by the
//! last part of its path alone, then without regard to case, since many files come from systems that do not care. A
//! file that is not there is a warning. One that is no image is taken for one that is not there: a mesh from elsewhere
//! must not be able to carry away any file of the machine.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use super::build::{Builder, Kind};
use super::error::ReadErrorKind;
use super::warning::Warning;
use crate::image::signature;
use crate::mesh::Image;

/// The most bytes of an image file.
const LARGEST_IMAGE: u64 = 1 << 30;

/// The most files that are looked for: looking for one that is missing reads a folder.
const MOST_FILES: usize = 4096;

/// How many names a warning lists.
const LISTED: usize = 8;

/// The folder of the mesh file, and what was found there so far.
pub(super) struct Files<'a> {
    base: Option<&'a Path>,
    /// By the name that stands in the mesh file.
    images: BTreeMap<String, u32>,
    /// By path, for names that differ and mean the same file.
    paths: BTreeMap<PathBuf, u32>,
    missing: BTreeMap<&'static str, (u64, Vec<String>)>,
    asked: usize,
}

impl<'a> Files<'a> {
    pub fn new(base: Option<&'a Path>) -> Self {
        Files { base, images: BTreeMap::new(), paths: BTreeMap::new(), missing: BTreeMap::new(), asked: 0 }
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

    /// The bytes of a text file such as a material library; `None` and a warning where it is not there.
    pub fn text(&mut self, b: &mut Builder, name: &str) -> Result<Option<Vec<u8>>, Kind> {
        self.asked += 1;
        let found = if self.asked > MOST_FILES { None } else { self.find(name) };
        let Some(path) = found else { return Ok(None) };
        let Ok(meta) = fs::metadata(&path) else { return Ok(None) };
        if meta.len() > LARGEST_IMAGE {
            return Err(size(name, meta.len()));
        }
        // The text, and what is made of it.
        b.budget.take(meta.len().saturating_mul(4))?;
        let mut bytes = Vec::new();
        let read = File::open(&path).and_then(|f| f.take(meta.len()).read_to_end(&mut bytes));
        Ok(read.ok().map(|_| bytes))
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
        find_beside(self.base?, name)
    }

    /// Say what was not found.
    pub fn report(self, b: &mut Builder) {
        for (what, (count, names)) in self.missing {
            b.tally.others.push(Warning::MissingFiles { what, count, names });
        }
    }
}

/// Where the file is that a mesh file in the folder `base` means by a name.
pub(crate) fn find_beside(base: &Path, name: &str) -> Option<PathBuf> {
    if name.is_empty() || name.contains('\0') {
        return None;
    }
    let slashes = name.replace('\\', "/");
    let last = slashes.rsplit('/').next().unwrap_or_default();
    let candidates = [base.join(name), base.join(&slashes), base.join(last)];
    if let Some(path) = candidates.iter().find(|p| p.is_file()) {
        return Some(path.clone());
    }
    candidates[1..].iter().find_map(|path| {
        let wanted = path.file_name()?.to_string_lossy().to_lowercase();
        let entries = fs::read_dir(path.parent()?).ok()?;
        let mut found: Vec<PathBuf> = entries
            .filter_map(Result::ok)
            .filter(|e| e.file_name().to_string_lossy().to_lowercase() == wanted)
            .map(|e| e.path())
            .filter(|p| p.is_file())
            .collect();
        found.sort();
        found.into_iter().next()
    })
}

fn size(name: &str, bytes: u64) -> Kind {
    ReadErrorKind::ImageSize { name: shown(name), bytes, limit: LARGEST_IMAGE }
}

/// A name from a file, fit for a message of one line.
pub(super) fn shown(name: &str) -> String {
    name.chars().take(80).flat_map(char::escape_debug).collect()
}

/// The bytes of an image file; `None` for what cannot be read or is no image.
fn read_image(b: &mut Builder, path: &Path, name: &str) -> Result<Option<Vec<u8>>, Kind> {
    let Ok(meta) = fs::metadata(path) else { return Ok(None) };
    if meta.len() > LARGEST_IMAGE {
        return Err(size(name, meta.len()));
    }
    let mut bytes = Vec::new();
    b.budget.reserve(&mut bytes, meta.len() as usize)?;
    let read = File::open(path).and_then(|f| f.take(meta.len()).read_to_end(&mut bytes));
    let good = read.is_ok() && !bytes.is_empty() && !media_type(name, &bytes).is_empty();
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
