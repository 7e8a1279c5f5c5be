//! A cursor over the bytes of a text file: numbers and words in place, without a string per line.
//!
//! Lines end with `\n`, `\r\n` or `\r`. Line numbers count from 1 and are kept as the cursor moves.

use super::build::Kind;
use super::error::{Place, ReadErrorKind, printable};

/// A place in a text.
#[derive(Clone)]
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    pos: usize,
    line: u64,
}

impl<'a> Cursor<'a> {
    /// At the first line of `bytes`; a UTF-8 byte order mark is skipped.
    pub fn new(bytes: &'a [u8]) -> Self {
        let pos = if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
        Cursor { bytes, pos, line: 1 }
    }

    #[inline]
    pub fn peek(&self) -> Option<u8> {
        self.bytes.get(self.pos).copied()
    }

    /// The rest of the text.
    #[inline]
    pub fn rest(&self) -> &'a [u8] {
        &self.bytes[self.pos..]
    }

    /// Offset from the start of the file.
    pub fn offset(&self) -> usize {
        self.pos
    }

    pub fn place(&self) -> Place {
        Place::Line(self.line)
    }

    pub fn line(&self) -> u64 {
        self.line
    }

    /// Blanks within a line.
    #[inline]
    pub fn skip_blanks(&mut self) {
        while let Some(b' ' | b'\t' | 0x0b | 0x0c) = self.peek() {
            self.pos += 1;
        }
    }

    /// Blanks within a line, which `\` at its end continues on the next.
    #[inline]
    pub fn skip_blanks_continued(&mut self) {
        loop {
            match self.peek() {
                Some(b' ' | b'\t' | 0x0b | 0x0c) => self.pos += 1,
                Some(b'\\') => match self.bytes.get(self.pos + 1) {
                    Some(b'\n' | b'\r') => {
                        self.pos += 1;
                        self.end_line();
                    }
                    _ => return,
                },
                _ => return,
            }
        }
    }

    #[inline]
    pub fn at_line_end(&self) -> bool {
        matches!(self.peek(), None | Some(b'\n' | b'\r'))
    }

    /// Past one byte that [`Cursor::peek`] has shown, not a line end.
    #[inline]
    pub fn skip_byte(&mut self) {
        self.pos += 1;
    }

    /// A blank, a line end, a comment or a continuation.
    #[inline]
    pub fn at_word_end(&self) -> bool {
        self.peek().is_none_or(|b| is_space(b) || b == b'#' || b == b'\\')
    }

    /// Past the line end at the cursor, if one is there.
    #[inline]
    pub fn end_line(&mut self) {
        match self.peek() {
            Some(b'\n') => self.pos += 1,
            Some(b'\r') => self.pos += 1 + usize::from(self.bytes.get(self.pos + 1) == Some(&b'\n')),
            _ => return,
        }
        self.line += 1;
    }

    /// To the start of the next line, whatever is left on this one.
    #[inline]
    pub fn skip_line(&mut self) {
        self.pos = memchr::memchr2(b'\n', b'\r', self.rest()).map_or(self.bytes.len(), |n| self.pos + n);
        self.end_line();
    }

    /// Like [`Cursor::skip_line`], along `\` at the ends of lines.
    #[inline]
    pub fn skip_line_continued(&mut self) {
        if self.peek() == Some(b'\n') {
            self.pos += 1;
            self.line += 1;
            return;
        }
        self.skip_rest_continued();
    }

    fn skip_rest_continued(&mut self) {
        loop {
            let start = self.pos;
            self.pos = memchr::memchr2(b'\n', b'\r', self.rest()).map_or(self.bytes.len(), |n| self.pos + n);
            let goes_on = self.pos > start && self.bytes[self.pos - 1] == b'\\' && self.pos < self.bytes.len();
            self.end_line();
            if !goes_on {
                return;
            }
        }
    }

    /// Blanks and line ends.
    #[inline]
    pub fn skip_space(&mut self) {
        loop {
            self.skip_blanks();
            if self.peek().is_none() || !self.at_line_end() {
                return;
            }
            self.end_line();
        }
    }

    /// Blanks, line ends and comments from `#` to the end of the line.
    #[inline]
    pub fn skip_space_and_comments(&mut self) {
        loop {
            self.skip_space();
            if self.peek() != Some(b'#') {
                return;
            }
            self.skip_line();
        }
    }

    /// The bytes up to the next blank or line end; may be empty.
    #[inline]
    pub fn word(&mut self) -> &'a [u8] {
        let start = self.pos;
        while let Some(b) = self.peek() {
            if is_space(b) {
                break;
            }
            self.pos += 1;
        }
        &self.bytes[start..self.pos]
    }

    /// The rest of the line without its end, trimmed; the cursor stays before the line end.
    pub fn rest_of_line(&mut self) -> &'a [u8] {
        let end = memchr::memchr2(b'\n', b'\r', self.rest()).map_or(self.bytes.len(), |n| self.pos + n);
        let text = &self.bytes[self.pos..end];
        self.pos = end;
        text.trim_ascii()
    }

    /// A number, which must end at a blank, a line end or `\`.
    #[inline]
    pub fn float(&mut self, what: &str) -> Result<f64, Kind> {
        match fast_float2::parse_partial::<f64, _>(self.rest()) {
            Ok((value, n)) if self.bytes.get(self.pos + n).is_none_or(|&b| is_space(b) || b == b'\\') => {
                self.pos += n;
                Ok(value)
            }
            _ => self.no_number().ok_or_else(|| self.unexpected(what)),
        }
    }

    /// What C libraries write for no number and for too large ones: `-nan(ind)`, `1.#QNAN`, `-1.#IND00`, `1.#INF`.
    #[cold]
    fn no_number(&mut self) -> Option<f64> {
        let after = self.clone();
        let word = self.word();
        let unsigned = word.strip_prefix(b"-").or(word.strip_prefix(b"+")).unwrap_or(word);
        let begins = |name: &str| unsigned.get(..name.len()).is_some_and(|w| w.eq_ignore_ascii_case(name.as_bytes()));
        if begins("nan(") && unsigned.ends_with(b")")
            || ["1.#ind", "1.#qnan", "1.#snan", "1.#nan"].into_iter().any(begins)
        {
            return Some(f64::NAN);
        }
        if begins("1.#inf") {
            return Some(if word.starts_with(b"-") { f64::NEG_INFINITY } else { f64::INFINITY });
        }
        *self = after;
        None
    }

    /// A whole number; what follows it is the caller's business. `None` leaves the cursor where it is.
    #[inline]
    pub fn integer(&mut self) -> Option<i64> {
        let mut at = self.pos;
        let negative = match self.bytes.get(at) {
            Some(b'-') => {
                at += 1;
                true
            }
            Some(b'+') => {
                at += 1;
                false
            }
            _ => false,
        };
        let first = at;
        let mut value = 0u64;
        while let Some(digit) = self.bytes.get(at).map(|b| b.wrapping_sub(b'0')).filter(|&d| d < 10) {
            // What overflows has too many digits, which is looked at once, behind the loop.
            value = value.wrapping_mul(10).wrapping_add(u64::from(digit));
            at += 1;
        }
        if at == first {
            return None;
        }
        if at - first > 18 {
            let significant = &self.bytes[first..at];
            let zeros = significant.iter().take_while(|&&b| b == b'0').count();
            if significant.len() - zeros > 18 {
                return None;
            }
        }
        let value = value as i64;
        self.pos = at;
        Some(if negative { -value } else { value })
    }

    /// A whole number that stands alone; `3.0` will do.
    #[inline]
    pub fn whole(&mut self, what: &str) -> Result<i64, Kind> {
        let start = self.pos;
        if let Some(value) = self.integer()
            && self.peek().is_none_or(|b| is_space(b) || b == b'#')
        {
            return Ok(value);
        }
        self.pos = start;
        let value = self.float(what)?;
        if value.fract() == 0.0 && value.abs() < 9.0e15 {
            return Ok(value as i64);
        }
        self.pos = start;
        Err(self.unexpected(what))
    }

    /// The error for something else than `what` at the cursor.
    #[cold]
    pub fn unexpected(&self, what: &str) -> Kind {
        if self.peek().is_none() {
            return ReadErrorKind::Truncated { what: format!("a line, before {what}"), missing: None };
        }
        if self.at_line_end() {
            return ReadErrorKind::Syntax(format!("the line ends where {what} belongs; complete it"));
        }
        let word = self.clone().word();
        ReadErrorKind::Syntax(format!("{} stands where {what} belongs; mend it", printable(word)))
    }
}

