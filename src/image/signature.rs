//! What an image is, by its first bytes.

/// The media type of a file that begins so; `None` for what is not known.
pub(crate) fn media_type(bytes: &[u8]) -> Option<&'static str> {
    const STARTS: [(&[u8], &str); 18] = [
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
        (b"\0\0\0\x0cjP  \r\n\x87\n", "image/unknown"),
        (b"\xff\x4f\xff\x51", "image/unknown"),
        (b"sB\x13\0", "image/ktx2"),
        (b"\x01\xda\0", "image/unknown"),
        (b"\x01\xda\x01", "image/unknown"),
    ];
    if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        return Some("image/webp");
    }
    if matches!(bytes.get(4..12), Some(b"ftypavif" | b"ftypavis")) {
        return Some("image/avif");
    }
    if is_anymap(bytes) {
        return Some("image/x-portable-anymap");
    }
    if is_tga(bytes) {
        return Some("image/x-tga");
    }
    STARTS.iter().find(|(start, _)| bytes.starts_with(start)).map(|(_, media)| *media)
}

/// PBM, PGM, PPM: `P1` to `P6`, blanks and comments, two numbers.
fn is_anymap(bytes: &[u8]) -> bool {
    let [b'P', b'1'..=b'6', rest @ ..] = bytes else { return false };
    let head = &rest[..rest.len().min(512)];
    let lines = head.split(|b| *b == b'\n').map(|line| line.split(|b| *b == b'#').next().unwrap_or_default());
    let mut words = lines.flat_map(|line| line.split(u8::is_ascii_whitespace)).filter(|w| !w.is_empty());
    let mut number = || words.next().is_some_and(|w| w.iter().all(u8::is_ascii_digit));
    rest.first().is_some_and(u8::is_ascii_whitespace) && number() && number()
}

/// TGA has no mark at its begin: a header of 18 bytes whose fields fit each other, and room for some pixels.
fn is_tga(bytes: &[u8]) -> bool {
    let Some(head) = bytes.first_chunk::<18>() else { return false };
    let word = |at: usize| u16::from_le_bytes([head[at], head[at + 1]]);
    let (map, kind, depth) = (head[1], head[2], head[16]);
    let mapped = matches!(kind, 1 | 9);
    let map_fits = match map {
        0 => !mapped && head[3..8] == [0; 5],
        1 => matches!(head[7], 15 | 16 | 24 | 32),
        _ => false,
    };
    let depth_fits = match kind {
        1 | 9 => matches!(depth, 8 | 16),
        2 | 10 => matches!(depth, 15 | 16 | 24 | 32),
        3 | 11 => matches!(depth, 8 | 16),
        _ => false,
    };
    map_fits && depth_fits && word(12) > 0 && word(14) > 0 && head[17] & 0xc0 == 0 && bytes.len() > 18
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
