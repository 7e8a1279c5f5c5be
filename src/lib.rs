//! lodestream: any polygon mesh into one progressive `.lods` stream, and back exactly.
//!
//! Data flows one way through the rooms of this crate: [`io`] reads a [`mesh`], [`encode`] simplifies it and writes the
//! [`format`](mod@format), whose decoder gives every level back. [`image`](mod@image) takes images apart and puts them together,
//! [`quality`] measures and draws, [`gpu`] does the heavy arithmetic of [`encode`] where there is a device, [`ingest`]
//! runs all of it over folders and buckets. Lower rooms never import upper ones: `docs/design/rooms.md` has the table,
//! and a test holds the imports against it. Decoding needs [`mesh`], [`image`](mod@image) and [`format`](mod@format) alone: no threads, clocks,
//! files or floating-point decisions (`--no-default-features`).
#![forbid(unsafe_code)]
#![warn(missing_docs)]

#[cfg(feature = "encode")]
pub mod encode;
pub mod format;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod image;
#[cfg(feature = "ingest")]
pub mod ingest;
#[cfg(feature = "formats")]
pub mod io;
mod leb128;
pub mod mesh;
#[cfg(feature = "ingest")]
#[doc(hidden)]
pub mod page;
mod parallel;
pub mod quality;
#[cfg(any(feature = "encode", feature = "formats", feature = "samples", test))]
mod random;
#[cfg(feature = "samples")]
pub mod samples;

// The example of the README is a test.
#[cfg(all(doctest, feature = "cli"))]
#[doc = include_str!("../README.md")]
struct Readme;
