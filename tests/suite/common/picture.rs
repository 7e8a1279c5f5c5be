//! Any bytes as an image: what the fuzz target does, and the encode_levels of what it has found.

use lodestream::image::jpeg::{Exactness, MAX_COEFFICIENT_BYTES, Treatment, cut, restore, same_picture};

/// Cut the bytes as an image: they come back. Then take them for a file and its reconstruction: bytes or an error, within the memory allowed.
pub fn check(bytes: &[u8]) {
    for exactness in [Exactness::Coefficients, Exactness::Bytes] {
        let answer = cut(bytes, exactness);
        let joined = answer.pieces.concat();
        match (answer.way, &answer.reconstruction) {
            (Treatment::Transcoded, Some(reconstruction)) => {
                assert!(restore(&joined, reconstruction, MAX_COEFFICIENT_BYTES).as_deref() == Ok(bytes));
            }
            (Treatment::Transcoded, None) => assert!(same_picture(&joined, bytes)),
            _ => assert!(joined == bytes),
        }
    }
    // The length of the file stands before it, two bytes.
    if let Some((length, rest)) = bytes.split_first_chunk() {
        let (file, reconstruction) = rest.split_at((u16::from_le_bytes(*length) as usize).min(rest.len()));
        let _ = restore(file, reconstruction, 1 << 24);
    }
}
