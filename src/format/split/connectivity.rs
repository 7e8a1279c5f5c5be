//! How a vertex splits: which elements go to which child, and what appears between them.
//!
//! Core paper section 5.3 and Figure 6, rearranged (`docs/format/connectivity.md` has the table). A star that is a fan
//! and is cut at one or two *loci* (an edge, where a triangle appears, or an element, which grows) takes the fast path:
//! one symbol among all pairs of loci, each scored by integers from the ring. The weights of the scores follow what was
//! seen (one step of gradient descent on the code length after each split, in fixed point). Everything else goes
//! element by element and neighbour by neighbour.

use crate::format::coder::range::{Bit, Coder, exp_golomb};
use crate::format::complex::placement::root;
use crate::format::complex::{Inserted, Side, Split};
use crate::format::split::fan::{OrderedStar, Shape};
use crate::format::split::neighbourhood::{LevelGeometry, Neighbourhood};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// `2^(−i/64)`, of 32768.
const EXP: [u32; 64] = [
    32768, 32415, 32066, 31720, 31379, 31041, 30706, 30376, 30048, 29725, 29405, 29088, 28774, 28464, 28158, 27855,
    27554, 27258, 26964, 26674, 26386, 26102, 25821, 25543, 25268, 24995, 24726, 24460, 24196, 23936, 23678, 23423,
    23170, 22921, 22674, 22430, 22188, 21949, 21713, 21479, 21247, 21019, 20792, 20568, 20347, 20127, 19911, 19696,
    19484, 19274, 19066, 18861, 18658, 18457, 18258, 18061, 17867, 17674, 17484, 17296, 17109, 16925, 16743, 16562,
];

const VALENCES: usize = 12;
const DEGREES: usize = 6;
const CHILD: usize = 14;
const SCALARS: usize = 3;

/// Adaptive models of connectivity.
#[derive(Clone, Debug)]
pub struct ConnectivityModels {
    /// Fast road or general road.
    fast: [Bit; 2],
    /// One locus or two, in an open fan.
    single: Bit,
    /// How many of the loci are elements.
    faces: [[Bit; 2]; 24],
    /// Weights in 1/65536 bit.
    edge: [i32; VALENCES],
    face: [i32; DEGREES],
    child: [i32; CHILD],
    scalar: [i32; SCALARS],
    border: i32,
    seen: u32,
    general: GeneralModels,
}

#[derive(Clone, Debug)]
struct GeneralModels {
    grow: [Bit; 32],
    side: [Bit; 64],
    count: [[Bit; 3]; 32],
    many: [Bit; 64],
    reversed: [Bit; 4],
    edges: [Bit; 4],
    more_edges: [Bit; 64],
}

impl Default for ConnectivityModels {
    fn default() -> Self {
        ConnectivityModels {
            fast: [Bit::with(60000), Bit::with(50000)],
            single: Bit::default(),
            faces: [[Bit::with(6000); 2]; 24],
            edge: START_EDGE,
            face: START_FACE,
            child: START_CHILD,
            scalar: START_SCALAR,
            border: 0,
            seen: 0,
            general: GeneralModels {
                grow: [Bit::with(8000); 32],
                side: [Bit::default(); 64],
                count: [[Bit::default(); 3]; 32],
                many: [Bit::default(); 64],
                reversed: [Bit::default(); 4],
                edges: [Bit::default(); 4],
                more_edges: [Bit::default(); 64],
            },
        }
    }
}

/// Where the weights start: about the mean of what eight meshes ended with.
const START_EDGE: [i32; VALENCES] = [0, 0, 0, 26214, 19661, -19661, -52429, -26214, -3277, 9830, 6554, 6554];
const START_FACE: [i32; DEGREES] = [131072, -163840, -98304, -65536, -65536, -65536];
const START_CHILD: [i32; CHILD] =
    [-196608, -196608, -131072, 19661, 65536, 58982, 19661, -13107, -32768, -26214, -19661, -13107, -13107, -13107];
