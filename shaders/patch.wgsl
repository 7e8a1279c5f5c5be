// The patch of an edge, gathered from the stars of its ends into the memory of one invocation. Twin of
// `src/metric/gather.rs`: same order of ring vertices and triangles. A patch that does not fit says so, and the processor
// weighs that edge.
//
// Software devices run both sides of a branch for all lanes, and read buffers lane by lane: so there is one path for all
// elements, and what is read is read once.

const RING: u32 = 32u;
const TRIANGLES: u32 = 48u;
const VANISHING: u32 = 8u;

const ORDINARY: u32 = 0u;
const BREAKING: u32 = 1u;
const DANGLING: u32 = 2u;
const ILLEGAL: u32 = 3u;
const TOO_LARGE: u32 = 4u;

/// In `ring_marks`, whose lower bits count elements with the edge to `a`, to `b`, and triangles `(a, b, x)`, six bits
/// each (a patch has at most 60 elements).
const SPOKE_A: u32 = 0x40000000u;
const SPOKE_B: u32 = 0x80000000u;
const COUNT: u32 = 0x3fu;
const AT_B_SHIFT: u32 = 6u;
const BOTH: u32 = 12u;
const STARS: u32 = 60u;
/// In `ring_marks` once the counts have been read.
const BORDER_A: u32 = 1u;
const BORDER_B: u32 = 2u;
const BORDER_AFTER: u32 = 4u;

/// In `triangles`.
const AT_B: u32 = 0x10000u;
const CONTINUES: u32 = 0x20000u;

/// In `vanishing`: it runs `(b, a, x)`; it is a triangle, not the corner of a polygon.
const REVERSED: u32 = 0x100u;
const WHOLE: u32 = 0x200u;

/// No place among a star's vertices.
const NOWHERE: u32 = 0xffu;

/// `(b - a) / 2`: relative to the midpoint, `a` lies at `-half` and `b` at `half`.
var<private> half: vec3<f32>;
var<private> ring_count: u32;
var<private> ring_vertex: array<u32, RING>;
var<private> ring_at: array<vec3<f32>, RING>;
/// Counts, then flags: see above.
var<private> ring_marks: array<u32, RING>;
/// Places in the ring of the vertices of the star of `b`.
var<private> place_of_b: array<u32, RING>;
var<private> triangle_count: u32;
/// Ring vertex after the apex in the low byte, before it in the next, then the flags above.
var<private> triangles: array<u32, TRIANGLES>;
var<private> vanishing_count: u32;
/// Third corner of a triangle that vanishes, and the flags above.
var<private> vanishing: array<u32, VANISHING>;
var<private> polygons: bool;
var<private> borders: bool;
var<private> border_ab: bool;
var<private> overflows: bool;
/// Whether the polygon that is being read has a triangle in the list.
var<private> continues: u32;

fn push_triangle(p: u32, q: u32, flags: u32) {
    if triangle_count >= TRIANGLES {
        overflows = true;
        return;
    }
    triangles[triangle_count] = p | (q << 8u) | flags;
    triangle_count += 1u;
}

/// A fan at `a`, among whose star's vertices `b` is number `other`.
fn fan_at_a(fan: u32, other: u32) {
    let kind = fan >> 30u;
    let p = fan & 0x3fu;
    let q = (fan >> 6u) & 0x3fu;
    if kind == FAN_NONE {
        return;
    }
    if kind != FAN_POLYGON || p == ((fan >> 12u) & 0x3fu) {
        continues = 0u;
    }
    if p == other || q == other {
        if p != q {
            if vanishing_count >= VANISHING {
                overflows = true;
                return;
            }
            let third = select(p, q, p == other);
            let flags = select(0u, REVERSED, q == other) | select(WHOLE, 0u, kind == FAN_POLYGON);
            vanishing[vanishing_count] = (third - select(0u, 1u, third > other)) | flags;
            vanishing_count += 1u;
        }
        return;
    }
    push_triangle(p - select(0u, 1u, p > other), q - select(0u, 1u, q > other), continues);
    continues = CONTINUES;
}

/// A fan at `b`, among whose star's vertices `a` is number `other`: elements with both ends count at `a` alone.
fn fan_at_b(fan: u32, other: u32, mixed: bool) {
    let kind = fan >> 30u;
    let next = (fan >> 12u) & 0x3fu;
    if kind == FAN_NONE || next == other || ((fan >> 18u) & 0x3fu) == other {
        return;
    }
    if kind != FAN_POLYGON || (fan & 0x3fu) == next {
        continues = 0u;
    }
    let p = place_of_b[fan & 0x3fu];
    let q = place_of_b[(fan >> 6u) & 0x3fu];
    if mixed {
        ring_marks[p] |= SPOKE_B;
        ring_marks[q] |= SPOKE_B;
    }
    push_triangle(p, q, AT_B | continues);
    continues = CONTINUES;
}

