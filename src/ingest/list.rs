//! The list of files, streamed: names come one by one, in a fixed order, and nothing is kept of them but a hash.
//!
//! A folder is listed sorted, one directory at a time, so that any number of files takes the memory of the largest
//! directory; a store is listed in the order of its keys. Links to files are followed, links to folders are not.

use super::error::{Failure, FailureKind, IngestError};
use super::location::STAGING;
use super::location::{Folder, Object, Source, output_name, source};
use super::manifest::{self, Job};
use super::settings::Settings;
use super::store::Stores;
use crate::io::read::Format;
use globset::GlobMatcher;
use sha2::{Digest, Sha256};
use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;

/// A file to be encoded.
pub(super) struct Item {
    pub object: Object,
    /// Bytes, where listing tells.
    pub size: Option<u64>,
    /// The name of the output below the destination.
    pub output: String,
    pub settings: Arc<Settings>,
    /// Its line in the manifest.
    pub line: Option<u64>,
}

/// What listing finds.
pub(super) enum Found {
    Item(Item),
    /// Something that will never be encoded, with its name and why.
    Failed(String, Failure),
    /// A hidden file that would be a mesh, or a hidden folder.
    PassedOver,
}

/// What becomes of hidden files and folders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Hidden {
    PassedOver,
    Taken,
}

/// Whether a part of a path is hidden: those that begin with a dot, which hides them on Unix (`.git`, and `._scan.obj`,
/// where a Mac keeps what other disks cannot hold), and the folder of such companions in archives of a Mac.
fn is_hidden(part: &str) -> bool {
    part.starts_with('.') && part != "." && part != ".." || part == "__MACOSX"
}

/// Which files of a folder are meant, and how they are to be encoded.
struct Wanted<'a> {
    pattern: Option<GlobMatcher>,
    hidden: Hidden,
    settings: &'a Arc<Settings>,
}

impl Wanted<'_> {
    /// Whether a file of a folder is a mesh that was meant.
    fn holds(&self, relative: &str) -> bool {
        self.pattern.as_ref().is_none_or(|p| p.is_match(relative)) && Format::from_path(Path::new(relative)).is_ok()
    }

    fn passes_over(&self, part: &str) -> bool {
        self.hidden == Hidden::PassedOver && is_hidden(part)
    }

    fn item(&self, object: Object, size: Option<u64>, relative: &str) -> Found {
        match output_name(relative) {
            Ok(output) => Found::Item(Item { object, size, output, settings: self.settings.clone(), line: None }),
            Err(failure) => Found::Failed(object.name(), failure),
        }
    }
}

/// What is to be listed, understood and checked, before anything is.
pub(super) enum Listing {
    Sources(Vec<Source>, Arc<Settings>),
    Jobs(Vec<Job>, Option<Folder>),
}

/// Which part of all files is ours: part `k` of `n`, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// The part, from 0.
    pub k: u32,
    /// How many parts there are.
    pub n: u32,
}

impl Shard {
    /// Whether an output belongs to this part. It goes by a hash of the name, so that every machine deals alike, however
    /// it lists and whatever else comes or goes.
    pub fn holds(&self, output: &str) -> bool {
        let hash = Sha256::digest(output.as_bytes());
        let word = hash.iter().take(8).fold(0u64, |w, &b| w << 8 | u64::from(b));
        self.n < 2 || word % u64::from(self.n) == u64::from(self.k)
    }
}

