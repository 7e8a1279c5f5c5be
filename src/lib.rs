//! lodestream: any polygon mesh into one progressive `.lods` stream, and back exactly.
//!
//! Data flows one way through the rooms of this crate:
//! `read → complex → metric → simplify → codec → container`, with `write` beside, and the
//! command line on top. Decoding needs [`mesh`], [`complex`], [`codec`] and [`container`] alone: no threads,
//! clocks, files or floating-point decisions (`--no-default-features`).
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod codec;
pub mod compare;
pub mod complex;
pub mod container;
pub mod decode;
#[cfg(feature = "encode")]
pub mod encode;
#[cfg(feature = "samples")]
pub mod generate;
#[cfg(feature = "gpu")]
pub mod gpu;
#[cfg(feature = "ingest")]
pub mod ingest;
pub mod lattice;
pub mod mesh;
mod par;
#[cfg(feature = "images")]
pub mod picture;
#[cfg(feature = "quality")]
pub mod quality;
pub mod quantizer;
#[cfg(all(feature = "encode", feature = "quality"))]
pub mod schedule;

#[cfg(feature = "encode")]
pub mod metric;
#[cfg(feature = "formats")]
pub mod read;
#[cfg(feature = "recompress")]
pub mod recompress;
#[cfg(feature = "encode")]
pub mod simplify;
pub mod texture;
#[cfg(feature = "encode")]
pub mod trace;
#[cfg(feature = "formats")]
pub mod write;

// The example of the README is a test.
#[cfg(all(doctest, feature = "cli"))]
#[doc = include_str!("../README.md")]
struct Readme;
