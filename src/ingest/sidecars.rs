//! Files beside a source that reach its output: MTL libraries, images, the buffers of glTF.
//!
//! The references are found as the readers find them, without reading the mesh, so that a run that resumes knows what
//! an output was made from at the cost of a look through the bytes. Files of a store are put into a temporary folder
//! that repeats their keys, where the reader finds them by the same names. Invariant: whatever a reader may take from
//! a file beside the source is in [`Sidecars::checksum`], and so is that a file is not there.

use super::error::{Failure, FailureKind};
use super::location::Object;
use super::output::TempFolder;
use super::stamp::{checksum_with, source_checksum};
use super::store::Store;
use crate::image::jpeg::Working;
use crate::io::beside::{Folder, open_regular, percent_decode, read_regular};
use crate::io::files::Place as FilePlace;
use crate::io::name;
use crate::io::read::{DropSet, Format, Packing, drawn_images, mtl};
use serde::Deserialize;
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// What a file beside the source is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Buffer,
    Library,
    Image,
}

/// References beyond this number are not followed, as reading does not follow them either.
const MOST: usize = 4096;
/// The most bytes of a header or document that are looked through.
const MAX_TEXT: u64 = 1 << 30;

/// The files beside a source.
pub(super) struct Sidecars {
    /// Their bytes.
    pub bytes: u64,
    /// Those of images, which stay in memory until the output is written.
    pub images: u64,
    /// What work on the largest of them takes.
    pub working: Working,
    /// Where the reader looks for them; `None`: there are none.
    pub folder: Option<PathBuf>,
    /// SHA-256 of the source and of these files, see `docs/format/source-stamp.md`.
    pub checksum: [u8; 32],
    /// The files themselves, where the source is local.
    pub places: Vec<FilePlace>,
    /// Where they were put, if the source lies in a store.
    held: Option<TempFolder>,
}

impl Sidecars {
    /// Find, check and, from a store, fetch all that `document` refers to.
    ///
    /// # Errors
    /// Those of the store. What is missing, reading will tell with its place.
    pub fn fetch(
        object: &Object,
        document: &[u8],
        format: Format,
        drop: DropSet,
        root: Option<&Path>,
    ) -> Result<Self, Failure> {
        let mut place = match object {
            Object::Local(path) => {
                let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
                Place::Folder(folder.into(), Folder::new(folder, root))
            }
            Object::Stored(store, key) => Place::Store { store, key, held: None, root: root.and_then(Path::to_str) },
        };
        let (mut parts, mut paths) = (Vec::new(), Vec::new());
        let (mut bytes, mut images, mut working) = (0, 0, Working::default());
        let mut wanted = references(document, format, drop);
        // Names that differ often mean one file: it is read once.
        let (mut seen, mut known) = (BTreeSet::new(), Known::new());
        let mut at = 0;
        while at < wanted.names.len() && at < MOST {
            let (kind, name) = wanted.names[at].clone();
            at += 1;
            if !seen.insert((kind, name.clone())) {
                continue;
            }
            let Some(part) = place.part(&name, &known)? else {
                parts.push([0; 32]);
                continue;
            };
            parts.push(part.checksum);
            if matches!(object, Object::Local(_)) {
                paths.push(FilePlace::of(&part.path));
            }
            if known.insert(part.path.clone(), (part.bytes, part.checksum)).is_some() {
                continue;
            }
            bytes += part.bytes;
            if kind == Kind::Image {
                images += part.bytes;
                let file = open_regular(&part.path).ok();
                let of = file.map_or(Working::default(), |(f, _)| Working::of(&mut BufReader::new(f), part.bytes));
                working = working.and(if wanted.drawn.contains(&name) { of } else { of.unseen() });
            }
            if kind == Kind::Library && !drop.images {
                let mut library = Vec::new();
                // What cannot be read is hashed as far as it could be, and is nothing for the reader either.
                let _ = read_regular(&part.path, &mut library);
                wanted.images_of(&library);
            }
        }
        let checksum = if parts.is_empty() { source_checksum(document) } else { checksum_with(document, &parts) };
        let (folder, held) = match place {
            Place::Folder(folder, _) => (Some(folder), None),
            Place::Store { key, held: Some(held), .. } => (Some(held.path().join(folder_of(key))), Some(held)),
            Place::Store { .. } => (None, None),
        };
        Ok(Sidecars { bytes, images, working, folder, checksum, places: paths, held })
    }

