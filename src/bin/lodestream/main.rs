//! The command line: one file per command, what they share in `shared`, `output`, `progress` and `stream`.
//!
//! Standard output carries results only (with `--json` exactly one object); progress, warnings and errors go to standard
//! error. Exit codes: 0 done, 1 a file could not be read, decoded or written, 2 wrong usage, 3 `verify` found a difference or
//! `ingest` could not do some files, 130 stopped by a signal.
#![forbid(unsafe_code)]

mod compare;
mod decode;
mod demo;
mod device;
#[cfg(feature = "gpu")]
mod devices;
mod encode;
mod info;
mod ingest;
mod ingest_progress;
mod model;
mod output;
mod progress;
mod render;
mod report;
mod shared;
mod signal;
mod stream;
mod verify;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Any polygon mesh into one progressive .lods file, and back exactly.
#[derive(Parser)]
#[command(name = "lodestream", version, about, long_about = None, after_help = HELP, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

const HELP: &str = "\
Examples:
  lodestream encode scan.ply -o scan.lods
  lodestream decode scan.lods -o preview.glb --max-vertices 10000
  lodestream verify scan.lods --against scan.ply
  lodestream demo

Exit codes: 0 done; 1 a file could not be read, decoded or written; 2 wrong usage; 3 verify found a difference, or some files
of ingest failed; 130 stopped by a signal.";

#[derive(Subcommand)]
enum Command {
    /// Turn a mesh (OBJ, PLY, STL, OFF, glTF, GLB, each also .gz, .zst, .xz) into a .lods file
    Encode(encode::Args),
    /// Write a level of a .lods file as OBJ, PLY, STL or GLB
    Decode(decode::Args),
    /// Say what a .lods file holds: header, levels, chunks
    Info(info::Args),
    /// Check all checksums, decode in full, and compare with the source
    Verify(verify::Args),
    /// Measure how far two models are from each other, and how alike they look
    Compare(compare::Args),
    /// Draw a mesh, or a level of a .lods file
    Render(render::Args),
    /// Measure what the levels of files cost and are worth, on one page
    Report(report::Args),
    /// Encode folders and buckets full of meshes, unattended
    Ingest(Box<ingest::Args>),
    /// List the GPUs that can weigh edges, and which one is taken
    #[cfg(feature = "gpu")]
    Devices(devices::Args),
    /// Make a mesh, encode it, decode several levels, show pictures of them
    Demo(demo::Args),
}

/// How a command ended without an error.
enum Outcome {
    /// All is well.
    Done,
    /// `verify` found a difference, or some files of `ingest` failed, and that was said.
    Different,
    /// What was asked for makes no sense, and that was said.
    Usage,
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            shared::complain(&usage_line(&error.to_string()));
            return ExitCode::from(2);
        }
        Err(help) => help.exit(),
    };
    signal::clean_up_when_stopped();
    let result = match &cli.command {
        Command::Encode(args) => encode::run(args),
        Command::Decode(args) => decode::run(args),
        Command::Info(args) => info::run(args),
        Command::Verify(args) => verify::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Render(args) => render::run(args),
        Command::Report(args) => report::run(args),
        Command::Ingest(args) => ingest::run(args),
        #[cfg(feature = "gpu")]
        Command::Devices(args) => devices::run(args),
        Command::Demo(args) => demo::run(args),
    };
    match result {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Different) => ExitCode::from(3),
        Ok(Outcome::Usage) => ExitCode::from(2),
        // The reader of our output has gone (`lodestream info … | head`): nothing to complain about.
        Err(error) if shared::is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            shared::complain(&format!("{error:#}"));
            ExitCode::FAILURE
        }
    }
}

/// What clap has to say, on one line: its first paragraph.
fn usage_line(text: &str) -> String {
    let first: Vec<&str> = text.lines().take_while(|l| !l.trim().is_empty()).map(str::trim).collect();
    let first = first.join(" ");
    format!("{}; see lodestream --help", first.strip_prefix("error: ").unwrap_or(&first))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn usage_errors_take_one_line() {
        let line = |args: &[&str]| {
            let Err(error) = Cli::try_parse_from([&["lodestream"], args].concat()) else { panic!("{args:?} parses") };
            usage_line(&error.to_string())
        };
        assert_eq!(
            line(&["encode", "a.obj"]),
            "the following required arguments were not provided: --output <OUT.lods>; see lodestream --help"
        );
        for bad in [
            &["encode", "a.obj", "-o", "b", "--position-bits", "22"][..],
            &["encode", "a.obj", "-o", "b", "--position-bits", "12", "--position-step", "1"],
            &["encode", "a.obj", "-o", "b", "--origin", "0,0,0"],
            &["encode", "a.obj", "-o", "b", "--position-step", "0"],
            &["encode", "a.obj", "-o", "b", "--weld", "--no-weld"],
            &["encode", "a.obj", "-o", "b", "--threads", "0"],
            &["encode", "a.obj", "-o", "b", "--device", "cuda"],
            &["encode", "a.obj", "-o", "b", "--gpu-memory", "much"],
            &["encode", "a.obj", "-o", "b", "--drop", "beauty"],
            &["decode", "a.lods", "-o", "b.ply", "--level", "1", "--max-bytes", "2"],
            &["decode", "a.lods", "-o", "b.ply", "--max-error", "-1"],
            &["decode", "a.lods", "-o", "b.ply", "--memory-limit", "much"],
            &["verify", "a.lods", "--map", "x"],
        ] {
            let line = line(bad);
            assert!(!line.contains('\n') && line.ends_with("; see lodestream --help"), "{line}");
        }
    }
}
