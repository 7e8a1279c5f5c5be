//! The generic edge collapse, a batch at a time: finer level and independent edges in, coarser level and batch out.
//!
//! Caillaud et al. 2016, section 4.1, with levels as multisets (`docs/design/operator.md`): elements that become equal
//! stay. A triangle at the collapsed edge vanishes; where it was the last to hold the edge to its third vertex, it
//! stays as a dangling edge. Larger elements lose a corner.
//!
//! Invariants asked of the caller: no element and no edge touches two of the edges; no element holds both ends of an
//! edge other than in consecutive corners ([`legal`]).

use super::batch::{Batch, Inserted, NONE, Side, Split};
use super::placement::{compensation, midpoint};
use super::{Faces, Level, Star};

/// Whether the collapse of `(a, b)` is one that a split can undo: every element that holds both holds them in
/// consecutive corners.
pub fn legal(faces: &Faces, star: &Star, a: u32, b: u32) -> bool {
    star.get(a).iter().all(|&f| {
        let c = faces.get(f);
        if c.len() <= 3 || !c.contains(&b) {
            return true;
        }
        let at = c.iter().position(|&x| x == a).unwrap_or(0);
        c[(at + 1) % c.len()] == b || c[(at + c.len() - 1) % c.len()] == b
    })
}

/// What [`coarsen`] makes.
#[derive(Clone, Debug)]
pub struct Coarsened {
    /// The coarser level.
    pub level: Level,
    /// Its stars.
    pub star: Star,
    /// The batch that leads back.
    pub batch: Batch,
    /// For each vertex of the finer level its vertex in the coarser one, [`NONE`] for one that left.
    pub vertex: Vec<u32>,
    /// For each split the finer vertices that its children stand for.
    pub pairs: Vec<[u32; 2]>,
    /// For each element of the coarser level its element in the finer one.
    pub element: Vec<u32>,
    /// For each element that the batch inserts (in the order of [`super::Refined::element`]) its element in the finer level.
    pub inserted: Vec<u32>,
    /// The finer vertices that the new vertices stand for.
    pub new_vertices: Vec<u32>,
}

/// How a coarser level is placed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Placement {
    /// Its shift, at least that of the finer level.
    pub shift: u8,
    /// Curvature compensation in 1/256.
    pub alpha: u8,
    /// Rounding of midpoints, 0 or 1.
    pub bias: i32,
}

