//! Files beside the mesh: material libraries and images.
//!
//! Names are made safe (one plain part, no blanks, an extension) and unique without regard to case. A file of that name
//! that is there already and holds something else is not touched: then the name begins with that of the mesh.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::io::name;
use crate::io::read::media_type;
use crate::mesh::{Image, Mesh};

/// What goes beside the mesh, and under which names.
#[derive(Default)]
pub(super) struct Sidecars<'m> {
    /// The folder and the name of the mesh file without its extension; `None` where nothing can stand beside it.
    pub place: Option<(PathBuf, String)>,
    /// The files to write.
    pub files: Vec<(String, Cow<'m, [u8]>)>,
    /// Names in use, in lower case.
    taken: BTreeSet<String>,
}

impl<'m> Sidecars<'m> {
    /// Of a mesh file at this path.
    pub fn of(target: &Path) -> Self {
        let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let stem = target.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        // Nothing beside the mesh may take its place.
        let taken = target.file_name().map(|n| n.to_string_lossy().to_lowercase()).into_iter().collect();
        Sidecars { place: Some((folder.to_path_buf(), stem)), taken, ..Sidecars::default() }
    }

    /// The name of a file `STEM.extension`.
    pub fn own_name(&mut self, extension: &str) -> Option<String> {
        let (_, stem) = self.place.as_ref()?;
        let name = format!("{}.{extension}", safe(stem));
        self.taken.insert(name.to_lowercase());
        Some(name)
    }

    /// Names for all images; those that have bytes will be written where there is a place for them.
    pub fn images(&mut self, mesh: &'m Mesh) -> Vec<String> {
        let mut names = Vec::with_capacity(mesh.appearance.images.len());
        for (number, image) in mesh.appearance.images.iter().enumerate() {
            let plain = safe_image(image, number);
            if image.bytes.is_empty() {
                // It stays where it is expected; another file must not take its name.
                self.taken.insert(plain.to_lowercase());
                names.push(plain);
                continue;
            }
            let mut name = plain.clone();
            let mut attempt = 0usize;
            while self.taken.contains(&name.to_lowercase()) || self.is_other(&name, &image.bytes, attempt) {
                let stem = self.place.as_ref().map_or("image".to_string(), |p| safe(&p.1));
                name = if attempt == 0 {
                    format!("{stem}_{plain}")
                } else {
                    format!("{stem}_{}_{plain}", number + attempt)
                };
                attempt += 1;
            }
            self.taken.insert(name.to_lowercase());
            if self.place.is_some() {
                self.files.push((name.clone(), Cow::Borrowed(&image.bytes)));
            }
            names.push(name);
        }
        names
    }

    /// Whether a file of that name is there that is not ours to replace.
    fn is_other(&self, name: &str, bytes: &[u8], attempt: usize) -> bool {
        let Some((folder, _)) = &self.place else { return false };
        let path = folder.join(name);
        match fs::metadata(&path) {
            // Behind the mesh's own name it is what an earlier run has written.
            Ok(meta) if attempt == 0 => meta.len() != bytes.len() as u64 || fs::read(&path).is_ok_and(|b| b != bytes),
            Ok(meta) => !meta.is_file(),
            Err(_) => false,
        }
    }
}

/// A name of one part, without what systems or formats give a meaning to.
pub(super) fn safe(text: &str) -> String {
    let last = text.rsplit(['/', '\\']).next().unwrap_or_default();
    let odd = |c: char| c.is_control() || c.is_whitespace() || name::is_byte(c) || "\"*:<>?|#%;".contains(c);
    let plain = |c: char| if odd(c) { '_' } else { c };
    let mut room = 120usize;
    let fits = |c: &char| {
        let left = room.checked_sub(c.len_utf8());
        room = left.unwrap_or(0);
        left.is_some()
    };
    let name: String = last.trim().chars().map(plain).take_while(fits).collect();
    let name = name.trim_start_matches(['.', '-']);
    if name.is_empty() { "unnamed".to_string() } else { name.to_string() }
}

fn safe_image(image: &Image, number: usize) -> String {
    let extension = match image.mime.as_str() {
        "image/png" => "png",
        "image/jpeg" => "jpg",
        "image/webp" => "webp",
        "image/ktx2" => "ktx2",
        "image/bmp" => "bmp",
        "image/gif" => "gif",
        "image/tiff" => "tif",
        "image/avif" => "avif",
        "image/x-tga" => "tga",
        _ => "img",
    };
    if image.name.is_empty() {
        return format!("image{number}.{extension}");
    }
    let name = safe(&image.name);
    match media_type(&name, &[]) {
        "" => format!("{name}.{extension}"),
        // It was made one since it was named.
        told if told != "image/jpeg" && image.mime == "image/jpeg" => {
            format!("{}.jpg", name.rsplit_once('.').map_or(name.as_str(), |(stem, _)| stem))
        }
        _ => name,
    }
}
