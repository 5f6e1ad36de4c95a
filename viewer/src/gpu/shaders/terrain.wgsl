@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> tiles: array<Tile>;
@group(0) @binding(2) var<storage, read> draws: array<Draw>;
@group(0) @binding(3) var<storage, read> steps: array<u32>;
@group(0) @binding(4) var<storage, read> buckets: array<u32>;
@group(0) @binding(5) var<storage, read> instances: array<Instance>;
@group(0) @binding(6) var heights: texture_2d_array<f32>;
@group(0) @binding(7) var valid: texture_2d_array<u32>;
@group(0) @binding(8) var images: texture_2d_array<f32>;
@group(0) @binding(9) var linear: sampler;
// Which bucket is drawn.
@group(1) @binding(0) var<uniform> bucket: vec4<u32>;

struct Vertex {
    @builtin(position) @invariant position: vec4<f32>,
    // Column and row of the tile's lattice.
    @location(0) place: vec2<f32>,
    // 1 where the surface is, 0 where it is void.
    @location(1) valid: f32,
    // The instance.
    @location(2) @interpolate(flat) draw: u32,
    @location(3) @interpolate(flat) part: u32,
}

// Corner of a tile's heights in its layer; the layer.
fn slot_of(tile: Tile) -> vec3<u32> {
    let k = frame.atlas.x;
    let at = tile.slot % (k * k);
    return vec3<u32>(vec2<u32>(at % k, at / k) * (frame.sizes.x + 1u), tile.slot / (k * k));
}

// North-west corner of a patch.
fn corner_of(part: u32) -> vec2<u32> {
    let number = part & 65535u;
    return vec2<u32>(number % frame.sizes.z, number / frame.sizes.z) << vec2<u32>(frame.sizes.y);
}

fn turned(at: vec2<u32>, side: u32, turn: u32) -> vec2<u32> {
    switch turn {
        case 1u: { return vec2<u32>(side - at.y, at.x); }
        case 2u: { return vec2<u32>(side - at.x, side - at.y); }
        case 3u: { return vec2<u32>(at.y, side - at.x); }
        default: { return at; }
    }
}

fn vertex(index: u32, number: u32, nearer: f32) -> Vertex {
    let it = instances[buckets[frame.counts.w + bucket.x] + number];
    let draw = draws[it.draw];
    let tile = tiles[draw.tile];
    let p = frame.sizes.y;
    let side = 1u << p;
    let corner = corner_of(it.part);
    let at = corner + turned(vec2<u32>(index % (side + 1u), index / (side + 1u)), side, (it.part >> 16u) & 3u);
    let slot = slot_of(tile);
    let height = textureLoad(heights, slot.xy + at, slot.z, 0).x;
    let local = vec2<i32>(at << vec2<u32>(exponent_of(tile)));
    let place = vec3<f32>(across(frame, tile.column + local.x, tile.row + local.y), above(frame, height));
    let depth = dot(place, frame.forward.xyz);
    var out: Vertex;
    out.position = vec4<f32>(
        dot(place, frame.right.xyz) / frame.right.w,
        dot(place, frame.up.xyz) / frame.up.w,
        // Reversed depth without a far plane: near / depth.
        frame.forward.w * nearer,
        depth
    );
    out.place = vec2<f32>(at);
    out.valid = f32(textureLoad(valid, slot.xy + at, slot.z, 0).x);
    out.draw = it.draw;
    out.part = it.part;
    return out;
}

@vertex
fn surface_vertex(@builtin(vertex_index) index: u32, @builtin(instance_index) number: u32) -> Vertex {
    return vertex(index, number, 1.0);
}

// Lines lie a little nearer than the triangles whose edges they are.
@vertex
fn line_vertex(@builtin(vertex_index) index: u32, @builtin(instance_index) number: u32) -> Vertex {
    return vertex(index, number, 1.0005);
}

fn hidden(in: Vertex) -> bool {
    if in.valid < 0.5 || (in.part & CUT) == 0u {
        return in.valid < 0.5;
    }
    // Only a side that cuts the patch matters: all else is drawn by this draw, to the last
    // fragment.
    let window = window_of(draws[in.draw]);
    let low = corner_of(in.part);
    let high = low + (1u << frame.sizes.y);
    return any((window.xy > low) & (in.place < vec2<f32>(window.xy)))
        || any((window.zw < high) & (in.place >= vec2<f32>(window.zw)));
}

// Height and gradient (metres for each sample) of the quadratic spline over the tile's full
// lattice: no facets from near by.
fn lattice(tile: Tile, place: vec2<f32>) -> vec3<f32> {
    let middle = clamp(round(place), vec2<f32>(1.0), vec2<f32>(f32(frame.sizes.x) - 1.0));
    let f = clamp(place - middle, vec2<f32>(-0.5), vec2<f32>(0.5));
    let slot = slot_of(tile);
    let at = slot.xy + vec2<u32>(middle);
    let u = vec3<f32>(0.5 * (0.5 - f.x) * (0.5 - f.x), 0.75 - f.x * f.x, 0.5 * (0.5 + f.x) * (0.5 + f.x));
    let v = vec3<f32>(0.5 * (0.5 - f.y) * (0.5 - f.y), 0.75 - f.y * f.y, 0.5 * (0.5 + f.y) * (0.5 + f.y));
    let north = row_of(at - vec2<u32>(0u, 1u), slot.z);
    let same = row_of(at, slot.z);
    let south = row_of(at + vec2<u32>(0u, 1u), slot.z);
    let heights_u = vec3<f32>(dot(north, u), dot(same, u), dot(south, u));
    let slope = vec3<f32>(f.x - 0.5, -2.0 * f.x, f.x + 0.5);
    let slopes_u = vec3<f32>(dot(north, slope), dot(same, slope), dot(south, slope));
    return vec3<f32>(dot(heights_u, v), dot(slopes_u, v), dot(heights_u, vec3<f32>(f.y - 0.5, -2.0 * f.y, f.y + 0.5)));
}

