// The patch of an edge, gathered from a level into the memory of one invocation. Twin of `src/metric/gather.rs`: same
// order of ring vertices and triangles. A patch that does not fit says so, and the processor weighs that edge.

const RING: u32 = 32u;
const TRIANGLES: u32 = 48u;
const VANISHING: u32 = 8u;

const ORDINARY: u32 = 0u;
const BREAKING: u32 = 1u;
const DANGLING: u32 = 2u;
const ILLEGAL: u32 = 3u;
const TOO_LARGE: u32 = 4u;

/// In `ring_marks`, whose lower bits count: faces with the edge to `a`, to `b`, dangling edges to `a`, to `b`,
/// triangles `(a, b, x)`, six bits each (a patch has at most 60 elements). One word, because writing where an index says
/// is what costs most on software devices.
const SPOKE_A: u32 = 0x40000000u;
const SPOKE_B: u32 = 0x80000000u;
const COUNT: u32 = 0x3fu;
const STRINGS: u32 = 12u;
const BOTH: u32 = 24u;
const STARS: u32 = 60u;
/// In `ring_marks` once the counts have been read.
const BORDER_A: u32 = 1u;
const BORDER_B: u32 = 2u;
const BORDER_AFTER: u32 = 4u;

/// In `triangles`.
const AT_B: u32 = 0x10000u;
const CONTINUES: u32 = 0x20000u;

/// `(b - a) / 2`: relative to the midpoint, `a` lies at `-half` and `b` at `half`.
var<private> half: vec3<f32>;
var<private> anchor: vec3<f32>;
var<private> ring_count: u32;
var<private> ring_vertex: array<u32, RING>;
var<private> ring_at: array<vec3<f32>, RING>;
/// Counts, then flags: see above.
var<private> ring_marks: array<u32, RING>;
var<private> triangle_count: u32;
/// Ring vertex after the apex in the low byte, before it in the next, then the flags above.
var<private> triangles: array<u32, TRIANGLES>;
var<private> vanishing_count: u32;
/// Third corner of a triangle that vanishes; bit 8: it runs `(b, a, x)`.
var<private> vanishing: array<u32, VANISHING>;
var<private> polygons: bool;
var<private> borders: bool;
var<private> border_ab: bool;
var<private> overflows: bool;

/// The place of vertex `x` in the ring, given to it here if it has none.
fn place(x: u32) -> u32 {
    for (var i = 0u; i < ring_count; i++) {
        if ring_vertex[i] == x {
            return i;
        }
    }
    if ring_count >= RING {
        overflows = true;
        return 0u;
    }
    let i = ring_count;
    ring_count += 1u;
    ring_vertex[i] = x;
    ring_at[i] = (position(x) - anchor) - half;
    ring_marks[i] = 0u;
    return i;
}

fn push_triangle(p: u32, q: u32, flags: u32) {
    if triangle_count >= TRIANGLES {
        overflows = true;
        return;
    }
    triangles[triangle_count] = p | (q << 8u) | flags;
    triangle_count += 1u;
}

/// What the apex itself, and the other end, need in the ring's stead: no place.
const NOWHERE: u32 = 0xffffu;

/// Places of the corners of a star that are not `other`, in the order in which the processor meets them.
fn place_unless(x: u32, other: u32) -> u32 {
    if x == other {
        return NOWHERE;
    }
    return place(x);
}

struct Uses {
    /// Of the edge between both ends.
    faces: u32,
    strings: u32,
    /// A polygon holds both ends, not side by side.
    far: bool,
    /// Some face edge at the apex has exactly one face.
    border: bool,
}

/// Count `plus` at a place and set flags there.
fn mark(i: u32, plus: u32, flags: u32) {
    if i != NOWHERE {
        ring_marks[i] = (ring_marks[i] + plus) | flags;
    }
}

/// A triangle of the fan at the edge: it vanishes.
fn push_vanishing(third: u32, reversed: bool) {
    if vanishing_count >= VANISHING {
        overflows = true;
        return;
    }
    vanishing[vanishing_count] = third | select(0u, 0x100u, reversed);
    vanishing_count += 1u;
}

