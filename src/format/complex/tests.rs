//! Inverse operators on random polygon soups: every element and vertex of the finer level comes back.

use super::*;
use proptest::prelude::*;

/// A soup: polygons of degree 2 to 6 over few vertices, so that everything unusual happens often.
pub(crate) fn soup() -> impl Strategy<Value = Level> {
    (2usize..40, any::<u64>()).prop_flat_map(|(n, _)| {
        let position = prop::array::uniform3(-300i32..300);
        let face = prop::collection::vec(0..n as u32, 2..7);
        (prop::collection::vec(position, n), prop::collection::vec(face, 0..50)).prop_map(|(positions, list)| {
            let mut faces = Faces::new();
            for mut f in list {
                let mut seen = Vec::new();
                f.retain(|v| {
                    !seen.contains(v) && {
                        seen.push(*v);
                        true
                    }
                });
                if f.len() >= 2 {
                    faces.push(&f);
                }
            }
            Level { positions, faces, shift: 0 }
        })
    })
}

/// A greedy independent set of legal edges, in an order that depends on `seed`.
pub(crate) fn independent(level: &Level, star: &Star, seed: u64) -> Vec<[u32; 2]> {
    let mut edges = Vec::new();
    for c in level.faces.iter() {
        for i in 0..c.len() {
            let (a, b) = (c[i], c[(i + 1) % c.len()]);
            edges.push([a.min(b), a.max(b)]);
        }
    }
    edges.sort_unstable();
    edges.dedup();
    edges.sort_by_key(|e| (e[0] as u64 * 7919 + e[1] as u64 * 104_729).wrapping_mul(seed | 1) >> 20 & 0xffff);
    let mut blocked = vec![false; level.positions.len()];
    edges.retain(|&[a, b]| {
        if blocked[a as usize] || blocked[b as usize] || !legal(&level.faces, star, a, b) {
            return false;
        }
        for v in [a, b] {
            for &f in star.get(v) {
                for &x in level.faces.get(f) {
                    blocked[x as usize] = true;
                }
            }
        }
        true
    });
    edges
}

pub(crate) fn same_cycle(a: &[u32], b: &[u32]) -> bool {
    a.len() == b.len() && (0..a.len().max(1)).any(|r| (0..a.len()).all(|i| a[i] == b[(i + r) % b.len()]))
}

/// For each vertex of what `refine` makes, the vertex of the finer level that it stands for.
pub(crate) fn back_to_fine(fine: &Level, c: &Coarsened, bias: i32) -> Result<(), TestCaseError> {
    let refined = refine(&c.level, c.star.clone(), &c.batch, bias, Wanted { star: true, element: true });
    let (again, parent) = (&refined.level, &refined.parent);
    let star = Star::fill(refined.star_start.clone(), &again.faces, true);
    prop_assert_eq!(star, Star::with_next(again.positions.len(), &again.faces));
    let mut of_coarse = vec![NONE; c.level.positions.len()];
    for (v, &w) in c.vertex.iter().enumerate().rev() {
        if w != NONE {
            of_coarse[w as usize] = v as u32;
        }
    }
    let mut new_vertices = c.new_vertices.iter();
    let names: Vec<u32> = (0..parent.len())
        .map(|v| match parent[v] {
            NONE => *new_vertices.next().unwrap(),
            p => match c.batch.vertex.binary_search(&p) {
                Ok(i) => c.pairs[i][(v > 0 && parent[v - 1] == p) as usize],
                Err(_) => of_coarse[p as usize],
            },
        })
        .collect();
    prop_assert_eq!(names.len(), fine.positions.len());
    for (v, &name) in names.iter().enumerate() {
        prop_assert_eq!(again.positions[v], fine.positions[name as usize]);
    }
    prop_assert_eq!(again.faces.len(), fine.faces.len());
    let mut seen = vec![false; fine.faces.len()];
    for f in 0..again.faces.len() {
        let e = refined.element[f];
        let old = if e & NEW != 0 { c.inserted[(e & !NEW) as usize] } else { c.element[e as usize] };
        prop_assert!(!std::mem::replace(&mut seen[old as usize], true));
        let named: Vec<u32> = again.faces.get(f as u32).iter().map(|&v| names[v as usize]).collect();
        prop_assert!(same_cycle(&named, fine.faces.get(old)), "{named:?} {:?}", fine.faces.get(old));
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn refine_undoes_coarsen_down_to_the_base(level in soup(), seed in any::<u64>(), alpha in 0u8..60) {
        let mut level = level;
        for step in 0..60u64 {
            let star = Star::build(level.positions.len(), &level.faces);
            let edges = independent(&level, &star, seed ^ step);
            let leaving: Vec<u32> = (0..level.positions.len() as u32).filter(|&v| star.get(v).is_empty() && v as u64 % 3 == step % 3).collect();
            if edges.is_empty() && leaving.is_empty() && step > 3 {
                break;
            }
            let place = Placement { shift: level.shift + (step % 4 == 1) as u8, alpha, bias: (step & 1) as i32 };
            let c = coarsen(&level, &star, &edges, &leaving, place);
            prop_assert_eq!(&c.star, &Star::build(c.level.positions.len(), &c.level.faces));
            for f in c.level.faces.iter() {
                prop_assert!(f.len() >= 2 && (0..f.len()).all(|i| !f[..i].contains(&f[i])));
            }
            back_to_fine(&level, &c, place.bias)?;
            level = c.level;
        }
    }
}
