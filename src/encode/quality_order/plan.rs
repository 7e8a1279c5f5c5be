//! The best way through the levels of a mesh and the pieces of its images, for what each pair of them is worth.
//!
//! After some steps of either kind the file is at a *cell* `(level, piece)`, has [`Sizes::at`] bytes and looks as good as `quality` says. A file
//! is a monotone path from `(0, 0)` to the last cell; the area under its curve of quality over the logarithm of bytes is a sum over its
//! cells, so the best path is found exactly, by dynamic programming over the grid. The core paper (section 6) walks greedily by ΔQ/ΔS;
//! [`greedy`] is that, for comparison.

/// Cells of the grid: steps of the mesh and of the images that are there.
pub type Cell = (usize, usize);

/// Bytes below which a file is one packet of any network: what it looks like on the way there hardly counts.
pub const FIRST_BYTES: f64 = 10_000.0;

/// How much the part of the curve below [`FIRST_BYTES`] counts.
const FIRST_WEIGHT: f64 = 0.0625;

/// Bytes of a file along both sides of the grid.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Bytes of the file at cell `(0, 0)`.
    pub base: u64,
    /// Bytes that the first `i` steps of the mesh add, from 0 for `i = 0`.
    pub mesh: Vec<u64>,
    /// The same of images.
    pub images: Vec<u64>,
}

impl Sizes {
    /// Bytes at a cell.
    pub fn at(&self, (l, s): Cell) -> u64 {
        self.base + self.mesh[l] + self.images[s]
    }

    /// The last cell, where all is there.
    pub fn last(&self) -> Cell {
        (self.mesh.len() - 1, self.images.len() - 1)
    }

    /// The logarithm of the bytes at a cell, with little weight below [`FIRST_BYTES`].
    fn place(&self, cell: Cell) -> f64 {
        let x = (self.at(cell) as f64).max(1.0).ln() - FIRST_BYTES.ln();
        if x < 0.0 { FIRST_WEIGHT * x } else { x }
    }
}

/// The area under the curve of a path, over the length of the curve: the mean quality on a logarithmic axis of bytes.
pub fn area(sizes: &Sizes, path: &[Cell], quality: impl Fn(Cell) -> f64) -> f64 {
    let pairs = path.iter().zip(&path[1.min(path.len())..]);
    let sum: f64 = pairs.map(|(&a, &b)| quality(a) * (sizes.place(b) - sizes.place(a))).sum();
    let length = match (path.first(), path.last()) {
        (Some(&a), Some(&b)) => sizes.place(b) - sizes.place(a),
        _ => 0.0,
    };
    if length > 0.0 { sum / length } else { 1.0 }
}

/// The path with the largest [`area`]; among equals images come late.
pub fn best(sizes: &Sizes, quality: impl Fn(Cell) -> f64) -> Vec<Cell> {
    let (l_last, s_last) = sizes.last();
    let width = s_last + 1;
    // What the rest of the path is worth from each cell, and whether it goes on with the mesh.
    let mut worth = vec![(0.0f64, false); (l_last + 1) * width];
    for l in (0..=l_last).rev() {
        for s in (0..=s_last).rev() {
            if (l, s) == (l_last, s_last) {
                continue;
            }
            let (here, q) = (sizes.place((l, s)), quality((l, s)));
            let step = |to: Cell| q * (sizes.place(to) - here) + worth[to.0 * width + to.1].0;
            let mesh = if l < l_last { step((l + 1, s)) } else { f64::NEG_INFINITY };
            let image = if s < s_last { step((l, s + 1)) } else { f64::NEG_INFINITY };
            worth[l * width + s] = if mesh >= image { (mesh, true) } else { (image, false) };
        }
    }
    walk(sizes, |(l, s)| worth[l * width + s].1)
}

/// The core paper's path: at each cell the refinement with the largest ΔQ/ΔS. A step that does not raise Q is merged with the ones behind it,
/// as far as they have to go until it does.
pub fn greedy(sizes: &Sizes, quality: impl Fn(Cell) -> f64) -> Vec<Cell> {
    let (l_last, s_last) = sizes.last();
    walk(sizes, |(l, s)| {
        let (q, bytes) = (quality((l, s)), sizes.at((l, s)));
        let slope = |to: Cell| (quality(to) - q) / (sizes.at(to) - bytes).max(1) as f64;
        let first_rise =
            |cells: &mut dyn Iterator<Item = Cell>| cells.map(slope).find(|&slope| slope > 0.0).unwrap_or(0.0);
        first_rise(&mut (l + 1..=l_last).map(|l| (l, s))) >= first_rise(&mut (s + 1..=s_last).map(|s| (l, s)))
    })
}

