//! The stamp: an optional chunk at the end of a `.lods` file that says what it was made from.
//!
//! `docs/format/source-stamp.md`: kind 128, one byte of version, SHA-256 of the source's bytes, SHA-256 of the settings.
//! Decoders skip it. It is what `--resume` goes by, so a file and its stamp appear together or not at all.

use crate::format::container::{Chunk, ContainerError, FileIndex, KIND_SOURCE, Kind, with_chunk};
use sha2::{Digest, Sha256};

/// What an output was made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// SHA-256 of the source file's bytes, as they are stored; where it refers to files beside it, of its checksum and theirs.
    pub source: [u8; 32],
    /// SHA-256 of the settings, see [`Settings::checksum`](super::Settings::checksum).
    pub settings: [u8; 32],
}

const VERSION: u8 = 1;

impl Stamp {
    fn payload(&self) -> Vec<u8> {
        let mut payload = vec![VERSION];
        payload.extend_from_slice(&self.source);
        payload.extend_from_slice(&self.settings);
        payload
    }

    /// The stamp in the payload of a chunk of kind [`KIND_SOURCE`]; `None` for another version.
    pub fn from_payload(payload: &[u8]) -> Option<Stamp> {
        let (&version, rest) = payload.split_first()?;
        let (source, settings) = rest.split_at_checked(32)?;
        if version != VERSION {
            return None;
        }
        Some(Stamp { source: source.try_into().ok()?, settings: settings.try_into().ok()? })
    }

    /// The chunk that holds it, behind all others of a file whose full level is `full`.
    pub(super) fn chunk(&self, full: u32) -> Chunk {
        Chunk {
            kind: Kind::Other(KIND_SOURCE),
            first_level: full,
            last_level: full,
            segment: 0,
            segments: 1,
            image: 0,
            memory: 0,
            payload: self.payload(),
        }
    }

    /// A `.lods` file with this stamp behind its last chunk.
    ///
    /// # Errors
    /// Those of [`with_chunk`].
    pub fn attach(&self, file: &[u8]) -> Result<Vec<u8>, ContainerError> {
        with_chunk(file, |full| self.chunk(full))
    }

    /// Where in the file the stamp lies.
    pub fn place(front: &FileIndex) -> Option<(usize, std::ops::Range<u64>)> {
        let (i, c) = front.chunks().iter().enumerate().find(|(_, c)| c.kind == Kind::Other(KIND_SOURCE))?;
        (c.length == 65).then(|| (i, c.offset..c.end()))
    }
}

/// SHA-256 of a source without files beside it.
pub(super) fn source_checksum(source: &[u8]) -> [u8; 32] {
    Sha256::digest(source).into()
}

/// SHA-256 over the SHA-256 of a source and those of the files that it refers to, zeros for one that is not there.
pub(super) fn checksum_with(source: &[u8], parts: &[[u8; 32]]) -> [u8; 32] {
    let mut hash = Sha256::new();
    hash.update(source_checksum(source));
    for part in parts {
        hash.update(part);
    }
    hash.finalize().into()
}

/// Bytes in hexadecimal.
pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::{EncodeOptions, encode};
    use crate::format::container::Parsed;
    use crate::format::decoder::{DecodeOptions, Decoder, Step};

    #[test]
    fn a_stamped_file_decodes_as_before_and_tells_its_stamp() {
        let mesh = crate::samples::asteroid(8, 1);
        let plain = encode(&mesh, &EncodeOptions::default()).unwrap().bytes;
        let stamp = Stamp { source: checksum_with(b"abc", &[source_checksum(b"d"), [0; 32]]), settings: [7; 32] };
        assert_eq!(hex(&source_checksum(b"abc"))[..16], *"ba7816bf8f01cfea");
        let stamped = stamp.attach(&plain).unwrap();
        assert!(stamped.len() <= plain.len() + 90, "{} bytes became {}", plain.len(), stamped.len());
        let Parsed::Ready(front) = FileIndex::parse(&stamped).unwrap() else { panic!("the front is whole") };
        let (index, place) = Stamp::place(&front).unwrap();
        let payload = front.payload(&stamped, index).unwrap().unwrap();
        assert_eq!(payload, &stamped[place.start as usize..place.end as usize]);
        assert_eq!(Stamp::from_payload(payload), Some(stamp));
        front.check_length(stamped.len() as u64).unwrap();
        let full = |bytes: &[u8]| {
            let mut decoder = Decoder::new(DecodeOptions::default());
            decoder.push(bytes);
            while let Step::Level(_) = decoder.next_level().unwrap() {}
            decoder.finish().unwrap();
            decoder.to_mesh()
        };
        assert_eq!(full(&stamped), full(&plain));
        assert_eq!(Stamp::from_payload(&[2; 65]), None);
        assert_eq!(Stamp::from_payload(&[1; 20]), None);
    }
}
