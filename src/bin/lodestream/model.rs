//! Models as `compare`, `render` and `report` take them: a mesh file, or a level of a `.lods` file.

use crate::decode::{self, Choice};
use crate::progress::Bars;
use crate::shared::{self, Machine};
use crate::stream::Stream;
use anyhow::{Context, Result, bail};
use lodestream::io::read::{Invalid, ReadOptions};
use lodestream::mesh::Mesh;
use std::path::Path;

/// A mesh and what it was.
pub struct Model {
    pub mesh: Mesh,
    /// The level of a `.lods` file.
    pub level: Option<u32>,
}

/// Whether a path names a `.lods` file.
pub fn is_lods(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("lods"))
}

/// Read a mesh, or decode a `.lods` file up to a level (the full one where none is chosen).
pub fn load(path: &Path, choice: &Choice, machine: &Machine, bars: &Bars) -> Result<Model> {
    if !is_lods(path) {
        if let Some(option) = choice.given() {
            bail!("{}: levels are in .lods files; leave {option} out", shared::name(path));
        }
        // What has no place has no distance and is not seen.
        let (memory_limit, invalid) = (Some(machine.memory_limit()), Invalid::Drop);
        let options = ReadOptions { memory_limit, invalid, allow_empty: true, ..ReadOptions::default() };
        return Ok(Model { mesh: shared::read_mesh(path, None, &options)?.mesh, level: None });
    }
    let name = shared::name(path);
    let mut stream = Stream::open(path, machine.memory_limit())?;
    let level = choice.pick(stream.front()).with_context(|| name.clone())?;
    let mut reached = stream.decode(level, decode::options(machine), bars, |_, _| Ok(()))?;
    if let Some(cut) = reached.cut {
        return Err(cut).context(name);
    }
    stream.pictures(&mut reached.decoder, choice.max_bytes().unwrap_or(u64::MAX))?;
    Ok(Model { mesh: reached.decoder.to_mesh(), level: Some(level) })
}
