use super::*;
use crate::format::coder::range::{Decoder, Encoder};
use proptest::prelude::*;

fn encode(positions: &[[i32; 3]], faces: &Faces) -> (Vec<u8>, Faces, Vec<Origin>) {
    let mut e = Encoder::new();
    let mut sorted = faces.clone();
    let origins = code_elements(&mut e, positions, &mut sorted, faces.corners.len()).unwrap();
    (e.finish(), sorted, origins)
}

fn round_trip(positions: &[[i32; 3]], faces: &Faces) -> usize {
    let (bytes, sorted, origins) = encode(positions, faces);
    assert_eq!(origins.len(), faces.len());
    let mut seen = vec![false; faces.len()];
    for (new, o) in origins.iter().enumerate() {
        assert!(!std::mem::replace(&mut seen[o.element as usize], true));
        let mut old = faces.get(o.element).to_vec();
        old.rotate_left(o.rotation as usize);
        assert_eq!(sorted.get(new as u32), old);
    }
    let mut d = Decoder::new(&bytes);
    let mut back = Faces::new();
    let none = code_elements(&mut d, positions, &mut back, faces.corners.len()).unwrap();
    assert!(none.is_empty());
    assert_eq!(back, sorted);
    assert!(!d.overrun());
    bytes.len()
}

fn grid(n: usize, degree: usize) -> (Vec<[i32; 3]>, Faces) {
    let positions = (0..n * n).map(|k| [(k / n) as i32 * 10, (k % n) as i32 * 10, (k * k % 7) as i32]).collect();
    let mut faces = Faces::new();
    for x in 0..n - 1 {
        for y in 0..n - 1 {
            let v = |dx: usize, dy: usize| ((x + dx) * n + y + dy) as u32;
            if degree == 4 {
                faces.push(&[v(0, 0), v(1, 0), v(1, 1), v(0, 1)]);
            } else {
                faces.push(&[v(0, 0), v(1, 0), v(1, 1)]);
                faces.push(&[v(1, 1), v(0, 1), v(0, 0)]);
            }
        }
    }
    (positions, faces)
}

fn soups() -> impl Strategy<Value = (Vec<[i32; 3]>, Vec<Vec<u32>>)> {
    (3usize..60, 1i32..200).prop_flat_map(|(n, side)| {
        let element = prop::sample::subsequence((0..n as u32).collect::<Vec<_>>(), 2..=n.min(6)).prop_shuffle();
        (
            prop::collection::vec(prop::array::uniform3(-side..side), n),
            prop::collection::vec((element, 1usize..4), 0..60)
                .prop_map(|l| l.into_iter().flat_map(|(e, k)| vec![e; k]).collect()),
        )
    })
}

proptest! {
    #[test]
    fn any_multiset_comes_back((positions, elements) in soups()) {
        let mut faces = Faces::new();
        elements.iter().for_each(|e| faces.push(e));
        round_trip(&positions, &faces);
    }

    #[test]
    fn any_bytes_give_valid_elements_or_an_error(
        (positions, _) in soups(),
        bytes in prop::collection::vec(any::<u8>(), 0..300),
        limit in 0usize..2000,
    ) {
        let mut faces = Faces::new();
        if code_elements(&mut Decoder::new(&bytes), &positions, &mut faces, limit).is_ok() {
            prop_assert!(check(&faces, positions.len(), limit).is_ok());
            prop_assert!(faces.iter().all(|f| f.len() >= 2));
        }
    }

    #[test]
    fn the_bytes_depend_on_the_multiset_alone(seed in any::<u32>()) {
        let (positions, faces) = grid(6, 3);
        let mut list: Vec<Vec<u32>> = faces.iter().map(<[u32]>::to_vec).collect();
        let n = list.len();
        for k in 0..n {
            list.swap(k, (seed.wrapping_mul(2_654_435_761).wrapping_add(k as u32 * 40_503) >> 7) as usize % n);
            list[k].rotate_left(k % 3);
        }
        let mut shuffled = Faces::new();
        list.iter().for_each(|e| shuffled.push(e));
        prop_assert_eq!(encode(&positions, &shuffled).0, encode(&positions, &faces).0);
        round_trip(&positions, &shuffled);
    }
}

#[test]
fn nothing_costs_next_to_nothing() {
    assert!(round_trip(&[], &Faces::new()) <= 1);
    assert!(round_trip(&[[0; 3]; 10], &Faces::new()) <= 1);
}

#[test]
fn regular_surfaces_are_compact() {
    let (positions, faces) = grid(40, 3);
    let bits = round_trip(&positions, &faces) as f64 * 8.0 / 1600.0;
    assert!(bits < 2.0, "{bits} bits a vertex");
    let (positions, faces) = grid(40, 4);
    let bits = round_trip(&positions, &faces) as f64 * 8.0 / 1600.0;
    assert!(bits < 1.0, "{bits} bits a vertex");
}

#[test]
fn what_does_not_fit_is_named() {
    let mut faces = Faces::new();
    faces.push(&[0, 1, 2]);
    let code = |faces: &mut Faces, limit| code_elements(&mut Encoder::new(), &[[0; 3]; 3], faces, limit);
    assert_eq!(code(&mut faces.clone(), 2), Err(ElementsError::TooManyCorners { limit: 2 }));
    faces.push(&[2, 1, 3]);
    let error = code(&mut faces, 9).unwrap_err();
    assert_eq!(error.to_string(), "element 1 names a vertex beyond the 3 there are: the file is damaged");
    let mut twice = Faces::new();
    twice.push(&[1, 2, 1]);
    assert_eq!(code(&mut twice, 9), Err(ElementsError::RepeatedVertex { element: 0, vertex: 1 }));
}