/// Read the patch of the edge `{a, b}`; its class.
fn read_patch(a: u32, b: u32) -> u32 {
    let vertex_a = vertices[a];
    let vertex_b = vertices[b];
    let anchor = position(vertex_a);
    half = 0.5 * (position(vertex_b) - anchor);
    ring_count = 0u;
    triangle_count = 0u;
    vanishing_count = 0u;
    borders = false;
    overflows = false;
    continues = 0u;
    let head_a = stars[vertex_a.w].x;
    let head_b = stars[vertex_b.w].x;
    if ((head_a | head_b) & STAR_TOO_LARGE) != 0u {
        return TOO_LARGE;
    }
    polygons = ((head_a | head_b) & STAR_POLYGONS) != 0u;
    let mixed = (head_b & STAR_POLYGONS) != 0u;

    // The ring: the vertices around a, then those around b alone.
    let count_a = head_a & 0xffu;
    let from_a = vertex_a.w + 1u;
    var b_in_a = NOWHERE;
    var edge = 0u;
    for (var i = 0u; i < count_a; i++) {
        let v = stars[from_a + i];
        if v.x == b {
            b_in_a = i;
            edge = v.y;
        } else {
            ring_vertex[ring_count] = v.x;
            ring_marks[ring_count] = (v.y & COUNT) | SPOKE_A;
            ring_count += 1u;
        }
    }
    if (edge & 0xffu) == 0u || (edge & STAR_FAR) != 0u {
        return ILLEGAL;
    }
    let edge_faces = (edge >> 8u) & 0xffu;
    border_ab = (edge & 0xffu) == 1u;
    if edge_faces == 0u {
        return DANGLING;
    }
    let count_b = head_b & 0xffu;
    let from_b = vertex_b.w + 1u;
    let around_a = ring_count;
    // A polygon with both ends joins its corners to a alone: where there may be one, fans tell.
    let spoke_b = select(SPOKE_B, 0u, mixed);
    var a_in_b = NOWHERE;
    for (var i = 0u; i < count_b; i++) {
        let v = stars[from_b + i];
        if v.x == a {
            a_in_b = i;
        } else {
            var at = 0u;
            while at < around_a {
                if ring_vertex[at] == v.x {
                    break;
                }
                at += 1u;
            }
            var marks = ((v.y & COUNT) << AT_B_SHIFT) | spoke_b;
            if at == around_a {
                if ring_count >= RING {
                    return TOO_LARGE;
                }
                at = ring_count;
                ring_count += 1u;
                ring_vertex[at] = v.x;
            } else {
                marks |= ring_marks[at];
            }
            ring_marks[at] = marks;
            place_of_b[i] = at;
        }
    }

    let fans_a = (((head_a >> 8u) & 0xffu) + 1u) / 2u;
    for (var i = 0u; i < fans_a; i++) {
        let pair = stars[from_a + count_a + i];
        fan_at_a(pair.x, b_in_a);
        fan_at_a(pair.y, b_in_a);
    }
    let fans_b = (((head_b >> 8u) & 0xffu) + 1u) / 2u;
    for (var i = 0u; i < fans_b; i++) {
        let pair = stars[from_b + count_b + i];
        fan_at_b(pair.x, a_in_b, mixed);
        fan_at_b(pair.y, a_in_b, mixed);
    }
    if overflows {
        return TOO_LARGE;
    }
    for (var i = 0u; i < vanishing_count; i++) {
        let v = vanishing[i];
        let marks = ring_marks[v & 0xffu] + select(0u, 1u << BOTH, (v & WHOLE) != 0u);
        ring_marks[v & 0xffu] = marks | SPOKE_A | SPOKE_B;
    }

    var breaks = edge_faces > 1u && (head_a & head_b & STAR_BORDER) != 0u;
    for (var i = 0u; i < ring_count; i++) {
        ring_at[i] = (position(vertices[ring_vertex[i]]) - anchor) - half;
        let counts = ring_marks[i];
        let to_a = counts & COUNT;
        let to_b = (counts >> AT_B_SHIFT) & COUNT;
        let both = (counts >> BOTH) & COUNT;
        // A triangle (a, b, x) is counted at both ends and leaves both.
        let after = to_a + to_b - 2u * both;
        breaks = breaks || select(to_a > 0u && to_b > 0u, after == 0u, both > 0u);
        var marks = counts & (SPOKE_A | SPOKE_B);
        marks |= select(0u, BORDER_A, to_a == 1u);
        marks |= select(0u, BORDER_B, to_b == 1u);
        marks |= select(0u, BORDER_AFTER, after == 1u);
        ring_marks[i] = marks;
        borders = borders || to_a == 1u || to_b == 1u || after == 1u;
    }
    return select(ORDINARY, BREAKING, breaks);
}
