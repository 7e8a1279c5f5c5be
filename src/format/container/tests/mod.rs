//! Round trips, damage, cuts and attacks on the frame of a file.

mod random;

use super::*;
use crate::leb128;
use crate::mesh::lattice::Lattice;

/// A header like that of a scan of `vertices` vertices in `levels` levels, from a little generator of noise.
fn scan(levels: usize, vertices: u32, seed: u32) -> Header {
    let mut state = seed | 1;
    let mut noise = move || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        ((state >> 16) % 1000) as f64 / 1000.0
    };
    let ratio = (vertices as f64 / 30.0).powf(1.0 / (levels - 1) as f64);
    let mut rows = Vec::new();
    let mut v = 30.0f64;
    let mut error = 900.0f64;
    let (mut elements, mut corners) = (56, 168);
    let mut last = 30;
    for l in 0..levels {
        let count = if l + 1 == levels { vertices } else { v as u32 };
        let grown = count - last;
        elements += 2 * grown - (noise() < 0.3) as u32;
        corners = elements * 3;
        let shift = ((error.log2() / 1.5) as i32 - 1).clamp(0, 6) as u8;
        rows.push(LevelInfo {
            vertices: count,
            elements,
            corners,
            shift: if l + 1 == levels { 0 } else { shift },
            error: ErrorBound::covering(error.max(0.866), 1.0),
        });
        last = count;
        v *= 1.0 + (ratio - 1.0) * (0.85 + 0.3 * noise());
        v = v.min(vertices as f64);
        error *= 1.0 - (0.08 + 0.1 * noise());
    }
    let _ = corners;
    Header {
        attributes: Default::default(),
        required: 0,
        optional: 0,
        lattice: Lattice { origin: [-0.18913f32 as f64, 0.03299f32 as f64, -0.0618f32 as f64], step: 0.25057 / 4095.0 },
        position_bits: Some(12),
        bounds: Some([[0; 3], [2551, 4095, 1987]]),
        components: 1,
        degenerate: DegenerateCounts::default(),
        levels: rows,
    }
}

/// Base, shared levels, and one segment or more for each of the finest levels.
fn scan_chunks(levels: u32, single: u32, segments: u32) -> Vec<Chunk> {
    let mut chunks = vec![Chunk::base(levels / 3, bytes(700, 1)).with_memory(3000)];
    chunks.push(Chunk::levels(levels / 3 + 1..=levels - 1 - single, bytes(3000, 2)).with_memory(60_000));
    for level in levels - single..levels {
        for s in 0..segments {
            let length = 1200 + 150 * (level + single - levels) as usize + 37 * s as usize;
            chunks.push(Chunk::segment(level, s, segments, bytes(length, level)).with_memory(80_000));
        }
    }
    chunks
}

fn bytes(length: usize, seed: u32) -> Vec<u8> {
    let mut state = seed.wrapping_mul(2_654_435_761) | 1;
    (0..length)
        .map(|_| {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 24) as u8
        })
        .collect()
}

/// A small file with every kind of chunk, a skippable unknown one among them.
fn small() -> (Header, Vec<Chunk>) {
    let mut header = scan(7, 400, 5);
    header.degenerate = DegenerateCounts { elements: 2, corners: 7 };
    header.optional = 1 << 40;
    let mut chunks = vec![
        Chunk::base(1, bytes(20, 1)),
        Chunk::levels(2..=4, bytes(12, 2)).with_memory(100),
        Chunk { kind: Kind::Other(200), ..Chunk::levels(3..=5, bytes(3, 9)) },
        Chunk::segment(5, 0, 1, bytes(9, 3)),
    ];
    for s in 0..3 {
        chunks.push(Chunk::segment(6, s, 3, bytes(5 + s as usize, 10 + s)));
    }
    chunks.push(Chunk::degenerate(6, bytes(4, 20)));
    (header, chunks)
}

fn front(file: &[u8]) -> FileIndex {
    match FileIndex::parse(file).unwrap() {
        Parsed::Ready(front) => front,
        other => panic!("{other:?}"),
    }
}

