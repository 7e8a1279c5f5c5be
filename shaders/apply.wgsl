// Puts the records of vertices that a batch changed to their places. One invocation a vertex; the rest of the level stays
// as it lies. See `src/gpu/stars.rs`.

struct Changes {
    count: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

@group(0) @binding(0) var<uniform> changes: Changes;
@group(0) @binding(1) var<storage, read> records: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> slots: array<u32>;
@group(0) @binding(3) var<storage, read_write> resident: array<vec4<u32>>;

@compute @workgroup_size(64)
fn apply(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < changes.count {
        resident[slots[id.x]] = records[id.x];
    }
}