    /// The folder of all that came from a store: nothing else is in it.
    pub fn held(&self) -> Option<&Path> {
        self.held.as_ref().map(TempFolder::path)
    }
}

/// The files beside a local mesh that reading it would look into, as far as they are there: libraries, images, buffers.
/// `format`: where the name does not tell; `root`: the folder in which they lie, where it is not that of the mesh. Empty
/// for what is no mesh.
pub fn named_files(path: &Path, format: Option<Format>, root: Option<&Path>) -> Vec<PathBuf> {
    let Some(format) = format.or_else(|| Format::from_path(path).ok()) else { return Vec::new() };
    let Ok((file, _)) = open_regular(path) else { return Vec::new() };
    let mut wanted = references_in(&mut BufReader::with_capacity(1 << 16, file), format, DropSet::NONE);
    let base = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (mut found, folder) = (Vec::new(), Folder::new(base, root));
    let mut at = 0;
    while at < wanted.names.len() && at < MOST {
        let (kind, name) = wanted.names[at].clone();
        at += 1;
        let Some(file) = folder.find(&name) else { continue };
        if kind == Kind::Library {
            let mut library = Vec::new();
            // What cannot be read names nothing.
            let _ = read_regular(&file, &mut library);
            wanted.images_of(&library);
        }
        found.push(file);
    }
    found
}

/// A file that is there.
struct Part {
    path: PathBuf,
    bytes: u64,
    checksum: [u8; 32],
}

/// Bytes and checksums of files by their paths.
type Known = BTreeMap<PathBuf, (u64, [u8; 32])>;

/// Where the source lies.
enum Place<'a> {
    Folder(PathBuf, Folder),
    Store { store: &'a Store, key: &'a str, held: Option<TempFolder>, root: Option<&'a str> },
}

impl Place<'_> {
    fn part(&mut self, name: &str, known: &Known) -> Result<Option<Part>, Failure> {
        match self {
            // What cannot be read is not there for the reader either, or is an error that it tells better.
            Place::Folder(_, folder) => Ok(folder.find(name).and_then(|path| {
                let (bytes, checksum) = known.get(&path).copied().or_else(|| hash_file(&path).ok())?;
                Some(Part { path, bytes, checksum })
            })),
            Place::Store { store, key, held, root: wanted } => {
                let temporary = |e: io::Error| Failure::writing("a temporary file", &e);
                let folder = folder_of(key);
                if held.is_none() {
                    let made = TempFolder::new().map_err(temporary)?;
                    if resolve("", folder).is_some() {
                        std::fs::create_dir_all(made.path().join(folder)).map_err(temporary)?;
                    }
                    *held = Some(made);
                }
                let Some(root) = held.as_ref().map(|h| h.path().to_path_buf()) else { return Ok(None) };
                let slashes = name.replace('\\', "/");
                let last = slashes.rsplit('/').next().unwrap_or_default();
                let mut tried = Vec::new();
                let candidates = [name, &slashes, last];
                // As on a disk: nothing outside of the folder of the source.
                let allowed = wanted.map_or(folder, |root| root.trim_matches('/'));
                let within =
                    |key: &String| allowed.is_empty() || key.strip_prefix(allowed).is_some_and(|k| k.starts_with('/'));
                for key in candidates.iter().filter_map(|c| resolve(folder, c)).filter(within) {
                    if tried.contains(&key) {
                        continue;
                    }
                    let path = root.join(&key);
                    if let Some(&(bytes, checksum)) = known.get(&path) {
                        return Ok(Some(Part { path, bytes, checksum }));
                    }
                    let bytes = match store.get(&key) {
                        Ok(bytes) => bytes,
                        // A store may answer so for what is not there, where it does not let us list.
                        Err(f)
                            if matches!(f.kind, FailureKind::Missing | FailureKind::Permission | FailureKind::Name) =>
                        {
                            tried.push(key);
                            continue;
                        }
                        Err(f) => return Err(f),
                    };
                    path.parent().map_or(Ok(()), std::fs::create_dir_all).map_err(temporary)?;
                    std::fs::write(&path, &bytes).map_err(temporary)?;
                    return Ok(Some(Part { path, bytes: bytes.len() as u64, checksum: Sha256::digest(&bytes).into() }));
                }
                Ok(None)
            }
        }
    }
}

