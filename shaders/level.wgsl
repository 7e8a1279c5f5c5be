// A level (or a window of one) as it lies in the device's memory: see `src/gpu/stars.rs`.

struct Params {
    /// Edges of this dispatch.
    edges: u32,
    /// Zero. A number that no compiler knows: see `as_it_is`.
    zero: u32,
    pad0: u32,
    pad1: u32,
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
/// The bits of three coordinates, and the place of the vertex's star in `stars`.
@group(0) @binding(1) var<storage, read> vertices: array<vec4<u32>>;
/// For each star a head (see the constants below); then for each of its vertices but the apex, in the order in which its
/// elements name them, the vertex and how it is joined to the apex; then its fans, two at a time.
@group(0) @binding(2) var<storage, read> stars: array<vec2<u32>>;
/// The ends of each edge, the smaller one first.
@group(0) @binding(3) var<storage, read> edges: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> outcomes: array<Outcome>;

/// In a head: vertices in the low byte, fans in the next.
const STAR_BORDER: u32 = 0x10000u;
const STAR_POLYGONS: u32 = 0x20000u;
/// There is nothing behind the head.
const STAR_TOO_LARGE: u32 = 0x40000u;

/// Beside a vertex: elements with the edge to the apex in the low byte, faces among them in the next, and whether a
/// polygon has both, not side by side.
const STAR_FAR: u32 = 0x10000u;

/// In a fan: four places among the star's vertices, six bits each: those of the fan, then the corners after and before
/// the apex in the element. Its kind is in the two highest bits: a triangle, a dangling edge, part of a polygon, or
/// nothing.
const FAN_STRING: u32 = 1u;
const FAN_POLYGON: u32 = 2u;
const FAN_NONE: u32 = 3u;

fn position(v: vec4<u32>) -> vec3<f32> {
    return bitcast<vec3<f32>>(v.xyz);
}

/// `x`, of which no compiler knows more than that: so that sums stay in their order and are not contracted.
fn as_it_is(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) ^ params.zero);
}
