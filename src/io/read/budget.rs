//! Memory: what reading may take, and growing within it.

use super::error::ReadErrorKind as Kind;

/// The largest number of vertices, corners or faces.
pub(super) const MAX: usize = u32::MAX as usize - 1;

/// Bytes in use against the bytes allowed.
pub(super) struct Budget {
    used: u64,
    limit: Option<u64>,
}

impl Budget {
    pub fn new(used: u64, limit: Option<u64>) -> Self {
        Budget { used, limit }
    }

    /// Count `bytes` as used, if they are allowed.
    pub fn take(&mut self, bytes: u64) -> Result<(), Kind> {
        let needed = self.used.saturating_add(bytes);
        match self.limit {
            Some(limit) if needed > limit => Err(Kind::Memory { needed, limit: Some(limit) }),
            _ => {
                self.used = needed;
                Ok(())
            }
        }
    }

    /// Bytes that may still be taken.
    pub fn left(&self) -> u64 {
        self.limit.map_or(u64::MAX, |limit| limit.saturating_sub(self.used))
    }

    pub fn release(&mut self, bytes: u64) {
        self.used = self.used.saturating_sub(bytes);
    }

    /// Room for `more` further items of `v`, exactly.
    pub fn reserve<T>(&mut self, v: &mut Vec<T>, more: usize) -> Result<(), Kind> {
        let size = size_of::<T>() as u64;
        let wanted = (v.len() as u64).saturating_add(more as u64).saturating_sub(v.capacity() as u64);
        let bytes = wanted.saturating_mul(size);
        self.take(bytes)?;
        v.try_reserve_exact(more).map_err(|_| Kind::Memory { needed: self.used, limit: None })
    }

    /// Room for at least `more` further items of `v` and for growth: half as much again.
    #[cold]
    pub fn grow<T>(&mut self, v: &mut Vec<T>, more: usize, what: &'static str) -> Result<(), Kind> {
        if v.len() + more > MAX {
            return Err(Kind::TooLarge { what, limit: MAX as u64 });
        }
        let extra = (v.len() / 2).max(more).max(64).min(MAX - v.len());
        self.reserve(v, extra)
    }
}
