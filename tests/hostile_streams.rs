//! Streams made to do harm: valid checksums around payloads, counts and tables that lie.
//!
//! Whatever they say, a decoder gives valid levels or an error of one line, within its memory limit. A counting allocator
//! watches that; it counts the whole process, so this binary holds one test.
#![cfg(all(feature = "encode", feature = "samples"))]

#[path = "suite/common/small.rs"]
mod small;

use lodestream::format::coder::range::Encoder;
use lodestream::format::complex::{Faces, Inserted, NONE, Split, Star};
use lodestream::format::container::{
    Chunk, DegenerateCounts, FileIndex, Header, Kind, Label, LevelInfo, Parsed, write,
};
use lodestream::format::decoder::{DecodeOptions, Decoder, Step};
use lodestream::format::elements::code_elements;
use lodestream::format::points::{canonical_order, code_points};
use lodestream::format::segment::{Given, ModelState, Scratch, SegmentTask, code_segment};
use lodestream::format::split::neighbourhood::LevelGeometry;
use lodestream::format::state::{segment_range, segments};
use lodestream::mesh::{Layer, LayerKind, Mesh, Stored};
use small::{Random, file, files};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};

/// Counts what is allocated.
struct Counting;

static NOW: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

fn more(n: usize) {
    let now = NOW.fetch_add(n, Relaxed) + n;
    PEAK.fetch_max(now, Relaxed);
}

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        more(layout.size());
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        more(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, p: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // Both may be there while the bytes are copied.
        more(size);
        NOW.fetch_sub(layout.size(), Relaxed);
        unsafe { System.realloc(p, layout, size) }
    }
    unsafe fn dealloc(&self, p: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Relaxed);
        unsafe { System.dealloc(p, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// A file taken apart.
#[derive(Clone)]
struct Parts {
    header: Header,
    chunks: Vec<Chunk>,
}

fn parts(bytes: &[u8]) -> Parts {
    let Ok(Parsed::Ready(front)) = FileIndex::parse(bytes) else { panic!("a valid file") };
    let chunks = front
        .chunks()
        .iter()
        .enumerate()
        .map(|(k, c)| c.chunk(front.payload(bytes, k).unwrap().unwrap().to_vec()))
        .collect();
    Parts { header: front.header().clone(), chunks }
}

fn number(r: &mut Random, near: u32) -> u32 {
    match r.below(8) {
        0 => near.wrapping_add(1),
        1 => near.wrapping_sub(1),
        2 => near.wrapping_mul(2),
        3 => near / 2,
        4 => r.below(20) as u32,
        5 => r.below(1 << 14) as u32,
        6 => (r.next() >> 32) as u32 >> r.below(32),
        _ => near.wrapping_add(r.below(100) as u32),
    }
}

/// Change something about a payload.
fn damage(r: &mut Random, payload: &mut Vec<u8>) {
    let n = payload.len();
    match r.below(10) {
        0 => payload.truncate(r.below(n + 1)),
        1 => payload.iter_mut().skip(r.below(n)).for_each(|b| *b = 0),
        2 => payload.iter_mut().skip(r.below(n)).for_each(|b| *b = 0xff),
        3 => (0..r.below(300)).for_each(|_| payload.push(r.next() as u8)),
        4 => {
            let from = r.below(n);
            payload.iter_mut().skip(from).for_each(|b| *b = r.next() as u8);
        }
        5 => payload.clear(),
        6 if n > 4 => {
            let from = r.below(n - 4);
            payload.drain(from..from + 1 + r.below(3));
        }
        _ => {
            for _ in 0..1 + r.below(3) {
                let (k, bit) = (r.below(n), 1 << r.below(8));
                if let Some(b) = payload.get_mut(k) {
                    *b ^= bit;
                }
            }
        }
    }
}

/// Change something about a file.
fn mutate(r: &mut Random, file: &mut Parts, others: &[Parts]) {
    let level = r.below(file.header.levels.len());
    let chunk = r.below(file.chunks.len());
    match r.below(15) {
        0..=5 => damage(r, &mut file.chunks[chunk].payload),
        6 => {
            // One count, and those behind it, so that none is fewer than the one before.
            let which = r.below(3);
            let row = file.header.levels[level];
            let old = [row.vertices, row.elements, row.corners][which];
            let new = number(r, old);
            let keep = r.below(3) == 0;
            for row in &mut file.header.levels[level..] {
                let at = [&mut row.vertices, &mut row.elements, &mut row.corners];
                let at = at.into_iter().nth(which).unwrap();
                *at = if keep { (*at).max(new) } else { at.wrapping_add(new.wrapping_sub(old)) };
            }
        }
        7 => {
            // All counts as large as they get, the payload as it is.
            let near = 1 << r.below(24);
            let n = number(r, near);
            for row in &mut file.header.levels[level..] {
                row.vertices = row.vertices.max(n);
                row.elements = row.elements.max(n);
                row.corners = row.corners.max(n.saturating_mul(2 + r.below(3) as u32));
            }
        }
        8 => {
            let shift = r.below(25) as u8;
            file.header.levels[..level].iter_mut().for_each(|row| row.shift = shift.max(row.shift));
        }
        9 => {
            // More levels than there are.
            let row = file.header.levels[level];
            let n = 1 + r.below(40);
            file.header.levels.splice(level..level, std::iter::repeat_n(row, n));
            for c in &mut file.chunks {
                c.first_level += if c.first_level as usize > level { n as u32 } else { 0 };
                c.last_level += if c.last_level as usize >= level { n as u32 } else { 0 };
            }
        }
        10 => {
            // A payload of another chunk or file.
            let other = &others[r.below(others.len())];
            file.chunks[chunk].payload = other.chunks[r.below(other.chunks.len())].payload.clone();
        }
        11 => {
            file.header.degenerate = DegenerateCounts { elements: number(r, 3), corners: number(r, 9) };
            if r.below(2) == 0 && !file.chunks.iter().any(|c| c.kind == Kind::Degenerate) {
                let payload = file.chunks[chunk].payload.clone();
                file.chunks.push(Chunk::degenerate(file.header.full_level(), payload));
            }
        }
        12 => {
            // One chunk cut into segments or levels.
            let c = &mut file.chunks[chunk];
            c.kind = [Kind::Levels, Kind::Segment, Kind::Base, Kind::Preview, Kind::Other(200)][r.below(5)];
            if c.kind == Kind::Segment && r.below(2) == 0 {
                let of = 2 + r.below(3) as u32;
                let c = c.clone();
                let segments = (0..of).map(|segment| Chunk { segment, segments: of, ..c.clone() });
                file.chunks.splice(chunk..=chunk, segments);
            }
        }
        13 => {
            // Something about the attributes.
            let a = &mut file.header.attributes;
            let layer = r.below(a.layers.len());
            match (r.below(7), a.layers.get_mut(layer)) {
                (0, Some(l)) => l.wedges = number(r, l.wedges),
                (1, Some(l)) => l.width = 1 + r.below(4) as u8,
                (2, _) => a.labels.push(Label { material: r.below(3) as u32, layers: r.next() as u32 & 7 }),
                (3, _) => a.labels.truncate(1 + r.below(3)),
                (4, Some(_)) => {
                    // As many layers as there may be.
                    let (n, l) = (r.below(33 - a.layers.len().min(32)), a.layers[layer].clone());
                    a.layers.extend(std::iter::repeat_n(l, n));
                    a.labels.iter_mut().for_each(|label| label.layers |= u32::MAX >> (32 - a.layers.len()));
                }
                (5, _) => {
                    a.extra = true;
                    let payload = file.chunks[chunk].payload.clone();
                    if !file.chunks.iter().any(|c| c.kind == Kind::ExtraAttributes) {
                        file.chunks.push(Chunk::extra(file.header.full_level(), payload));
                    }
                }
                _ => {
                    a.appearance = true;
                    a.materials = number(r, a.materials);
                    if !file.chunks.iter().any(|c| c.kind == Kind::Appearance) {
                        let payload = file.chunks[chunk].payload.clone();
                        file.chunks.push(Chunk::appearance(0, payload));
                    }
                }
            }
        }
        _ => {
            // The levels of a run each in a segment of their own.
            let c = file.chunks[chunk].clone();
            if c.first_level < c.last_level && c.kind != Kind::Base {
                let each = (c.first_level..=c.last_level).map(|l| Chunk::segment(l, 0, 1, c.payload.clone()));
                file.chunks.splice(chunk..=chunk, each);
            }
        }
    }
}

/// Decode under a limit; what comes out has to be valid. Returns whether all of it came, and the most memory at once.
fn survive(bytes: &[u8], limit: u64) -> Result<(bool, usize), String> {
    let before = NOW.load(Relaxed);
    PEAK.store(before, Relaxed);
    let mut decoder = Decoder::new(DecodeOptions { memory_limit: limit });
    decoder.push(bytes);
    let mut named = Vec::new();
    let mut most = 0;
    let full = loop {
        match decoder.next_level() {
            Ok(Step::Level(_)) => {
                most = most.max(PEAK.load(Relaxed) - before);
                let level = decoder.complex();
                named.clear();
                named.resize(level.positions.len(), u32::MAX);
                for (f, corners) in (0u32..).zip(level.faces.iter()) {
                    if corners.len() < 2 {
                        return Err(format!("element {f} has {} corners", corners.len()));
                    }
                    for &v in corners {
                        match named.get_mut(v as usize) {
                            Some(last) if *last != f => *last = f,
                            _ => return Err(format!("element {f} of level {:?} is bad at {v}", decoder.level())),
                        }
                    }
                }
                for layer in &decoder.attributes().layers {
                    let wedges = layer.len() as u32;
                    if layer.corner.iter().any(|&w| w != NONE && w >= wedges) {
                        return Err(format!("a wedge of level {:?} that is not there", decoder.level()));
                    }
                }
                PEAK.store(NOW.load(Relaxed), Relaxed);
            }
            Ok(Step::NeedBytes) => return Err("it asks for more bytes".to_string()),
            Ok(Step::Full) => break true,
            Err(error) => {
                if error.to_string().lines().count() != 1 {
                    return Err(error.to_string());
                }
                break false;
            }
        }
    };
    most = most.max(PEAK.load(Relaxed) - before);
    decoder.to_mesh().validate().map_err(|error| error.to_string())?;
    if most > limit as usize + OVERHEAD + 4 * bytes.len() {
        return Err(format!("{most} bytes of memory at once, the limit is {limit}"));
    }
    Ok((full, most))
}

/// Beyond the limit: the tables of the front, the models, and the file itself a few times over.
const OVERHEAD: usize = 4 << 20;

/// What each of them lists.
const LIST: usize = 40_000;
/// How many of them there are in a segment.
const LISTS: u32 = 25;

/// Splits of which a few in each segment list triangles without end.
fn greedy(star: &Star, faces: &Faces, range: std::ops::Range<u32>) -> Given<'static> {
    let mut given = Given::default();
    let mut blocked = std::collections::HashSet::<u32>::new();
    for v in range {
        if given.batch.len() as u32 == LISTS || blocked.contains(&v) {
            continue;
        }
        let around = star.get(v);
        let Some(apex) = faces.get(around[0]).iter().copied().find(|&x| x != v) else { continue };
        let mut split = Split::default();
        split.reset(around.len());
        split.triangles.extend(std::iter::repeat_n(Inserted { apex, reversed: false }, LIST));
        given.batch.push(v, &split, [0; 3]);
        around.iter().for_each(|&f| blocked.extend(faces.get(f).iter().copied()));
    }
    given
}

/// A file of two levels whose segments each list as many triangles as the header says the whole level has more.
fn segments_that_each_claim_all() -> Vec<u8> {
    let mut decoder = Decoder::new(DecodeOptions::default());
    let bytes = file(&lodestream::samples::sphere(80, 0.01, 4), 12);
    decoder.push(&bytes);
    while let Step::Level(_) = decoder.next_level().unwrap() {}
    let mut level = decoder.complex().clone();
    let order = canonical_order(&level.positions);
    let mut renumber = vec![0; order.len()];
    (0u32..).zip(&order).for_each(|(new, &old)| renumber[old as usize] = new);
    level.faces.corners.iter_mut().for_each(|v| *v = renumber[*v as usize]);
    let mut base = Encoder::new();
    let n = level.positions.len();
    code_points(&mut base, &mut level.positions, n);
    let corners = level.faces.corners.len();
    code_elements(&mut base, &level.positions, &mut level.faces, corners).unwrap();

    let star = Star::with_next(n, &level.faces);
    let view = LevelGeometry::new(&level, &star);
    let pieces = segments(n);
    assert!(pieces > 3);
    let mut chunks = vec![Chunk::base(0, base.finish())];
    for k in 0..pieces {
        let range = segment_range(n, k, pieces);
        let element_budget = AtomicU64::new(u64::MAX);
        let task = SegmentTask {
            view,
            range: (range.start, range.end),
            first: k == 0,
            growth: (u64::MAX, u64::MAX),
            element_budget: &element_budget,
            wedge_budget: &[],
            shift: 0,
            bias: 0,
        };
        let mut coder = Encoder::new();
        let given = greedy(&star, &level.faces, range);
        let (mut models, mut scratch) = (ModelState::default(), Scratch::default());
        code_segment(&mut coder, &mut models, &mut scratch, &task, Some(&given)).unwrap();
        chunks.push(Chunk::segment(1, k as u32, pieces as u32, coder.finish()));
    }
    let Parts { mut header, .. } = parts(&bytes);
    let row = LevelInfo { shift: 0, ..header.full() };
    let more = LISTS * LIST as u32;
    let vertices = row.vertices + LISTS * pieces as u32;
    let finer = LevelInfo { vertices, elements: row.elements + more, corners: row.corners + 3 * more, ..row };
    header.levels = vec![row, finer];
    write(&header, &chunks).unwrap()
}

/// Honest files under just the limit that their tables ask for.
fn honest_files_keep_to_what_they_say() {
    use lodestream::samples::{crumbs, point_cloud, soup, terrain};
    let mut r = Random(7);
    let mut with = |mut mesh: Mesh, layers: &[(&str, LayerKind, u8)]| {
        for &(name, kind, width) in layers {
            let layer = small::any_layer(&mesh, name, kind, width, &mut r);
            mesh.layers.push(layer);
        }
        mesh
    };
    let (uv, color) = (("uv", LayerKind::Uv, 2), ("color", LayerKind::Color, 4));
    let (quality, normal) = (("quality", LayerKind::Scalar, 1), ("normal", LayerKind::Normal, 3));
    let mut smooth = terrain(60_000, 1);
    let (values, n) = (smooth.positions.iter().flat_map(|p| [p[0], p[1]]).collect(), smooth.vertex_count());
    let layer = Layer::per_vertex("uv", LayerKind::Uv, 2, Stored::F32, values, &smooth.corners, n);
    smooth.layers.push(layer);
    let meshes = [
        ("terrain", terrain(60_000, 1)),
        ("points", point_cloud(100_000, 2)),
        ("crumbs", crumbs(20_000, 3)),
        ("soup", soup(5_000, 10_000, 4)),
        ("smooth layer", smooth),
        ("wild layers", with(terrain(30_000, 1), &[uv, quality, color])),
        ("points with values", with(point_cloud(100_000, 2), &[color, normal])),
        ("soup with values", with(soup(5_000, 10_000, 4), &[uv, quality])),
        ("crumbs with materials", small::with_attributes(crumbs(10_000, 3), 5)),
    ];
    for (name, mesh) in meshes {
        for bits in [10, 21] {
            let bytes = file(&mesh, bits);
            let Ok(Parsed::Ready(front)) = FileIndex::parse(&bytes) else { panic!("a valid file") };
            let limit = front.memory(front.full_level());
            let (whole, peak) = survive(&bytes, limit).unwrap_or_else(|error| panic!("{name} at {bits} bits: {error}"));
            eprintln!("{name} at {bits} bits: {peak} bytes at once, announced {limit}, file {}", bytes.len());
            assert!(whole, "{name} at {bits} bits");
            assert!(!survive(&bytes, limit - 1).unwrap().0, "{name} at {bits} bits");
        }
    }
}

#[test]
fn hostile_streams_do_no_harm() {
    honest_files_keep_to_what_they_say();
    let greedy = segments_that_each_claim_all();
    let Ok(Parsed::Ready(front)) = FileIndex::parse(&greedy) else { panic!("a valid front") };
    let (whole, peak) = survive(&greedy, front.memory(1)).unwrap();
    eprintln!("greedy segments: {peak} bytes at once, announced {}, file {}", front.memory(1), greedy.len());
    assert!(!whole);
    let mut files: Vec<(&str, Parts)> = files().into_iter().map(|(name, bytes)| (name, parts(&bytes))).collect();
    let large = lodestream::samples::sphere(60, 0.01, 4);
    let large = parts(&file(&large, 12));
    assert!(large.chunks.iter().any(|c| c.segments > 1), "a file with segments");
    let dressed = parts(&file(&small::with_attributes(lodestream::samples::terrain(30_000, 4), 6), 10));
    assert!(dressed.chunks.iter().any(|c| c.segments > 1 && c.kind == Kind::Segment), "layers in segments");
    let others: Vec<Parts> = files.iter().map(|(_, p)| p.clone()).collect();
    files.retain(|(name, _)| *name != "empty");
    let rounds: usize = std::env::var("LODESTREAM_HOSTILE_ROUNDS").ok().and_then(|s| s.parse().ok()).unwrap_or(1);
    let mut r = Random(0x9e37_79b9_7f4a_7c15);
    let (mut decoded, mut full, mut refused) = (0, 0, 0);
    let mut attack = |name: &str, original: &Parts, r: &mut Random| {
        let seed = r.0;
        let mut file = original.clone();
        for _ in 0..1 + r.below(3) {
            mutate(r, &mut file, &others);
        }
        let Ok(bytes) = write(&file.header, &file.chunks) else {
            refused += 1;
            return;
        };
        decoded += 1;
        for limit in [1 << 20, 64 << 20] {
            match std::panic::catch_unwind(|| survive(&bytes, limit)) {
                Ok(Ok(whole)) => full += whole.0 as usize,
                Ok(Err(error)) => panic!("{name}, state {seed:#x}, limit {limit}: {error}"),
                Err(_) => panic!("{name}, state {seed:#x}, limit {limit}: a panic"),
            }
        }
    };
    for _ in 0..1500 * rounds {
        for (name, original) in &files {
            attack(name, original, &mut r);
        }
    }
    for _ in 0..60 * rounds {
        attack("large", &large, &mut r);
    }
    for _ in 0..30 * rounds {
        attack("large with layers", &dressed, &mut r);
    }
    eprintln!("{decoded} files decoded, {full} runs to the full level; {refused} were not written");
    assert!(decoded > 10_000 && full > 100);
}
