//! Where things are: what the texts SOURCE and DEST mean.

use super::error::{Failure, FailureKind, IngestError};
use super::store::{SCHEMES, Store, Stores};
use crate::io::read::Packing;
use globset::{GlobBuilder, GlobMatcher};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The folder for files on their way, inside the destination.
pub(super) const STAGING: &str = ".lodestream-staging";

/// Whether a path leads into a staging folder, as it is written or through links.
pub(super) fn is_staged(path: &Path) -> bool {
    let leads = |path: &Path| path.iter().any(|part| part.eq_ignore_ascii_case(STAGING));
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let real = |path: &Path| fs::canonicalize(path).is_ok_and(|path| leads(&path));
    leads(path) || real(path) || real(folder)
}

/// A file or an object.
#[derive(Clone)]
pub(super) enum Object {
    Local(PathBuf),
    Stored(Arc<Store>, String),
}

impl Object {
    /// Its name for people.
    pub fn name(&self) -> String {
        match self {
            Object::Local(path) => path.display().to_string(),
            Object::Stored(store, key) => store.name(key),
        }
    }

    /// The part of the name from which a format is told.
    pub fn path(&self) -> &Path {
        match self {
            Object::Local(path) => path,
            Object::Stored(_, key) => Path::new(key),
        }
    }

    /// All its bytes.
    pub fn read(&self) -> Result<Vec<u8>, Failure> {
        match self {
            Object::Stored(store, key) => store.get(key),
            Object::Local(path) => crate::io::files::read_regular(path).map_err(|e| Failure::reading(&self.name(), &e)),
        }
    }
}

/// A relative path that goes down only.
pub(super) fn is_plain(path: &str) -> bool {
    !path.is_empty()
        && !path.contains(['\\', ':', '\0'])
        && path.split('/').all(|part| !part.is_empty() && part != "." && part != "..")
}

/// What a SOURCE text means.
pub(super) enum Source {
    /// One file or object.
    One(Object),
    /// All below a folder or prefix that match, or all meshes where there is no pattern.
    Many(Folder, Option<GlobMatcher>),
}

/// A folder, or the keys below a prefix, which ends with `/` or is empty.
#[derive(Clone)]
pub(super) enum Folder {
    Local(PathBuf),
    Stored(Arc<Store>, String),
}

impl Folder {
    /// The object of that relative name.
    pub fn object(&self, relative: &str) -> Object {
        match self {
            Folder::Local(path) => Object::Local(path.join(relative)),
            Folder::Stored(store, prefix) => Object::Stored(store.clone(), format!("{prefix}{relative}")),
        }
    }
}

/// `s3://bucket/key` as its three parts; `None` for what is no URL of a store.
fn split_url(text: &str) -> Option<(&str, &str, &str)> {
    let (scheme, rest) = text.split_once("://")?;
    let scheme = match scheme {
        "s3a" => "s3",
        "azure" | "abfs" | "abfss" | "adl" => "az",
        other => *SCHEMES.iter().find(|s| **s == other)?,
    };
    let (bucket, key) = rest.split_once('/').unwrap_or((rest, ""));
    Some((scheme, bucket, key))
}

/// A local path, also from a `file://` URL.
fn local(text: &str) -> Result<PathBuf, IngestError> {
    if !text.starts_with("file:") {
        if let Some((scheme, _)) = text.split_once("://") {
            let known = "known are s3://, gs://, az:// and file://";
            return Err(IngestError::Usage(format!("{text}: the scheme {scheme}:// is not known; {known}")));
        }
        return Ok(PathBuf::from(text));
    }
    url::Url::parse(text).ok().and_then(|u| u.to_file_path().ok()).ok_or_else(|| {
        IngestError::Usage(format!("{text}: this is no path of a file; write it as file:///folder/file"))
    })
}

/// Where a pattern begins: the folder before the first part with a wildcard, and the rest.
fn split_glob(text: &str) -> Option<(&str, &str)> {
    let wild = text.find(['*', '?', '[', '{'])?;
    let cut = text[..wild].rfind('/').map_or(0, |i| i + 1);
    Some((&text[..cut], &text[cut..]))
}

fn matcher(text: &str, pattern: &str) -> Result<GlobMatcher, IngestError> {
    let glob = GlobBuilder::new(pattern).literal_separator(true).build();
    glob.map(|g| g.compile_matcher())
        .map_err(|e| IngestError::Usage(format!("{text}: this is no pattern: {}", e.kind())))
}