// Three heights from west to east.
fn row_of(at: vec2<u32>, layer: u32) -> vec3<f32> {
    return vec3<f32>(
        textureLoad(heights, at - vec2<u32>(1u, 0u), layer, 0).x,
        textureLoad(heights, at, layer, 0).x,
        textureLoad(heights, at + vec2<u32>(1u, 0u), layer, 0).x
    );
}

// Sky and sun; 1 on flat ground under a sun in the zenith.
fn light(tile: Tile, slope: vec2<f32>) -> f32 {
    let sample = frame.spacing.xy * f32(1u << exponent_of(tile));
    let gradient = slope * frame.spacing.z / sample;
    let normal = normalize(vec3<f32>(-gradient.x, gradient.y, 1.0));
    return 0.3 * (0.5 + 0.5 * normal.z) + 0.7 * max(dot(normal, frame.sun.xyz), 0.0);
}

// Lowlands green, then yellow, brown, grey, white: linear colours.
fn tint(height: f32) -> vec3<f32> {
    let t = 5.0 * (height - frame.range.x) / max(frame.range.y - frame.range.x, 1.0e-6);
    var colour = mix(vec3<f32>(0.073, 0.194, 0.091), vec3<f32>(0.246, 0.392, 0.141), saturate(t));
    colour = mix(colour, vec3<f32>(0.604, 0.571, 0.258), saturate(t - 1.0));
    colour = mix(colour, vec3<f32>(0.376, 0.223, 0.098), saturate(t - 2.0));
    colour = mix(colour, vec3<f32>(0.366, 0.319, 0.279), saturate(t - 3.0));
    return mix(colour, vec3<f32>(0.905, 0.913, 0.930), saturate(t - 4.0));
}

// A colour for each number, neighbours far apart.
fn code(number: u32) -> vec3<f32> {
    let hue = fract(f32(number) * 0.381966) * 6.0;
    let wheel = abs(vec3<f32>(hue) - vec3<f32>(3.0, 2.0, 4.0)) * vec3<f32>(1.0, -1.0, -1.0) + vec3<f32>(-1.0, 2.0, 2.0);
    return mix(vec3<f32>(0.12), vec3<f32>(0.8), saturate(wheel));
}

// The image over a colour.
fn over(draw: Draw, place: vec2<f32>, under: vec3<f32>) -> vec3<f32> {
    if draw.image == 0u {
        return under;
    }
    let k = frame.atlas.y;
    let side = f32(frame.atlas.z);
    let at = (draw.image - 1u) % (k * k);
    let corner = vec2<f32>(vec2<u32>(at % k, at / k)) * side;
    let texel = corner + clamp(place * draw.texel.x + draw.texel.yz, vec2<f32>(0.5), vec2<f32>(side - 0.5));
    let colour = textureSampleLevel(images, linear, texel / (side * f32(k)), (draw.image - 1u) / (k * k), 0.0);
    return mix(under, colour.xyz, colour.w);
}

// For a target that does not code sRGB itself.
fn coded(linear_colour: vec3<f32>) -> vec3<f32> {
    if (frame.look.y & 2u) == 0u {
        return linear_colour;
    }
    let c = clamp(linear_colour, vec3<f32>(0.0), vec3<f32>(1.0));
    let curved = 1.055 * pow(max(c, vec3<f32>(1.0e-9)), vec3<f32>(1.0 / 2.4)) - 0.055;
    return select(curved, 12.92 * c, c <= vec3<f32>(0.0031308));
}

@fragment
fn surface(in: Vertex) -> @location(0) vec4<f32> {
    let pixel = fwidth(in.place);
    if hidden(in) {
        discard;
    }
    let draw = draws[in.draw];
    let tile = tiles[draw.tile];
    let patches = frame.sizes.z * frame.sizes.z;
    let number = draw.tile * patches + (in.part & 65535u);
    let ground = lattice(tile, in.place);
    var colour = vec3<f32>(0.0);
    switch frame.look.x {
        case 0u: { colour = over(draw, in.place, tint(ground.x)); }
        case 1u: { colour = tint(ground.x); }
        case 2u: { colour = code((tile.kind >> 8u) & 255u); }
        case 3u: { colour = code(steps[number] & 255u); }
        default: {
            let error = bitcast<f32>(steps[frame.counts.x * patches + number]);
            let t = 2.0 * error / max(frame.sun.w, 1.0e-6);
            colour = mix(vec3<f32>(0.03, 0.1, 0.8), vec3<f32>(0.1, 0.6, 0.15), saturate(t));
            colour = mix(colour, vec3<f32>(0.85, 0.05, 0.03), saturate(t - 1.0));
        }
    }
    colour *= light(tile, ground.yz);
    if (frame.look.y & 1u) != 0u {
        let away = min(in.place, vec2<f32>(f32(frame.sizes.x)) - in.place) / max(pixel, vec2<f32>(1.0e-9));
        colour *= mix(0.25, 1.0, clamp(min(away.x, away.y) - 0.5, 0.0, 1.0));
    }
    return vec4<f32>(coded(colour), 1.0);
}

@fragment
fn line(in: Vertex) -> @location(0) vec4<f32> {
    if hidden(in) {
        discard;
    }
    return vec4<f32>(coded(vec3<f32>(0.01)), 0.5);
}

@fragment
fn counted(in: Vertex) -> @location(0) vec4<f32> {
    if hidden(in) {
        discard;
    }
    return vec4<f32>(1.0 / 16.0, 0.0, 0.0, 0.0);
}