/// The part of a key up to its last slash.
fn folder_of(key: &str) -> &str {
    key.rfind('/').map_or("", |i| &key[..i])
}

/// The key that a reference means from a folder; `None` where it leaves the bucket or is no key.
fn resolve(folder: &str, reference: &str) -> Option<String> {
    if reference.is_empty() || reference.starts_with('/') || reference.contains(['\0', ':']) {
        return if reference.is_empty() && folder.is_empty() { Some(String::new()) } else { None };
    }
    let mut parts: Vec<&str> = folder.split('/').filter(|p| !p.is_empty()).collect();
    if parts.iter().any(|p| *p == "." || *p == "..") {
        return None;
    }
    for part in reference.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                parts.pop()?;
            }
            part => parts.push(part),
        }
    }
    Some(parts.join("/"))
}

fn hash_file(path: &Path) -> io::Result<(u64, [u8; 32])> {
    let (file, size) = open_regular(path)?;
    let mut file = file.take(size);
    let (mut hash, mut bytes) = (Sha256::new(), 0);
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok((bytes, hash.finalize().into())),
            n => {
                hash.update(&buffer[..n]);
                bytes += n as u64;
            }
        }
    }
}

/// What a source refers to, in the order of its first mention.
#[derive(Default)]
struct References {
    names: Vec<(Kind, String)>,
    /// The materials that an OBJ uses.
    materials: BTreeSet<String>,
    /// The images that pictures show.
    drawn: BTreeSet<String>,
}

impl References {
    fn add(&mut self, kind: Kind, name: &str) {
        if !name.is_empty() {
            self.names.push((kind, name.to_string()));
        }
    }

    /// The images of a library, as far as its materials are used.
    fn images_of(&mut self, library: &[u8]) {
        for record in mtl::records(library) {
            if self.materials.contains(&record.name) {
                for map in record.lines.iter().filter_map(|line| mtl::map_line(line)) {
                    self.add(Kind::Image, map.file);
                    if map.keyword == "map_kd" {
                        self.drawn.insert(map.file.to_string());
                    }
                }
            }
        }
    }
}

fn references(mut document: &[u8], format: Format, drop: DropSet) -> References {
    if format == Format::Obj && !may_name_libraries(document) {
        return References::default();
    }
    references_in(&mut document, format, drop)
}

/// The same of a document that comes bit by bit, packed with gzip or not.
fn references_in(document: &mut dyn BufRead, format: Format, drop: DropSet) -> References {
    let mut found = References::default();
    let mut packed;
    let packing = document.fill_buf().ok().and_then(Packing::of);
    let mut input: &mut dyn BufRead = match packing {
        Some(packing) => {
            packed = BufReader::with_capacity(1 << 16, packing.reader(document));
            &mut packed
        }
        None => document,
    };
    // Damaged data ends the search where it ends reading; reading will say so.
    let _ = match format {
        Format::Obj if !drop.materials => obj(&mut input, &mut found),
        Format::Ply if !drop.materials && !drop.images => ply(&mut input, &mut found),
        Format::Gltf | Format::Glb => gltf(&mut input, drop, &mut found),
        _ => Ok(()),
    };
    found
}

/// Whether an OBJ may name libraries: one pass that is much quicker than looking at lines.
fn may_name_libraries(document: &[u8]) -> bool {
    Packing::of(document).is_some() || memchr::memmem::find(document, b"mtllib").is_some()
}

