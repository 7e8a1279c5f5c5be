//! LEB128: a number in pieces of seven bits, the lowest first, each number in one spelling (`docs/format`, conventions).

/// A number that is written in too many bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Overlong;

/// Append a number.
pub(crate) fn put(out: &mut Vec<u8>, mut value: u64) {
    while value >= 128 {
        out.push(value as u8 | 128);
        value >>= 7;
    }
    out.push(value as u8);
}

/// The number of at most ten bytes at `at`, which moves behind it; `None` where the bytes end early.
pub(crate) fn take(bytes: &[u8], at: &mut usize) -> Result<Option<u64>, Overlong> {
    let mut value = 0u64;
    for k in 0..10 {
        let Some(&byte) = bytes.get(*at) else { return Ok(None) };
        *at += 1;
        if (k == 9 && byte > 1) || (k > 0 && byte == 0) {
            break;
        }
        value |= u64::from(byte & 127) << (7 * k);
        if byte < 128 {
            return Ok(Some(value));
        }
    }
    Err(Overlong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_one_spelling() {
        for value in [0, 1, 127, 128, 300, 16_383, 16_384, 1 << 35, u64::MAX] {
            let mut bytes = vec![7];
            put(&mut bytes, value);
            let mut at = 1;
            assert_eq!(take(&bytes, &mut at), Ok(Some(value)));
            assert_eq!(at, bytes.len());
            assert_eq!(take(&bytes[..bytes.len() - 1], &mut 1), Ok(None));
        }
        assert_eq!(take(&[0x80, 0], &mut 0), Err(Overlong));
        assert_eq!(take(&[[0xff; 9].as_slice(), &[2]].concat(), &mut 0), Err(Overlong));
        assert_eq!(take(&[0xff; 11], &mut 0), Err(Overlong));
    }
}
