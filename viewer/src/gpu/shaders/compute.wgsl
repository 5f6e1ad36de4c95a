@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> meshes: array<vec4<u32>, 99>;
@group(0) @binding(2) var<storage, read> tiles: array<Tile>;
@group(0) @binding(3) var<storage, read> tables: array<f32>;
@group(0) @binding(4) var<storage, read> draws: array<Draw>;
// Exponent of each patch, shown << 8; then, in the second half, its least exponent, at the end its
// error in pixels.
@group(0) @binding(5) var<storage, read_write> steps: array<u32>;
// By edge number, the greatest least exponent of its patches; then, in the second half, 255 - the
// edge's exponent: both grow, so both start at 0.
@group(0) @binding(6) var<storage, read_write> edges: array<atomic<u32>>;
// By bucket: how many instances, the first of them, how many are written.
@group(0) @binding(7) var<storage, read_write> buckets: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> instances: array<Instance>;
// Arguments of the indirect draws, of triangles and then of lines.
@group(0) @binding(9) var<storage, read_write> arguments: array<u32>;

fn thread(id: vec3<u32>, groups: vec3<u32>) -> u32 {
    return id.x + id.y * groups.x * 64u;
}
