//! Previews: whole small picture files that stand in for images of which nothing is there yet.
//!
//! Their kind of chunk may be skipped, so the chunk table knows nothing of them but their length: the payload says which image, and which of
//! its previews, it is. A payload that makes no sense is passed over, as by a decoder that does not know the kind.

use crate::image::signature;
use crate::leb128;

/// A preview of an image, as the payload of its chunk tells it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preview<'a> {
    /// The number of the image.
    pub image: u32,
    /// Its number among the previews of the image: the higher, the finer.
    pub number: u32,
    /// A whole JPEG or PNG file.
    pub bytes: &'a [u8],
}

impl<'a> Preview<'a> {
    /// What a payload says; `None` where it makes no sense: numbers that are cut or too large, or a file that begins neither as JPEG nor as PNG.
    pub fn of(payload: &'a [u8]) -> Option<Self> {
        let mut at = 0;
        let mut number = || leb128::take(payload, &mut at).ok().flatten().and_then(|n| u32::try_from(n).ok());
        let (image, number) = (number()?, number()?);
        let preview = Preview { image, number, bytes: payload.get(at..)? };
        preview.media_type().map(|_| preview)
    }

    /// The media type of the file by its first bytes.
    pub fn media_type(&self) -> Option<&'static str> {
        signature::media_type(self.bytes).filter(|media| ["image/jpeg", "image/png"].contains(media))
    }

    /// The payload of its chunk.
    pub fn to_payload(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(10 + self.bytes.len());
        leb128::put(&mut out, self.image.into());
        leb128::put(&mut out, self.number.into());
        out.extend_from_slice(self.bytes);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn payloads_say_what_they_are_or_nothing() {
        let file = b"\x89PNG and so on";
        let preview = Preview { image: 300, number: 2, bytes: file };
        let payload = preview.to_payload();
        assert_eq!(payload[..3], [0xAC, 2, 2]);
        assert_eq!(Preview::of(&payload), Some(preview));
        assert_eq!(preview.media_type(), Some("image/png"));
        let jpeg = Preview { image: u32::MAX, number: u32::MAX, bytes: &[0xFF, 0xD8, 0xFF] };
        assert_eq!(Preview::of(&jpeg.to_payload()), Some(jpeg));
        for wrong in [
            &b""[..],
            &[1],
            &[1, 2],
            &[0x80],
            b"\0\0GIF89a",
            // Numbers beyond 32 bits, and one that is spelt too long.
            b"\xff\xff\xff\xff\x1f\0\x89PNG",
            b"\0\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\x89PNG",
            b"\x80\0\0\x89PNG",
        ] {
            assert_eq!(Preview::of(wrong), None, "{wrong:?}");
        }
    }
}
