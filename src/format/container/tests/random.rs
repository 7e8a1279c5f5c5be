//! Properties of files with random headers, tables and chunks, honest and forged.

use super::*;
use proptest::prelude::*;

/// Any valid header and chunks that go with it; rows grow by any amounts.
fn any_file() -> impl Strategy<Value = (Header, Vec<Chunk>)> {
    let rows = prop::collection::vec((0u32..5000, 0u32..9000, 0u32..40_000, 0u8..3, 0u16..1024, 0u32..28), 1..40);
    let cuts = prop::collection::vec((0u32..6, 1u32..4, any::<u8>(), 0usize..40, 0u64..1 << 45), 1..60);
    let float = prop_oneof![any::<f64>(), any::<f32>().prop_map(f64::from), (-1000i32..1000).prop_map(f64::from)]
        .prop_map(|x| if x.is_finite() { x } else { 0.0 });
    let frame = (prop::array::uniform4(float), 0u8..22, prop::array::uniform6(-(1 << 24)..=1i32 << 24), any::<u32>());
    (rows, cuts, frame, (0u32..3, 0u32..9, any::<u64>())).prop_map(|(rows, cuts, (f, bits, b, n), degenerate)| {
        let mut levels = Vec::new();
        let (mut v, mut e, mut c) = (0u32, 0u32, 0u32);
        for &(dv, de, dc, ds, error, scale) in &rows {
            v = v.saturating_add(dv << (scale / 2)).min(MAX_COUNT);
            if v >= 2 {
                let grown = (de << (scale / 2)).min((MAX_COUNT - 100 - c) / 2);
                e += grown;
                c += 2 * grown;
                if e > 0 {
                    c += (dc << (scale / 3)).min(MAX_COUNT - 100 - c);
                }
            }
            let shift = levels.last().map_or(24, |l: &LevelInfo| l.shift).saturating_sub(ds);
            levels.push(LevelInfo {
                vertices: v,
                elements: e,
                corners: c,
                shift,
                error: ErrorBound::from_code(error).unwrap(),
            });
        }
        levels.last_mut().unwrap().shift = 0;
        let with_aside = degenerate.0 > 0 && v > 0;
        let header = Header {
            attributes: Default::default(),
            required: 0,
            optional: degenerate.2,
            lattice: Some(Lattice { origin: [f[0], f[1], f[2]], step: if f[3] == 0.0 { 1.0 } else { f[3].abs() } })
                .filter(Lattice::is_finite)
                .unwrap_or(Lattice { origin: [0.0; 3], step: 1.0 }),
            position_bits: (bits > 0).then_some(bits),
            bounds: (v > 0)
                .then(|| [std::array::from_fn(|k| b[k].min(b[k + 3])), std::array::from_fn(|k| b[k].max(b[k + 3]))]),
            components: if v == 0 { 0 } else { n % v + 1 },
            degenerate: if with_aside {
                DegenerateCounts { elements: degenerate.0, corners: 2 * degenerate.0 + degenerate.1 }
            } else {
                DegenerateCounts::default()
            },
            levels,
        };
        let count = header.levels.len() as u32;
        let mut chunks = Vec::new();
        let mut next = 0;
        let mut k = 0;
        while next < count {
            let (span, segments, other, length, memory) = cuts[k % cuts.len()];
            k += 1;
            if other >= 200 {
                let spare = Chunk {
                    kind: Kind::Other(other),
                    segment: 1,
                    segments: 3,
                    ..Chunk::levels(0..=next, vec![other; 3])
                };
                chunks.push(spare);
            }
            let last = (next + span).min(count - 1);
            if next == 0 {
                chunks.push(Chunk::base(last, bytes(length, k as u32)).with_memory(memory));
            } else if segments == 1 {
                chunks.push(Chunk::levels(next..=last, bytes(length, k as u32)));
            } else {
                for s in 0..segments {
                    let part = Chunk::segment(next, s, segments, bytes(length + s as usize, k as u32 + s));
                    chunks.push(Chunk { last_level: last, ..part }.with_memory(memory));
                }
            }
            next = last + 1;
        }
        if with_aside {
            chunks.push(Chunk::degenerate(count - 1, bytes(6, 77)));
        }
        (header, chunks)
    })
}