const START_SCALAR: [i32; SCALARS] = [-393216, -131072, -170394];

/// Buffers reused from split to split.
#[derive(Clone, Debug, Default)]
pub struct ConnectivityScratch {
    loci: Vec<Locus>,
    pairs: Vec<Pair>,
    freqs: Vec<u32>,
    cosines: Vec<i32>,
    trial: Split,
    attach: Vec<(bool, bool, u32, u8)>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Locus {
    /// Place along the fan: 2·edge or 2·element + 1.
    at: u16,
    /// Index of the weight of its kind.
    class: u8,
    /// Length of the edge to it over the mean, less one, in 1/256, at most 3.
    len: i32,
    /// Direction to it, length 256.
    dir: [i32; 3],
    score: i32,
}

#[derive(Clone, Copy, Debug)]
struct Pair {
    /// The loci, by number; `u8::MAX` for none.
    p: u8,
    q: u8,
    /// Ring vertices of the first child.
    n1: u8,
    /// Cosine of the angle between the loci, in 1/256.
    cos: i16,
}

/// What the fast road says about a split: the places of the loci.
fn expand(around: &OrderedStar, p: u16, q: Option<u16>, split: &mut Split) {
    split.reset(around.spokes.len());
    let end = q.unwrap_or(u16::MAX);
    for (i, s) in around.spokes.iter().enumerate() {
        let at = 2 * i as u16 + 1;
        split.sides[s.place as usize] = if at == p {
            Side::Grow12
        } else if at == end {
            Side::Grow21
        } else if p < at && at < end {
            Side::One
        } else {
            Side::Two
        };
    }
    if p & 1 == 0 {
        split.triangles.push(Inserted { apex: around.ring[p as usize / 2], reversed: false });
    }
    if let Some(q) = q
        && q & 1 == 0
    {
        split.triangles.push(Inserted { apex: around.ring[q as usize / 2], reversed: true });
    }
}

/// The loci of a split if the fast road can say it; `trial` then holds what it says, and the flag tells whether the
/// children change places.
fn fast_form(around: &OrderedStar, want: &Split, trial: &mut Split) -> Option<(u16, Option<u16>, bool)> {
    if around.shape == Shape::General || want.edges != 0 {
        return None;
    }
    let mut at = [0u16; 3];
    let mut n = 0;
    let mut put = |x: u16| {
        if n < 3 {
            at[n] = x;
        }
        n += 1;
    };
    for t in &want.triangles {
        put(2 * around.ring.iter().position(|&r| r == t.apex)? as u16);
    }
    for (i, s) in around.spokes.iter().enumerate() {
        if want.sides[s.place as usize] as u8 >= Side::Grow12 as u8 {
            put(2 * i as u16 + 1);
        }
    }
    let (p, q) = match n {
        1 if around.shape == Shape::Open => (at[0], None),
        2 if at[0] != at[1] => (at[0].min(at[1]), Some(at[0].max(at[1]))),
        _ => return None,
    };
    expand(around, p, q, trial);
    for swap in [false, true] {
        if swap {
            trial.swap();
        }
        let same = trial.sides == want.sides
            && trial.triangles.len() == want.triangles.len()
            && trial.triangles.iter().all(|t| want.triangles.contains(t));
        if same {
            expand(around, p, q, trial);
            return Some((p, q, swap));
        }
    }
    None
}

/// Code the connectivity of the split of `v`, whose patch is ordered.
///
/// Encoding, `split` is what is wanted and becomes the canonical form of it; the result tells whether the children change
/// places. Decoding, `split` becomes what the stream says; the result is `None` when that makes no sense. `room` is how many
/// triangles all segments of the batch may still list on the general road, so that no list is longer than the header says.
pub fn code_connectivity<C: Coder>(
    coder: &mut C,
    m: &mut ConnectivityModels,
    scratch: &mut ConnectivityScratch,
    view: &LevelGeometry,
    patch: &Neighbourhood,
    split: &mut Split,
    room: &AtomicU64,
) -> Option<bool> {
    let around = &patch.around;
    let fan = around.shape != Shape::General;
    let mut form = None;
    if fan && !C::DECODING {
        form = fast_form(around, split, &mut scratch.trial);
    }
    if fan && coder.bit(&mut m.fast[(around.shape == Shape::Open) as usize], form.is_some()) {
        let (p, q, swap) = form.unwrap_or((0, None, false));
        let (p, q) = code_loci(coder, m, scratch, view, patch, p, q)?;
        expand(around, p, q, split);
        return Some(swap);
    }
    code_general(coder, &mut m.general, scratch, around, split, room)
}

fn code_loci<C: Coder>(
    coder: &mut C,
    m: &mut ConnectivityModels,
    scratch: &mut ConnectivityScratch,
    view: &LevelGeometry,
    patch: &Neighbourhood,
    p: u16,
    q: Option<u16>,
) -> Option<(u16, Option<u16>)> {
    let around = &patch.around;
    let open = around.shape == Shape::Open;
    let single = open && coder.bit(&mut m.single, q.is_none());
    // How many loci are elements rather than edges.
    let triangles = around.spokes.iter().filter(|s| s.degree == 3).count();
    let mix = if triangles == around.spokes.len() { 0 } else { 1 + (4 * triangles / around.spokes.len()).min(3) };
    let context = &mut m.faces[mix * 3 + if open { 1 + single as usize } else { 0 }];
    let have = (p & 1) + q.map_or(0, |q| q & 1);
    let mut count = coder.bit(&mut context[0], have > 0) as u16;
    if count == 1 && !single {
        count += coder.bit(&mut context[1], have > 1) as u16;
    }

    // Score the loci.
    let ConnectivityScratch { loci, pairs, freqs, cosines, .. } = scratch;
    loci.clear();
    let n = around.ring.len();
    let scale = (1i64 << 32) / patch.mean;
    let mut locus = |at: u16, class: u8, r: [i64; 3], weights: &[i32], w_len: i32| {
        // The ring vector over the mean, in 1/256.
        let v = r.map(|c| (c * scale >> 16).clamp(-(1 << 24), 1 << 24));
        let len = root((v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) as u64) as i64;
        let inverse = (1i64 << 24) / len.max(1);
        let len = len.min(1023) as i32 - 256;
        loci.push(Locus {
            at,
            class,
            len,
            dir: [(v[0] * inverse >> 16) as i32, (v[1] * inverse >> 16) as i32, (v[2] * inverse >> 16) as i32],
            score: weights[class as usize] + (w_len * len >> 8),
        });
    };
    for k in 0..n {
        let r = patch.ring[k];
        if count < 2 {
            let valence = view.star.get(around.ring[k]).len().min(VALENCES - 1);
            locus(2 * k as u16, valence as u8, r, &m.edge, m.scalar[0]);
        }
        if count > 0 && k < around.spokes.len() {
            let next = patch.ring[if k + 1 == n { 0 } else { k + 1 }];
            let mid = [(r[0] + next[0]) / 2, (r[1] + next[1]) / 2, (r[2] + next[2]) / 2];
            let class = (around.spokes[k].degree as usize - 3).min(DEGREES - 1) as u8;
            locus(2 * k as u16 + 1, class, mid, &m.face, m.scalar[1]);
        }
    }

    // Score the candidates: what the loci say, how many neighbours each child gets, and the angle between the loci.
    pairs.clear();
    freqs.clear();
    let last = 2 * (n as u16 - 1);
    let bend = m.scalar[2];
    // By the number of ring vertices of v1; those of both children sum up to `both`.
    let both = if single { n + 1 - count as usize } else { n + 2 - count as usize };
    let mut children = [0i32; RING];
    for (n1, score) in children[..=both].iter_mut().enumerate() {
        *score = m.child[n1.min(CHILD - 1)] + m.child[(both - n1).min(CHILD - 1)];
    }
    // Loci of one kind in rows: (0, 1), (0, 2), …, (1, 2), …; so nothing need be kept of a pair but its cosine.
    let rows = !single && count != 1;
    // In a row, v1 has this many ring vertices at least.
    let fewest = if count == 0 { 2 } else { 1 };
    if rows {
        let size = loci.len() * loci.len().saturating_sub(1) / 2;
        freqs.resize(size, 0);
        cosines.clear();
        cosines.resize(size, 0);
        let (mut scores, mut cosines) = (freqs.as_mut_slice(), cosines.as_mut_slice());
        for (i, a) in loci.iter().enumerate() {
            let others = &loci[i + 1..];
            let (row, scores_left) = std::mem::take(&mut scores).split_at_mut(others.len());
            let (angles, cosines_left) = std::mem::take(&mut cosines).split_at_mut(others.len());
            for (((score, angle), b), child) in row.iter_mut().zip(&mut *angles).zip(others).zip(&children[fewest..]) {
                let cos = (a.dir[0] * b.dir[0] + a.dir[1] * b.dir[1] + a.dir[2] * b.dir[2]) >> 8;
                *angle = cos;
                *score = (a.score + b.score + child + (bend * cos >> 8)) as u32;
            }
            if open && count == 0 {
                let bordering = if i == 0 { 0 } else { others.len().saturating_sub(1) };
                for score in &mut row[bordering..] {
                    *score = score.wrapping_add(m.border as u32);
                }
            }
            (scores, cosines) = (scores_left, cosines_left);
        }
    } else {
        for (i, a) in loci.iter().enumerate() {
            // Ring vertices of v1: from the first at or behind `a` to the last at or before `b`.
            let from = (a.at as usize).div_ceil(2);
            if single {
                if a.at & 1 == count {
                    let n1 = n - from;
                    pairs.push(Pair { p: i as u8, q: u8::MAX, n1: n1 as u8, cos: 0 });
                    freqs.push((a.score + children[n1]) as u32);
                }
                continue;
            }
            for (j, b) in loci.iter().enumerate().skip(i + 1) {
                if (a.at ^ b.at) & 1 == 0 {
                    continue;
                }
                let n1 = b.at as usize / 2 + 1 - from;
                let cos = (a.dir[0] * b.dir[0] + a.dir[1] * b.dir[1] + a.dir[2] * b.dir[2]) >> 8;
                let mut s = a.score + b.score + children[n1] + (bend * cos >> 8);
                if open && (a.at == 0 || b.at == last) {
                    s += m.border;
                }
                pairs.push(Pair { p: i as u8, q: j as u8, n1: n1 as u8, cos: cos as i16 });
                freqs.push(s as u32);
            }
        }
    }
    if freqs.is_empty() {
        return None;
    }
    let mut want = 0;
    if !C::DECODING {
        let find = |at: u16| loci.iter().position(|l| l.at == at);
        let (i, j) = (find(p)?, q.map_or(Some(usize::MAX), find)?);
        want = if rows {
            i * (2 * loci.len() - i - 1) / 2 + (j - i - 1)
        } else {
            pairs.iter().position(|x| x.p as usize == i && (x.q as usize == j || single))?
        };
    }
    let best = freqs.iter().fold(i32::MIN, |best, &f| best.max(f as i32));
    let mut total = 0u32;
    for f in freqs.iter_mut() {
        let below = (best - *f as i32) as u32 >> 10;
        *f = (EXP[(below & 63) as usize] >> (below >> 6).min(31)).max(1);
        total += *f;
    }
    let chosen = coder.symbol(freqs, total, want);

    // Follow what was seen: one step down the gradient of the code length.
    m.seen = m.seen.saturating_add(1);
    let rate = if m.seen <= 256 {
        5
    } else if m.seen <= 2048 {
        6
    } else {
        7
    };
    let inverse = (1u64 << 40) / total as u64;
    let mut mass = [0i32; RING];
    let mut seen = [0i32; RING];
    let mut bends = 0i32;
    let mut borders = 0;
    let share = |f: u32| -(((f as u64 * inverse) >> 24) as i32);
    let picked;
    if rows {
        let (mut freqs, mut cosines, mut left) = (&freqs[..], &cosines[..], chosen);
        let mut pair = (0, 0);
        for i in 0..loci.len() {
            let others = loci.len() - i - 1;
            let (row, freqs_left) = freqs.split_at(others);
            let (angles, cosines_left) = cosines.split_at(others);
            let mut own = 0;
            for (((&f, &cos), mass), seen) in row.iter().zip(angles).zip(&mut mass[i + 1..]).zip(&mut seen[fewest..]) {
                let g = share(f);
                own += g;
                *mass += g;
                *seen += g;
                bends += g * cos >> 8;
            }
            if left < others {
                pair = (i, i + 1 + left);
                own += 65536;
                mass[pair.1] += 65536;
                seen[fewest + left] += 65536;
                bends += 256 * angles[left];
                left = usize::MAX;
            } else if left != usize::MAX {
                left -= others;
            }
            mass[i] += own;
            if open && count == 0 && others > 0 {
                let hit = |j: usize| if pair == (i, j) && left == usize::MAX { 65536 } else { 0 };
                borders += if i == 0 { own } else { share(row[others - 1]) + hit(loci.len() - 1) };
            }
            (freqs, cosines) = (freqs_left, cosines_left);
        }
        picked = (loci[pair.0].at, Some(loci[pair.1].at));
    } else {
        for (k, (pair, &f)) in pairs.iter().zip(freqs.iter()).enumerate() {
            let g = ((k == chosen) as i32) * 65536 + share(f);
            mass[pair.p as usize] += g;
            mass[pair.q as usize & (RING - 1)] += g;
            seen[pair.n1 as usize] += g;
            bends += g * pair.cos as i32 >> 8;
            if open && pair.q != u8::MAX && (loci[pair.p as usize].at == 0 || loci[pair.q as usize].at == last) {
                borders += g;
            }
        }
        let pair = pairs[chosen];
        picked = (loci[pair.p as usize].at, (pair.q != u8::MAX).then(|| loci[pair.q as usize].at));
    }
    let limit = |w: i32| w.clamp(-(12 << 16), 12 << 16);
    for (l, &g) in loci.iter().zip(&mass) {
        let (w, s) = if l.at & 1 == 0 {
            (&mut m.edge[l.class as usize], &mut m.scalar[0])
        } else {
            (&mut m.face[l.class as usize], &mut m.scalar[1])
        };
        *w = limit(*w + (g >> rate));
        *s = limit(*s + (((g as i64 * l.len as i64) >> 8) >> rate) as i32);
    }
    for (n1, &g) in seen[..=both].iter().enumerate() {
        for n in [n1, both - n1] {
            let w = &mut m.child[n.min(CHILD - 1)];
            *w = limit(*w + (g >> rate));
        }
    }
    m.scalar[2] = limit(m.scalar[2] + (bends >> rate));
    m.border = limit(m.border + (borders >> rate));
    Some(picked)
}

/// Loci of a fan, and ring vertices of both children, are fewer than this.
const RING: usize = 128;

/// The general road: a side for each element, a number of triangles for each neighbour, a number of dangling edges.
fn code_general<C: Coder>(
    coder: &mut C,
    m: &mut GeneralModels,
    scratch: &mut ConnectivityScratch,
    around: &OrderedStar,
    split: &mut Split,
    room: &AtomicU64,
) -> Option<bool> {
    let fan = around.shape != Shape::General;
    let trial = &mut scratch.trial;
    trial.reset(around.spokes.len());
    // The first element says which child is the first.
    let swap = !C::DECODING
        && around.spokes.first().is_some_and(|s| matches!(split.sides[s.place as usize], Side::Two | Side::Grow21));
    if swap {
        split.swap();
    }
    // For each neighbour: does the first child have it, the second, in how many elements, and which orientation is expected.
    let attach = &mut scratch.attach;
    attach.clear();
    attach.resize(around.ring.len(), (false, false, 0, 0));
    let find = |x: u32| {
        if fan {
            around.ring.iter().position(|&r| r == x).unwrap_or(0)
        } else {
            around.ring.binary_search(&x).unwrap_or(0)
        }
    };
    for (i, s) in around.spokes.iter().enumerate() {
        let (next, prev) = (find(s.next), find(s.prev));
        let side = if C::DECODING { Side::One } else { split.sides[s.place as usize] };
        let hints = |x: usize| attach[x].0 as usize + 2 * attach[x].1 as usize;
        let (h1, h2) = (hints(next), hints(prev));
        let context = (h1.min(h2) * 4 + h1.max(h2)) * 2 + (s.degree == 2) as usize;
        let grows = coder.bit(&mut m.grow[context], side as u8 >= 2);
        let second = if i == 0 && (s.degree > 2 || !grows) {
            false
        } else {
            coder.bit(&mut m.side[(h1 * 4 + h2) * 2 + grows as usize], side as u8 & 1 == 1)
        };
        let side = match (grows, second) {
            (false, false) => Side::One,
            (false, true) => Side::Two,
            (true, false) => Side::Grow12,
            (true, true) => Side::Grow21,
        };
        trial.sides[s.place as usize] = side;
        // The element holds prev → v → next.
        let (of_prev, of_next) = match side {
            Side::One => (0, 0),
            Side::Two => (1, 1),
            Side::Grow12 => (0, 1),
            Side::Grow21 => (1, 0),
        };
        for (x, child, incoming) in [(prev, of_prev, true), (next, of_next, false)] {
            let a = &mut attach[x];
            if child == 0 {
                a.0 = true;
            } else {
                a.1 = true;
            }
            a.2 += 1;
            if s.degree > 2 {
                // Across x → v1 a triangle should hold v1 → x, which is (v2, v1, x); across v1 → x it is (v1, v2, x).
                a.3 |= if (child == 0) == incoming { 2 } else { 1 };
            }
        }
    }
    let mut any = trial.sides.iter().any(|&s| s as u8 >= 2);
    for (k, &x) in around.ring.iter().enumerate() {
        let (one, two, elements, expected) = attach[k];
        let context = (one as usize + 2 * two as usize) * 4 + (elements.min(4) - 1).min(3) as usize;
        let have = if C::DECODING { 0 } else { split.triangles.iter().filter(|t| t.apex == x).count() as u32 };
        let mut n = 0u32;
        while n < 3 && coder.bit(&mut m.count[context][n as usize], have > n) {
            n += 1;
        }
        if n == 3 {
            n = n.saturating_add(exp_golomb(coder, &mut m.many, have.wrapping_sub(3)));
        }
        if C::DECODING && n > 0 {
            room.fetch_update(Relaxed, Relaxed, |r| r.checked_sub(n as u64)).ok()?;
        }
        let reversed =
            if C::DECODING { 0 } else { split.triangles.iter().filter(|t| t.apex == x && t.reversed).count() as u32 };
        for j in 0..n {
            let r = coder.bit(&mut m.reversed[expected as usize], j >= n - reversed.min(n));
            trial.triangles.push(Inserted { apex: x, reversed: r });
        }
        any |= n > 0;
    }
    let mut edges = 0;
    let context = 2 * around.spokes.is_empty() as usize + any as usize;
    if !any || coder.bit(&mut m.edges[context], split.edges > 0) {
        edges = exp_golomb(coder, &mut m.more_edges, split.edges.wrapping_sub(1)).saturating_add(1);
    }
    trial.edges = edges;
    std::mem::swap(split, trial);
    Some(swap)
}
