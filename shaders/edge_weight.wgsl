// The weight of an edge: what its collapse to the midpoint costs. One invocation an edge: gathers the patch from the
// level, then measures it. CPU twin: `src/metric/kernel.rs`, explained in `src/metric/weight.rs`.
//#include "triangle.wgsl"
//#include "level.wgsl"
//#include "patch.wgsl"

const FOLDS: u32 = 0x100u;
const SLIVER: f32 = 1e-4;
const SPOKES: u32 = 64u;

/// The ring in the frame of the patch.
var<private> flat: array<vec3<f32>, RING>;
/// Ring vertex of each spoke before, times two, plus one if it begins at `b`.
var<private> spokes: array<u32, SPOKES>;

fn end_of(t: u32) -> vec3<f32> {
    return select(-half, half, (t & AT_B) != 0u);
}

/// Squared distances from `x` and `y` to the patch after.
fn to_after(x: vec3<f32>, y: vec3<f32>) -> vec2<f32> {
    var best = vec2<f32>(3.0e38, 3.0e38);
    for (var i = 0u; i < triangle_count; i++) {
        let t = triangles[i];
        let triangle = prepare(ring_at[t & 0xffu], ring_at[(t >> 8u) & 0xffu]);
        best.x = smaller(best.x, triangle2(x, triangle));
        best.y = smaller(best.y, triangle2(y, triangle));
    }
    return best;
}

/// The same for one point.
fn one_to_after(x: vec3<f32>) -> f32 {
    var best = 3.0e38;
    for (var i = 0u; i < triangle_count; i++) {
        let t = triangles[i];
        best = smaller(best, triangle2(x, prepare(ring_at[t & 0xffu], ring_at[(t >> 8u) & 0xffu])));
    }
    return best;
}

/// Edges of a triangle that vanishes, from `a`.
fn vanishing_edges(i: u32) -> array<vec3<f32>, 2> {
    let v = vanishing[i];
    let ax = ring_at[v & 0xffu] + half;
    let ab = half + half;
    if (v & REVERSED) != 0u {
        return array<vec3<f32>, 2>(ax, ab);
    }
    return array<vec3<f32>, 2>(ab, ax);
}

/// Squared distance from `x` to the patch before.
fn to_before(x: vec3<f32>) -> f32 {
    var best = 3.0e38;
    for (var i = 0u; i < triangle_count; i++) {
        let t = triangles[i];
        let c = end_of(t);
        let triangle = prepare(ring_at[t & 0xffu] - c, ring_at[(t >> 8u) & 0xffu] - c);
        best = smaller(best, triangle2(x - c, triangle));
    }
    for (var i = 0u; i < vanishing_count; i++) {
        let e = vanishing_edges(i);
        best = smaller(best, triangle2(x + half, prepare(e[0], e[1])));
    }
    return best;
}

/// Shape of a triangle: squared normal over the fourth power of the longest edge.
fn shape(nn: f32, longest: f32) -> f32 {
    let i = inverse(longest);
    return nn * i * i;
}

fn sliver(before: f32, after: f32) -> bool {
    return after < SLIVER && after * 16.0 < before;
}

/// A surviving triangle: the corners that stay, seen from the new vertex and from the old one, and its normals before and after.
struct Moved {
    p: vec3<f32>,
    q: vec3<f32>,
    e0: vec3<f32>,
    e1: vec3<f32>,
    before: vec3<f32>,
    after: vec3<f32>,
}

fn moved(t: u32) -> Moved {
    let p = ring_at[t & 0xffu];
    let q = ring_at[(t >> 8u) & 0xffu];
    let c = end_of(t);
    return Moved(p, q, p - c, q - c, cross3(p - c, q - c), cross3(p, q));
}

/// Whether a surviving triangle turns over or becomes a sliver.
fn folds_triangles() -> bool {
    for (var i = 0u; i < triangle_count; i++) {
        let t = moved(triangles[i]);
        if dot3(t.before, t.after) < 0.0 {
            return true;
        }
        let pq = t.q - t.p;
        let i0 = inverse(dot3(t.p, t.p));
        let least = smaller(smaller(i0, inverse(dot3(t.q, t.q))), inverse(dot3(pq, pq)));
        let thin = dot3(t.after, t.after) * least * least;
        if thin < SLIVER && i0 > 0.0 {
            let e2 = t.e1 - t.e0;
            let longest = larger(larger(dot3(t.e0, t.e0), dot3(t.e1, t.e1)), dot3(e2, e2));
            if sliver(shape(dot3(t.before, t.before), longest), thin) {
                return true;
            }
        }
    }
    return false;
}

