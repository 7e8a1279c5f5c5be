//! The datasets of `datasets.toml`: where they are found, and what becomes of those that are not.
//!
//! The folder in `LODESTREAM_DATA` comes first, then `datasets/` in the repository; generated ones are always there. What is
//! not found is skipped and named; with `CI=true` it is an error, so that no check is lost by accident.

use lodestream::io::read::{self, Format, ReadOptions};
use lodestream::mesh::Mesh;
use lodestream::samples;
use serde::Deserialize;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// One entry of `datasets.toml`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dataset {
    pub name: String,
    /// Of a file: its place in the data folder, where it comes from, on which terms, and its checksum.
    pub path: Option<String>,
    pub source: Option<String>,
    pub licence: Option<String>,
    pub sha256: Option<String>,
    /// Of a generated one: name, size and seed for `samples::by_name`.
    pub generated: Option<String>,
    #[serde(default)]
    pub size: u32,
    #[serde(default)]
    pub seed: u64,
    /// Vertex records and faces as read without welding.
    pub vertices: usize,
    pub faces: usize,
    /// Too large for everyday tests.
    #[serde(default)]
    pub large: bool,
}

#[derive(Deserialize)]
struct Catalogue {
    dataset: Vec<Dataset>,
}

/// The repository.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every entry of `datasets.toml`.
pub fn all() -> Vec<Dataset> {
    let path = root().join("datasets.toml");
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let catalogue: Catalogue = toml::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    catalogue.dataset
}

/// The entry of this name.
pub fn named(name: &str) -> Dataset {
    all().into_iter().find(|d| d.name == name).unwrap_or_else(|| panic!("datasets.toml has no {name}"))
}

/// Entries of everyday size whose files are at hand, and generated ones. The others are reported as skipped, by name.
///
/// # Panics
/// With `CI=true`, where a file is missing.
pub fn available(wanted: impl Fn(&Dataset) -> bool) -> Vec<Dataset> {
    let (found, missing): (Vec<_>, Vec<_>) = all().into_iter().filter(wanted).partition(Dataset::is_available);
    report_missing(&missing);
    found
}

/// Name what is skipped.
///
/// # Panics
/// With `CI=true`, where there is any.
pub fn report_missing(missing: &[Dataset]) {
    if missing.is_empty() {
        return;
    }
    let names: Vec<&str> = missing.iter().map(|d| d.name.as_str()).collect();
    assert!(!is_ci(), "datasets missing in LODESTREAM_DATA and datasets/: {}", names.join(", "));
    eprintln!("skipped, not in LODESTREAM_DATA or datasets/: {}", names.join(", "));
}

/// Whether a missing dataset is an error.
pub fn is_ci() -> bool {
    std::env::var("CI").is_ok_and(|v| !v.is_empty() && v != "false" && v != "0")
}

impl Dataset {
    /// Where its file is.
    pub fn file(&self) -> Option<PathBuf> {
        let path = self.path.as_ref()?;
        let folders = [std::env::var_os("LODESTREAM_DATA").map(PathBuf::from), Some(root().join("datasets"))];
        folders.into_iter().flatten().map(|folder| folder.join(path)).find(|file| file.is_file())
    }

    /// Whether it can be loaded.
    pub fn is_available(&self) -> bool {
        self.generated.is_some() || self.file().is_some()
    }

    /// Whether it has faces.
    pub fn has_faces(&self) -> bool {
        self.faces > 0
    }

    /// The mesh as `lodestream encode` sees it, or without welding.
    ///
    /// # Errors
    /// One line: the file is missing, not the one that `datasets.toml` means, or not readable.
    pub fn load(&self, weld: Option<bool>) -> Result<Mesh, String> {
        if let Some(generated) = &self.generated {
            return samples::by_name(generated, self.size, self.seed)
                .ok_or_else(|| format!("{}: nothing generated is called {generated}", self.name));
        }
        let file = self.file().ok_or_else(|| format!("{}: not found", self.name))?;
        let options = ReadOptions { weld, ..ReadOptions::default() };
        let read = if file.extension().is_some_and(|e| e == "xz") {
            let bytes = unpack_xz(&file)?;
            let inner = file.with_extension("");
            let format = Format::from_path(&inner).map_err(|e| format!("{}: format {e:?}", self.name))?;
            read::read_bytes(&bytes, format, file.parent(), &options)
        } else {
            read::read_path(&file, &options)
        };
        read.map(|r| r.mesh).map_err(|e| e.to_string())
    }

    /// Whether the file is the one that `datasets.toml` means.
    ///
    /// # Errors
    /// One line with both checksums.
    pub fn check_sum(&self) -> Result<(), String> {
        let (Some(file), Some(expected)) = (self.file(), &self.sha256) else { return Ok(()) };
        let bytes = std::fs::read(&file).map_err(|e| format!("{}: {e}", file.display()))?;
        let sum: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
        if sum == *expected { Ok(()) } else { Err(format!("{}: sha256 {sum}, expected {expected}", self.name)) }
    }
}

/// Unpack with the `xz` command, which only the large datasets need.
fn unpack_xz(file: &Path) -> Result<Vec<u8>, String> {
    let run = Command::new("xz").args(["-dc", "--"]).arg(file).stderr(Stdio::null()).output();
    let output = run.map_err(|e| format!("{}: the xz command is needed: {e}", file.display()))?;
    if !output.status.success() {
        return Err(format!("{}: xz could not unpack it", file.display()));
    }
    Ok(output.stdout)
}
