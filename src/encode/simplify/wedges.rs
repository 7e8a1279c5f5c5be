//! What a batch of collapses does to the attributes, by slots.
//!
//! Caillaud et al. 2016, section 4.1. When `a` and `b` become one vertex, a wedge of `a` and a wedge of `b` are *matchable* when an element that
//! holds both vertices has both wedges: they become one, with the value halfway. What no such element joins stays as it is. Where
//! several wedges are joined (a dart whose tip is `a` and whose mouth is open at `b`), all of them become one: the dart loses a step of
//! its length, and the value of the widest wedge of either side counts.
//!
//! A merged wedge keeps the number, its *slot*, of a wedge of `a`; slots of wedges that are gone keep the values that they had when they
//! went, so that the history need only tell the values of those that stay and change.

use crate::encode::sets::Sets;
use crate::format::attributes::Value;
use crate::format::complex::{Attributes, Coarsened, Faces, NONE, Side, Star, Wedges, middle};
use crate::parallel;

/// The values of a layer's wedges that a batch changes, and which corners have other wedges at the finer level.
#[derive(Clone, Debug, Default)]
pub struct StoredWedges {
    /// Split `i` owns `star[star_start[i] .. star_start[i + 1]]`.
    pub star_start: Vec<u32>,
    /// Elements around the merged vertex (by slot) whose wedge at the finer level is another: for one that grows two entries, the first
    /// child's before the second's.
    pub star: Vec<[u32; 2]>,
    /// For each triangle of the batch the wedges at the first child, at the second, at the apex.
    pub triangles: Vec<[u32; 3]>,
    /// For each dangling edge those at the children.
    pub edges: Vec<[u32; 2]>,
    /// Wedges of the coarser level whose values change.
    pub changed: Vec<u32>,
    /// Their values at the finer level.
    pub values: Vec<i32>,
}

/// Splits that one task follows.
const CHUNK: usize = 1024;

/// The place of vertex `v` in element `f`, counted over all corners.
#[inline]
fn corner_of(faces: &Faces, f: u32, v: u32) -> usize {
    faces.start[f as usize] as usize + faces.get(f).iter().position(|&x| x == v).unwrap_or(0)
}

/// The wedges of one of two vertices, joined by the elements that hold both.
#[derive(Default)]
struct Meeting {
    /// Wedges of both, in order, which vertex has them, how many corners, and the root of each.
    wedges: Vec<(u32, u8, u32)>,
    sets: Sets,
    order: Vec<(u32, usize)>,
    list: Vec<(u32, u8)>,
    joins: Vec<[u32; 2]>,
}

impl Meeting {
    fn gather(&mut self, faces: &Faces, star: &Star, layer: &Wedges, a: u32, b: u32) {
        self.list.clear();
        self.joins.clear();
        for (which, v, other) in [(0u8, a, b), (1, b, a)] {
            for &f in star.get(v) {
                let w = layer.corner[corner_of(faces, f, v)];
                if w == NONE {
                    continue;
                }
                self.list.push((w, which));
                if which == 0 && faces.get(f).contains(&other) {
                    self.joins.push([w, layer.corner[corner_of(faces, f, other)]]);
                }
            }
        }
        self.list.sort_unstable();
        self.wedges.clear();
        for run in self.list.chunk_by(|x, y| x == y) {
            self.wedges.push((run[0].0, run[0].1, run.len() as u32));
        }
        self.sets.reset(self.wedges.len() as u32);
        for k in 0..self.joins.len() {
            let [x, y] = self.joins[k].map(|w| self.wedges.partition_point(|e| e.0 < w));
            if y < self.wedges.len() {
                self.sets.join(x as u32, y as u32);
            }
        }
    }

    /// Calls `f` with each joined set: for each of the two vertices the wedge with most corners; and all wedges.
    fn sets(&mut self, mut f: impl FnMut([Option<(u32, u32)>; 2], &[(u32, usize)], &[(u32, u8, u32)])) {
        self.order.clear();
        for x in 0..self.wedges.len() {
            let root = self.sets.find(x as u32);
            self.order.push((root, x));
        }
        self.order.sort_unstable();
        for set in self.order.chunk_by(|x, y| x.0 == y.0) {
            let mut main = [None::<(u32, u32)>; 2];
            for &(_, y) in set {
                let (w, which, count) = self.wedges[y];
                let m = &mut main[which as usize];
                if m.is_none_or(|(c, _)| count > c) {
                    *m = Some((count, w));
                }
            }
            f(main, set, &self.wedges);
        }
    }
}

/// Which wedges merge into which, and what that does to values.
#[derive(Default)]
struct Merges {
    /// Wedge and what it becomes, where that is another.
    renamed: Vec<(u32, u32)>,
    /// Wedges that change, with the values before and after.
    changed: Vec<(u32, Value, Value)>,
}

