//! What the tests and the benches share.
#![allow(dead_code, reason = "each test binary uses its own part")]

pub mod datasets;
