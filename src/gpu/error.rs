//! What can go wrong with a device.

use thiserror::Error;

/// Why there is no device, or why it cannot go on.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// No device, or only software ones and none was asked for by name.
    #[error("no GPU found{}", if *.software { " (a software device must be asked for by name)" } else { "" })]
    None {
        /// Whether a software device is there.
        software: bool,
    },
    /// No device of this name.
    #[error("no device is called {wanted:?}; there {}", list(.known))]
    NotFound {
        /// What was asked for.
        wanted: String,
        /// The names of those that are there.
        known: Vec<String>,
    },
    /// The driver would not give the device.
    #[error("{device}: the driver does not give the device: {reason}")]
    Refused {
        /// Its name.
        device: String,
        /// What the driver said.
        reason: String,
    },
    /// The device cannot do what the kernels need.
    #[error("{device}: the device is too small: {what} is {has}, {needs} are needed")]
    TooSmall {
        /// Its name.
        device: String,
        /// A limit.
        what: &'static str,
        /// Its value.
        has: u64,
        /// What it would have to be.
        needs: u64,
    },
    /// A shader did not pass the driver or wgpu.
    #[error("{device}: a shader was refused: {reason}")]
    Shader {
        /// The device's name.
        device: String,
        /// What was said.
        reason: String,
    },
    /// Memory of the device ran out.
    #[error("{device}: out of memory; --gpu-memory sets a limit")]
    OutOfMemory {
        /// The device's name.
        device: String,
    },
    /// The device was lost.
    #[error("{device}: the device was lost: {reason}")]
    Lost {
        /// Its name.
        device: String,
        /// What was said.
        reason: String,
    },
    /// The device did not answer in time.
    #[error("{device}: no answer in {seconds} s")]
    Timeout {
        /// Its name.
        device: String,
        /// The deadline.
        seconds: u64,
    },
    /// The device reported an error of another kind.
    #[error("{device}: {reason}")]
    Failed {
        /// Its name.
        device: String,
        /// What was said.
        reason: String,
    },
}

fn list(known: &[String]) -> String {
    match known {
        [] => "is none".to_string(),
        [one] => format!("is only {one:?}"),
        _ => format!("are {}", known.iter().map(|k| format!("{k:?}")).collect::<Vec<_>>().join(", ")),
    }
}

/// What a driver or wgpu says, on one line of bounded length.
pub(super) fn line(text: &str) -> String {
    let mut line = String::new();
    for word in text.split_whitespace() {
        if line.len() + word.len() > 240 {
            line.push_str(" …");
            break;
        }
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
    }
    line
}
