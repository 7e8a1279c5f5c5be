//! The header of a PLY file: which elements with which properties follow, and in which encoding.

use std::collections::HashSet;

use super::super::build::Kind;
use super::super::error::{At, Fail, Place, ReadErrorKind, printable};
use super::super::text::Cursor;
use super::super::{DISTINCT, REPEATED};
use crate::io::name;

/// How the body is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Little,
    Big,
}

/// The types of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &[u8]) -> Option<Scalar> {
        Some(match name {
            b"char" | b"int8" => Scalar::I8,
            b"uchar" | b"uint8" => Scalar::U8,
            b"short" | b"int16" => Scalar::I16,
            b"ushort" | b"uint16" => Scalar::U16,
            b"int" | b"int32" => Scalar::I32,
            b"uint" | b"uint32" => Scalar::U32,
            b"long" | b"int64" => Scalar::I64,
            b"ulong" | b"uint64" => Scalar::U64,
            b"float" | b"float32" => Scalar::F32,
            b"double" | b"float64" => Scalar::F64,
            _ => return None,
        })
    }

    /// Bytes in a binary file.
    pub fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::I64 | Scalar::U64 | Scalar::F64 => 8,
        }
    }
}

/// A property of an element.
#[derive(Debug)]
pub(super) struct Property<'a> {
    pub name: &'a str,
    /// The type of the count, for a list.
    pub list: Option<Scalar>,
    /// The type of the value or of each item.
    pub scalar: Scalar,
}

/// A run of records of one kind.
#[derive(Debug)]
pub(super) struct Element<'a> {
    pub name: &'a str,
    pub count: u64,
    pub properties: Vec<Property<'a>>,
    /// The line that announces it.
    pub line: u64,
}

impl Element<'_> {
    /// The fewest bytes that a record takes in the body.
    pub fn least_bytes(&self, encoding: Encoding) -> u64 {
        match encoding {
            // A digit and what separates it from the next.
            Encoding::Ascii => 2 * self.properties.len() as u64,
            _ => self.properties.iter().map(|p| p.list.unwrap_or(p.scalar).size() as u64).sum(),
        }
    }

    /// Bytes of a binary record, if all are the same.
    pub fn stride(&self) -> Option<usize> {
        self.properties.iter().try_fold(0, |sum, p| if p.list.is_some() { None } else { Some(sum + p.scalar.size()) })
    }

    /// The scalar property of that name.
    pub fn scalar(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.list.is_none() && p.name == name)
    }

    /// The list property with one of these names.
    pub fn list(&self, names: &[&str]) -> Option<usize> {
        self.properties.iter().position(|p| p.list.is_some() && names.contains(&p.name))
    }
}

/// The header.
#[derive(Debug)]
pub(super) struct Header<'a> {
    pub encoding: Encoding,
    pub elements: Vec<Element<'a>>,
    /// How many vertices are announced.
    pub vertices: u64,
    /// The names of all elements.
    names: HashSet<&'a str>,
    /// Textures named in comments.
    pub textures: Vec<String>,
    /// Whether vertices repeat for their attributes, where a comment of the writer tells.
    pub repeats: Option<bool>,
}

/// Read the header and leave the cursor at the first byte of the body.
pub(super) fn read<'a>(c: &mut Cursor<'a>, bytes: &'a [u8]) -> Result<Header<'a>, Fail> {
    if c.word() != b"ply" || !c.at_line_end() {
        let (format, expected, found) = ("a PLY file", "`ply`", printable(bytes));
        return Err(ReadErrorKind::WrongMagic { format, expected, found }.into());
    }
    // A binary body may begin with a byte that looks like part of the line end: the first line shows what one is.
    let crlf = c.rest().starts_with(b"\r\n");
    c.end_line();
    let mut header = Header {
        encoding: Encoding::Ascii,
        elements: Vec::new(),
        vertices: 0,
        names: HashSet::new(),
        textures: Vec::new(),
        repeats: None,
    };
    let mut encoding = None;
    loop {
        if c.peek().is_none() {
            return Err(Kind::Truncated { what: "the header".to_string(), missing: None }).at(|| c.place());
        }
        let line = c.line();
        c.skip_blanks();
        let keyword = c.word();
        if keyword == b"end_header" {
            c.skip_blanks();
            if crlf && c.rest().starts_with(b"\r\n") || !c.rest().starts_with(b"\r") {
                c.end_line();
            } else {
                c.skip_byte();
            }
            break;
        }
        let rest = c.rest_of_line();
        c.end_line();
        let at = |kind| Fail { place: Some(Place::Line(line)), kind };
        header_line(&mut header, &mut encoding, keyword, rest, line).map_err(at)?;
    }
    header.encoding = encoding.ok_or_else(|| {
        Kind::Syntax("the header has no `format` line; add one, such as `format ascii 1.0`".to_string())
    })?;
    Ok(header)
}

