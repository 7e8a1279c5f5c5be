//! Windows: a level, or as much of it as the edges at hand need, as flat words for the device.
//!
//! A level that fits is uploaded whole and stays for all of its edges. One that does not is cut: the elements around
//! the ends of a run of edges and the corners of those elements, renumbered in their order, so that a patch comes out as
//! it would from the whole level. The kernels look at the stars of the ends only; other vertices of a window have none.

use crate::metric::WeighInput;

/// Arrays of words, in the order of the kernel's bindings.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Window {
    pub positions: Vec<f32>,
    pub face_start: Vec<u32>,
    pub corners: Vec<u32>,
    pub star_start: Vec<u32>,
    pub star_faces: Vec<u32>,
    /// The edges, in the window's numbers.
    pub edges: Vec<[u32; 2]>,
}

/// Bytes of the largest array of a level, and of all.
pub fn bytes_of(level: &WeighInput) -> (u64, u64) {
    let arrays = [
        level.positions.len() * 12,
        level.faces.start.len() * 4,
        level.faces.corners.len() * 4,
        level.star.start.len() * 4,
        level.star.faces.len() * 4,
    ];
    (arrays.iter().copied().max().unwrap_or(0) as u64, arrays.iter().sum::<usize>() as u64)
}

/// Cut what the first edges of `edges` need, as many as keep the window within about `most` bytes and at least one;
/// returns it and how many edges it has.
pub fn cut(level: &WeighInput, edges: &[[u32; 2]], most: u64) -> (Window, usize) {
    let mut elements: Vec<u32> = Vec::new();
    let mut taken = 0;
    let mut bytes = 0;
    for (i, &[a, b]) in edges.iter().enumerate() {
        // Edges come in the order of their smaller ends: its star need not be listed twice in a row.
        let again = i > 0 && edges[i - 1][0] == a;
        for v in [a, b].into_iter().skip(usize::from(again)) {
            let star = level.star.get(v);
            elements.extend_from_slice(star);
            bytes += 20 + star.iter().map(|&f| 8 + level.faces.get(f).len() as u64 * 20).sum::<u64>();
        }
        if bytes > most && taken > 0 {
            // What was counted twice may leave room.
            elements.sort_unstable();
            elements.dedup();
            bytes = elements.iter().map(|&f| 12 + level.faces.get(f).len() as u64 * 20).sum();
            if bytes > most / 4 * 3 {
                break;
            }
        }
        taken = i + 1;
    }
    let edges = &edges[..taken];
    elements.sort_unstable();
    elements.dedup();
    let mut vertices: Vec<u32> = elements.iter().flat_map(|&f| level.faces.get(f)).copied().collect();
    vertices.extend(edges.iter().flatten());
    vertices.sort_unstable();
    vertices.dedup();
    let local = |list: &[u32], x: u32| list.binary_search(&x).unwrap_or(0) as u32;
    let mut window = Window { face_start: vec![0], ..Window::default() };
    for &v in &vertices {
        window.positions.extend(level.positions[v as usize]);
    }
    for &f in &elements {
        window.corners.extend(level.faces.get(f).iter().map(|&v| local(&vertices, v)));
        window.face_start.push(window.corners.len() as u32);
    }
    window.edges = edges.iter().map(|e| e.map(|v| local(&vertices, v))).collect();
    let mut end = vec![false; vertices.len()];
    window.edges.iter().flatten().for_each(|&v| end[v as usize] = true);
    window.star_start.push(0);
    for (&v, end) in vertices.iter().zip(end) {
        if end {
            window.star_faces.extend(level.star.get(v).iter().map(|&f| local(&elements, f)));
        }
        window.star_start.push(window.star_faces.len() as u32);
    }
    (window, taken)
}
