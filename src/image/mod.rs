//! Images: JPEG taken apart without loss into pieces, other formats coded as JPEG, and previews.

pub mod jpeg;
#[cfg(feature = "recompress")]
pub mod preview;
#[cfg(feature = "recompress")]
pub mod recompress;
pub(crate) mod signature;

pub use signature::is_jpeg;
