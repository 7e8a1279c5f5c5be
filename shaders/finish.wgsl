// From light to codes: adds the samples that show no triangle, and looks the mean up. One invocation a pixel. CPU twin: the end of
// `Frame::resolve` of `src/picture/raster.rs`.

/// A tile of the picture.
struct Tile {
    width: u32,
    height: u32,
    triangles: u32,
    pad0: u32,
}

@group(0) @binding(0) var<uniform> tile: Tile;
@group(0) @binding(1) var ids: texture_2d<u32>;
@group(0) @binding(2) var<storage, read> light: array<vec4<f32>>;
/// Linear light of nothing, of wires, of dangling edges; then of lone points.
@group(0) @binding(3) var<storage, read> others: array<vec4<f32>>;
/// What each step of light is in the picture.
@group(0) @binding(4) var<storage, read> codes: array<u32>;
/// Red, green and blue, from the lowest byte up.
@group(0) @binding(5) var<storage, read_write> pixels: array<u32>;

/// Numbers from here up are nothing, wires, dangling edges, downwards.
const EMPTY: u32 = 0xffffffffu;
const DANGLING: u32 = 0xfffffffdu;
const CODES: f32 = 4096.0;

fn code(c: f32) -> u32 {
    let at = c / 4.0 * CODES + 0.5;
    return codes[u32(select(select(at, CODES, at > CODES), 0.0, at < 0.0))];
}

@compute @workgroup_size(8, 8)
fn finish(@builtin(global_invocation_id) pixel: vec3<u32>) {
    let width = tile.width / 2u;
    if pixel.x >= width || pixel.y >= tile.height / 2u {
        return;
    }
    let at = pixel.y * width + pixel.x;
    var sum = light[at].xyz;
    for (var i = 0u; i < 4u; i++) {
        let place = vec2<i32>(i32(2u * pixel.x + i % 2u), i32(2u * pixel.y + i / 2u));
        let id = textureLoad(ids, place, 0).x;
        if id >= DANGLING {
            sum += others[EMPTY - id].xyz;
        } else if id >= tile.triangles {
            sum += others[3u + id - tile.triangles].xyz;
        }
    }
    pixels[at] = code(sum.x) | (code(sum.y) << 8u) | (code(sum.z) << 16u);
}