/// All of the mesh, then the images.
pub fn mesh_first(sizes: &Sizes) -> Vec<Cell> {
    walk(sizes, |_| true)
}

/// All images, then the mesh.
pub fn texture_first(sizes: &Sizes) -> Vec<Cell> {
    walk(sizes, |_| false)
}

/// Both in turns, each as far through its bytes as the other.
pub fn linear(sizes: &Sizes) -> Vec<Cell> {
    let (l_last, s_last) = sizes.last();
    let (all_mesh, all_images) = (u128::from(sizes.mesh[l_last]).max(1), u128::from(sizes.images[s_last]).max(1));
    walk(sizes, |(l, s)| {
        // The next one whose end is less far.
        let mesh = u128::from(sizes.mesh[(l + 1).min(l_last)]) * all_images;
        mesh <= u128::from(sizes.images[(s + 1).min(s_last)]) * all_mesh
    })
}

/// The path that goes on with the mesh where `mesh` says so, and anyway where the images are complete.
fn walk(sizes: &Sizes, mesh: impl Fn(Cell) -> bool) -> Vec<Cell> {
    let (l_last, s_last) = sizes.last();
    let mut path = vec![(0, 0)];
    let (mut l, mut s) = (0, 0);
    while (l, s) != (l_last, s_last) {
        if s == s_last || (l < l_last && mesh((l, s))) {
            l += 1;
        } else {
            s += 1;
        }
        path.push((l, s));
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all_paths(sizes: &Sizes) -> Vec<Vec<Cell>> {
        let (l_last, s_last) = sizes.last();
        let steps = l_last + s_last;
        (0u32..1 << steps)
            .filter(|turns| turns.count_ones() as usize == l_last)
            .map(|turns| walk(sizes, |(l, s)| turns >> (l + s) & 1 == 1))
            .collect()
    }

    proptest! {
        /// No path is better than the one that is found, for any sizes and qualities, rising or not.
        #[test]
        fn the_best_path_is_the_best(
            base in 1u64..100_000,
            mesh in proptest::collection::vec(1u64..200_000, 0..5),
            images in proptest::collection::vec(1u64..200_000, 0..5),
            quality in proptest::collection::vec(0.0f64..1.0, 25),
        ) {
            let sums = |steps: &[u64]| {
                let mut sum = 0;
                std::iter::once(0).chain(steps.iter().map(|b| { sum += b; sum })).collect::<Vec<u64>>()
            };
            let sizes = Sizes { base, mesh: sums(&mesh), images: sums(&images) };
            let q = |(l, s): Cell| quality[l * 5 + s];
            let found = area(&sizes, &best(&sizes, q), q);
            for path in all_paths(&sizes) {
                prop_assert!(area(&sizes, &path, q) <= found + 1e-9, "{path:?}");
            }
            for path in [greedy(&sizes, q), mesh_first(&sizes), texture_first(&sizes), linear(&sizes)] {
                prop_assert_eq!(path.len(), mesh.len() + images.len() + 1);
                prop_assert_eq!(path.last(), Some(&sizes.last()));
            }
        }
    }

    #[test]
    fn cheap_gains_come_first() {
        let sizes = Sizes { base: 20_000, mesh: vec![0, 10_000, 110_000], images: vec![0, 5_000, 500_000] };
        // The first piece of the picture helps most, then the first level; the last piece hardly.
        let mesh = [0.5, 0.8, 1.0];
        let picture = [0.6, 0.95, 1.0];
        let q = |(l, s): Cell| mesh[l] * picture[s];
        let expected = [(0, 0), (0, 1), (1, 1), (2, 1), (2, 2)];
        assert_eq!(best(&sizes, q), expected);
        assert_eq!(greedy(&sizes, q), expected);
        assert_eq!(mesh_first(&sizes), [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2)]);
        assert_eq!(texture_first(&sizes), [(0, 0), (0, 1), (0, 2), (1, 2), (2, 2)]);
        // A step that gains nothing is judged together with the one behind it.
        let flat = |(l, s): Cell| [0.5, 0.5, 0.9][l] + [0.0, 0.02, 0.1][s];
        assert_eq!(greedy(&sizes, flat)[1], (0, 1));
        let flat = |(l, s): Cell| [0.5, 0.5, 0.9][l] + [0.0, 0.01, 0.1][s];
        assert_eq!(greedy(&sizes, flat)[1], (1, 0));
        assert!(area(&sizes, &expected, q) > area(&sizes, &mesh_first(&sizes), q));
        assert_eq!(area(&sizes, &[(0, 0)], q), 1.0);
    }
}
