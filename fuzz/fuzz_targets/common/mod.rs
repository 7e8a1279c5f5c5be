//! What every reader's target checks.

use lodestream::io::read::{Format, ReadErrorKind, ReadOptions, read_bytes};

/// Read once as the format likes it and once with the opposite about welding.
pub fn read(format: Format, bytes: &[u8]) {
    // gzip multiplies, and so do the instances of glTF, by design; what is left must stay near the size of the input.
    let packed = bytes.starts_with(&[0x1f, 0x8b]);
    let limit = Some(if packed { 1 << 26 } else { 400 * bytes.len() as u64 + 65_536 });
    for weld in [Some(true), Some(false)] {
        match read_bytes(bytes, format, None, &ReadOptions { weld, memory_limit: limit, ..Default::default() }) {
            Ok(read) => {
                read.mesh.validate().expect("a reader gives valid meshes");
                assert!(read.map.iter().all(|&v| (v as usize) < read.mesh.vertex_count()));
            }
            Err(error) => {
                assert_eq!(error.to_string().lines().count(), 1, "one line");
                let memory = matches!(error.kind, ReadErrorKind::Memory { .. });
                assert!(!memory || packed || format == Format::Gltf, "{error}");
            }
        }
    }
}
