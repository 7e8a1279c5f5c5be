//! Numbers that Rust and the shaders share; a test compares them.

/// Invocations of a workgroup.
pub const GROUP: u32 = 64;
/// Storage buffers of the kernel that has most.
pub const BUFFERS: usize = 4;
/// Words of `Params`: edges, zeros.
pub const PARAMS: usize = 4;
/// Words of an `Outcome`: value, kind.
pub const OUTCOME: usize = 2;
/// In the kind of an outcome: the class.
pub const CLASS: u32 = 0xff;
/// In the kind of an outcome: a face folds.
pub const FOLDS: u32 = 0x100;
/// The class of a patch that the kernel does not take.
pub const TOO_LARGE: u32 = 4;
/// Stars of both ends together with more elements are not even begun.
pub const STARS: usize = 60;
/// The most vertices of a ring, and so of a star.
pub const RING: usize = 32;
/// The most triangles of a patch, and so fans of a star.
pub const TRIANGLES: usize = 48;
/// In the head of a star: an edge of the apex has exactly one face.
pub const STAR_BORDER: u32 = 0x1_0000;
/// In the head of a star: some element has more than three corners.
pub const STAR_POLYGONS: u32 = 0x2_0000;
/// In the head of a star: there is nothing behind it.
pub const STAR_TOO_LARGE: u32 = 0x4_0000;
/// Beside a vertex of a star: a polygon has it and the apex, not side by side.
pub const STAR_FAR: u32 = 0x1_0000;
/// Kind of a fan: a dangling edge.
pub const FAN_STRING: u32 = 1;
/// Kind of a fan: part of a polygon.
pub const FAN_POLYGON: u32 = 2;
/// Kind of a fan: none.
pub const FAN_NONE: u32 = 3;
