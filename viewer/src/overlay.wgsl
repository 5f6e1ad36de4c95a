// Rectangles in pixels over a picture.

struct Screen { size: vec2f }
@group(0) @binding(0) var<uniform> screen: Screen;

struct Out {
    @builtin(position) position: vec4f,
    @location(0) colour: vec4f,
}

@vertex
fn vs(@builtin(vertex_index) corner: u32, @location(0) place: vec4f, @location(1) colour: vec4f) -> Out {
    let at = place.xy + place.zw * vec2f(f32(corner & 1u), f32(corner >> 1u));
    let clip = at / screen.size * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
    return Out(vec4f(clip, 0.0, 1.0), colour);
}

@fragment
fn fs(in: Out) -> @location(0) vec4f {
    return in.colour;
}