/// Chunks by their row numbers.
type HandedOut = Vec<(usize, Vec<u8>)>;

/// Everything a reader hands out of a complete file, and what it says at the end.
fn read_all(reader: &mut Reader) -> (HandedOut, Result<(), ContainerError>) {
    let mut out = Vec::new();
    loop {
        match reader.next_chunk() {
            Ok(Event::Chunk { index, payload, .. }) => out.push((index, payload.to_vec())),
            Ok(Event::End | Event::NeedBytes(_)) => return (out, reader.finish()),
            Err(e) => return (out, Err(e)),
        }
    }
}

/// A front with any tables in it, its checksum right.
fn wrap(body: &[u8]) -> Vec<u8> {
    let mut out = MAGIC.to_vec();
    out.push(VERSION);
    leb128::put(&mut out, body.len() as u64);
    out.extend_from_slice(body);
    let sum = crc32fast::hash(&out);
    out.extend_from_slice(&sum.to_le_bytes());
    out
}

/// A front that says what it is told, be it nonsense.
fn forge(header: &Header, infos: &[ChunkInfo]) -> Vec<u8> {
    let mut body = vec![0, 0];
    leb128::put(&mut body, infos.len() as u64);
    infos.iter().for_each(|i| body.extend_from_slice(&i.checksum.to_le_bytes()));
    body.extend_from_slice(&table::encode(header, infos).unwrap());
    wrap(&body)
}

fn info(kind: Kind, first_level: u32, last_level: u32) -> ChunkInfo {
    ChunkInfo {
        kind,
        first_level,
        last_level,
        segment: 0,
        segments: 1,
        image: 0,
        memory: 0,
        offset: 0,
        length: 1,
        checksum: 0,
    }
}

