//! What a file is going to take: bytes of memory at the peak, from a survey.
//!
//! The figures are measured, not derived: `cargo bench --bench ingest -- calibrate` prints what each file of a varied
//! set took in a run of its own beside what is predicted here. `DESIGN.md`, "Ingest", has the table.

use crate::read::Survey;

/// Bytes of the mesh and the map, for each vertex, corner, element and record.
const MESH: [u64; 4] = [24, 4, 4, 4];
/// Bytes at the peak of encoding a mesh, the mesh included: for each vertex and corner, and less for each element.
const ENCODING: [u64; 2] = [150, 44];
const LESS: u64 = 19;
/// Bytes more for each isolated vertex: coding point sets takes more than collapsing them saves.
const ISOLATED: u64 = 82;
/// Bytes of a table for welding, for each vertex.
const WELD: u64 = 20;
/// Vertices from which a file gets all cores to itself.
pub const LARGE: u64 = 2_000_000;

/// How often the bytes of an image are in memory at the end: in the mesh, in its chunk, in the output, in the stamped output.
const IMAGE: u64 = 4;

/// The peak of one file, beyond what the process takes without it. `stored`: bytes of the file as it is stored; `images`: of
/// the images beside it.
pub fn peak(s: &Survey, stored: u64, images: u64) -> u64 {
    let dot = |a: &[u64], b: &[u64]| a.iter().zip(b).fold(0u64, |sum, (x, y)| sum.saturating_add(x.saturating_mul(*y)));
    let mesh = dot(&MESH, &[s.vertices, s.corners, s.elements, s.records]);
    let packed = if s.unpacked > stored { stored } else { 0 };
    let weld = if s.records > s.vertices { WELD.saturating_mul(s.vertices) } else { 0 };
    let reading = mesh.saturating_add(s.unpacked).saturating_add(packed).saturating_add(weld);
    // Records beside vertices stay in the map while the mesh is encoded.
    let records = MESH[3].saturating_mul(s.records.saturating_sub(s.vertices));
    let isolated = ISOLATED.saturating_mul(s.vertices.saturating_sub(s.corners));
    let encoding = dot(&ENCODING, &[s.vertices, s.corners]).saturating_sub(LESS.saturating_mul(s.elements));
    let carried = IMAGE.saturating_mul(images.saturating_add(s.images));
    reading.max(encoding.saturating_add(isolated).saturating_add(records)).saturating_add(carried)
}

/// The most vertices or corners that a file can have.
pub const MOST: u64 = u32::MAX as u64 - 1;

/// The memory that a run may take where the user does not say: four fifths of what is free, within the limits of the
/// control group; 4 GiB where the system does not tell.
pub fn default_memory() -> u64 {
    let number = |path: &str| std::fs::read_to_string(path).ok()?.trim().parse::<u64>().ok();
    let free = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| {
        let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
        line.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib * 1024)
    });
    let group = number("/sys/fs/cgroup/memory.max").or_else(|| number("/sys/fs/cgroup/memory/memory.limit_in_bytes"));
    let most = match (free, group) {
        (Some(a), Some(b)) => a.min(b),
        (Some(a), None) | (None, Some(a)) => a,
        (None, None) => 5 << 30,
    };
    most / 5 * 4
}

/// Bytes of memory that the process holds now; a usual figure where the system does not tell.
pub fn resident() -> u64 {
    let pages = std::fs::read_to_string("/proc/self/statm").ok();
    pages.and_then(|t| t.split_whitespace().nth(1)?.parse::<u64>().ok()).map_or(32 << 20, |pages| pages * 4096)
}

/// The most memory that the process has held, in bytes; 0 where the system does not tell.
pub fn peak_resident() -> u64 {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else { return 0 };
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0) * 1024
}
