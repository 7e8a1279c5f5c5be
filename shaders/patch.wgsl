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

/// In `ring_marks`.
const SPOKE_A: u32 = 0x100u;
const SPOKE_B: u32 = 0x200u;
const BORDER_A: u32 = 0x400u;
const BORDER_B: u32 = 0x800u;
const BORDER_AFTER: u32 = 0x1000u;

/// In `triangles`.
const AT_B: u32 = 0x10000u;
const CONTINUES: u32 = 0x20000u;

/// `(b - a) / 2`: relative to the midpoint, `a` lies at `-half` and `b` at `half`.
var<private> half: vec3<f32>;
var<private> anchor: vec3<f32>;
var<private> ring_count: u32;
var<private> ring_vertex: array<u32, RING>;
var<private> ring_at: array<vec3<f32>, RING>;
/// From the lowest byte: faces with the edge to `a`, to `b`, dangling edges to `a`, to `b`.
var<private> ring_uses: array<u32, RING>;
/// Low byte: triangles `(a, b, x)`; then the flags above.
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
    ring_uses[i] = 0u;
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

/// Read one star: `at_a` for `a`, whose elements at the edge vanish or lose a corner, else for `b`.
fn read_star(apex: u32, other: u32, at_a: bool) -> Uses {
    var uses = Uses(0u, 0u, false, false);
    let shift = select(8u, 0u, at_a);
    let spoke = select(SPOKE_B, SPOKE_A, at_a);
    let side = select(AT_B, 0u, at_a);
    let end = star_start[apex + 1u];
    for (var s = star_start[apex]; s < end; s++) {
        let f = star_faces[s];
        let first_corner = face_start[f];
        let degree = face_start[f + 1u] - first_corner;
        if degree > 3u {
            polygons = true;
            if degree > RING {
                overflows = true;
                return uses;
            }
        }
        var at = 0u;
        for (var i = 0u; i < degree; i++) {
            if corners[first_corner + i] == apex {
                at = i;
                break;
            }
        }
        // The corners after the apex, in the orientation of the element.
        var k = at + 1u;
        k = select(k, 0u, k == degree);
        let next = corners[first_corner + k];
        let next_place = place_unless(next, other);
        if degree == 2u {
            if next == other {
                uses.strings += 1u;
            } else {
                ring_uses[next_place] += 0x10000u << shift;
                ring_marks[next_place] |= spoke;
                push_triangle(next_place, next_place, side);
            }
            continue;
        }
        let before = corners[first_corner + select(at, degree, at == 0u) - 1u];
        // An element with both ends counts at `a` alone.
        let mine = at_a || (next != other && before != other);
        var last = next_place;
        var continues = 0u;
        for (var i = 2u; i < degree; i++) {
            k += 1u;
            k = select(k, 0u, k == degree);
            let x = corners[first_corner + k];
            let here = place_unless(x, other);
            if i + 1u < degree && x == other {
                uses.far = true;
            }
            if !mine {
                last = here;
                continue;
            }
            if last == NOWHERE || here == NOWHERE {
                let reversed = here == NOWHERE;
                let third = select(here, last, reversed);
                if vanishing_count >= VANISHING {
                    overflows = true;
                } else {
                    vanishing[vanishing_count] = third | select(0u, 0x100u, reversed);
                    vanishing_count += 1u;
                }
                ring_marks[third] |= SPOKE_A | SPOKE_B;
                if degree == 3u {
                    ring_marks[third] += 1u;
                }
            } else {
                ring_marks[last] |= spoke;
                ring_marks[here] |= spoke;
                push_triangle(last, here, side | continues);
                continues = CONTINUES;
            }
            last = here;
        }
        if next_place == NOWHERE {
            uses.faces += 1u;
        } else {
            ring_uses[next_place] += 1u << shift;
        }
        if last == NOWHERE {
            uses.faces += 1u;
        } else {
            ring_uses[last] += 1u << shift;
        }
        if overflows {
            return uses;
        }
    }
    uses.border = uses.faces == 1u;
    for (var i = 0u; i < ring_count; i++) {
        uses.border = uses.border || ((ring_uses[i] >> shift) & 0xffu) == 1u;
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
    if at_a + at_b > TRIANGLES + 2u * VANISHING {
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
        let uses = ring_uses[i];
        let to_a = (uses & 0xffu) + ((uses >> 16u) & 0xffu);
        let to_b = ((uses >> 8u) & 0xffu) + (uses >> 24u);
        let both = ring_marks[i] & 0xffu;
        // A triangle (a, b, x) is counted at both ends and leaves both.
        let after = to_a + to_b - 2u * both;
        if both > 0u {
            breaks = breaks || after == 0u;
        } else {
            breaks = breaks || (to_a > 0u && to_b > 0u);
        }
        var marks = ring_marks[i];
        marks |= select(0u, BORDER_A, to_a == 1u);
        marks |= select(0u, BORDER_B, to_b == 1u);
        marks |= select(0u, BORDER_AFTER, after == 1u);
        ring_marks[i] = marks;
        borders = borders || to_a == 1u || to_b == 1u || after == 1u;
    }
    return select(ORDINARY, BREAKING, breaks);
}