/// Lines `mtllib` and `usemtl`.
fn obj(input: &mut dyn BufRead, found: &mut References) -> io::Result<()> {
    let mut last = String::new();
    each_line(input, |line| {
        let line = line.trim_ascii_start();
        // Nearly all lines begin with another letter.
        if !matches!(line.first(), Some(b'm' | b'u')) {
            return true;
        }
        let line = name::from_bytes(line);
        let Some((keyword, rest)) = line.split_once(char::is_whitespace) else { return true };
        let rest = rest.trim();
        match keyword {
            "mtllib" => {
                // One name with blanks, or several names: whichever is there.
                found.add(Kind::Library, rest.trim_matches('"'));
                if rest.contains(char::is_whitespace) {
                    rest.split_whitespace().for_each(|part| found.add(Kind::Library, part));
                }
            }
            "usemtl" if rest != last => {
                last = rest.to_string();
                found.materials.insert(last.clone());
            }
            _ => {}
        }
        true
    })
}

/// Comments `TextureFile` of the header.
fn ply(input: &mut dyn BufRead, found: &mut References) -> io::Result<()> {
    each_line(&mut input.take(1 << 20), |line| {
        let line = name::from_bytes(line);
        let line = line.trim();
        if let Some(rest) = line.strip_prefix("comment")
            && let Some(name) = rest.trim_start().strip_prefix("TextureFile")
        {
            let name = name.trim().trim_matches('"');
            found.add(Kind::Image, name);
            found.drawn.insert(name.to_string());
        }
        line != "end_header"
    })
}

/// Hand out lines until `each` gives `false`; `\` at the end of a line joins it to the next.
fn each_line(input: &mut dyn BufRead, mut each: impl FnMut(&[u8]) -> bool) -> io::Result<()> {
    let mut joined = Vec::new();
    let mut line = Vec::new();
    loop {
        line.clear();
        if (&mut *input).take(1 << 20).read_until(b'\n', &mut line)? == 0 {
            if !joined.is_empty() {
                each(&joined);
            }
            return Ok(());
        }
        for part in line.split(|b| *b == b'\r' || *b == b'\n') {
            if let Some(part) = part.strip_suffix(b"\\") {
                joined.extend_from_slice(part);
                joined.push(b' ');
            } else if !joined.is_empty() && !part.is_empty() {
                joined.extend_from_slice(part);
                if !each(&std::mem::take(&mut joined)) {
                    return Ok(());
                }
            } else if !part.is_empty() && !each(part) {
                return Ok(());
            }
        }
    }
}

#[derive(Deserialize)]
struct Document<'a> {
    #[serde(default, borrow)]
    buffers: Vec<Item<'a>>,
    #[serde(default, borrow)]
    images: Vec<Item<'a>>,
    #[serde(default)]
    materials: Vec<Value>,
    #[serde(default)]
    textures: Vec<Value>,
}

#[derive(Deserialize)]
struct Item<'a> {
    #[serde(default, borrow)]
    uri: Option<Cow<'a, str>>,
}

