// Squared distance of each point to the nearest of its candidate triangles: the inner loop of a Hausdorff estimate. One
// invocation a point. CPU twin: `Distances::on_cpu` in `src/gpu/hausdorff.rs`.
//#include "triangle.wgsl"

struct Count {
    points: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

@group(0) @binding(0) var<uniform> count: Count;
/// Three numbers a point.
@group(0) @binding(1) var<storage, read> points: array<f32>;
/// Point `i` looks at the triangles `candidates[start[i] .. start[i + 1]]`.
@group(0) @binding(2) var<storage, read> start: array<u32>;
@group(0) @binding(3) var<storage, read> candidates: array<u32>;
/// Nine numbers a triangle.
@group(0) @binding(4) var<storage, read> soup: array<f32>;
/// Bits of the squared distance, and the triangle it is to.
@group(0) @binding(5) var<storage, read_write> nearest: array<vec2<u32>>;

@compute @workgroup_size(64)
fn hausdorff(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= count.points {
        return;
    }
    let x = vec3<f32>(points[3u * id.x], points[3u * id.x + 1u], points[3u * id.x + 2u]);
    var best = 3.0e38;
    var at = 0xffffffffu;
    let end = start[id.x + 1u];
    for (var i = start[id.x]; i < end; i++) {
        let t = 9u * candidates[i];
        let c = vec3<f32>(soup[t], soup[t + 1u], soup[t + 2u]);
        let p = vec3<f32>(soup[t + 3u], soup[t + 4u], soup[t + 5u]);
        let q = vec3<f32>(soup[t + 6u], soup[t + 7u], soup[t + 8u]);
        let d = triangle2(x - c, prepare(p - c, q - c));
        if d < best {
            best = d;
            at = candidates[i];
        }
    }
    nearest[id.x] = vec2<u32>(bitcast<u32>(best), at);
}
