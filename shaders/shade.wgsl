// The light of what is seen: one invocation a pixel adds those of its samples that show a triangle of the window. CPU twin:
// `Frame::resolve` of `src/picture/raster.rs`.
//#include "scene.wgsl"

@group(1) @binding(0) var ids: texture_2d<u32>;
/// Sums over the samples of each pixel.
@group(1) @binding(1) var<storage, read_write> light: array<vec4<f32>>;

/// Under a bright half of the sky around the lamp, without shadows.
fn colour(t: u32, column: i32, row: i32) -> vec3<f32> {
    let s = spot(t, column, row);
    let w = s.weights;
    let nx = w.x * triangles[t].normals[0] + w.y * triangles[t].normals[3] + w.z * triangles[t].normals[6];
    let ny = w.x * triangles[t].normals[1] + w.y * triangles[t].normals[4] + w.z * triangles[t].normals[7];
    let nz = w.x * triangles[t].normals[2] + w.y * triangles[t].normals[5] + w.z * triangles[t].normals[8];
    let far = sqrt(nx * nx + ny * ny + nz * nz);
    var cosine = 0.0;
    if far > 0.0 {
        cosine = (nx * frame.lamp.x + ny * frame.lamp.y + nz * frame.lamp.z) / far;
    }
    let sky = 0.5 + 0.5 * select(cosine, -cosine, s.back);
    let bright = 0.04 + 0.96 * sky * sky;
    var tint = vec3<f32>(1.0, 1.0, 1.0);
    if paints[triangles[t].paint & NUMBER].plain != 0u {
        tint = select(vec3<f32>(0.72, 0.75, 0.81), vec3<f32>(0.62, 0.33, 0.22), s.back);
    }
    return bright * base_of(t, s).xyz * tint;
}

@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) pixel: vec3<u32>) {
    let width = frame.width / 2u;
    if pixel.x >= width || pixel.y >= frame.height / 2u {
        return;
    }
    var sum = vec3<f32>(0.0, 0.0, 0.0);
    for (var i = 0u; i < 4u; i++) {
        let column = i32(2u * pixel.x + i % 2u);
        let row = i32(2u * pixel.y + i / 2u);
        let t = textureLoad(ids, vec2<i32>(column, row), 0).x - frame.first;
        if t < frame.count {
            sum += colour(t, frame.left + column, frame.top + row);
        }
    }
    let at = pixel.y * width + pixel.x;
    light[at] = light[at] + vec4<f32>(sum, 0.0);
}
