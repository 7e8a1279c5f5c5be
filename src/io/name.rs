//! Names as files have them: bytes, of which text is what people see.
//!
//! Old programs write names in the encoding of their country (GBK, Shift-JIS, Latin-1), and nothing says which. Names
//! have to stay apart as their bytes do, and to come out as they went in. So each byte that is no UTF-8 is carried as
//! a character of a private use area, `U+F780..=U+F7FF`, and the few files that have those characters have their bytes
//! carried so too: the way there and back is one to one.

use std::borrow::Cow;
use std::ffi::OsString;
use std::fmt::Write as _;

/// The character that carries byte 0 would be this; only those from 0x80 on are needed.
const FIRST: u32 = 0xf700;

fn carried(c: char) -> Option<u8> {
    let byte = u32::from(c).checked_sub(FIRST)?;
    (0x80..=0xff).contains(&byte).then_some(byte as u8)
}

/// Bytes as text that stands for them.
pub(crate) fn from_bytes(bytes: &[u8]) -> String {
    let mut out = String::with_capacity(bytes.len());
    let carry = |out: &mut String, bytes: &[u8]| {
        out.extend(bytes.iter().filter_map(|&b| char::from_u32(FIRST + u32::from(b))));
    };
    for chunk in bytes.utf8_chunks() {
        for c in chunk.valid().chars() {
            match carried(c) {
                None => out.push(c),
                Some(_) => carry(&mut out, c.encode_utf8(&mut [0; 4]).as_bytes()),
            }
        }
        carry(&mut out, chunk.invalid());
    }
    out
}

/// The bytes that a text stands for.
pub(crate) fn to_bytes(text: &str) -> Cow<'_, [u8]> {
    if !text.chars().any(|c| carried(c).is_some()) {
        return Cow::Borrowed(text.as_bytes());
    }
    let mut out = Vec::with_capacity(text.len());
    for c in text.chars() {
        match carried(c) {
            Some(byte) => out.push(byte),
            None => out.extend(c.encode_utf8(&mut [0; 4]).as_bytes()),
        }
    }
    Cow::Owned(out)
}

/// The text as the name of a file.
pub(crate) fn to_os(text: &str) -> OsString {
    match to_bytes(text) {
        Cow::Borrowed(_) => text.into(),
        #[cfg(unix)]
        Cow::Owned(bytes) => std::os::unix::ffi::OsStringExt::from_vec(bytes),
        // Systems whose names are text have no such files.
        #[cfg(not(unix))]
        Cow::Owned(_) => text.into(),
    }
}

/// Whether a character stands for a byte that is no text.
pub(crate) fn is_byte(c: char) -> bool {
    carried(c).is_some()
}

/// A name from a file, fit for a message of one line.
pub(crate) fn shown(name: &str) -> String {
    let mut out = String::new();
    for c in name.chars().take(80) {
        let _ = match carried(c) {
            Some(byte) => write!(out, "\\x{byte:02x}"),
            None => write!(out, "{}", c.escape_debug()),
        };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_come_back_as_they_were_and_stay_apart() {
        let all: Vec<u8> = (0..=255).collect();
        for bytes in [&b"plain"[..], "grün 红".as_bytes(), b"\xba\xec\xc9\xab", "\u{f7ba}\u{f780}".as_bytes(), &all] {
            assert_eq!(to_bytes(&from_bytes(bytes)), bytes);
        }
        assert_ne!(from_bytes(b"\xba\xec"), from_bytes(b"\xba\xed"));
        assert_ne!(from_bytes(b"\xba"), from_bytes("\u{f7ba}".as_bytes()));
        assert_eq!(shown(&from_bytes(b"a\xba\n\xc3\xbc")), "a\\xba\\n\u{fc}");
    }
}
