//! What an image is, by its first bytes.

/// The media type of a file that begins so; `None` for what is not known.
pub(crate) fn media_type(bytes: &[u8]) -> Option<&'static str> {
    const STARTS: [(&[u8], &str); 13] = [
        (b"\x89PNG", "image/png"),
        (b"\xff\xd8\xff", "image/jpeg"),
        (b"GIF8", "image/gif"),
        (b"BM", "image/bmp"),
        (b"II*\0", "image/tiff"),
        (b"MM\0*", "image/tiff"),
        (b"DDS ", "image/vnd-ms.dds"),
        (b"\xabKTX 20\xbb", "image/ktx2"),
        (b"\xabKTX 11\xbb", "image/ktx"),
        (b"#?RADIANCE", "image/vnd.radiance"),
        (b"#?RGBE", "image/vnd.radiance"),
        (b"v/1\x01", "image/x-exr"),
        (b"8BPS", "image/vnd.adobe.photoshop"),
    ];
    if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        return Some("image/webp");
    }
    if matches!(bytes.get(4..12), Some(b"ftypavif" | b"ftypavis")) {
        return Some("image/avif");
    }
    STARTS.iter().find(|(start, _)| bytes.starts_with(start)).map(|(_, media)| *media)
}

/// Whether a file begins as JPEG does.
pub fn is_jpeg(bytes: &[u8]) -> bool {
    media_type(bytes) == Some("image/jpeg")
}

/// Whether a file begins as PNG does.
pub(crate) fn is_png(bytes: &[u8]) -> bool {
    media_type(bytes) == Some("image/png")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_bytes_tell() {
        for (bytes, expected) in [
            (&b"\x89PNG\r\n"[..], Some("image/png")),
            (b"\xff\xd8\xff\xe0", Some("image/jpeg")),
            (b"\xff\xd8", None),
            (b"RIFF....WEBPVP8 ", Some("image/webp")),
            (b"RIFF....WAVE", None),
            (b"\0\0\0\x20ftypavif", Some("image/avif")),
            (b"\xabKTX 20\xbb\r\n", Some("image/ktx2")),
            (b"", None),
        ] {
            assert_eq!(media_type(bytes), expected, "{bytes:?}");
            assert_eq!(
                (is_jpeg(bytes), is_png(bytes)),
                (expected == Some("image/jpeg"), expected == Some("image/png"))
            );
        }
    }
}