proptest! {
    #[test]
    fn any_valid_file_comes_back((header, chunks) in any_file(), pieces in prop::collection::vec(1usize..200, 1..20)) {
        let file = write(&header, &chunks).unwrap();
        let front = front(&file);
        prop_assert_eq!(front.header(), &header);
        prop_assert_eq!(front.chunks().len(), chunks.len());
        for (i, (info, chunk)) in front.chunks().iter().zip(&chunks).enumerate() {
            prop_assert_eq!(info.kind, chunk.kind);
            prop_assert_eq!((info.first_level, info.last_level), (chunk.first_level, chunk.last_level));
            prop_assert_eq!((info.segment, info.segments), (chunk.segment, chunk.segments));
            prop_assert!(info.memory >= chunk.memory);
            prop_assert_eq!(front.payload(&file, i).unwrap(), Some(&chunk.payload[..]));
        }
        prop_assert_eq!(front.check_length(file.len() as u64), Ok(()));
        let needs: Vec<u64> = (0..=front.full_level()).map(|l| front.prefix_bytes(l).unwrap()).collect();
        prop_assert!(needs.is_sorted());

        // In pieces, the reader says the same as at once, and asks only for bytes that are to come.
        let mut at_once = Reader::new();
        at_once.push(&file);
        let whole = read_all(&mut at_once);
        prop_assert_eq!(&whole.1, &Ok(()));
        prop_assert_eq!(at_once.whole_level(), Some(front.full_level()));
        let (mut reader, mut given, mut k) = (Reader::new(), 0, 0);
        let mut handed_out = Vec::new();
        loop {
            match reader.next_chunk().unwrap() {
                Event::Chunk { index, payload, .. } => handed_out.push((index, payload.to_vec())),
                Event::End => break,
                Event::NeedBytes(n) => {
                    prop_assert!(n > given as u64 && n <= file.len() as u64);
                    prop_assert_eq!(reader.whole_level(), front.whole_level(given as u64));
                    let to = (given + pieces[k % pieces.len()]).min(file.len());
                    k += 1;
                    reader.push(&file[given..to]);
                    given = to;
                }
            }
        }
        prop_assert_eq!(handed_out, whole.0);
        prop_assert_eq!(reader.bytes(), file.len() as u64);
        prop_assert_eq!(reader.finish(), Ok(()));
    }

    #[test]
    fn hostile_tables_never_panic(body in prop::collection::vec(any::<u8>(), 0..300), chunks in 0u8..100) {
        for head in [vec![], vec![0, 0, chunks]] {
            let file = wrap(&[head, body.clone()].concat());
            if let Ok(Parsed::Ready(front)) = FileIndex::parse(&file) {
                prop_assert!(front.chunks().len() * 4 <= file.len());
                front.memory(front.full_level());
            }
        }
    }

    #[test]
    fn forged_tables_never_panic((header, chunks) in any_file(), at in any::<prop::sample::Index>(), with in any::<u8>()) {
        let file = write(&header, &chunks).unwrap();
        let length = front(&file).length() as usize;
        let start = MAGIC.len() + if length > 128 + 14 { 3 } else { 2 };
        let mut body = file[start..length - 4].to_vec();
        let at = at.index(body.len());
        body[at] ^= with;
        match FileIndex::parse(&wrap(&body)) {
            Ok(Parsed::Ready(front)) => {
                // Whatever is accepted is consistent enough to be written again.
                let again: Vec<Chunk> = front
                    .chunks()
                    .iter()
                    .map(|c| c.chunk(vec![]))
                    .collect();
                let file = write(front.header(), &again).unwrap();
                let again = self::front(&file);
                prop_assert_eq!(again.header(), front.header());
            }
            Ok(Parsed::NeedBytes(_)) => {
                return Err(TestCaseError::fail("a whole front"));
            }
            Err(_) => {}
        }
    }

    #[test]
    fn nonsense_in_a_header_is_refused(
        rows in prop::collection::vec((any::<u32>(), any::<u32>(), any::<u32>(), 0u8..32, 0u16..1024), 1..6),
        lattice in prop::array::uniform4(any::<u64>()),
        places in prop::collection::vec((any::<u8>(), any::<u32>(), any::<u32>(), 0u32..9, any::<u64>()), 0..6),
    ) {
        let levels = rows
            .iter()
            .map(|&(vertices, elements, corners, shift, error)| LevelInfo {
                vertices,
                elements,
                corners,
                shift,
                error: ErrorBound::from_code(error).unwrap(),
            })
            .collect();
        let lattice = lattice.map(f64::from_bits);
        let header = Header {
            attributes: Default::default(),
            lattice: Lattice { origin: [lattice[0], lattice[1], lattice[2]], step: lattice[3] },
            levels,
            ..scan(3, 100, 1)
        };
        let infos: Vec<_> = places
            .iter()
            .map(|&(kind, a, b, segment, length)| ChunkInfo {
                segment,
                segments: 8,
                length,
                ..info(Kind::from_number(kind), a.min(b), a.max(b))
            })
            .collect();
        prop_assert!(FileIndex::parse(&forge(&header, &infos)).is_err());
    }

    #[test]
    fn any_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..64), magic in any::<bool>()) {
        let mut file = if magic { [&MAGIC[..], &[VERSION]].concat() } else { vec![] };
        file.extend_from_slice(&bytes);
        let mut reader = Reader::new();
        reader.push(&file);
        prop_assert!(read_all(&mut reader).1.is_err());
    }
}