#[inline]
fn is_space(b: u8) -> bool {
    matches!(b, b' ' | b'\t' | 0x0b | 0x0c | b'\n' | b'\r')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_counted_whatever_ends_them() {
        let mut c = Cursor::new(b"\xef\xbb\xbfa\nb\r\nc\rd\\\n e");
        let mut seen = Vec::new();
        while c.peek().is_some() {
            seen.push((c.line(), c.word().to_vec()));
            c.skip_blanks_continued();
            c.skip_space();
        }
        let words: Vec<_> = seen.iter().map(|(l, w)| (*l, w.as_slice())).collect();
        assert_eq!(words, [(1, &b"a"[..]), (2, b"b"), (3, b"c"), (4, b"d\\"), (5, b"e")]);
    }

    #[test]
    fn numbers_are_read_exactly() {
        for text in ["0.1", "-3e-7", "+2.5", ".5", "7.", "123456789.123456789", "1e400", "5e-324", "-0"] {
            let value = Cursor::new(text.as_bytes()).float("x").unwrap();
            assert_eq!(value.to_bits(), text.parse::<f64>().unwrap().to_bits(), "{text}");
        }
        for text in ["-nan(ind)", "nan(snan)", "1.#QNAN", "-1.#IND00", "NaN", "-nan"] {
            assert!(Cursor::new(text.as_bytes()).float("x").unwrap().is_nan(), "{text}");
        }
        assert_eq!(Cursor::new(b"-1.#INF0").float("x").unwrap(), f64::NEG_INFINITY);
        assert!(Cursor::new(b"1.#GUESS").float("x").is_err());
        assert!(Cursor::new(b"12a").float("x").is_err());
        assert_eq!(Cursor::new(b"3.0 ").whole("x").unwrap(), 3);
        assert!(Cursor::new(b"3.5").whole("x").is_err());
        assert_eq!(Cursor::new(b"-12/5").integer(), Some(-12));
        assert_eq!(Cursor::new(b"99999999999999999999").integer(), None);
        assert_eq!(Cursor::new(b"-999999999999999999").integer(), Some(-999_999_999_999_999_999));
        assert_eq!(Cursor::new(b"000000000000000000000042").integer(), Some(42));
    }
}
