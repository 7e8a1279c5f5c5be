//! What the tests and the benches share.
#![allow(dead_code, reason = "each binary uses its own part")]

pub mod bucket;
pub mod datasets;
pub mod distance;
#[cfg(feature = "samples")]
pub mod outcome;
pub mod picture;
pub mod repair;
pub mod rock;
pub mod small;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// A folder of its own for a test, removed when the test is over.
pub struct Scratch(PathBuf);

impl Scratch {
    /// `name` has to be unique among the tests.
    pub fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("lodestream-test-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Scratch(folder)
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Write a file in the folder.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, content).unwrap();
        path
    }

    /// The names in the folder, sorted.
    pub fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(&self.0)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// What a run of the program gave.
pub struct Run {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl Run {
    fn new(output: Output) -> Self {
        Run {
            code: output.status.code().expect("the program was not killed"),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }

    /// Standard output as the one JSON object that it has to be.
    pub fn json(&self) -> serde_json::Value {
        assert_eq!(self.code, 0, "{}", self.stderr);
        let value: serde_json::Value = serde_json::from_str(&self.stdout).unwrap();
        assert!(value.is_object());
        value
    }

    /// Fail the test unless the exit code is 0.
    #[track_caller]
    pub fn ok(self) -> Self {
        assert_eq!(self.code, 0, "{}{}", self.stdout, self.stderr);
        self
    }
}

/// Run the program in a folder with words separated by spaces, the last ones given as they are.
pub fn lodestream(folder: &Path, words: &str) -> Run {
    lodestream_with(folder, words, None)
}

/// The same with variables in the environment.
pub fn lodestream_in(folder: &Path, words: &str, environment: &[(&str, String)]) -> Run {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream"));
    command.args(words.split_whitespace()).current_dir(folder).stdin(Stdio::null());
    command.envs(environment.iter().map(|(name, value)| (name, value)));
    Run::new(command.output().unwrap())
}

/// The same with bytes on standard input.
pub fn lodestream_with(folder: &Path, words: &str, input: Option<&[u8]>) -> Run {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream"));
    command.args(words.split_whitespace()).current_dir(folder).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.stdin(if input.is_some() { Stdio::piped() } else { Stdio::null() });
    let mut child = command.spawn().unwrap();
    if let (Some(bytes), Some(mut pipe)) = (input, child.stdin.take()) {
        // A program that fails early closes the pipe; what it says then is what counts.
        let _ = std::io::Write::write_all(&mut pipe, bytes);
    }
    Run::new(child.wait_with_output().unwrap())
}