fn merges(faces: &Faces, star: &Star, layer: &Wedges, pairs: &[[u32; 2]], bias: i32) -> Merges {
    let mut out = Merges::default();
    let mut meeting = Meeting::default();
    let value = |w: u32| {
        let mut v: Value = [0; 4];
        v[..layer.width].copy_from_slice(layer.value(w));
        v
    };
    for &[a, b] in pairs {
        meeting.gather(faces, star, layer, a, b);
        meeting.sets(|main, set, wedges| {
            let name = match main {
                [Some((m, x)), Some((n, y))] => {
                    let (p, q) = (value(x), value(y));
                    // The one with more corners keeps its number: less to note.
                    let (name, old) = if m < n { (y, q) } else { (x, p) };
                    let after = std::array::from_fn(|c| middle(p[c], q[c], bias));
                    if old != after {
                        out.changed.push((name, old, after));
                    }
                    name
                }
                [Some((_, x)), None] | [None, Some((_, x))] => x,
                [None, None] => return,
            };
            out.renamed.extend(set.iter().map(|&(_, y)| wedges[y].0).filter(|&w| w != name).map(|w| (w, name)));
        });
    }
    out
}

/// Follow a batch: the attributes of the coarser level, whose wedges go by slots, and what leads back.
pub fn collapse_wedges(
    c: &Coarsened,
    faces: &Faces,
    star: &Star,
    attributes: Attributes,
    face_slot: &[u32],
    bias: i32,
) -> (Attributes, Vec<StoredWedges>) {
    let labels = if attributes.labels.is_empty() {
        Vec::new()
    } else {
        c.element.iter().map(|&f| attributes.labels[f as usize]).collect()
    };
    let mut layers = Vec::new();
    let mut stored = Vec::new();
    for layer in attributes.layers {
        let (coarse, s) = follow_layer(c, faces, star, layer, face_slot, bias);
        layers.push(coarse);
        stored.push(s);
    }
    (Attributes { layers, labels }, stored)
}

fn follow_layer(
    c: &Coarsened,
    faces: &Faces,
    star: &Star,
    mut layer: Wedges,
    face_slot: &[u32],
    bias: i32,
) -> (Wedges, StoredWedges) {
    let all = parallel::map(c.pairs.chunks(CHUNK).collect(), |pairs| merges(faces, star, &layer, pairs, bias));
    let mut stored = StoredWedges { star_start: vec![0], ..StoredWedges::default() };
    let mut renamed: Vec<(u32, u32)> = Vec::new();
    for m in &all {
        renamed.extend_from_slice(&m.renamed);
        for (w, before, after) in &m.changed {
            stored.changed.push(*w);
            stored.values.extend_from_slice(&before[..layer.width]);
            layer.values[*w as usize * layer.width..][..layer.width].copy_from_slice(&after[..layer.width]);
        }
    }
    renamed.sort_unstable();
    let name = |w: u32| match renamed.binary_search_by_key(&w, |r| r.0) {
        Ok(i) => renamed[i].1,
        Err(_) => w,
    };
    // Corners of elements that nothing touched keep their wedges.
    let mut merged = vec![false; faces.len()];
    for &[a, b] in &c.pairs {
        star.get(a).iter().chain(star.get(b)).for_each(|&f| merged[f as usize] = true);
    }
    let coarse_faces = &c.level.faces;
    let mut corner = Vec::with_capacity(coarse_faces.corners.len());
    for (f, &e) in c.element.iter().enumerate() {
        let fine = faces.start[e as usize] as usize..faces.start[e as usize + 1] as usize;
        if !merged[e as usize] {
            corner.extend_from_slice(&layer.corner[fine]);
            continue;
        }
        let names = coarse_faces.get(f as u32);
        let own = &layer.corner[fine.clone()];
        let before = &faces.corners[fine];
        // An element that holds both ends has lost a corner: both have the same wedge now.
        let mut at = 0;
        for &v in names {
            while c.vertex[before[at] as usize] != v {
                at += 1;
            }
            corner.push(if own[at] == NONE { NONE } else { name(own[at]) });
            at += 1;
        }
    }
    let mut inserted = c.inserted.iter();
    for (i, &[a, b]) in c.pairs.iter().enumerate() {
        let v = c.batch.vertex[i];
        for (&f, &side) in c.star.get(v).iter().zip(c.batch.sides_of(i)) {
            let e = c.element[f as usize];
            let slot = face_slot[e as usize];
            let (x, y) = (|| layer.corner[corner_of(faces, e, a)], || layer.corner[corner_of(faces, e, b)]);
            match side {
                Side::One | Side::Two => {
                    let w = if side == Side::One { x() } else { y() };
                    if w != NONE && name(w) != w {
                        stored.star.push([slot, w]);
                    }
                }
                Side::Grow12 | Side::Grow21 => stored.star.extend([[slot, x()], [slot, y()]]),
            }
        }
        stored.star_start.push(stored.star.len() as u32);
        let ends = |e: u32| [layer.corner[corner_of(faces, e, a)], layer.corner[corner_of(faces, e, b)]];
        for _ in c.batch.triangles_of(i) {
            let e = *inserted.next().unwrap_or(&0);
            let [x, y] = ends(e);
            let apex = faces.get(e).iter().copied().find(|&p| p != a && p != b).unwrap_or(a);
            stored.triangles.push([x, y, layer.corner[corner_of(faces, e, apex)]]);
        }
        for _ in 0..c.batch.edges[i] {
            stored.edges.push(ends(*inserted.next().unwrap_or(&0)));
        }
    }
    (Wedges { width: layer.width, corner, values: layer.values }, stored)
}
