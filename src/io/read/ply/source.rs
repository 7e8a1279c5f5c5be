//! One number after another from the body of a PLY file, whatever its encoding.

use super::super::build::Kind;
use super::super::error::{Place, ReadErrorKind};
use super::super::text::Cursor;
use super::header::Scalar;

/// The body of a PLY file.
pub(super) trait Source {
    /// The next number.
    fn float(&mut self, scalar: Scalar) -> Result<f64, Kind>;
    /// The next number, which has to be whole.
    fn whole(&mut self, scalar: Scalar) -> Result<i64, Kind>;
    /// The next `count` numbers, behind those in `out`.
    #[inline]
    fn floats(&mut self, scalar: Scalar, count: u64, out: &mut Vec<f64>) -> Result<(), Kind> {
        for _ in 0..count {
            out.push(self.float(scalar)?);
        }
        Ok(())
    }
    /// Past `count` numbers.
    fn skip(&mut self, scalar: Scalar, count: u64) -> Result<(), Kind>;
    /// Where the next number stands.
    fn place(&self) -> Place;
    /// Bytes from here to the end of the file.
    fn remaining(&self) -> u64;
}

/// Numbers as text. Records are not held to lines.
pub(super) struct Ascii<'a>(pub Cursor<'a>);

impl Source for Ascii<'_> {
    #[inline]
    fn float(&mut self, _: Scalar) -> Result<f64, Kind> {
        self.0.skip_space();
        self.0.float("a number")
    }

    #[inline]
    fn whole(&mut self, _: Scalar) -> Result<i64, Kind> {
        self.0.skip_space();
        self.0.whole("a whole number")
    }

    #[inline]
    fn skip(&mut self, _: Scalar, count: u64) -> Result<(), Kind> {
        for _ in 0..count {
            self.0.skip_space();
            if self.0.word().is_empty() {
                return Err(self.0.unexpected("a number"));
            }
        }
        Ok(())
    }

    fn place(&self) -> Place {
        self.0.place()
    }

    fn remaining(&self) -> u64 {
        self.0.rest().len() as u64
    }
}

/// Numbers as bytes, `BIG` end first or not.
pub(super) struct Binary<'a, const BIG: bool> {
    pub bytes: &'a [u8],
    pub pos: usize,
}

impl<'a, const BIG: bool> Binary<'a, BIG> {
    /// The next `count` bytes.
    #[inline]
    pub fn take(&mut self, count: usize) -> Result<&'a [u8], Kind> {
        let rest = &self.bytes[self.pos..];
        let Some(taken) = rest.get(..count) else {
            let missing = (count - rest.len()) as u64;
            return Err(ReadErrorKind::Truncated { what: "the data".to_string(), missing: Some(missing) });
        };
        self.pos += count;
        Ok(taken)
    }

    #[inline]
    fn fixed<const N: usize>(&mut self) -> Result<[u8; N], Kind> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?);
        if BIG {
            bytes.reverse();
        }
        Ok(bytes)
    }
}

impl<const BIG: bool> Source for Binary<'_, BIG> {
    #[inline]
    fn float(&mut self, scalar: Scalar) -> Result<f64, Kind> {
        Ok(match scalar {
            Scalar::F32 => f64::from(f32::from_le_bytes(self.fixed()?)),
            Scalar::F64 => f64::from_le_bytes(self.fixed()?),
            Scalar::U64 => u64::from_le_bytes(self.fixed()?) as f64,
            _ => self.whole(scalar)? as f64,
        })
    }

    #[inline]
    fn whole(&mut self, scalar: Scalar) -> Result<i64, Kind> {
        Ok(match scalar {
            Scalar::I8 => i64::from(i8::from_le_bytes(self.fixed()?)),
            Scalar::U8 => i64::from(u8::from_le_bytes(self.fixed()?)),
            Scalar::I16 => i64::from(i16::from_le_bytes(self.fixed()?)),
            Scalar::U16 => i64::from(u16::from_le_bytes(self.fixed()?)),
            Scalar::I32 => i64::from(i32::from_le_bytes(self.fixed()?)),
            Scalar::U32 => i64::from(u32::from_le_bytes(self.fixed()?)),
            Scalar::I64 => i64::from_le_bytes(self.fixed()?),
            // Beyond the positive range it becomes one that no count and no index can be.
            Scalar::U64 => i64::try_from(u64::from_le_bytes(self.fixed()?)).unwrap_or(i64::MAX),
            Scalar::F32 | Scalar::F64 => {
                let value = self.float(scalar)?;
                if value.fract() != 0.0 || value.abs() > 9.0e15 {
                    return Err(ReadErrorKind::Syntax(format!("{value} stands where a whole number belongs; mend it")));
                }
                value as i64
            }
        })
    }

    #[inline]
    fn floats(&mut self, scalar: Scalar, count: u64, out: &mut Vec<f64>) -> Result<(), Kind> {
        if scalar != Scalar::F32 {
            for _ in 0..count {
                out.push(self.float(scalar)?);
            }
            return Ok(());
        }
        let items = self.take(usize::try_from(count.saturating_mul(4)).unwrap_or(usize::MAX))?;
        out.extend(items.chunks_exact(4).map(|x| {
            let x = [x[0], x[1], x[2], x[3]];
            f64::from(if BIG { f32::from_be_bytes(x) } else { f32::from_le_bytes(x) })
        }));
        Ok(())
    }

    #[inline]
    fn skip(&mut self, scalar: Scalar, count: u64) -> Result<(), Kind> {
        let bytes = count.saturating_mul(scalar.size() as u64);
        if bytes > self.remaining() {
            let missing = Some(bytes - self.remaining());
            return Err(ReadErrorKind::Truncated { what: "a list".to_string(), missing });
        }
        self.pos += bytes as usize;
        Ok(())
    }

    fn place(&self) -> Place {
        Place::Byte(self.pos as u64)
    }

    fn remaining(&self) -> u64 {
        (self.bytes.len() - self.pos) as u64
    }
}
