// Vectors, and the squared distance of a point to a triangle. Shared by all kernels; twin of the same functions in
// `src/metric/kernel.rs`, operation by operation: sums in the same order, no built-in `dot`, `cross` or `min`, so that
// a device that neither contracts nor reorders gives the same bits.

fn dot3(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

fn cross3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

/// One over `x`, or 0 for 0.
fn inverse(x: f32) -> f32 {
    return select(0.0, 1.0 / x, x > 0.0);
}

/// Into 0 ..= 1.
fn unit(x: f32) -> f32 {
    let y = select(0.0, x, x > 0.0);
    return select(1.0, y, y < 1.0);
}

fn smaller(a: f32, b: f32) -> f32 {
    return select(b, a, a < b);
}

fn larger(a: f32, b: f32) -> f32 {
    return select(b, a, a > b);
}

/// Triangle `0, e0, e1`, and what the distance of a point to it needs.
struct Triangle {
    e0: vec3<f32>,
    e1: vec3<f32>,
    /// Normal `e0 × e1`.
    n: vec3<f32>,
    /// Dual basis of `e0, e1` in the plane; zero where the triangle is a segment or nearly so.
    m0: vec3<f32>,
    m1: vec3<f32>,
    /// One over the squared lengths of `e0`, `e1`, `e1 - e0`, and of the normal; zero for zero.
    i0: f32,
    i1: f32,
    i2: f32,
    inn: f32,
}

fn prepare(e0: vec3<f32>, e1: vec3<f32>) -> Triangle {
    let e2 = e1 - e0;
    let d0 = dot3(e0, e0);
    let d1 = dot3(e1, e1);
    let d2 = dot3(e2, e2);
    let n = cross3(e0, e1);
    let nn = dot3(n, n);
    // Below an angle of 1e-4 the normal is noise: there the edges alone stand for the triangle.
    let inn = select(0.0, inverse(nn), nn > 1e-8 * d0 * d1);
    return Triangle(
        e0, e1, n, cross3(e1, n) * inn, cross3(n, e0) * inn, inverse(d0), inverse(d1), inverse(d2), inn,
    );
}

/// Squared distance from `w`, seen from the triangle's first corner.
fn triangle2(w: vec3<f32>, t: Triangle) -> f32 {
    let r0 = w - t.e0 * unit(dot3(w, t.e0) * t.i0);
    let r1 = w - t.e1 * unit(dot3(w, t.e1) * t.i1);
    let w2 = w - t.e0;
    let e2 = t.e1 - t.e0;
    let r2 = w2 - e2 * unit(dot3(w2, e2) * t.i2);
    let edges = smaller(smaller(dot3(r0, r0), dot3(r1, r1)), dot3(r2, r2));
    let s = dot3(w, t.m0);
    let r = dot3(w, t.m1);
    let h = dot3(w, t.n);
    let plane = h * h * t.inn;
    // Strict, so that a segment, whose m0 and m1 are zero, is never taken for a plane.
    let inside = smaller(smaller(s, r), 1.0 - (s + r));
    return select(edges, plane, inside > 0.0);
}

/// Squared distance from `x` to the segment from `c` to `d`.
fn segment2(x: vec3<f32>, c: vec3<f32>, d: vec3<f32>) -> f32 {
    let w = x - c;
    let e = d - c;
    let r = w - e * unit(dot3(w, e) * inverse(dot3(e, e)));
    return dot3(r, r);
}
