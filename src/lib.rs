//! lodestream: any polygon mesh into one progressive `.lods` stream, and back exactly.
//!
//! [`encode`](fn@encode) turns a [`Mesh`] into the bytes of a file, [`decode`] turns them back, and a [`Decoder`] gives every level on the
//! way, from bytes as they arrive. [`io`] reads and writes other formats, [`quality`] measures and draws, [`ingest`] works through folders
//! and buckets.
//!
//! # Encode
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use lodestream::{EncodeOptions, Mesh, Quantization};
//!
//! let mut mesh = Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], ..Mesh::default() };
//! mesh.push_face(&[0, 1, 2]);
//! # #[cfg(feature = "encode")] {
//! let options = EncodeOptions::default().quantization(Quantization::Bits(14));
//! let encoded = lodestream::encode(&mesh, &options)?;
//! assert_eq!(encoded.map.len(), 3); // where each vertex went
//! # }
//! # Ok(())
//! # }
//! ```
//!
//! # Decode progressively, or stream from HTTP
//! Bytes go in as they come, from a socket or a range request; [`FileIndex::prefix_bytes`] says how many a level needs.
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let body: Vec<Vec<u8>> = Vec::new();
//! use lodestream::{DecodeOptions, Decoder, Step};
//!
//! let mut decoder = Decoder::new(DecodeOptions::default());
//! for bytes in body {
//!     decoder.push(&bytes);
//!     while let Step::Level(level) = decoder.next_level()? {
//!         // What a renderer needs, written into its own buffers.
//!         let shape = decoder.render_level();
//!         let mut positions = vec![0f32; 3 * shape.vertex.len()];
//!         decoder.write_positions(&shape, [0.0; 3], &mut positions)?;
//!         println!("level {level}: {} triangles", shape.triangles.len() / 3);
//!     }
//! }
//! # Ok(())
//! # }
//! ```
//!
//! # Own attributes
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use lodestream::mesh::{Layer, LayerKind, Stored};
//! use lodestream::{EncodeOptions, Mesh};
//!
//! let mut mesh = Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], ..Mesh::default() };
//! mesh.push_face(&[0, 1, 2]);
//! let heat = vec![20.5, 21.0, 23.25];
//! mesh.layers.push(Layer::per_vertex("heat", LayerKind::Scalar, 1, Stored::F32, heat, &mesh.corners, 3));
//! # #[cfg(feature = "encode")] {
//! let encoded = lodestream::encode(&mesh, &EncodeOptions::default().scalar_bits(16))?;
//! assert_eq!(lodestream::decode(&encoded.bytes)?.layers[0].name, "heat");
//! # }
//! # Ok(())
//! # }
//! ```
//!
//! # Compare exactly
//! [`quality::exact`] compares a decoded mesh with its source on the file's lattice, apart from the codec:
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # #[cfg(feature = "encode")] {
//! use lodestream::quality::exact;
//! use lodestream::{EncodeOptions, FileIndex, Mesh, Parsed};
//!
//! let mut mesh = Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], ..Mesh::default() };
//! mesh.push_face(&[0, 1, 2]);
//! let encoded = lodestream::encode(&mesh, &EncodeOptions::default())?;
//! let Parsed::Ready(index) = FileIndex::parse(&encoded.bytes)? else { panic!("it is whole") };
//! exact::by_map(&mesh, &lodestream::decode(&encoded.bytes)?, &index.header().lattice, &encoded.map)?;
//! # }
//! # Ok(())
//! # }
//! ```
//!
//! # Inside
//! Data flows one way: lower rooms never import upper ones. `docs/design/rooms.md` has the table, and a test holds the imports
//! against it. Decoding needs `mesh`, `image` and `format` alone: no threads, clocks, files or floating-point
//! decisions (`--no-default-features`). What is hidden from this page (`format`, `gpu`, parts of the encoder) is there for the tests, benches
//! and fuzz targets, and may change at any time.
#![forbid(unsafe_code)]
#![warn(missing_docs)]

#[cfg(feature = "encode")]
pub mod encode;
#[doc(hidden)]
pub mod format;
#[cfg(feature = "gpu")]
#[doc(hidden)]
pub mod gpu;
#[doc(hidden)]
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
#[doc(hidden)]
pub mod samples;

#[cfg(feature = "encode")]
pub use encode::{EncodeError, EncodeOptions, Encoded, encode};
pub use format::complex::Faces;
pub use format::container::{ChunkInfo, ContainerError, FileIndex, Header, LevelInfo, Parsed};
pub use format::decoder::{
    BufferError, DecodeError, DecodeOptions, Decoder, Group, MissingImages, PositionTransform, RenderLevel, Step,
    decode,
};
pub use mesh::lattice::{Lattice, Quantization};
pub use mesh::quantizer::Precision;
pub use mesh::{Mesh, MeshError};

// The example of the README is a test.
#[cfg(all(doctest, feature = "cli"))]
#[doc = include_str!("../README.md")]
struct Readme;
