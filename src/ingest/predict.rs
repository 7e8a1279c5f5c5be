//! What a file is going to take: bytes of memory at the peak, from a survey.
//!
//! The peak is in one of three moments, each held against the others: reading, with the file and the mesh in memory; the
//! first collapses, with the mesh, several levels and their attributes; the end, with images in the mesh and in the output.
//! The figures are measured, not derived: `cargo bench --bench ingest -- memory` prints what each file of a varied set took
//! in a run of its own beside what is predicted here. `docs/lab/ingest.md` has the table.

use super::settings::{IMAGE_CACHE, Settings};
use crate::image::jpeg::Working;
use crate::image::preview::Previews;
use crate::image::recompress::Textures;
use crate::io::read::Survey;

/// Bytes of the mesh and the map, for each vertex, corner, element and record.
const MESH: [u64; 4] = [24, 4, 4, 4];
/// Bytes of the attributes of the mesh, for each number of a value and each corner of a layer.
const LAYERS: [u64; 2] = [8, 4];
/// Bytes at the peak of encoding a mesh, the mesh included: for each vertex and corner, and less for each element.
const ENCODING: [u64; 2] = [150, 44];
const LESS: u64 = 19;
/// Bytes more for each isolated vertex: coding point sets takes more than collapsing them saves.
const ISOLATED: u64 = 82;
/// Bytes more for each corner of a layer, each number of a value as it is in the mesh, each wedge and each of its numbers.
const ATTRIBUTES: [u64; 4] = [30, 8, 30, 4];
/// The most wedges of a vertex in a layer, on average: where a file repeats a vertex more often, values repeat with it.
const WEDGES: u64 = 3;
/// Bytes more for each layer of an isolated vertex.
const ISOLATED_VALUES: u64 = 10;
/// Bytes for each of a JSON document: what is parsed from it is kept by the allocator, if not by the reader.
const DOCUMENT: u64 = 6;
/// Bytes of a table for welding, for each vertex.
const WELD: u64 = 20;
/// Bytes that are left of encoding when the output is put together, for each vertex.
const HISTORY: u64 = 90;
/// Bytes for that order: for each vertex and corner of a level in memory and as a scene, for each number of a value and corner of a layer, for each
/// texel of all images, and for each pixel of all views.
const DRAWING: [u64; 5] = [160, 60, 8, 20, 8];
/// States of an image that are kept, at most, as far as the cache goes; bytes of each for each texel.
const STATES: u64 = 10 * 11;
/// Vertices from which a file gets all cores to itself.
pub const LARGE: u64 = 2_000_000;

/// The peak of one file, beyond what the process takes without it. `stored`: bytes of the file as it is stored; `beside`: of
/// the images beside it, and what work on the largest takes; `verify`: whether the output is decoded and compared.
pub fn peak(s: &Survey, stored: u64, beside: (u64, Working), settings: &Settings, verify: bool) -> u64 {
    let drop = settings.drop;
    let dot = |a: &[u64], b: &[u64]| a.iter().zip(b).fold(0u64, |sum, (x, y)| sum.saturating_add(x.saturating_mul(*y)));
    let values = s.carried(drop);
    let of_layers = values.layers.saturating_mul(s.corners);
    let isolated = s.vertices.saturating_sub(s.corners);
    let (images, working) = match drop.images || drop.materials {
        true => (0, Working::default()),
        false => (beside.0.saturating_add(s.images), beside.1.and(s.working)),
    };
    // Previews have at most a sixteenth of the bytes of their image, and are made in memory that cutting it takes too.
    let images = images.saturating_add(if settings.previews == Previews::Auto { images / 16 } else { 0 });
    let (coefficients, pixels) = match settings.textures {
        Textures::Keep => (working.coefficients, 0),
        Textures::Fine | Textures::Jpeg(_) => (working.coefficients.max(working.made), working.pixels),
    };
    let mesh = dot(&MESH, &[s.vertices, s.corners, s.elements, s.records])
        .saturating_add(dot(&LAYERS, &[values.numbers, of_layers]))
        .saturating_add(images);

    let packed = if s.unpacked > stored { stored } else { 0 };
    let weld = if s.records > s.vertices { WELD.saturating_mul(s.vertices) } else { 0 };
    let reading = mesh.saturating_add(s.unpacked).saturating_add(packed).saturating_add(weld);
    // One image after another becomes a JPEG, when the file is not needed any more.
    let recompressing = mesh.saturating_add(pixels);

    // Records beside vertices stay in the map while the mesh is encoded.
    let records = MESH[3].saturating_mul(s.records.saturating_sub(s.vertices));
    let wedges = values.values.min(WEDGES.saturating_mul(values.layers).saturating_mul(s.vertices));
    let width = if values.values > 0 { values.numbers.div_ceil(values.values) } else { 0 };
    let of_wedges = [of_layers, values.numbers, wedges, wedges.saturating_mul(width)];
    let encoding = dot(&ENCODING, &[s.vertices, s.corners])
        .saturating_sub(LESS.saturating_mul(s.elements))
        .saturating_add(dot(&ATTRIBUTES, &of_wedges))
        .saturating_add(dot(&[ISOLATED, ISOLATED_VALUES], &[isolated, values.layers.saturating_mul(isolated)]))
        .saturating_add(records)
        .saturating_add(images);

    // Images that stay as they are go from the mesh into the output. Others are cut one after another: the pieces of all are there, and the
    // new file and the coefficients of one; then the output. Verifying has that, what was pushed into a decoder, what that
    // made of it, and the decoded mesh; it compares the coefficients of both, where their bytes differ.
    let copies = if coefficients > 0 { 2 } else { 1 };
    let cutting = dot(&[copies, 1], &[images, coefficients]);
    let verifying = if verify { dot(&[4, 2], &[images, working.coefficients]) } else { 0 };
    let writing = HISTORY.saturating_mul(s.vertices).saturating_add(mesh).saturating_add(cutting.max(verifying));
    // The file, a decoder's copy of it, its images, and the file in another order; a level and its scene.
    let drawing = if settings.by_quality && images > 0 {
        let (views, size) = settings.effort.views();
        let pictures = views as u64 * u64::from(size).pow(2);
        let kept = dot(&[4], &[images]).saturating_add(IMAGE_CACHE.min(STATES.saturating_mul(working.texels)));
        let source = if verify { mesh } else { 0 };
        dot(&DRAWING, &[s.vertices, s.corners, of_layers.saturating_add(values.numbers), working.texels, pictures])
            .saturating_add(kept)
            .saturating_add(source)
    } else {
        0
    };
    let end = writing.max(drawing);
    reading.max(recompressing).max(encoding).max(end).saturating_add(DOCUMENT.saturating_mul(s.document))
}

/// The most vertices or corners that a file can have.
pub const MOST: u64 = u32::MAX as u64 - 1;

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