/// Collapse `edges` and let the isolated vertices `leaving` go.
pub fn coarsen(level: &Level, star: &Star, edges: &[[u32; 2]], leaving: &[u32], place: Placement) -> Coarsened {
    let fine = level.positions.len();
    let down = (place.shift - level.shift) as u32;
    let positions: Vec<[i32; 3]> = level.positions.iter().map(|p| p.map(|c| c >> down)).collect();

    // Numbering: the merged vertex takes the place of its smaller end.
    let mut partner = vec![NONE; fine];
    for &[a, b] in edges {
        partner[a as usize] = b;
        partner[b as usize] = a;
    }
    let mut leaves = vec![false; fine];
    for &v in leaving {
        leaves[v as usize] = true;
    }
    let mut vertex = vec![NONE; fine];
    let mut n = 0u32;
    for v in 0..fine {
        if leaves[v] || (partner[v] != NONE && (partner[v] as usize) < v) {
            continue;
        }
        vertex[v] = n;
        n += 1;
    }
    for v in 0..fine {
        if partner[v] != NONE && (partner[v] as usize) < v {
            vertex[v] = vertex[partner[v] as usize];
        }
    }

    // Which elements vanish: 0 stays, 1 vanishes, 2 loses its corner at the larger end.
    let mut fate = vec![0u8; level.faces.len()];
    let mut third: Vec<(u32, u32)> = Vec::new();
    for &[a, b] in edges {
        third.clear();
        for &f in star.get(a) {
            let c = level.faces.get(f);
            if !c.contains(&b) {
                continue;
            }
            match c.len() {
                2 => fate[f as usize] = 1,
                3 => {
                    let x = c.iter().copied().find(|&x| x != a && x != b).unwrap_or(a);
                    third.push((x, f));
                    fate[f as usize] = 1;
                }
                _ => fate[f as usize] = 2,
            }
        }
        third.sort_unstable();
        for k in 0..third.len() {
            let (x, f) = third[k];
            if k > 0 && third[k - 1].0 == x {
                continue;
            }
            // An element with such an edge is in both stars: the smaller is searched, or a hub would cost the square of its valence.
            let holds = |&g: &u32| {
                let d = level.faces.get(g);
                fate[g as usize] != 1
                    && (0..d.len()).any(|i| {
                        let (p, q) = (d[i], d[(i + 1) % d.len()]);
                        (p == x && (q == a || q == b)) || (q == x && (p == a || p == b))
                    })
            };
            let held = if star.get(x).len() > star.get(a).len() + star.get(b).len() {
                star.get(a).iter().chain(star.get(b)).any(holds)
            } else {
                star.get(x).iter().any(holds)
            };
            if !held {
                fate[f as usize] = 2;
            }
        }
    }

    // The coarser elements.
    let mut faces = Faces {
        start: Vec::with_capacity(level.faces.len() + 1),
        corners: Vec::with_capacity(level.faces.corners.len()),
    };
    faces.start.push(0);
    let mut element = Vec::with_capacity(level.faces.len());
    let mut new_element = vec![NONE; level.faces.len()];
    for f in 0..level.faces.len() {
        if fate[f] == 1 {
            continue;
        }
        for &v in level.faces.get(f as u32) {
            // An element that holds both ends names the merged vertex once, at its smaller end.
            if fate[f] == 2 && partner[v as usize] < v && level.faces.get(f as u32).contains(&partner[v as usize]) {
                continue;
            }
            faces.corners.push(vertex[v as usize]);
        }
        faces.start.push(faces.corners.len() as u32);
        new_element[f] = element.len() as u32;
        element.push(f as u32);
    }
    let coarse_star = Star::build(n as usize, &faces);

    // The batch, in order of the merged vertex.
    let mut pairs: Vec<[u32; 2]> = edges.iter().map(|&[a, b]| [a.min(b), a.max(b)]).collect();
    pairs.sort_unstable();
    let mut batch = Batch { alpha: place.alpha, shift: level.shift, ..Batch::default() };
    let mut inserted = Vec::new();
    let mut split = Split::default();
    for &[a, b] in &pairs {
        let v = vertex[a as usize];
        let around = coarse_star.get(v);
        split.reset(around.len());
        for (side, &f) in split.sides.iter_mut().zip(around) {
            let c = level.faces.get(element[f as usize]);
            let (at_a, at_b) = (c.iter().position(|&x| x == a), c.iter().position(|&x| x == b));
            *side = match (at_a, at_b) {
                (Some(_), None) => Side::One,
                (None, Some(_)) => Side::Two,
                (Some(i), _) if c[(i + 1) % c.len()] == b => Side::Grow12,
                _ => Side::Grow21,
            };
        }
        let mut new: Vec<(Inserted, u32)> = Vec::new();
        let mut dangling = Vec::new();
        for &f in star.get(a) {
            let c = level.faces.get(f);
            if fate[f as usize] != 1 || !c.contains(&b) {
                continue;
            }
            if c.len() == 2 {
                dangling.push(f);
                continue;
            }
            let i = c.iter().position(|&x| x == a).unwrap_or(0);
            let reversed = c[(i + 1) % 3] != b;
            let x = c.iter().copied().find(|&x| x != a && x != b).unwrap_or(a);
            new.push((Inserted { apex: vertex[x as usize], reversed }, f));
        }
        new.sort_unstable();
        for &(t, f) in &new {
            split.triangles.push(t);
            inserted.push(f);
        }
        split.edges = dangling.len() as u32;
        inserted.extend(dangling);
        let (p, q) = (positions[a as usize], positions[b as usize]);
        batch.push(v, &split, std::array::from_fn(|k| p[k] - q[k]));
    }

    // Positions.
    let mut coarse = Level { positions: vec![[0; 3]; n as usize], faces, shift: place.shift };
    for v in 0..fine {
        if vertex[v] != NONE {
            coarse.positions[vertex[v] as usize] = positions[v];
        }
    }
    for &[a, b] in &pairs {
        coarse.positions[vertex[a as usize] as usize] =
            midpoint(positions[a as usize], positions[b as usize], place.bias);
    }
    if place.alpha > 0 {
        let mut merged = vec![false; n as usize];
        for &v in &batch.vertex {
            merged[v as usize] = true;
        }
        let off: Vec<[i32; 3]> =
            batch.vertex.iter().map(|&v| compensation(&coarse, &coarse_star, &merged, v, place.alpha)).collect();
        for (&v, o) in batch.vertex.iter().zip(off) {
            let p = &mut coarse.positions[v as usize];
            for k in 0..3 {
                p[k] += o[k];
            }
        }
    }

    let new_vertices: Vec<u32> = leaving.to_vec();
    batch.new_vertices = new_vertices.iter().map(|&v| positions[v as usize]).collect();
    if down > 0 {
        // In the order of the finer level that `refine` makes: children in place of their parent, new vertices last.
        let low = |v: u32| level.positions[v as usize].map(|c| (c & ((1 << down) - 1)) as u16);
        let mut pair = pairs.iter().peekable();
        for v in 0..fine as u32 {
            if leaves[v as usize] || (partner[v as usize] != NONE && partner[v as usize] < v) {
                continue;
            }
            batch.low_bits.push(low(v));
            if pair.peek().is_some_and(|p| p[0] == v) {
                batch.low_bits.push(low(partner[v as usize]));
                pair.next();
            }
        }
        batch.low_bits.extend(new_vertices.iter().map(|&v| low(v)));
    }
    Coarsened { level: coarse, star: coarse_star, batch, vertex, pairs, element, inserted, new_vertices }
}
