//! Numbers that are near where vertices are near: along a Morton curve, for meshes whose own order is scattered.
//!
//! Every stage walks over vertices by number and looks at their neighbours. Most files list neighbours together; where one does
//! not, each look is a cache miss, and a mesh of a million vertices takes twice as long to simplify. So large meshes are looked at first,
//! and renumbered where it pays. Positions, elements and all that follows are then in terms of the new numbers; the caller translates
//! once, at the end. Meshes in good order keep it: what they encode to does not depend on this module.

use crate::format::complex::{Attributes, Faces, Level};
use rayon::prelude::*;

/// Numbers so far apart are far apart in memory.
const FAR: u32 = 1 << 14;
/// Smaller meshes fit into caches in any order.
const SMALL: usize = 1 << 16;
/// Bits of each coordinate on the curve.
const BITS: u32 = 21;

/// Renumber a level if its order is scattered; then for each old vertex its new number. Wedges keep their numbers.
pub fn reorder(level: &mut Level, attributes: &mut Attributes) -> Option<Vec<u32>> {
    if level.positions.len() < SMALL || !is_scattered(&level.faces) {
        return None;
    }
    let place = along_curve(&level.positions);
    let mut positions = vec![[0; 3]; place.len()];
    for (&p, &new) in level.positions.iter().zip(&place) {
        positions[new as usize] = p;
    }
    level.positions = positions;
    level.faces.corners.par_iter_mut().for_each(|c| *c = place[*c as usize]);
    // Elements by their smallest vertex.
    let mut order: Vec<(u32, u32)> = (0..level.faces.len() as u32)
        .into_par_iter()
        .map(|f| (level.faces.get(f).iter().copied().min().unwrap_or(0), f))
        .collect();
    order.par_sort_unstable();
    let mut faces = Faces {
        start: Vec::with_capacity(level.faces.start.len()),
        corners: Vec::with_capacity(level.faces.corners.len()),
    };
    faces.start.push(0);
    order.iter().for_each(|&(_, f)| faces.push(level.faces.get(f)));
    for layer in &mut attributes.layers {
        let mut corner = Vec::with_capacity(layer.corner.len());
        for &(_, f) in &order {
            let (from, to) = (level.faces.start[f as usize] as usize, level.faces.start[f as usize + 1] as usize);
            corner.extend_from_slice(&layer.corner[from..to]);
        }
        layer.corner = corner;
    }
    if !attributes.labels.is_empty() {
        attributes.labels = order.iter().map(|&(_, f)| attributes.labels[f as usize]).collect();
    }
    level.faces = faces;
    Some(place)
}

/// Whether more than an eighth of the elements reach far, or are far from the one before.
fn is_scattered(faces: &Faces) -> bool {
    let (mut wide, mut jumps, mut last) = (0, 0, 0u32);
    for f in faces.iter() {
        let (least, most) = f.iter().fold((u32::MAX, 0), |(lo, hi), &v| (lo.min(v), hi.max(v)));
        wide += usize::from(most.saturating_sub(least) > FAR);
        jumps += usize::from(least.abs_diff(last) > FAR);
        last = least;
    }
    wide.max(jumps) > faces.len() / 8
}

/// The place of each vertex on a Morton curve; vertices at one point keep their order.
fn along_curve(positions: &[[i32; 3]]) -> Vec<u32> {
    let mut least = [i32::MAX; 3];
    let mut most = [i32::MIN; 3];
    for p in positions {
        for k in 0..3 {
            least[k] = least[k].min(p[k]);
            most[k] = most[k].max(p[k]);
        }
    }
    let extent = (0..3).map(|k| most[k].abs_diff(least[k])).max().unwrap_or(0);
    let shift = (u32::BITS - extent.leading_zeros()).saturating_sub(BITS);
    let mut keys: Vec<(u64, u32)> = positions
        .par_iter()
        .enumerate()
        .map(|(v, p)| {
            let spread_out = |k: usize| spread(u64::from(p[k].abs_diff(least[k]) >> shift));
            (spread_out(0) | spread_out(1) << 1 | spread_out(2) << 2, v as u32)
        })
        .collect();
    keys.par_sort_unstable();
    let mut place = vec![0; positions.len()];
    for (new, &(_, old)) in keys.iter().enumerate() {
        place[old as usize] = new as u32;
    }
    place
}

/// Put two zero bits between any two of the low 21 bits.
fn spread(x: u64) -> u64 {
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid of quads whose vertices and elements are numbered by `number`, out of `side²`.
    fn grid(side: u32, number: impl Fn(u32) -> u32) -> Level {
        let mut positions = vec![[0; 3]; (side * side) as usize];
        let mut faces = Faces::new();
        for i in 0..side * side {
            positions[number(i) as usize] = [(i % side) as i32 - 7, (i / side) as i32 + 3, 0];
            if i % side + 1 < side && i / side + 1 < side {
                faces.push(&[i, i + 1, i + side + 1, i + side].map(&number));
            }
        }
        Level { positions, faces, shift: 0 }
    }

    /// The elements as points, each from its smallest corner, sorted: equal for equal meshes.
    fn shape(level: &Level) -> Vec<Vec<[i32; 3]>> {
        let mut shape: Vec<Vec<[i32; 3]>> = level
            .faces
            .iter()
            .map(|f| {
                let mut points: Vec<_> = f.iter().map(|&v| level.positions[v as usize]).collect();
                let first = (0..points.len()).min_by_key(|&i| points[i]).unwrap_or(0);
                points.rotate_left(first);
                points
            })
            .collect();
        shape.sort_unstable();
        shape
    }

    #[test]
    fn good_order_is_kept() {
        let mut level = grid(300, |i| i);
        let before = level.clone();
        assert_eq!(reorder(&mut level, &mut Attributes::default()), None);
        assert_eq!(level, before);
        // Too small to matter.
        assert_eq!(reorder(&mut grid(100, |i| i * 7919 % 10_000), &mut Attributes::default()), None);
    }

    #[test]
    fn scattered_order_becomes_near_and_the_mesh_stays() {
        let mut level = grid(300, |i| (u64::from(i) * 7919 % 90_000) as u32);
        let before = level.clone();
        let place = reorder(&mut level, &mut Attributes::default()).unwrap();
        assert!(!is_scattered(&level.faces));
        assert_eq!(shape(&level), shape(&before));
        for (old, p) in before.positions.iter().enumerate() {
            assert_eq!(level.positions[place[old] as usize], *p);
        }
    }

    #[test]
    fn the_curve_keeps_ties_in_order_and_takes_any_extent() {
        assert_eq!(along_curve(&[[5, 5, 5], [-9, 0, 0], [5, 5, 5]]), [1, 0, 2]);
        assert_eq!(along_curve(&[[i32::MAX; 3], [i32::MIN; 3], [0; 3]]), [2, 0, 1]);
        assert_eq!(along_curve(&[]), [0u32; 0]);
        assert_eq!(spread((1 << BITS) - 1), 0x1249_2492_4924_9249);
    }
}
