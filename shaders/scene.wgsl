// What is drawn, as all passes of the renderer read it, and what a surface looks like at a sample: twins of `Plane` and `Surface` of
// `src/picture/raster.rs` and of `Texture::sample` of `src/picture/texture.rs`, in the same order and with the same formulas. Nothing is
// left to the samplers of the device: their filters are as coarse as each maker likes.

/// A window of the triangles on a tile of the picture.
struct Frame {
    /// The tile's first sample, and its samples.
    left: i32,
    top: i32,
    width: u32,
    height: u32,
    /// Number of the window's first triangle, triangles in it, triangles in all.
    first: u32,
    count: u32,
    triangles: u32,
    pad0: u32,
    /// From where the light comes, in the scene's axes.
    lamp: vec4<f32>,
}

/// A point as it is seen: column and row in 1/256 of a sample, depth from 0.1 to 0.9 (below 0 behind the eye), how much nearer than
/// the centre it is.
struct Seen {
    x: i32,
    y: i32,
    z: f32,
    near: f32,
}

/// Points of the window, what it is painted with, values at its corners.
struct Triangle {
    a: u32,
    b: u32,
    c: u32,
    paint: u32,
    normals: array<f32, 9>,
    uvs: array<f32, 6>,
    /// Texels of the full image in twice the triangle.
    texels: f32,
}