/// Understand a SOURCE; local ones have to be there.
pub(super) fn source(text: &str, stores: &Stores) -> Result<Source, IngestError> {
    if let Some((scheme, bucket, key)) = split_url(text) {
        let store = stores.open(scheme, bucket)?;
        if let Some((prefix, pattern)) = split_glob(key) {
            return Ok(Source::Many(Folder::Stored(store, prefix.to_string()), Some(matcher(text, pattern)?)));
        }
        // A key with the extension of a mesh is one object, anything else stands for what is below it.
        if !key.ends_with('/') && crate::io::read::Format::from_path(Path::new(key)).is_ok() {
            return Ok(Source::One(Object::Stored(store, key.to_string())));
        }
        let prefix = if key.is_empty() || key.ends_with('/') { key.to_string() } else { format!("{key}/") };
        return Ok(Source::Many(Folder::Stored(store, prefix), None));
    }
    let path = local(text)?;
    let meta = match std::fs::metadata(&path) {
        Ok(meta) => meta,
        Err(e) => {
            if let Some((root, pattern)) = split_glob(text).filter(|_| !text.starts_with("file:")) {
                let root = if root.is_empty() { PathBuf::from(".") } else { PathBuf::from(root) };
                if !root.is_dir() {
                    let root = root.display();
                    return Err(IngestError::Setup(format!("{text}: the folder {root} is not there; check the path")));
                }
                return Ok(Source::Many(Folder::Local(root), Some(matcher(text, pattern)?)));
            }
            return Err(IngestError::Setup(Failure::reading(text, &e).message));
        }
    };
    Ok(if meta.is_dir() { Source::Many(Folder::Local(path), None) } else { Source::One(Object::Local(path)) })
}

/// Where outputs go.
#[derive(Clone)]
pub(super) enum Dest {
    /// Everything below this folder or prefix.
    Folder(Folder),
    /// The one output of the one source.
    File(Object),
}

/// Understand a DEST. A text that ends with `.lods` is one file, any other a folder, which is made when needed.
pub(super) fn dest(text: &str, stores: &Stores) -> Result<Dest, IngestError> {
    if text.is_empty() || text == "-" {
        return Err(IngestError::Usage("the destination has to be a folder or a bucket; name it with -o".to_string()));
    }
    if let Some((scheme, bucket, key)) = split_url(text) {
        let store = stores.open(scheme, bucket)?;
        if key.ends_with(".lods") {
            return Ok(Dest::File(Object::Stored(store, key.to_string())));
        }
        let prefix = if key.is_empty() || key.ends_with('/') { key.to_string() } else { format!("{key}/") };
        return Ok(Dest::Folder(Folder::Stored(store, prefix)));
    }
    let path = local(text)?;
    if is_staged(&path) {
        let what = format!("{text}: {STAGING} is for files on their way, which a run removes; choose another place");
        return Err(IngestError::Usage(what));
    }
    if path.is_file() || (text.ends_with(".lods") && !path.is_dir()) {
        return Ok(Dest::File(Object::Local(path)));
    }
    std::fs::create_dir_all(&path).map_err(|e| IngestError::Setup(Failure::writing(text, &e).message))?;
    Ok(Dest::Folder(Folder::Local(path)))
}

/// The name of an output beside the name of its source: `a/scan.ply.gz` gives `a/scan.lods`.
pub(super) fn output_name(relative: &str) -> Result<String, Failure> {
    let (folder, file) = relative.rfind('/').map_or(("", relative), |i| relative.split_at(i + 1));
    let file = match file.rsplit_once('.') {
        Some((plain, extension)) if !plain.is_empty() && Packing::from_extension(extension).is_some() => plain,
        _ => file,
    };
    let stem = file.rfind('.').filter(|&i| i > 0).map_or(file, |i| &file[..i]);
    if !is_plain(&format!("{folder}{stem}")) {
        return Err(Failure::new(
            FailureKind::Name,
            format!("{relative}: no output can have this name; rename the file"),
        ));
    }
    Ok(format!("{folder}{stem}.lods"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_are_named_after_their_sources() {
        for (source, output) in [
            ("scan.ply", "scan.lods"),
            ("a/b.c/scan.PLY.GZ", "a/b.c/scan.lods"),
            ("a/scan.obj.zst", "a/scan.lods"),
            ("scan.stl.xz", "scan.lods"),
            ("a/.hidden", "a/.hidden.lods"),
            ("plain", "plain.lods"),
            ("gä.obj", "gä.lods"),
        ] {
            assert_eq!(output_name(source).unwrap(), output);
        }
        assert!(output_name("../x.ply").is_err());
        assert!(output_name("a//x.ply").is_err());
    }

    #[test]
    fn patterns_begin_at_the_folder_before_the_first_wildcard() {
        assert_eq!(split_glob("a/b/*.ply"), Some(("a/b/", "*.ply")));
        assert_eq!(split_glob("*.ply"), Some(("", "*.ply")));
        assert_eq!(split_glob("a/b*/c/**/x.ply"), Some(("a/", "b*/c/**/x.ply")));
        assert_eq!(split_glob("a/b"), None);
        assert_eq!(split_url("s3://bucket/a/b"), Some(("s3", "bucket", "a/b")));
        assert_eq!(split_url("gs://bucket"), Some(("gs", "bucket", "")));
        assert_eq!(split_url("https://bucket/a"), None);
    }

    #[test]
    fn references_go_down_only() {
        for good in ["a.bin", "x/y.bin"] {
            assert!(is_plain(good), "{good}");
        }
        for bad in ["", "/a", "../a", "a/../b", "a//b", "http://x/y", "c:\\x", "a/."] {
            assert!(!is_plain(bad), "{bad}");
        }
    }
}