fn bad(nb: vec3<f32>, na: vec3<f32>, lb: f32, la: f32) -> bool {
    return dot3(nb, na) < 0.0 || sliver(shape(dot3(nb, nb), lb), shape(dot3(na, na), la));
}

/// The same for polygons: their vector areas, as far as the fan shows them.
fn folds_polygons() -> bool {
    var nb = vec3<f32>(0.0);
    var na = vec3<f32>(0.0);
    var lb = 0.0;
    var la = 0.0;
    for (var i = 0u; i < triangle_count; i++) {
        let t = moved(triangles[i]);
        let pq = t.p - t.q;
        let mb = larger(larger(dot3(t.e0, t.e0), dot3(t.e1, t.e1)), dot3(pq, pq));
        let ma = larger(larger(dot3(t.p, t.p), dot3(t.q, t.q)), dot3(pq, pq));
        if (triangles[i] & CONTINUES) != 0u {
            nb = nb + t.before;
            na = na + t.after;
            lb = larger(lb, mb);
            la = larger(la, ma);
        } else {
            if bad(nb, na, lb, la) {
                return true;
            }
            nb = t.before;
            na = t.after;
            lb = mb;
            la = ma;
        }
    }
    return bad(nb, na, lb, la);
}

/// Squared distance between the borders before and after.
fn border_distance() -> f32 {
    let none = 3.0e38;
    var to_a = none;
    var to_b = none;
    var to_v = select(none, 0.0, border_ab);
    var at_a = false;
    var at_b = false;
    for (var i = 0u; i < ring_count; i++) {
        let marks = ring_marks[i];
        let r = ring_at[i];
        if (marks & BORDER_AFTER) != 0u {
            to_a = smaller(to_a, segment2(-half, vec3<f32>(0.0), r));
            to_b = smaller(to_b, segment2(half, vec3<f32>(0.0), r));
        }
        if (marks & BORDER_A) != 0u {
            at_a = true;
            to_v = smaller(to_v, segment2(vec3<f32>(0.0), -half, r));
        }
        if (marks & BORDER_B) != 0u {
            at_b = true;
            to_v = smaller(to_v, segment2(vec3<f32>(0.0), half, r));
        }
    }
    // Without a border on the other side there is nothing to be far from: the surface distance speaks alone.
    var worst = 0.0;
    if at_a && to_a < none {
        worst = larger(worst, to_a);
    }
    if at_b && to_b < none {
        worst = larger(worst, to_b);
    }
    if to_a < none && to_v < none {
        worst = larger(worst, to_v);
    }
    return worst;
}

struct Frame {
    x: vec3<f32>,
    y: vec3<f32>,
    n: vec3<f32>,
    /// No triangle of either patch faces against `n`.
    holds: bool,
}

/// Normal of triangle `i` before.
fn normal_before(i: u32) -> vec3<f32> {
    if i < triangle_count {
        let t = triangles[i];
        let c = end_of(t);
        return cross3(ring_at[t & 0xffu] - c, ring_at[(t >> 8u) & 0xffu] - c);
    }
    let e = vanishing_edges(i - triangle_count);
    return cross3(e[0], e[1]);
}

