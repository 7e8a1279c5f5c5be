//! Windows: of a level that does not fit, as much as the edges at hand need.
//!
//! The ends of a run of edges with their stars, and the records of the vertices around them, renumbered. Stars keep their
//! order, so that a patch comes out as it would from the whole level.

use super::stars::Stars;
use crate::encode::cost::{Side, WeighInput};

/// What some edges need.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Window {
    pub stars: Stars,
    /// The edges, in the window's numbers.
    pub edges: Vec<[u32; 2]>,
}

/// Cut what the first edges of `edges` need, as many as keep the window within about `most` bytes and at least one;
/// returns it and how many edges it has.
pub fn cut(level: &WeighInput, edges: &[[u32; 2]], most: u64) -> (Window, usize) {
    let mut ends: Vec<u32> = Vec::new();
    let mut taken = 0;
    let mut bytes = 0;
    for (i, &[a, b]) in edges.iter().enumerate() {
        // Edges come in the order of their smaller ends: its star need not be counted twice in a row.
        let again = i > 0 && edges[i - 1][0] == a;
        for v in [a, b].into_iter().skip(usize::from(again)) {
            ends.push(v);
            bytes += cost(level, v);
        }
        if bytes > most && taken > 0 {
            // What was counted twice may leave room.
            ends.sort_unstable();
            ends.dedup();
            bytes = ends.iter().map(|&v| cost(level, v)).sum();
            if bytes > most / 4 * 3 {
                break;
            }
        }
        taken = i + 1;
    }
    let edges = &edges[..taken];
    let mut ends: Vec<u32> = edges.as_flattened().to_vec();
    ends.sort_unstable();
    ends.dedup();
    let around = |v: &u32| level.star.get(*v).iter().flat_map(|&f| level.faces.get(f)).copied();
    let mut others: Vec<u32> = ends.iter().flat_map(around).filter(|x| ends.binary_search(x).is_err()).collect();
    others.sort_unstable();
    others.dedup();
    let local = |x: u32| match ends.binary_search(&x) {
        Ok(at) => at as u32,
        Err(_) => (ends.len() + others.binary_search(&x).unwrap_or(0)) as u32,
    };
    let mut window = Window::default();
    let mut side = Side::default();
    for &v in &ends {
        window.stars.push(level, v, &mut side, local);
    }
    for &v in &others {
        window.stars.push_record(level, v);
    }
    window.edges = edges.iter().map(|e| e.map(local)).collect();
    (window, taken)
}

/// About the bytes of a vertex, its star, and the records of some vertices around that no other edge needs.
fn cost(level: &WeighInput, v: u32) -> u64 {
    24 + 20 * level.star.get(v).iter().map(|&f| level.faces.get(f).len() as u64 - 1).sum::<u64>()
}