fn message(result: Result<impl std::fmt::Debug, ContainerError>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn a_file_comes_back() {
    let (header, chunks) = small();
    let file = write(&header, &chunks).unwrap();
    let front = front(&file);
    assert_eq!(front.header(), &header);
    assert_eq!(front.total_bytes(), file.len() as u64);
    assert_eq!((header.vertices(), header.elements()), (400, header.full().elements + 2));
    for (i, chunk) in chunks.iter().enumerate() {
        assert_eq!(front.payload(&file, i).unwrap(), Some(&chunk.payload[..]));
        let at = front.chunks()[i];
        assert_eq!(
            (at.kind, at.first_level, at.last_level, at.segment, at.segments),
            (chunk.kind, chunk.first_level, chunk.last_level, chunk.segment, chunk.segments)
        );
        assert!(at.memory >= chunk.memory && at.memory <= (chunk.memory + chunk.memory / 8).max(64));
    }
    assert_eq!(front.payload(&file, chunks.len()).unwrap(), None);
    let ends: Vec<u64> = (0..7).map(|l| front.prefix_bytes(l).unwrap()).collect();
    let end = |i: usize| front.chunks()[i].end();
    assert_eq!(ends, [end(0), end(0), end(1), end(1), end(1), end(3), end(7)]);
    assert_eq!(front.prefix_bytes(7), None);
    assert_eq!(front.whole_level(end(0) - 1), None);
    assert_eq!(front.whole_level(end(0)), Some(1));
    assert_eq!(front.whole_level(u64::MAX), Some(6));
}

#[test]
fn a_level_is_found_by_size_or_error() {
    let header = scan(9, 1000, 4);
    for (l, row) in header.levels.iter().enumerate() {
        let l = l as u32;
        assert_eq!(header.finest_of(row.vertices), Some(l));
        assert_eq!(header.finest_of(row.vertices - 1), l.checked_sub(1));
        assert_eq!(header.coarsest_within(header.error(l).unwrap()), Some(l));
    }
    assert_eq!(header.coarsest_within(0.0), None);
    assert_eq!(header.coarsest_within(f64::NAN), None);
    assert_eq!(header.error(9), None);
}

#[test]
fn nothing_and_one_vertex_come_back() {
    for vertices in [0, 1] {
        let header = Header {
            attributes: Default::default(),
            bounds: (vertices > 0).then_some([[3, -4, 5]; 2]),
            components: vertices,
            position_bits: None,
            lattice: Lattice { origin: [0.0, -0.0, 1e300], step: f64::MIN_POSITIVE },
            levels: vec![LevelInfo { vertices, ..LevelInfo::default() }],
            ..scan(2, 100, 1)
        };
        let file = write(&header, &[Chunk::base(0, vec![])]).unwrap();
        let front = front(&file);
        assert_eq!(front.header(), &header);
        assert_eq!(front.prefix_bytes(0), Some(file.len() as u64));
        assert_eq!(
            read_all(&mut {
                let mut r = Reader::new();
                r.push(&file);
                r
            }),
            (vec![(0, vec![])], Ok(()))
        );
    }
}

#[test]
fn every_flipped_bit_is_an_error() {
    let (header, chunks) = small();
    let file = write(&header, &chunks).unwrap();
    let front_length = front(&file).length() as usize;
    for bit in 0..file.len() * 8 {
        let mut bad = file.clone();
        bad[bit / 8] ^= 1 << (bit % 8);
        let mut reader = Reader::new();
        reader.push(&bad);
        let (handed_out, end) = read_all(&mut reader);
        assert!(end.is_err(), "bit {bit}");
        assert_eq!(handed_out.is_empty(), bit / 8 < front_length + chunks[0].payload.len(), "bit {bit}");
        for (index, payload) in handed_out {
            assert_eq!(payload, chunks[index].payload, "bit {bit}");
        }
        assert_eq!(read_all(&mut reader), (vec![], end), "the same error again");
    }
}

#[test]
fn every_cut_gives_the_whole_chunks_and_says_where() {
    let (header, chunks) = small();
    let file = write(&header, &chunks).unwrap();
    let whole = front(&file);
    for cut in 0..file.len() {
        let part = &file[..cut];
        let mut reader = Reader::new();
        reader.push(part);
        let (handed_out, end) = read_all(&mut reader);
        let Err(ContainerError::Truncated { have, need, exact, level }) = end else { panic!("{end:?}") };
        assert_eq!(have, cut as u64);
        assert_eq!(exact, cut as u64 >= whole.length());
        assert!(need > have && need <= file.len() as u64);
        assert_eq!(level, if exact { whole.whole_level(have) } else { None });
        assert_eq!(level, reader.whole_level());
        let expect: Vec<_> = (0..chunks.len())
            .filter(|&i| exact && i < whole.whole_chunks(have) && chunks[i].kind != Kind::Other(200))
            .collect();
        assert_eq!(handed_out.iter().map(|c| c.0).collect::<Vec<_>>(), expect);
        for (i, chunk) in chunks.iter().enumerate().filter(|_| exact) {
            let there = i < whole.whole_chunks(have);
            assert_eq!(whole.payload(part, i).unwrap(), there.then_some(&chunk.payload[..]));
        }
    }
}

#[test]
fn more_bytes_than_the_table_says_are_an_error() {
    let (header, chunks) = small();
    let mut file = write(&header, &chunks).unwrap();
    let total = file.len() as u64;
    file.push(0);
    let mut reader = Reader::new();
    reader.push(&file);
    let (handed_out, end) = read_all(&mut reader);
    assert_eq!(handed_out.len(), chunks.len() - 1);
    assert_eq!(end, Err(ContainerError::TrailingBytes { have: total + 1, total }));
}

#[test]
fn errors_are_one_clear_line() {
    let (header, chunks) = small();
    let file = write(&header, &chunks).unwrap();
    assert_eq!(
        message(FileIndex::parse(b"ply\nformat")),
        "not a .lods file: it does not begin with the magic number; check the name of the file"
    );
    let text = "the .lods file was changed in transfer as if it were text (line ends or the eighth bit); transfer it again in binary mode";
    assert_eq!(message(FileIndex::parse(b"\x8cLODS\n\n\x01")), text);
    assert_eq!(message(FileIndex::parse(b"\x8cLODS\r\r\n\r\n")), text);
    assert_eq!(message(FileIndex::parse(b"\x0cLODS\r\n\n")), text);
    let mut bad = file.clone();
    bad[8] = 9;
    assert_eq!(
        message(FileIndex::parse(&bad)),
        "byte 8: .lods format version 9, but this program reads version 1; use a newer program"
    );
    let mut bad = file.clone();
    bad[30] ^= 4;
    let text = message(FileIndex::parse(&bad));
    assert!(text.starts_with("the front of the file (bytes 0 to "), "{text}");
    assert!(text.ends_with("; fetch the file again"), "{text}");
    let at = front(&file).chunks()[1].offset;
    let mut bad = file.clone();
    bad[at as usize] ^= 1;
    let text = message(front(&bad).payload(&bad, 1));
    assert!(text.starts_with(&format!("chunk 1 (levels, 12 bytes from byte {at}) is damaged: checksum ")), "{text}");
    let total = file.len();
    let text = message(front(&file).check_length(at));
    assert_eq!(text, format!("the file is cut: {at} bytes of {total}, levels up to 1 are whole; fetch the rest of it"));
    let text = message(front(&file).check_length(at - 1));
    assert_eq!(text, format!("the file is cut: {} bytes of {total}, no level is whole; fetch the rest of it", at - 1));
    let mut reader = Reader::new();
    reader.push(&file[..9]);
    assert_eq!(
        message(reader.finish()),
        "the file is cut: 9 bytes of at least 10, no level is whole; fetch the rest of it"
    );
    assert_eq!(
        message(front(&file).check_length(total as u64 + 3)),
        format!(
            "the file goes on after its last byte: {} bytes, the chunk table ends at {total}; cut it there",
            total + 3
        )
    );
    assert_eq!(
        message(write(&Header { required: 1 << 5, ..header.clone() }, &chunks)),
        "the file needs feature 5, which this program does not know; use a newer program"
    );
    assert_eq!(
        message(FileIndex::parse(&wrap(&[32, 0, 0]))),
        "the file needs feature 5, which this program does not know; use a newer program"
    );
    let infos = [info(Kind::Base, 0, 6), info(Kind::Other(17), 2, 2)];
    assert_eq!(
        message(FileIndex::parse(&forge(&header, &infos))),
        "chunk 1 is of kind 17, which has to be understood and is not; use a newer program"
    );
    assert_eq!(
        message(front(&file).check_memory(6, 1000)),
        format!(
            "decoding needs about {} bytes of memory, the limit is 1000; raise the memory limit if you trust the file",
            front(&file).memory(6)
        )
    );
    let mut wrong = header;
    wrong.levels[3].vertices = 1;
    assert_eq!(
        message(write(&wrong, &chunks)),
        "level 3 of the level table: fewer vertices, elements or corners than the level before; the file was made by a faulty encoder or to do harm"
    );
    assert_eq!(
        ContainerError::Inconsistent { place: Place::Chunk(4), what: "segments out of order" }.to_string(),
        "chunk 4 of the chunk table: segments out of order; the file was made by a faulty encoder or to do harm"
    );
    assert_eq!(
        ContainerError::Inconsistent { place: Place::Header, what: "no levels" }.to_string(),
        "header: no levels; the file was made by a faulty encoder or to do harm"
    );
}

#[test]
fn chunks_have_to_cover_the_levels_in_order() {
    let header = Header { degenerate: DegenerateCounts::default(), ..scan(5, 400, 3) };
    let check = |chunks: &[Chunk]| {
        let written = write(&header, chunks);
        let infos: Vec<_> = chunks
            .iter()
            .map(|c| ChunkInfo {
                segment: c.segment,
                segments: c.segments,
                image: c.image,
                ..info(c.kind, c.first_level, c.last_level)
            })
            .collect();
        // A forged file is refused for the same reason, or for what cannot even be said in a table.
        assert_eq!(FileIndex::parse(&forge(&header, &infos)).is_ok(), written.is_ok());
        written.is_ok()
    };
    let base = || Chunk::base(1, vec![1]);
    let part = |level, s, n| Chunk::segment(level, s, n, vec![2]);
    let other = || Chunk { kind: Kind::Other(128), ..base() };
    assert!(check(&[base(), Chunk::levels(2..=4, vec![])]));
    assert!(check(&[
        other(),
        base(),
        other(),
        part(2, 0, 2),
        other(),
        part(2, 1, 2),
        Chunk::levels(3..=4, vec![]),
        other()
    ]));
    assert!(check(&[base(), Chunk { last_level: 4, ..part(2, 0, 2) }, Chunk { last_level: 4, ..part(2, 1, 2) }]));
    assert!(!check(&[]));
    assert!(!check(&[base()]));
    assert!(!check(&[Chunk::levels(0..=4, vec![])]));
    assert!(!check(&[part(0, 0, 1), Chunk::levels(1..=4, vec![])]));
    assert!(!check(&[base(), base(), Chunk::levels(2..=4, vec![])]));
    assert!(!check(&[base(), Chunk::levels(2..=3, vec![])]));
    assert!(!check(&[base(), Chunk::levels(3..=4, vec![])]));
    assert!(!check(&[base(), Chunk::levels(1..=4, vec![])]));
    assert!(!check(&[base(), Chunk::levels(2..=5, vec![])]));
    assert!(!check(&[Chunk::base(3, vec![]), part(4, 0, 2)]));
    assert!(!check(&[Chunk::base(3, vec![]), part(4, 1, 2)]));
    assert!(!check(&[Chunk::base(3, vec![]), part(4, 1, 2), part(4, 0, 2)]));
    assert!(!check(&[Chunk::base(3, vec![]), part(4, 0, 3), part(4, 1, 2)]));
    assert!(!check(&[Chunk::base(3, vec![]), part(4, 0, 2), part(4, 0, 2), part(4, 1, 2)]));
    assert!(!check(&[base(), part(2, 0, 2), part(3, 1, 2), Chunk::levels(3..=4, vec![])]));
    assert!(!check(&[Chunk::base(4, vec![]), Chunk::degenerate(4, vec![])]));
    assert!(!check(&[Chunk { kind: Kind::Other(5), ..base() }, Chunk::base(4, vec![])]));
    let with_aside = Header { degenerate: DegenerateCounts { elements: 1, corners: 3 }, ..header.clone() };
    assert!(write(&with_aside, &[Chunk::base(4, vec![]), Chunk::degenerate(4, vec![])]).is_ok());
    assert!(write(&with_aside, &[Chunk::base(4, vec![])]).is_err());
    assert!(write(&with_aside, &[Chunk::degenerate(4, vec![]), Chunk::base(4, vec![])]).is_err());
    assert!(write(&with_aside, &[Chunk::base(4, vec![]), Chunk::degenerate(3, vec![])]).is_err());
}

#[test]
fn claims_are_checked_before_memory_is_taken() {
    let mut header = scan(3, 400, 1);
    for (row, count) in header.levels.iter_mut().zip([10, 100_000, MAX_COUNT / 6]) {
        *row =
            LevelInfo { vertices: count, elements: 2 * count, corners: 6 * count, shift: 0, error: ErrorBound::EXACT };
    }
    let file = write(&header, &[Chunk::base(1, vec![1]).with_memory(1 << 20), Chunk::levels(2..=2, vec![2])]).unwrap();
    assert!(file.len() < 150, "{} bytes", file.len());
    let front = front(&file);
    assert_eq!(front.check_memory(0, 2 << 20), Ok(()));
    assert_eq!(front.check_memory(1, 48 << 20), Ok(()));
    assert!(
        matches!(front.check_memory(2, 4 << 30), Err(ContainerError::MemoryLimit { limit, .. }) if limit == 4 << 30)
    );
    assert!(front.memory(2) > 100 << 30);
    assert_eq!(front.memory(2), front.memory(u32::MAX));
    // The same with a chunk as long as it can be said to be.
    let long = ChunkInfo { length: 1 << 61, memory: u64::MAX, ..info(Kind::Base, 0, 2) };
    let forged = self::front(&forge(&header, &[long]));
    assert!(forged.total_bytes() > 1 << 61);
    assert!(forged.check_memory(0, 1 << 60).is_err());
    let long = ChunkInfo { length: 1 << 61, ..info(Kind::Levels, 1, 2) };
    let result = FileIndex::parse(&forge(&header, &[ChunkInfo { length: 1 << 61, ..info(Kind::Base, 0, 0) }, long]));
    assert_eq!(
        message(result),
        "chunk 1 of the chunk table: the file would be longer than 2^62 bytes; the file was made by a faulty encoder or to do harm"
    );
    assert!(matches!(
        FileIndex::parse(&wrap(&[0, 0, 255, 255, 255, 255, 15, 1, 2, 3])),
        Err(ContainerError::Inconsistent { place: Place::Header, .. })
    ));
}

#[test]
fn the_example_of_the_format_text_is_what_is_written() {
    let header = Header {
        attributes: Default::default(),
        required: 0,
        optional: 0,
        lattice: Lattice { origin: [0.0; 3], step: 1.0 },
        position_bits: None,
        bounds: Some([[3, -4, 5]; 2]),
        components: 1,
        degenerate: DegenerateCounts::default(),
        levels: vec![LevelInfo { vertices: 1, error: ErrorBound::QUANTIZATION, ..LevelInfo::default() }],
    };
    let file = write(&header, &[Chunk::base(0, vec![0x2a])]).unwrap();
    let text = include_str!("../../../../docs/format/container.md");
    let example = text.split("<!-- checked by a test -->\n").nth(1).unwrap();
    let lines = example.lines().take_while(|l| l.starts_with("    "));
    let digits: Vec<&str> = lines.flat_map(str::split_whitespace).collect();
    assert_eq!(file.iter().map(|b| format!("{b:02X}")).collect::<Vec<_>>().join(" "), digits.join(" "));
}

#[test]
fn tables_are_small() {
    for (levels, vertices, single, segments, limit) in
        [(50, 8_857, 2, 1, 156), (50, 8_857, 8, 1, 192), (60, 43_243, 12, 1, 236), (72, 437_645, 14, 6, 668)]
    {
        let header = scan(levels, vertices, 7);
        let chunks = scan_chunks(levels as u32, single, segments);
        let file = write(&header, &chunks).unwrap();
        let front = front(&file);
        assert_eq!(front.header(), &header);
        assert!(front.length() <= limit, "{levels} levels, {} chunks: {} bytes", chunks.len(), front.length());
    }
}

#[test]
fn error_bounds_round_up() {
    for code in 0..=1022 {
        let bound = ErrorBound::from_code(code).unwrap();
        assert_eq!(bound.code(), code);
        assert_eq!(ErrorBound::covering(bound.distance(0.37), 0.37), bound);
        let next = ErrorBound::from_code(code + 1).unwrap();
        assert!(next > bound && next.steps() > bound.steps());
        assert_eq!(ErrorBound::covering(bound.distance(0.37).next_up(), 0.37), next);
    }
    assert_eq!(ErrorBound::from_code(1024), None);
    assert_eq!(ErrorBound::covering(3f64.sqrt() / 2.0, 1.0), ErrorBound::QUANTIZATION);
    assert_eq!(ErrorBound::from_code(129).unwrap().steps(), 1.0);
    assert_eq!(ErrorBound::covering(f64::NAN, 1.0), ErrorBound::UNKNOWN);
    assert_eq!(ErrorBound::covering(f64::INFINITY, 1.0), ErrorBound::UNKNOWN);
    assert_eq!(ErrorBound::covering(0.0, 1.0), ErrorBound::EXACT);
    for i in 0..16 {
        let exact = 2f64.powf(i as f64 / 16.0);
        let steps = ErrorBound::from_code(129 + i).unwrap().steps();
        assert!((steps / exact - 1.0).abs() < 1e-15);
    }
}

#[test]
fn amounts_of_memory_round_up() {
    use crate::format::container::chunk::{MAX_MEMORY_CODE, memory_amount, memory_code};
    for code in 0..MAX_MEMORY_CODE {
        assert_eq!(memory_code(memory_amount(code)), code);
        assert_eq!(memory_code(memory_amount(code) + 1), code + 1);
    }
    assert_eq!(memory_amount(memory_code(u64::MAX)), 15 << 42);
}
