//! Round trips of random polygon soups through the whole codec: exact through the map, and every prefix decodes.

use lodestream::encode::{EncodeError, EncodeOptions, Encoded, encode};
use lodestream::format::container::{FileIndex, Parsed};
use lodestream::format::decoder::{DecodeOptions, Decoder, Step};
use lodestream::mesh::Mesh;
use lodestream::mesh::lattice::Quantization;
use proptest::prelude::*;

fn soup(vertices: usize, faces: usize) -> impl Strategy<Value = Mesh> {
    (1..vertices).prop_flat_map(move |n| {
        let face = prop::collection::vec(0..n as u32, 2..7);
        let position = prop::array::uniform3(-20f64..20.0);
        (prop::collection::vec(position, n), prop::collection::vec(face, 0..faces)).prop_map(|(positions, faces)| {
            let mut mesh = Mesh { positions, ..Mesh::default() };
            for f in faces {
                mesh.push_face(&f);
            }
            mesh
        })
    })
}

/// The element with its smallest rotation, so that equal cycles are equal lists.
fn canonical(f: impl Iterator<Item = u32>) -> Vec<u32> {
    let f: Vec<u32> = f.collect();
    (0..f.len()).map(|r| [&f[r..], &f[..r]].concat()).min().unwrap_or_default()
}

/// An encoding; soups whose isolated vertices lie out of reach of the lattice are refused, and are none.
fn encoded(mesh: &Mesh, options: &EncodeOptions) -> Result<Encoded, TestCaseError> {
    match encode(mesh, options) {
        Err(EncodeError::Lattice(error)) => Err(TestCaseError::reject(error.to_string())),
        other => Ok(other.unwrap()),
    }
}

fn exact(mesh: &Mesh, bytes: &[u8], map: &[u32]) -> Result<(), TestCaseError> {
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(bytes);
    let mut last = None;
    let mut before = 0;
    loop {
        match decoder.next_level() {
            Ok(Step::Level(l)) => {
                last = Some(l);
                for &p in decoder.parents() {
                    prop_assert!(p == u32::MAX || (p as usize) < before);
                }
                before = decoder.complex().positions.len();
            }
            Ok(Step::Full) => break,
            other => prop_assert!(false, "{other:?} after {last:?}"),
        }
    }
    decoder.finish().unwrap();
    let lattice = decoder.index().unwrap().unwrap().header().lattice;
    let wanted = lattice.quantize(&mesh.positions).unwrap();
    let level = decoder.complex();
    prop_assert_eq!(level.positions.len(), wanted.len());
    let mut hit = vec![false; wanted.len()];
    for (old, &new) in map.iter().enumerate() {
        prop_assert!(!std::mem::replace(&mut hit[new as usize], true));
        prop_assert_eq!(level.positions[new as usize], wanted[old]);
    }
    let mut want: Vec<_> = mesh.faces().map(|f| canonical(f.iter().map(|&v| map[v as usize]))).collect();
    let back = decoder.to_mesh();
    let mut have: Vec<_> = back.faces().map(|f| canonical(f.iter().copied())).collect();
    want.sort();
    have.sort();
    prop_assert_eq!(want, have);
    Ok(())
}

fn all_prefixes(bytes: &[u8]) -> Result<(), TestCaseError> {
    for cut in 0..bytes.len() {
        let mut decoder = Decoder::new(DecodeOptions::default());
        decoder.push(&bytes[..cut]);
        let mut reached = None;
        loop {
            match decoder.next_level() {
                Ok(Step::Level(l)) => reached = Some(l),
                Ok(Step::NeedBytes) => break,
                other => prop_assert!(false, "{other:?} at {cut} of {}", bytes.len()),
            }
        }
        prop_assert!(decoder.finish().is_err());
        if let Ok(Parsed::Ready(front)) = FileIndex::parse(&bytes[..cut]) {
            prop_assert_eq!(reached, front.whole_level(cut as u64));
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn soups_come_back(mesh in soup(60, 80), lock in any::<bool>(), bits in 1u8..15) {
        let options = EncodeOptions::default().quantization(Quantization::Bits(bits)).lock_borders(lock);
        let e = encoded(&mesh, &options)?;
        exact(&mesh, &e.bytes, &e.map)?;
    }

    #[test]
    fn sparse_soups_come_back(mesh in soup(400, 60), bits in 1u8..22) {
        let options = EncodeOptions::default().quantization(Quantization::Bits(bits));
        let e = encoded(&mesh, &options)?;
        exact(&mesh, &e.bytes, &e.map)?;
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]

    #[test]
    fn every_prefix_decodes_to_its_whole_levels(mesh in soup(60, 60)) {
        let e = encoded(&mesh, &EncodeOptions::default())?;
        all_prefixes(&e.bytes)?;
    }
}
