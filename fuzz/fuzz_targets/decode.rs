//! Any bytes as a `.lods` stream, as they are and with their checksums made right: valid levels or an error, within
//! the memory limit.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/suite/common/repair.rs"]
mod repair;

fuzz_target!(|bytes: &[u8]| {
    repair::decode(bytes);
    let mut bytes = bytes.to_vec();
    if repair::repair(&mut bytes).is_some() {
        repair::decode(&bytes);
    }
});