impl Listing {
    pub fn new(
        sources: &[String],
        manifest: Option<&Path>,
        settings: &Settings,
        stores: &Stores,
    ) -> Result<Self, IngestError> {
        let mut places = sources.iter().map(|s| source(s, stores)).collect::<Result<Vec<_>, _>>()?;
        let Some(manifest) = manifest else {
            if places.is_empty() {
                return Err(IngestError::Usage(
                    "there is nothing to ingest; name a file, a folder or a bucket".to_string(),
                ));
            }
            return Ok(Listing::Sources(places, Arc::new(settings.clone())));
        };
        let root = match (places.pop(), places.is_empty()) {
            (None, _) => None,
            (Some(Source::Many(folder, None)), true) => Some(folder),
            _ => {
                let what = "with a manifest, SOURCE is the one folder or bucket that its sources are relative to";
                return Err(IngestError::Usage(what.to_string()));
            }
        };
        let jobs = manifest::read(manifest, settings)?;
        let root = root.or_else(|| manifest.parent().map(|p| Folder::Local(p.to_path_buf())));
        // Sources elsewhere must be well-named before work starts.
        let mut errors = Vec::new();
        for job in jobs.iter().filter(|j| j.source.contains("://")) {
            if let Err(e) = source(&job.source, stores).map(|_| ())
                && !matches!(e, IngestError::Setup(_))
            {
                errors.push(format!("{}, line {}: {e}", manifest.display(), job.line));
            }
        }
        if errors.is_empty() { Ok(Listing::Jobs(jobs, root)) } else { Err(IngestError::Manifest(errors)) }
    }

    /// Whether all files lie on this machine.
    pub fn is_local(&self) -> bool {
        match self {
            Listing::Sources(list, _) => {
                list.iter().all(|s| matches!(s, Source::One(Object::Local(_)) | Source::Many(Folder::Local(_), _)))
            }
            Listing::Jobs(jobs, root) => {
                !matches!(root, Some(Folder::Stored(..))) && jobs.iter().all(|j| !j.source.contains("://"))
            }
        }
    }

    /// Whether this is one file, named as such.
    pub fn is_single(&self) -> bool {
        match self {
            Listing::Sources(list, _) => matches!(list.as_slice(), [Source::One(_)]),
            Listing::Jobs(jobs, _) => jobs.len() == 1,
        }
    }

    /// Hand out every file of the shard, until `each` gives `false`.
    pub fn walk(self, shard: Shard, hidden: Hidden, stores: &Stores, mut each: impl FnMut(Found) -> bool) {
        let mut names = HashSet::new();
        let mut emit = |found: Found| match found {
            Found::PassedOver => each(found),
            Found::Item(item) => {
                // Some disks do not know upper from lower case.
                let unseen = names.insert(Sha256::digest(item.output.to_lowercase().as_bytes())[..16].to_vec());
                if !shard.holds(&item.output) {
                    return true;
                }
                if unseen {
                    return each(Found::Item(item));
                }
                let name = item.object.name();
                let what = format!(
                    "{name}: another source has the same output {}, case aside; name outputs in a manifest",
                    item.output
                );
                each(Found::Failed(name, Failure::new(FailureKind::Name, what)))
            }
            // What has no output is told by one of the shards.
            Found::Failed(name, failure) => !shard.holds(&name) || each(Found::Failed(name, failure)),
        };
        match self {
            Listing::Jobs(jobs, root) => {
                for job in jobs {
                    let Job { line, source: text, output, settings } = job;
                    let found = match job_object(&text, root.as_ref(), stores) {
                        Ok(object) => Found::Item(Item {
                            object,
                            size: None,
                            output,
                            settings: Arc::new(settings),
                            line: Some(line),
                        }),
                        Err(failure) => Found::Failed(text, failure),
                    };
                    if !emit(found) {
                        return;
                    }
                }
            }
            Listing::Sources(sources, settings) => {
                for source in sources {
                    let go = match source {
                        Source::One(object) => {
                            let name = object.name();
                            let file = name.rsplit('/').next().unwrap_or(&name);
                            emit(match output_name(file) {
                                Ok(output) => {
                                    let settings = settings.clone();
                                    Found::Item(Item { object, size: None, output, settings, line: None })
                                }
                                Err(failure) => Found::Failed(name, failure),
                            })
                        }
                        Source::Many(folder, pattern) => {
                            let names_hidden = |p: &GlobMatcher| p.glob().glob().split('/').any(is_hidden);
                            let hidden =
                                if pattern.as_ref().is_some_and(names_hidden) { Hidden::Taken } else { hidden };
                            let wanted = Wanted { pattern, hidden, settings: &settings };
                            walk_folder(&folder, &wanted, &mut emit)
                        }
                    };
                    if !go {
                        return;
                    }
                }
            }
        }
    }
}

