//! The symbols of a split: where a vertex's elements can be cut, which are, and how far apart the children lie.

pub mod connectivity;
pub mod fan;
pub mod neighbourhood;
pub mod vector;
