// The displacement of seams by a collapse. One invocation an edge, on patches that the processor has read. CPU twin:
// `seam_displacement` in `src/metric/seam.rs`.
//#include "triangle.wgsl"

struct Seams {
    edges: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

/// `half` of the edge, then what the wedges say: bit 0 torn, bit 1 on a seam.
struct SeamPatch {
    x: f32,
    y: f32,
    z: f32,
    marks: u32,
}

@group(0) @binding(0) var<uniform> seams: Seams;
@group(0) @binding(1) var<storage, read> patches: array<SeamPatch>;
/// Patch `i` has the points `start[i] .. start[i + 1]`.
@group(0) @binding(2) var<storage, read> start: array<u32>;
/// Three numbers a point.
@group(0) @binding(3) var<storage, read> points: array<f32>;
/// Bits of the displacement, and nothing.
@group(0) @binding(4) var<storage, read_write> displacements: array<vec2<u32>>;

/// Distance of `end` to the nearest of the segments from the midpoint, which is 0.
fn to_seam(end: vec3<f32>, first: u32, last: u32) -> f32 {
    var nearest = 3.0e38;
    for (var i = first; i < last; i++) {
        let p = vec3<f32>(points[3u * i], points[3u * i + 1u], points[3u * i + 2u]);
        let pp = dot3(p, p);
        let t = select(0.0, unit(dot3(end, p) / pp), pp > 0.0);
        let r = end - p * t;
        nearest = smaller(nearest, sqrt(dot3(r, r)));
    }
    return nearest;
}

@compute @workgroup_size(64)
fn seam_displacement(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= seams.edges {
        return;
    }
    let patch_ = patches[id.x];
    let half = vec3<f32>(patch_.x, patch_.y, patch_.z);
    let first = start[id.x];
    let last = start[id.x + 1u];
    var worst = 0.0;
    if (patch_.marks & 1u) != 0u {
        worst = sqrt(dot3(half, half));
    } else if (patch_.marks & 2u) != 0u && first < last {
        worst = larger(worst, to_seam(-half, first, last));
        worst = larger(worst, to_seam(half, first, last));
    }
    displacements[id.x] = vec2<u32>(bitcast<u32>(worst), 0u);
}
