//! glTF: not read yet.
use std::path::Path;

use super::error::{Fail, ReadErrorKind};
use super::{ReadMesh, ReadOptions};

pub(super) fn read(_: &[u8], _: Option<&Path>, _: &ReadOptions) -> Result<ReadMesh, Fail> {
    Err(ReadErrorKind::Unsupported { what: "glTF".to_string(), advice: "convert the file to PLY" }.into())
}
