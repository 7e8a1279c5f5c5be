use super::*;
use crate::format::coder::range::{Decoder, Encoder};
use proptest::prelude::*;

fn round_trip(points: &[[i32; 3]]) -> usize {
    let mut e = Encoder::new();
    let mut sorted = points.to_vec();
    code_points(&mut e, &mut sorted, points.len());
    let order = canonical_order(points);
    assert!(order.iter().zip(&sorted).all(|(&k, &p)| points[k as usize] == p));
    let bytes = e.finish();
    let mut d = Decoder::new(&bytes);
    let mut back = Vec::new();
    code_points(&mut d, &mut back, points.len());
    assert!(back == sorted, "decoded points differ");
    assert!(!d.overrun());
    bytes.len()
}

/// Points in a box of a side that is itself drawn, so that few and many, near and far, equal and flat sets all occur.
fn clouds(most: usize) -> impl Strategy<Value = Vec<[i32; 3]>> {
    (prop::array::uniform3(0u32..26), prop::array::uniform3(-1000..1000i32)).prop_flat_map(move |(bits, at)| {
        let axis = move |k: usize| (0..1i32 << bits[k]).prop_map(move |c| (c + at[k]).min(POINT_LIMIT));
        prop::collection::vec((axis(0), axis(1), axis(2)).prop_map(|(x, y, z)| [x, y, z]), 0..most)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn few_points_come_back(points in clouds(SMALL + 8)) {
        round_trip(&points);
    }

    #[test]
    fn many_points_come_back(points in clouds(1500)) {
        round_trip(&points);
    }

    #[test]
    fn crowds_of_equal_points_come_back(points in prop::collection::vec((prop::array::uniform3(-3..3i32), 1usize..300), 1..20)) {
        let points: Vec<_> = points.iter().flat_map(|&(p, n)| std::iter::repeat_n(p, n)).collect();
        round_trip(&points);
    }

    #[test]
    fn points_of_a_known_box_come_back(points in clouds(200), slack in prop::array::uniform6(0..100i32)) {
        let mut lo = [0; 3];
        let mut hi = [0; 3];
        for k in 0..3 {
            lo[k] = points.iter().map(|p| p[k]).min().unwrap_or(0) - slack[k];
            hi[k] = points.iter().map(|p| p[k]).max().unwrap_or(0) + slack[k + 3];
        }
        let mut e = Encoder::new();
        let count = points.len();
        let mut sorted = points;
        code_points_in_box(&mut e, lo, hi, &mut sorted, count);
        let bytes = e.finish();
        let mut back = Vec::new();
        code_points_in_box(&mut Decoder::new(&bytes), lo, hi, &mut back, count);
        prop_assert_eq!(back, sorted);
    }

    #[test]
    fn any_bytes_give_the_number_of_points_asked_for(
        bytes in prop::collection::vec(any::<u8>(), 0..200),
        count in 0usize..3000,
        a in prop::array::uniform3(any::<i32>()),
        b in prop::array::uniform3(any::<i32>()),
    ) {
        let mut back = Vec::new();
        code_points(&mut Decoder::new(&bytes), &mut back, count);
        prop_assert_eq!(back.len(), count);
        prop_assert!(back.is_sorted() && back.iter().flatten().all(|c| c.abs() <= POINT_LIMIT));
        code_points_in_box(&mut Decoder::new(&bytes), a, b, &mut back, count);
        prop_assert_eq!(back.len(), count);
        prop_assert!(back.is_sorted());
        for k in 0..3 {
            let lo = a[k].clamp(-POINT_LIMIT, POINT_LIMIT);
            let hi = b[k].clamp(-POINT_LIMIT, POINT_LIMIT).max(lo);
            prop_assert!(back.iter().all(|p| lo <= p[k] && p[k] <= hi));
        }
    }
}

#[test]
fn limits_come_back() {
    let l = POINT_LIMIT;
    let corners: Vec<_> = (0..8)
        .map(|c| [if c & 1 > 0 { l } else { -l }, if c & 2 > 0 { l } else { -l }, if c & 4 > 0 { l } else { -l }])
        .collect();
    for copies in [1, 2, 10] {
        round_trip(&corners.repeat(copies));
    }
    round_trip(&[[l; 3]]);
    round_trip(&[[-l; 3]]);
}

/// A generator of numbers without a dependency.
fn noise(state: &mut u64) -> u32 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 33) as u32
}

#[test]
fn few_points_cost_their_entropy() {
    for count in [1, 2, 3, 5, 10, 20] {
        let mut state = count as u64;
        let mut total = 0;
        for _ in 0..50 {
            let points: Vec<_> =
                (0..count).map(|_| [0; 3].map(|_: i32| (noise(&mut state) >> 19 & 4095) as i32)).collect();
            total += round_trip(&points);
        }
        let entropy = 36.0 * count as f64 - (1..=count).map(|k| (k as f64).log2()).sum::<f64>();
        let bits = total as f64 * 8.0 / 50.0;
        // The box, its flags, and the end of the stream.
        assert!(bits < entropy + 20.0, "{count} points: {bits} bits, entropy {entropy}");
    }
}

#[test]
fn a_dense_plane_costs_little() {
    let points: Vec<_> = (0..10_000).map(|k| [k % 100, k / 100, (k % 100 + k / 100) / 2]).collect();
    let bits = round_trip(&points) as f64 * 8.0 / points.len() as f64;
    assert!(bits < 0.5, "{bits} bits a point");
}

#[test]
fn a_tilted_plane_of_sparse_points_is_seen() {
    let mut state = 7;
    let mut at = || (noise(&mut state) >> 19 & 4095) as i32;
    let points: Vec<_> = (0..4000).map(|_| [at(), at()]).map(|[x, y]| [x, y, (3 * x + 5 * y) / 8]).collect();
    let bits = round_trip(&points) as f64 * 8.0 / points.len() as f64;
    // Two free coordinates, less what the order of 4000 points is worth, plus the height.
    assert!(bits < 24.0 - 10.5 + 3.5, "{bits} bits a point");
}

#[test]
fn a_lattice_is_seen() {
    let mut state = 7;
    let mut at = || (noise(&mut state) >> 24 & 127) as i32 * 31 + 5;
    let points: Vec<_> = (0..4000).map(|_| [at(), at(), at()]).collect();
    let bits = round_trip(&points) as f64 * 8.0 / points.len() as f64;
    assert!(bits < 21.0 - 10.5 + 4.0, "{bits} bits a point");
}