/// Read one star: `at_a` for `a`, whose elements at the edge vanish or lose a corner, else for `b`.
fn read_star(apex: u32, other: u32, at_a: bool) -> Uses {
    var uses = Uses(0u, 0u, false, false);
    let shift = select(6u, 0u, at_a);
    let one = 1u << shift;
    let spoke = select(SPOKE_B, SPOKE_A, at_a);
    let side = select(AT_B, 0u, at_a);
    let end = star_start[apex + 1u];
    for (var s = star_start[apex]; s < end; s++) {
        let f = star_faces[s];
        let first_corner = face_start[f];
        let degree = face_start[f + 1u] - first_corner;
        if degree == 3u {
            let x = corners[first_corner];
            let y = corners[first_corner + 1u];
            let z = corners[first_corner + 2u];
            let next = select(select(x, z, y == apex), y, x == apex);
            let before = select(select(y, x, y == apex), z, x == apex);
            let next_place = place_unless(next, other);
            let last = place_unless(before, other);
            if next == other || before == other {
                uses.faces += 1u;
                let third = select(next_place, last, next == other);
                // An element with both ends counts at `a` alone.
                if at_a {
                    push_vanishing(third, before == other);
                    mark(third, one + (1u << BOTH), SPOKE_A | SPOKE_B);
                } else {
                    mark(third, one, 0u);
                }
            } else {
                mark(next_place, one, spoke);
                mark(last, one, spoke);
                push_triangle(next_place, last, side);
            }
        } else if degree == 2u {
            let x = corners[first_corner];
            let next = select(x, corners[first_corner + 1u], x == apex);
            if next == other {
                uses.strings += 1u;
            } else {
                let here = place(next);
                mark(here, one << STRINGS, spoke);
                push_triangle(here, here, side);
            }
        } else {
            polygons = true;
            if degree > RING {
                overflows = true;
                return uses;
            }
            var at = 0u;
            for (var i = 0u; i < degree; i++) {
                if corners[first_corner + i] == apex {
                    at = i;
                    break;
                }
            }
            // The corners after the apex, in the orientation of the element.
            var k = select(at + 1u, 0u, at + 1u == degree);
            let next = corners[first_corner + k];
            let next_place = place_unless(next, other);
            let before = corners[first_corner + select(at, degree, at == 0u) - 1u];
            let mine = at_a || (next != other && before != other);
            var last = next_place;
            var continues = 0u;
            for (var i = 2u; i < degree; i++) {
                k = select(k + 1u, 0u, k + 1u == degree);
                let x = corners[first_corner + k];
                let here = place_unless(x, other);
                if i + 1u < degree && x == other {
                    uses.far = true;
                }
                if mine {
                    if last == NOWHERE || here == NOWHERE {
                        let third = select(here, last, here == NOWHERE);
                        push_vanishing(third, here == NOWHERE);
                        mark(third, 0u, SPOKE_A | SPOKE_B);
                    } else {
                        mark(last, 0u, spoke);
                        mark(here, 0u, spoke);
                        push_triangle(last, here, side | continues);
                        continues = CONTINUES;
                    }
                }
                last = here;
            }
            uses.faces += select(0u, 1u, next == other) + select(0u, 1u, before == other);
            mark(next_place, one, 0u);
            mark(last, one, 0u);
        }
        if overflows {
            return uses;
        }
    }
    uses.border = uses.faces == 1u;
    for (var i = 0u; i < ring_count; i++) {
        uses.border = uses.border || ((ring_marks[i] >> shift) & COUNT) == 1u;
    }
    return uses;
}

/// Read the patch of the edge `{a, b}`; its class.
fn read_patch(a: u32, b: u32) -> u32 {
    let pa = position(a);
    half = 0.5 * (position(b) - pa);
    anchor = pa;
    ring_count = 0u;
    triangle_count = 0u;
    vanishing_count = 0u;
    polygons = false;
    borders = false;
    overflows = false;
    // A star of more triangles than fit is not even begun.
    let at_a = star_start[a + 1u] - star_start[a];
    let at_b = star_start[b + 1u] - star_start[b];
    if at_a + at_b > STARS {
        return TOO_LARGE;
    }
    let of_a = read_star(a, b, true);
    if overflows {
        return TOO_LARGE;
    }
    if of_a.faces + of_a.strings == 0u || of_a.far {
        return ILLEGAL;
    }
    let of_b = read_star(b, a, false);
    if overflows {
        return TOO_LARGE;
    }
    border_ab = of_a.faces + of_a.strings == 1u;
    if of_a.faces == 0u {
        return DANGLING;
    }
    var breaks = of_a.faces > 1u && of_a.border && of_b.border;
    for (var i = 0u; i < ring_count; i++) {
        let counts = ring_marks[i];
        let to_a = (counts & COUNT) + ((counts >> STRINGS) & COUNT);
        let to_b = ((counts >> 6u) & COUNT) + ((counts >> (STRINGS + 6u)) & COUNT);
        let both = (counts >> BOTH) & COUNT;
        // A triangle (a, b, x) is counted at both ends and leaves both.
        let after = to_a + to_b - 2u * both;
        if both > 0u {
            breaks = breaks || after == 0u;
        } else {
            breaks = breaks || (to_a > 0u && to_b > 0u);
        }
        var marks = counts & (SPOKE_A | SPOKE_B);
        marks |= select(0u, BORDER_A, to_a == 1u);
        marks |= select(0u, BORDER_B, to_b == 1u);
        marks |= select(0u, BORDER_AFTER, after == 1u);
        ring_marks[i] = marks;
        borders = borders || to_a == 1u || to_b == 1u || after == 1u;
    }
    return select(ORDINARY, BREAKING, breaks);
}
