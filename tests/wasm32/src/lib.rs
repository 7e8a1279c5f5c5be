//! The decoder behind three plain functions: `alloc` makes room for a file, `decode` answers with the length of what it says of it,
//! `result` with where that lies. Neither bindings nor `unsafe`: the host reads and writes the memory. A file that is not sound traps.

#[path = "../../suite/common/outcome.rs"]
mod outcome;

use std::sync::Mutex;

static FILE: Mutex<Vec<u8>> = Mutex::new(Vec::new());
static RESULT: Mutex<String> = Mutex::new(String::new());

/// Room for a file of `length` bytes; its address.
#[no_mangle]
pub extern "C" fn alloc(length: usize) -> *const u8 {
    let Ok(mut file) = FILE.lock() else { return std::ptr::null() };
    file.clear();
    file.resize(length, 0);
    file.as_ptr()
}

/// Decode the file; the bytes of the lines of [`outcome::expected`].
#[no_mangle]
pub extern "C" fn decode() -> usize {
    let (Ok(file), Ok(mut result)) = (FILE.lock(), RESULT.lock()) else { return 0 };
    *result = outcome::expected("file", &file);
    result.len()
}

/// Where the answer lies.
#[no_mangle]
pub extern "C" fn result() -> *const u8 {
    RESULT.lock().map_or(std::ptr::null(), |result| result.as_ptr())
}
