//! Any bytes as an image, and as a progressive file with a reconstruction: they come back, or an error comes.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/suite/common/picture.rs"]
mod picture;

fuzz_target!(|bytes: &[u8]| picture::check(bytes));
