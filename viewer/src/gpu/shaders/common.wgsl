// What all passes know. Positions are relative to the eye: a tile's origin is given in columns and
// rows from the camera's own column and row, so that single precision is enough anywhere.

struct Frame {
    right: vec4<f32>,     // w: tangent of half the horizontal field of view
    up: vec4<f32>,        // w: of the vertical one
    forward: vec4<f32>,   // w: metres to the near plane
    spacing: vec4<f32>,   // dx, dy, exaggeration, lambda
    eye: vec4<f32>,       // fractions of column and row, height and what single precision left of it
    sun: vec4<f32>,       // w: tolerance in pixels
    range: vec4<f32>,     // lowest tint, greatest
    sizes: vec4<u32>,     // T, p, patches on a side, rule (0 shared, 1 paper)
    counts: vec4<u32>,    // tiles, draws, edge numbers, buckets
    atlas: vec4<u32>,     // tiles on a side of a layer of heights, the same for images, texels of an image
    look: vec4<u32>,      // paint, 1 borders | 2 the target is not sRGB
}

struct Tile {
    column: i32,
    row: i32,
    kind: u32,            // exponent, level << 8, parity of x + y << 16
    slot: u32,
    first: vec4<u32>,     // of its sides: north, east, south, west
    local: vec4<u32>,
    side: vec4<u32>,      // shift, limit << 8
}

struct Draw {
    tile: u32,
    image: u32,           // slot + 1, or 0
    west_east: u32,       // window, 16 bits each
    north_south: u32,
    texel: vec4<f32>,     // texels of an image's layer: scale, left, top
}

struct Instance {
    draw: u32,
    part: u32,            // patch, turn << 16, CUT
}

// The window of the draw cuts the patch.
const CUT: u32 = 0x40000u;

fn exponent_of(tile: Tile) -> u32 {
    return tile.kind & 255u;
}

fn window_of(draw: Draw) -> vec4<u32> {
    return vec4<u32>(
        draw.west_east & 65535u, draw.north_south & 65535u,
        draw.west_east >> 16u, draw.north_south >> 16u
    );
}

// Metres east and north of the eye.
fn across(frame: Frame, column: i32, row: i32) -> vec2<f32> {
    return vec2<f32>(
        (f32(column) - frame.eye.x) * frame.spacing.x,
        -((f32(row) - frame.eye.y) * frame.spacing.y)
    );
}

// Metres above the eye.
fn above(frame: Frame, height: f32) -> f32 {
    return (height * frame.spacing.z - frame.eye.z) - frame.eye.w;
}