fn header_line<'a>(
    header: &mut Header<'a>,
    encoding: &mut Option<Encoding>,
    keyword: &'a [u8],
    rest: &'a [u8],
    line: u64,
) -> Result<(), Kind> {
    let words: Vec<&[u8]> = rest.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).take(5).collect();
    let syntax = |message: String| Err(ReadErrorKind::Syntax(message));
    match (keyword, words.as_slice()) {
        (b"comment", [b"TextureFile", _, ..]) => {
            let text = name::from_bytes(rest);
            let name = text.trim().strip_prefix("TextureFile").unwrap_or_default().trim();
            header.textures.push(name.trim_matches('"').to_string());
        }
        (b"comment", _) if rest.trim_ascii() == REPEATED.as_bytes() => header.repeats = Some(true),
        (b"comment", _) if rest.trim_ascii() == DISTINCT.as_bytes() => header.repeats = Some(false),
        (b"comment" | b"obj_info" | b"", _) => {}
        (b"format", [kind, b"1.0"]) => {
            *encoding = Some(match *kind {
                b"ascii" => Encoding::Ascii,
                b"binary_little_endian" => Encoding::Little,
                b"binary_big_endian" => Encoding::Big,
                other => return syntax(format!("{} is not a PLY encoding; mend the header", printable(other))),
            });
        }
        (b"format", _) => return syntax("only PLY format version 1.0 is known; convert the file".to_string()),
        (b"element", [name, count]) => {
            let name = text(name)?;
            let Some(count) = std::str::from_utf8(count).ok().and_then(|t| t.parse().ok()) else {
                return syntax(format!("{} is not a number of elements; mend the header", printable(count)));
            };
            if !header.names.insert(name) {
                return syntax(format!("the element `{name}` is announced twice; mend the header"));
            }
            if name == "vertex" {
                header.vertices = count;
            }
            header.elements.push(Element { name, count, properties: Vec::new(), line });
        }
        (b"property", words @ ([_, _] | [b"list", _, _, _])) => {
            let Some(element) = header.elements.last_mut() else {
                return syntax("a property stands before the first element; mend the header".to_string());
            };
            let scalar = |name: &[u8]| {
                let unknown =
                    || ReadErrorKind::Syntax(format!("{} is not a PLY type; mend the header", printable(name)));
                Scalar::parse(name).ok_or_else(unknown)
            };
            let (list, kind, name) = match *words {
                [b"list", count, item, name] => (Some(scalar(count)?), scalar(item)?, name),
                [kind, name, ..] => (None, scalar(kind)?, name),
                _ => return syntax("a property without type and name; mend the header".to_string()),
            };
            element.properties.push(Property { name: text(name)?, list, scalar: kind });
        }
        _ => {
            return syntax(format!("{} does not begin a line of a PLY header; mend it", printable(keyword)));
        }
    }
    Ok(())
}

/// A name that can stand in a message.
fn text(name: &[u8]) -> Result<&str, Kind> {
    let readable = |s: &&str| s.len() <= 200 && !s.chars().any(char::is_control);
    std::str::from_utf8(name).ok().filter(readable).ok_or_else(|| {
        ReadErrorKind::Syntax(format!("the name {} is not readable text; mend the header", printable(name)))
    })
}
