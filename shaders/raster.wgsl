// Which triangle is nearest at each sample: its number and depth. The device's rasterizer covers samples by the same rule as
// the twin, `Frame::fill` of `src/picture/raster.rs`: corners on 1/256 of a sample, edges by the top-left rule, the nearer and of
// equals the first.
//#include "scene.wgsl"

/// A sample of a line or a lone point.
struct Plot {
    /// Column, and row times 65536.
    place: u32,
    z: f32,
    id: u32,
}

@group(1) @binding(0) var<storage, read> plots: array<Plot>;

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) id: u32,
}

fn before(a: Seen, b: Seen) -> bool {
    return a.x < b.x || (a.x == b.x && (a.y < b.y || (a.y == b.y && a.z < b.z)));
}

/// Three invocations a triangle. Corners are put in order of their places, so that triangles that lie in each other have the same depths
/// and the first stays.
@vertex
fn corner(@builtin(vertex_index) index: u32) -> Corner {
    let t = index / 3u;
    let k = index % 3u;
    var a = seen[triangles[t].a];
    var b = seen[triangles[t].b];
    var c = seen[triangles[t].c];
    var out: Corner;
    out.id = frame.first + t;
    // What reaches behind the eye is left out: all three corners in one place.
    out.position = vec4<f32>(-2.0, -2.0, 0.0, 1.0);
    if a.z < 0.0 || b.z < 0.0 || c.z < 0.0 {
        return out;
    }
    if before(b, a) {
        let other = a;
        a = b;
        b = other;
    }
    if before(c, b) {
        let other = b;
        b = c;
        c = other;
    }
    if before(b, a) {
        let other = a;
        a = b;
        b = other;
    }
    if k == 1u {
        a = b;
    }
    if k == 2u {
        a = c;
    }
    let x = f32(a.x - frame.left * PARTS) / (f32(PARTS / 2) * f32(frame.width)) - 1.0;
    let y = 1.0 - f32(a.y - frame.top * PARTS) / (f32(PARTS / 2) * f32(frame.height));
    out.position = vec4<f32>(x, y, a.z, 1.0);
    return out;
}

/// One invocation a sample.
@vertex
fn plot(@builtin(vertex_index) index: u32) -> Corner {
    let p = plots[index];
    let x = (f32(i32(p.place & 0xffffu) - frame.left) + 0.5) * 2.0 / f32(frame.width) - 1.0;
    let y = 1.0 - (f32(i32(p.place >> 16u) - frame.top) + 0.5) * 2.0 / f32(frame.height);
    var out: Corner;
    out.id = p.id;
    out.position = vec4<f32>(x, y, p.z, 1.0);
    return out;
}

@fragment
fn number(in: Corner) -> @location(0) u32 {
    return in.id;
}

/// The same where alpha may cut.
@fragment
fn number_where_solid(in: Corner) -> @location(0) u32 {
    let t = in.id - frame.first;
    let cutoff = paints[triangles[t].paint & NUMBER].cutoff;
    let s = spot(t, frame.left + i32(in.position.x), frame.top + i32(in.position.y));
    if base_of(t, s).w < cutoff {
        discard;
    }
    return in.id;
}