fn job_object(text: &str, root: Option<&Folder>, stores: &Stores) -> Result<Object, Failure> {
    if text.contains("://") || Path::new(text).is_absolute() {
        return match source(text, stores) {
            Ok(Source::One(object)) => Ok(object),
            Ok(Source::Many(..)) => {
                Err(Failure::new(FailureKind::Name, format!("{text}: this is not one file; name a mesh")))
            }
            Err(e) => Err(Failure::new(FailureKind::Missing, e.to_string())),
        };
    }
    Ok(match root {
        Some(folder) => folder.object(text),
        None => Object::Local(text.into()),
    })
}

fn walk_folder(folder: &Folder, wanted: &Wanted<'_>, emit: &mut dyn FnMut(Found) -> bool) -> bool {
    match folder {
        Folder::Local(root) => walk_local(root, "", wanted, emit),
        Folder::Stored(store, prefix) => {
            let mut go = true;
            let listed = store.list(prefix.trim_end_matches('/'), |key, size| {
                if let Some(relative) = key.strip_prefix(prefix.as_str())
                    && wanted.holds(relative)
                {
                    go = if relative.split('/').any(|part| wanted.passes_over(part)) {
                        emit(Found::PassedOver)
                    } else {
                        emit(wanted.item(Object::Stored(store.clone(), key.to_string()), Some(size), relative))
                    };
                }
                go
            });
            match listed {
                Ok(()) => go,
                Err(failure) => emit(Found::Failed(store.name(prefix), failure)),
            }
        }
    }
}

fn walk_local(root: &Path, below: &str, wanted: &Wanted<'_>, emit: &mut dyn FnMut(Found) -> bool) -> bool {
    let folder = root.join(below);
    let listed = std::fs::read_dir(&folder).and_then(|entries| {
        let mut names = Vec::new();
        for entry in entries {
            let entry = entry?;
            // The type comes with the name; only links need a look of their own.
            let is_folder = entry.file_type().is_ok_and(|t| t.is_dir());
            names.push((entry.file_name(), is_folder));
        }
        Ok(names)
    });
    let mut names = match listed {
        Ok(names) => names,
        Err(e) => {
            let name = folder.display().to_string();
            let failure = Failure::reading(&name, &e);
            return emit(Found::Failed(name, failure));
        }
    };
    names.sort_unstable();
    for (name, is_folder) in names {
        if is_folder && name.eq_ignore_ascii_case(STAGING) {
            continue;
        }
        if wanted.passes_over(&name.to_string_lossy()) {
            if (is_folder || Format::from_path(Path::new(&name)).is_ok()) && !emit(Found::PassedOver) {
                return false;
            }
            continue;
        }
        let Some(text) = name.to_str() else {
            if !is_folder && Format::from_path(Path::new(&name)).is_ok() {
                let shown = folder.join(&name).display().to_string();
                let what = format!("{shown}: the name is not UTF-8; rename the file");
                if !emit(Found::Failed(shown, Failure::new(FailureKind::Name, what))) {
                    return false;
                }
            }
            continue;
        };
        let relative = if below.is_empty() { text.to_string() } else { format!("{below}/{text}") };
        if is_folder {
            if !walk_local(root, &relative, wanted, emit) {
                return false;
            }
        } else if wanted.holds(&relative) {
            let path = root.join(&relative);
            if path.is_dir() {
                continue;
            }
            if !emit(wanted.item(Object::Local(path), None, &relative)) {
                return false;
            }
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_share_everything_out_once_and_evenly() {
        let names: Vec<String> = (0..3000).map(|i| format!("folder/scan-{i}.lods")).collect();
        let mut counts = [0; 3];
        for name in &names {
            let holders: Vec<u32> = (0..3).filter(|&k| Shard { k, n: 3 }.holds(name)).collect();
            assert_eq!(holders.len(), 1);
            counts[holders[0] as usize] += 1;
        }
        assert!(counts.iter().all(|c| (900..1100).contains(c)), "{counts:?}");
        assert!(Shard { k: 0, n: 1 }.holds("anything"));
    }
}