fn patch_frame() -> Frame {
    var frame: Frame;
    frame.holds = false;
    let total = triangle_count + vanishing_count;
    // The processor sums eight lanes apart: so do these, without an array, as indexed writes cost more than selections.
    var s0 = vec3<f32>(0.0);
    var s1 = s0;
    var s2 = s0;
    var s3 = s0;
    var s4 = s0;
    var s5 = s0;
    var s6 = s0;
    var s7 = s0;
    for (var i = 0u; i < total; i++) {
        let n = normal_before(i);
        let l = i & 7u;
        s0 = select(s0, s0 + n, l == 0u);
        s1 = select(s1, s1 + n, l == 1u);
        s2 = select(s2, s2 + n, l == 2u);
        s3 = select(s3, s3 + n, l == 3u);
        s4 = select(s4, s4 + n, l == 4u);
        s5 = select(s5, s5 + n, l == 5u);
        s6 = select(s6, s6 + n, l == 6u);
        s7 = select(s7, s7 + n, l == 7u);
    }
    let sum = ((s0 + s4) + (s1 + s5)) + ((s2 + s6) + (s3 + s7));
    var low = 0.0;
    for (var i = 0u; i < total; i++) {
        low = smaller(low, dot3(sum, normal_before(i)));
        if i < triangle_count {
            let t = triangles[i];
            low = smaller(low, dot3(sum, cross3(ring_at[t & 0xffu], ring_at[(t >> 8u) & 0xffu])));
        }
    }
    let nn = dot3(sum, sum);
    if low < 0.0 || !(nn > 0.0) {
        return frame;
    }
    let n = sum * (1.0 / sqrt(nn));
    // Frisvad's basis, with the sign that keeps it away from its singularity (Duff et al. 2017).
    let sign = select(1.0, -1.0, n.z < 0.0);
    let i = -1.0 / (sign + n.z);
    let k = n.x * n.y * i;
    frame.x = vec3<f32>(1.0 + sign * n.x * n.x * i, sign * k, -sign * n.x);
    frame.y = vec3<f32>(k, sign + n.y * n.y * i, -n.y);
    frame.n = n;
    frame.holds = true;
    return frame;
}

/// Places where the spoke before from `fc` along `d` and the spoke after to `y` cross in the plane, on either.
fn cross_spokes(fc: vec2<f32>, d: vec2<f32>, along: f32, y: vec2<f32>) -> vec2<f32> {
    let inv = 1.0 / (y.x * d.y - y.y * d.x);
    return vec2<f32>((fc.x * y.y - fc.y * y.x) * inv, along * inv);
}

/// Raise `least` by the crossings of spokes before with spokes after, the largest gap first and of equals the first. A pass
/// keeps the four largest in registers: to list them all takes writes by index, which cost software devices more than to
/// pass again in the rare case.
fn crossings(frame: Frame, least: f32) -> f32 {
    var worst = least;
    var spoke_count = 0u;
    for (var i = 0u; i < ring_count; i++) {
        let p = ring_at[i];
        flat[i] = vec3<f32>(dot3(p, frame.x), dot3(p, frame.y), dot3(p, frame.n));
        let marks = ring_marks[i];
        if (marks & SPOKE_A) != 0u {
            spokes[spoke_count] = 2u * i;
            spoke_count += 1u;
        }
        if (marks & SPOKE_B) != 0u {
            spokes[spoke_count] = 2u * i + 1u;
            spoke_count += 1u;
        }
    }
    let fb = vec3<f32>(dot3(half, frame.x), dot3(half, frame.y), dot3(half, frame.n));
    // The last one that was taken.
    var last_gap = 3.0e38;
    var last = 0u;
    loop {
        var gaps = vec4<f32>(0.0);
        var found = vec4<u32>(0u);
        for (var i = 0u; i < spoke_count; i++) {
            let spoke = spokes[i];
            let fc = select(-fb, fb, (spoke & 1u) != 0u);
            let d = flat[spoke >> 1u] - fc;
            let along = fc.x * d.y - fc.y * d.x;
            for (var j = 0u; j < ring_count; j++) {
                let y = flat[j];
                let at = cross_spokes(fc.xy, d.xy, along, y.xy);
                // Both between 0 and 1. Parallel lines give an infinity or no number: neither passes.
                let inside = smaller(smaller(at.y, 1.0 - at.y), smaller(at.x, 1.0 - at.x));
                let z = fc.z + at.x * d.z - at.y * y.z;
                let gap = z * z;
                let number = (i << 8u) | j;
                let counts = inside > 0.0 && gap > worst && (gap < last_gap || (gap == last_gap && number > last));
                let beats = vec4<f32>(select(0.0, gap, counts)) > gaps;
                let behind = vec4<bool>(false, beats.x, beats.y, beats.z);
                gaps = select(select(gaps, vec4<f32>(gap), beats), vec4<f32>(0.0, gaps.xyz), behind);
                found = select(select(found, vec4<u32>(number), beats), vec4<u32>(0u, found.xyz), behind);
            }
        }
        var left = 4u;
        while left > 0u && gaps.x > worst {
            left -= 1u;
            last_gap = gaps.x;
            last = found.x;
            gaps = vec4<f32>(gaps.yzw, 0.0);
            found = vec4<u32>(found.yzw, 0u);
            let spoke = spokes[last >> 8u];
            let j = last & 0xffu;
            let at_b = (spoke & 1u) != 0u;
            let x = ring_at[spoke >> 1u];
            let y = ring_at[j];
            let c = select(-half, half, at_b);
            let fc = select(-fb, fb, at_b);
            let d = flat[spoke >> 1u] - fc;
            let places = cross_spokes(fc.xy, d.xy, fc.x * d.y - fc.y * d.x, flat[j].xy);
            let before = c + (x - c) * places.x;
            let after = y * places.y;
            // Each spoke belongs to its patch: the distance to it bounds the distance to the patch.
            if segment2(before, vec3<f32>(0.0), y) > worst {
                worst = larger(worst, one_to_after(before));
            }
            if segment2(after, c, x) > worst {
                worst = larger(worst, to_before(after));
            }
        }
        if left > 0u {
            break;
        }
    }
    return worst;
}