/// What a face is painted with. `levels` is 0 without an image.
struct Paint {
    factor: vec4<f32>,
    cutoff: f32,
    plain: u32,
    wraps: u32,
    levels: u32,
    width: u32,
    height: u32,
    /// The first row of `texels` that is the image's.
    row: u32,
    pad0: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> seen: array<Seen>;
@group(0) @binding(2) var<storage, read> triangles: array<Triangle>;
/// Twelve numbers a triangle, where triangles have colours.
@group(0) @binding(3) var<storage, read> colours: array<f32>;
@group(0) @binding(4) var<storage, read> paints: array<Paint>;
/// All images in all sizes, one texel after the other.
@group(0) @binding(5) var texels: texture_2d_array<u32>;

const PARTS: i32 = 256;
/// In `Triangle::paint`: there are texture coordinates, there are colours; the paint's number is in the other bits.
const HAS_UVS: u32 = 0x40000000u;
const HAS_COLOURS: u32 = 0x80000000u;
const NUMBER: u32 = 0x3fffffffu;
/// Texels of a row of `texels`, rows of a layer.
const ROW: u32 = 2048u;

/// The points of a triangle, and what is known of it at a sample.
struct Spot {
    a: Seen,
    b: Seen,
    c: Seen,
    /// How much each corner counts, seen in perspective.
    weights: vec3<f32>,
    back: bool,
    /// In samples, of the triangle twice.
    area: f32,
}

fn offset_from(p: Seen, x: i32, y: i32) -> vec2<f32> {
    return vec2<f32>(f32(p.x - x), f32(p.y - y));
}

fn turn(a: vec2<f32>, b: vec2<f32>) -> f32 {
    return a.x * b.y - a.y * b.x;
}

/// Triangle `t` of the window at a sample of the picture.
fn spot(t: u32, column: i32, row: i32) -> Spot {
    var s: Spot;
    s.a = seen[triangles[t].a];
    s.b = seen[triangles[t].b];
    s.c = seen[triangles[t].c];
    let x = column * PARTS + PARTS / 2;
    let y = row * PARTS + PARTS / 2;
    let a = offset_from(s.a, x, y);
    let b = offset_from(s.b, x, y);
    let c = offset_from(s.c, x, y);
    let w = vec3<f32>(turn(b, c) * s.a.near, turn(c, a) * s.b.near, turn(a, b) * s.c.near);
    let sum = w.x + w.y + w.z;
    s.weights = select(vec3<f32>(1.0 / 3.0), w / sum, sum != 0.0);
    let area = turn(offset_from(s.b, s.a.x, s.a.y), offset_from(s.c, s.a.x, s.a.y));
    s.back = area > 0.0;
    s.area = abs(area) / f32(PARTS * PARTS);
    return s;
}

/// The texel that a place before or behind the edges of an image means.
fn wrapped(i: i32, n: i32, wrap: u32) -> i32 {
    if wrap == 1u {
        return select(select(i, n - 1, i >= n), 0, i < 0);
    }
    let period = select(n, 2 * n, wrap == 2u);
    var j = i % period;
    j = select(j, j + period, j < 0);
    return select(j, 2 * n - 1 - j, j >= n);
}

fn texel(first: u32, width: u32, column: i32, row: i32) -> vec4<f32> {
    let at = first + u32(row) * width + u32(column);
    let line = at / ROW;
    return vec4<f32>(textureLoad(texels, vec2<i32>(i32(at % ROW), i32(line % ROW)), i32(line / ROW), 0));
}

fn within_size(p: Paint, first: u32, width: u32, height: u32, uv: vec2<f32>) -> vec4<f32> {
    let at = vec2<f32>(uv.x * f32(width) - 0.5, uv.y * f32(height) - 0.5);
    let low = floor(at);
    let part = at - low;
    let n = vec2<i32>(i32(width), i32(height));
    let left = wrapped(i32(low.x), n.x, p.wraps & 3u);
    let right = wrapped(i32(low.x) + 1, n.x, p.wraps & 3u);
    let top = wrapped(i32(low.y), n.y, p.wraps >> 2u);
    let bottom = wrapped(i32(low.y) + 1, n.y, p.wraps >> 2u);
    let a = texel(first, width, left, top);
    let b = texel(first, width, right, top);
    let c = texel(first, width, left, bottom);
    let d = texel(first, width, right, bottom);
    let upper = a + part.x * (b - a);
    let lower = c + part.x * (d - c);
    return (upper + part.y * (lower - upper)) / 65535.0;
}

/// The value of the image between its texels and its sizes.
fn textured(p: Paint, uv: vec2<f32>, size: f32) -> vec4<f32> {
    let last = f32(p.levels - 1u);
    let level = select(select(size, last, size > last), 0.0, size < 0.0);
    let fine = u32(level);
    var first = p.row * ROW;
    var width = p.width;
    var height = p.height;
    for (var i = 0u; i < fine; i++) {
        first += width * height;
        width = select(1u, width / 2u, width > 1u);
        height = select(1u, height / 2u, height > 1u);
    }
    let a = within_size(p, first, width, height, uv);
    let t = level - f32(fine);
    if t == 0.0 {
        return a;
    }
    first += width * height;
    width = select(1u, width / 2u, width > 1u);
    height = select(1u, height / 2u, height > 1u);
    let b = within_size(p, first, width, height, uv);
    return a + t * (b - a);
}

/// Linear light and alpha before any lamp.
fn base_of(t: u32, s: Spot) -> vec4<f32> {
    let marks = triangles[t].paint;
    let p = paints[marks & NUMBER];
    let w = s.weights;
    var base = p.factor;
    if (marks & HAS_COLOURS) != 0u {
        let c = 12u * t;
        base *= w.x * vec4<f32>(colours[c], colours[c + 1u], colours[c + 2u], colours[c + 3u])
            + w.y * vec4<f32>(colours[c + 4u], colours[c + 5u], colours[c + 6u], colours[c + 7u])
            + w.z * vec4<f32>(colours[c + 8u], colours[c + 9u], colours[c + 10u], colours[c + 11u]);
    }
    if (marks & HAS_UVS) != 0u && p.levels > 0u {
        let u = w.x * triangles[t].uvs[0] + w.y * triangles[t].uvs[2] + w.z * triangles[t].uvs[4];
        let v = w.x * triangles[t].uvs[1] + w.y * triangles[t].uvs[3] + w.z * triangles[t].uvs[5];
        var size = 0.0;
        let ratio = triangles[t].texels / s.area;
        if ratio > 1.0e-6 {
            size = 0.5 * log2(ratio);
        }
        base *= textured(p, vec2<f32>(u, v), size);
    }
    return base;
}
