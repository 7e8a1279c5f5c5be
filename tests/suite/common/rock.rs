//! A mesh and a `.lods` file of it, for tests of the program.

use super::{Scratch, lodestream};
use lodestream::io::read::{self, ReadOptions};
use lodestream::io::write::{self, WriteOptions};
use lodestream::mesh::Mesh;
use lodestream::samples;
use serde_json::Value;
use std::path::Path;

pub fn save(mesh: &Mesh, path: &Path) {
    write::write_path(path, mesh, None, &WriteOptions::default()).unwrap();
}

pub fn load(path: &Path) -> Mesh {
    read::read_path(path, &ReadOptions::default()).unwrap().mesh
}

/// A folder with `rock.ply` and `rock.lods` in it.
pub fn rock(name: &str) -> Scratch {
    let scratch = Scratch::new(name);
    save(&samples::ringed_asteroid(12, 60, 1), &scratch.path("rock.ply"));
    lodestream(scratch.folder(), "encode rock.ply -o rock.lods").ok();
    scratch
}

pub fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is not a number"))
}
