//! A reader for bytes that arrive over time.

use super::chunk::ChunkInfo;
use super::error::ContainerError;
use super::index::{FileIndex, Parsed, verify};
use super::kind::Kind;
use std::sync::Arc;

/// Takes the bytes of a file in pieces of any size and hands out its chunks in order, each verified.
///
/// Holds the bytes that have arrived and were not yet handed out, and never reserves by what the file claims. After an
/// error the same call gives the same error again.
#[derive(Clone, Debug, Default)]
pub struct Reader {
    /// The bytes of the file from `dropped` on.
    buffer: Vec<u8>,
    dropped: u64,
    /// Bytes of the buffer that were handed out and may go.
    used: usize,
    index: Option<Arc<FileIndex>>,
    /// Bytes of memory that the index may take; `None` for any.
    limit: Option<u64>,
    next: usize,
}

/// What the reader has to say next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// Nothing before the file is known up to this many bytes at least.
    NeedBytes(u64),
    /// The next chunk, whole and verified.
    Chunk {
        /// Its row number in the chunk table.
        index: usize,
        /// Its row in the chunk table.
        info: ChunkInfo,
        /// Its bytes.
        payload: &'a [u8],
    },
    /// All chunks were handed out.
    End,
}

impl Reader {
    /// A reader that has seen nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// The same whose front may take so many bytes of memory.
    pub fn within(limit: u64) -> Self {
        Reader { limit: Some(limit), ..Self::default() }
    }

    /// Hand in the next bytes of the file.
    pub fn push(&mut self, bytes: &[u8]) {
        // Moving what is left at most once for each time as much was used keeps the cost linear.
        if self.used > self.buffer.len() / 2 {
            self.buffer.drain(..self.used);
            self.dropped += self.used as u64;
            self.used = 0;
        }
        self.buffer.extend_from_slice(bytes);
    }

    /// Bytes handed in so far.
    pub fn bytes(&self) -> u64 {
        self.dropped + self.buffer.len() as u64
    }

    /// The index of the file, `None` until its bytes are there.
    ///
    /// # Errors
    /// As [`FileIndex::parse`].
    pub fn index(&mut self) -> Result<Option<Arc<FileIndex>>, ContainerError> {
        Ok(match self.index_or_need()? {
            Ok(()) => self.index.clone(),
            Err(_) => None,
        })
    }

    /// Make the index ready, or say how many bytes that takes.
    fn index_or_need(&mut self) -> Result<Result<(), u64>, ContainerError> {
        if self.index.is_none() {
            match FileIndex::parse_within(&self.buffer, self.limit.unwrap_or(u64::MAX))? {
                Parsed::NeedBytes(n) => return Ok(Err(n)),
                Parsed::Ready(front) => {
                    self.used = front.length() as usize;
                    self.index = Some(Arc::new(front));
                }
            }
        }
        Ok(Ok(()))
    }

    /// The next chunk, if its bytes are there. Chunks of unknown kinds that may be skipped are verified and skipped.
    ///
    /// # Errors
    /// As [`FileIndex::parse`]; [`ContainerError::ChunkDamaged`]; [`ContainerError::TrailingBytes`] after the last chunk.
    pub fn next_chunk(&mut self) -> Result<Event<'_>, ContainerError> {
        if let Err(n) = self.index_or_need()? {
            return Ok(Event::NeedBytes(n));
        }
        let Some(file) = self.index.clone() else { return Ok(Event::NeedBytes(self.bytes() + 1)) };
        while let Some(&info) = file.chunks().get(self.next) {
            let index = self.next;
            let from = self.used;
            let Some(to) = usize::try_from(info.length).ok().and_then(|n| from.checked_add(n)) else {
                return Ok(Event::NeedBytes(info.end()));
            };
            let Some(payload) = self.buffer.get(from..to) else { return Ok(Event::NeedBytes(info.end())) };
            verify(index, &info, payload)?;
            self.used = to;
            self.next += 1;
            if !matches!(info.kind, Kind::Other(_)) {
                return Ok(Event::Chunk { index, info, payload: &self.buffer[from..to] });
            }
        }
        file.check_length(self.bytes())?;
        Ok(Event::End)
    }

    /// The finest level all chunks of which have been handed out.
    pub fn whole_level(&self) -> Option<u32> {
        let front = self.index.as_ref()?;
        let (mut lo, mut hi) = (0, front.header().levels.len() as u32);
        while lo < hi {
            let middle = (lo + hi) / 2;
            if front.prefix_chunks(middle).is_some_and(|n| n <= self.next) {
                lo = middle + 1;
            } else {
                hi = middle;
            }
        }
        lo.checked_sub(1)
    }

    /// Call when no more bytes will come: whether the file was whole.
    ///
    /// # Errors
    /// As [`FileIndex::parse`]; [`ContainerError::Truncated`] says how far the file goes, [`ContainerError::TrailingBytes`] that it
    /// goes on after its end.
    pub fn finish(&mut self) -> Result<(), ContainerError> {
        let have = self.bytes();
        match self.index_or_need()? {
            Err(need) => Err(ContainerError::Truncated { have, need, exact: false, level: None }),
            Ok(()) => self.index.as_ref().map_or(Ok(()), |front| front.check_length(have)),
        }
    }
}
