//! Who may start: memory by prediction, cores by turns.
//!
//! Memory is charged for a file from before it is fetched until its mesh is gone; the sum of all charges stays below the
//! limit. Cores are handed out in the order of asking, one to a file, all of them to a large one; when nothing else is
//! left to start, the last files share the idle ones.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Bytes promised, of those allowed.
#[derive(Debug)]
pub(super) struct Memory {
    limit: u64,
    used: u64,
}

impl Memory {
    pub fn new(limit: u64) -> Self {
        Memory { limit, used: 0 }
    }

    /// Whether so many bytes are free.
    pub fn fits(&self, bytes: u64) -> bool {
        bytes <= self.limit.saturating_sub(self.used)
    }

    /// Charge `bytes` if they are free.
    pub fn take(&mut self, bytes: u64) -> bool {
        let fits = self.fits(bytes);
        if fits {
            self.used += bytes;
        }
        fits
    }

    pub fn give(&mut self, bytes: u64) {
        self.used = self.used.saturating_sub(bytes);
    }
}

/// Cores, first come, first served.
pub(super) struct Cores {
    state: Mutex<Turns>,
    change: Condvar,
    total: usize,
}

struct Turns {
    free: usize,
    next_ticket: u64,
    serving: u64,
}

impl Cores {
    pub fn new(total: usize) -> Self {
        let state = Turns { free: total, next_ticket: 0, serving: 0 };
        Cores { state: Mutex::new(state), change: Condvar::new(), total }
    }

    fn lock(&self) -> MutexGuard<'_, Turns> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Wait for `least` cores, and take up to what `share` says of those that are free then.
    pub fn take(&self, least: usize, share: impl FnOnce(usize) -> usize) -> Held<'_> {
        let least = least.clamp(1, self.total);
        let mut turns = self.lock();
        let ticket = turns.next_ticket;
        turns.next_ticket += 1;
        while turns.serving != ticket || turns.free < least {
            turns = self.change.wait(turns).unwrap_or_else(PoisonError::into_inner);
        }
        let count = share(turns.free).clamp(least, turns.free);
        turns.free -= count;
        turns.serving += 1;
        drop(turns);
        self.change.notify_all();
        Held { cores: self, count }
    }
}

/// Cores in use, given back when dropped.
pub(super) struct Held<'a> {
    cores: &'a Cores,
    pub count: usize,
}

impl std::ops::Drop for Held<'_> {
    fn drop(&mut self) {
        self.cores.lock().free += self.count;
        self.cores.change.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn memory_is_never_promised_twice() {
        let mut m = Memory::new(100);
        assert!(m.take(60) && !m.take(41) && m.take(40) && !m.take(1));
        m.give(60);
        assert!(m.take(60));
        assert!(!Memory::new(10).take(u64::MAX));
    }

    #[test]
    fn cores_are_never_handed_out_twice_and_large_files_get_their_turn() {
        let cores = Cores::new(3);
        let busy = AtomicUsize::new(0);
        std::thread::scope(|s| {
            for i in 0..12 {
                let (cores, busy) = (&cores, &busy);
                s.spawn(move || {
                    let held = cores.take(if i % 4 == 0 { 3 } else { 1 }, |_| 1);
                    assert_eq!(held.count, if i % 4 == 0 { 3 } else { 1 });
                    assert!(busy.fetch_add(held.count, Ordering::SeqCst) + held.count <= 3);
                    std::thread::yield_now();
                    busy.fetch_sub(held.count, Ordering::SeqCst);
                });
            }
        });
        assert_eq!(cores.take(99, |free| free).count, 3);
        assert_eq!(cores.take(1, |free| free + 7).count, 3);
    }
}
