// A level (or a window of one) as it lies in the device's memory: see `src/gpu/window.rs`.

struct Params {
    /// Edges of this dispatch.
    edges: u32,
    /// Vertices and elements of the level, for a shader that wants to check.
    vertices: u32,
    elements: u32,
    pad: u32,
}

/// What comes back for each edge.
struct Outcome {
    /// The value of the weight, the bits of an `f32`.
    value: u32,
    /// Class in the low byte (0 ordinary, 1 breaking, 2 dangling, 3 illegal, 4: not for this kernel, ask the
    /// processor), whether a face folds in bit 8.
    kind: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
/// Three numbers a vertex.
@group(0) @binding(1) var<storage, read> positions: array<f32>;
/// Element `f` owns `corners[face_start[f] .. face_start[f + 1]]`.
@group(0) @binding(2) var<storage, read> face_start: array<u32>;
@group(0) @binding(3) var<storage, read> corners: array<u32>;
/// Vertex `v` belongs to the elements `star_faces[star_start[v] .. star_start[v + 1]]`, in increasing order.
@group(0) @binding(4) var<storage, read> star_start: array<u32>;
@group(0) @binding(5) var<storage, read> star_faces: array<u32>;
/// The ends of each edge, the smaller one first.
@group(0) @binding(6) var<storage, read> edges: array<vec2<u32>>;
@group(0) @binding(7) var<storage, read_write> outcomes: array<Outcome>;

fn position(v: u32) -> vec3<f32> {
    return vec3<f32>(positions[3u * v], positions[3u * v + 1u], positions[3u * v + 2u]);
}
