// A picture in a part of a target: what windows and pages show.
//
// One triangle covers the viewport. Sizes may differ; between texels it is filtered.

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var between: sampler;

// The target encodes sRGB itself, as the picture already is.
override decodes: bool = false;

struct Varyings {
    @builtin(position) position: vec4<f32>,
    @location(0) st: vec2<f32>,
}

@vertex
fn present_vertex(@builtin(vertex_index) corner: u32) -> Varyings {
    let st = vec2(f32(corner & 1u), f32(corner >> 1u)) * 2.0;
    return Varyings(vec4(st.x * 2.0 - 1.0, 1.0 - st.y * 2.0, 0.0, 1.0), st);
}

// IEC 61966-2-1.
fn linear_from_srgb(encoded: vec3<f32>) -> vec3<f32> {
    let power = pow((max(encoded, vec3(0.04045)) + 0.055) / 1.055, vec3(2.4));
    return select(power, encoded / 12.92, encoded <= vec3(0.04045));
}

@fragment
fn present_fragment(varyings: Varyings) -> @location(0) vec4<f32> {
    let shown = textureSampleLevel(picture, between, varyings.st, 0.0).rgb;
    return vec4(select(shown, linear_from_srgb(shown), decodes), 1.0);
}
