//! Ctrl-C, and being told to end: temporary files go first.

/// The exit code of a program that was told to stop; 128 and the number of Ctrl-C's signal.
#[cfg(unix)]
const STOPPED: i32 = 130;

/// From now on Ctrl-C (SIGINT), SIGTERM and SIGHUP remove temporary files before they end the program. What the caller has
/// asked to be ignored (`nohup`, jobs in the background of a script) stays ignored.
#[cfg(unix)]
pub fn clean_up_when_stopped() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    use signal_hook::iterator::Signals;
    use std::sync::{Arc, atomic::AtomicBool};

    let ignored = ignored();
    // A file beyond the limit of the shell (`ulimit -f`) is an error of writing, as a full disk is, and no end of the program.
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)));
    let heard = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0);
    // Where that cannot be had, a signal ends the program as it does any other.
    let Ok(mut signals) = Signals::new(heard) else { return };
    std::thread::spawn(move || {
        if signals.forever().next().is_some() {
            let _no_more = (crate::output::remove_all(), lodestream::ingest::abandon());
            std::process::exit(STOPPED);
        }
    });
}

/// The signals that this process was started to ignore, the first in the lowest bit; none where the system does not tell.
#[cfg(unix)]
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

/// Elsewhere the system has other ways, which are not used yet.
#[cfg(not(unix))]
pub fn clean_up_when_stopped() {}