/// Raise `least` by the middles of all spokes, both ways.
fn middles(least: f32) -> f32 {
    var worst = least;
    for (var i = 0u; i < ring_count; i++) {
        let r = ring_at[i];
        let marks = ring_marks[i];
        let at_a = (marks & SPOKE_A) != 0u;
        let at_b = (marks & SPOKE_B) != 0u;
        // The spoke after, or before, is part of the other patch: most middles are near enough to it.
        for (var side = 0u; side < 2u; side++) {
            let c = select(-half, half, side == 1u);
            let middle = 0.5 * (c + r);
            if select(at_a, at_b, side == 1u) && segment2(middle, vec3<f32>(0.0), r) > worst {
                worst = larger(worst, one_to_after(middle));
            }
        }
        let middle = r * 0.5;
        let near_a = at_a && segment2(middle, -half, r) <= worst;
        let near_b = at_b && segment2(middle, half, r) <= worst;
        if (at_a || at_b) && !near_a && !near_b {
            worst = larger(worst, to_before(middle));
        }
    }
    return worst;
}

fn area(e0: vec3<f32>, e1: vec3<f32>) -> f32 {
    let n = cross3(e0, e1);
    return 0.5 * sqrt(dot3(n, n));
}

/// Area after less area before: a small difference of large sums, so that their order shows. Drivers may turn `a + (b - c)`
/// into `(a + b) - c`, as Mesa seems to.
fn area_change() -> f32 {
    var change = 0.0;
    for (var i = 0u; i < triangle_count; i++) {
        let t = triangles[i];
        let p = ring_at[t & 0xffu];
        let q = ring_at[(t >> 8u) & 0xffu];
        let c = end_of(t);
        change = as_it_is(change + as_it_is(area(p, q) - area(p - c, q - c)));
    }
    for (var i = 0u; i < vanishing_count; i++) {
        let x = ring_at[vanishing[i] & 0xffu];
        change = as_it_is(change - area(-half - x, half - x));
    }
    return change;
}

fn weigh(a: u32, b: u32) -> Outcome {
    let kind = read_patch(a, b);
    if kind >= ILLEGAL {
        return Outcome(0u, kind);
    }
    if kind == DANGLING {
        return Outcome(bitcast<u32>(2.0 * sqrt(dot3(half, half))), kind);
    }
    if kind == BREAKING {
        return Outcome(bitcast<u32>(sqrt(abs(area_change()))), kind);
    }
    // No point of either patch is farther from the other than the ends move.
    let reach = dot3(half, half);
    let ends = to_after(-half, half);
    var worst = larger(ends.x, ends.y);
    if borders {
        worst = larger(worst, border_distance());
    }
    var folds = false;
    if polygons {
        folds = folds_polygons();
    } else {
        folds = folds_triangles();
    }
    if reach > worst {
        let frame = patch_frame();
        if frame.holds {
            worst = crossings(frame, worst);
        } else if reach * 0.25 > worst {
            worst = middles(worst);
        }
    }
    var value = sqrt(worst);
    if folds {
        value += 2.0 * sqrt(dot3(half, half));
    }
    return Outcome(bitcast<u32>(value), kind | select(0u, FOLDS, folds));
}

@compute @workgroup_size(64)
fn edge_weight(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.edges {
        let ends = edges[id.x];
        outcomes[id.x] = weigh(ends.x, ends.y);
    }
}