/// URIs of buffers and images.
fn gltf(input: &mut dyn BufRead, drop: DropSet, found: &mut References) -> io::Result<()> {
    let mut text = Vec::new();
    input.take(20).read_to_end(&mut text)?;
    let mut left = MAX_TEXT;
    if let (true, Some(&[a, b, c, d])) = (text.starts_with(b"glTF"), text.get(12..16)) {
        left = u64::from(u32::from_le_bytes([a, b, c, d]));
        text.clear();
    }
    input.take(left).read_to_end(&mut text)?;
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
    let Ok(document) = serde_json::from_slice::<Document<'_>>(text) else { return Ok(()) };
    let images = if drop.materials || drop.images { &[][..] } else { &document.images };
    let drawn = drawn_images(&document.materials, &document.textures);
    for (kind, list) in [(Kind::Buffer, &document.buffers[..]), (Kind::Image, images)] {
        for (number, item) in list.iter().enumerate() {
            let Some(uri) = item.uri.as_deref().filter(|u| !u.starts_with("data:")) else { continue };
            let name = percent_decode(uri).unwrap_or_else(|| uri.to_string());
            found.add(kind, &name);
            if kind == Kind::Image && drawn.contains(&(number as u64)) {
                found.drawn.insert(name);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(text: &[u8], format: Format, drop: DropSet) -> Vec<(Kind, String)> {
        references(text, format, drop).names
    }

    #[test]
    fn references_are_found_as_readers_find_them() {
        let own = |list: &[(Kind, &str)]| list.iter().map(|(k, n)| (*k, n.to_string())).collect::<Vec<_>>();
        let obj = b"# x\r\nmtllib a b.mtl\r\n v 0 0 0\nusemtl one\nmtllib \\\n c.mtl\nusemtl two\n";
        let libraries = own(&[
            (Kind::Library, "a b.mtl"),
            (Kind::Library, "a"),
            (Kind::Library, "b.mtl"),
            (Kind::Library, "c.mtl"),
        ]);
        assert_eq!(names(obj, Format::Obj, DropSet::NONE), libraries);
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        io::Write::write_all(&mut packed, obj).unwrap();
        assert_eq!(names(&packed.finish().unwrap(), Format::Obj, DropSet::NONE), libraries);
        let mut found = references(obj, Format::Obj, DropSet::NONE);
        found.names.clear();
        found.images_of(
            b"newmtl one\nmap_Kd -s 1 1 1 wood.png\nnewmtl three\nmap_Kd other.png\nnewmtl two\nbump b.jpg\n",
        );
        assert_eq!(found.names, own(&[(Kind::Image, "wood.png"), (Kind::Image, "b.jpg")]));
        assert_eq!(found.drawn, BTreeSet::from(["wood.png".to_string()]));
        let painted = br#"{"images":[{"uri":"n.png"},{"uri":"c.png"}],"textures":[{"source":0},{"extensions":{"X":{"source":1}}}],
            "materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":1}},"normalTexture":{"index":0}}]}"#;
        assert_eq!(references(painted, Format::Gltf, DropSet::NONE).drawn, BTreeSet::from(["c.png".to_string()]));
        let ply = b"ply\nformat ascii 1.0\ncomment TextureFile my tex.png\nend_header\ncomment TextureFile no.png\n";
        assert_eq!(names(ply, Format::Ply, DropSet::NONE), own(&[(Kind::Image, "my tex.png")]));
        let json = br#"{"asset":{"version":"2.0"},"buffers":[{"uri":"a%20b.bin"},{"uri":"data:x"},{}],"images":[{"uri":"i.png"},{"bufferView":1}]}"#;
        assert_eq!(names(json, Format::Gltf, DropSet::NONE), own(&[(Kind::Buffer, "a b.bin"), (Kind::Image, "i.png")]));
        assert_eq!(names(json, Format::Gltf, DropSet::ALL), own(&[(Kind::Buffer, "a b.bin")]));
        let mut glb = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
        glb.extend((json.len() as u32).to_le_bytes());
        glb.extend(b"JSON");
        glb.extend(json);
        glb.extend([0; 40]);
        assert_eq!(names(&glb, Format::Glb, DropSet::NONE).len(), 2);
        for format in Format::ALL {
            assert!(names(b"\x1f\x8b{", format, DropSet::NONE).is_empty());
            assert!(names(b"glTF", format, DropSet::NONE).is_empty());
        }
    }

    #[test]
    fn keys_stay_within_the_bucket() {
        for (folder, reference, key) in [
            ("a/b", "c.png", Some("a/b/c.png")),
            ("a/b", "./t/c.png", Some("a/b/t/c.png")),
            ("a/b", "../t/c.png", Some("a/t/c.png")),
            ("", "c.png", Some("c.png")),
            ("a", "../../c.png", None),
            ("a", "/etc/passwd", None),
            ("a", "c:/x.png", None),
            ("a/../..", "x.png", None),
        ] {
            assert_eq!(resolve(folder, reference).as_deref(), key, "{folder} {reference}");
        }
    }
}
