//! Any bytes as PLY: a valid mesh or an error, within the memory that their number justifies.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lodestream::io::read::Format;

mod common;

fuzz_target!(|bytes: &[u8]| common::read(Format::Ply, bytes));
