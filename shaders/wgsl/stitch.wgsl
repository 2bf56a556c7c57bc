// Borders of cached pages from the payloads of their neighbours, in two passes: no pass may read and write one
// texture, so what is gathered waits in a buffer. Gathering reads payloads only and scattering writes borders only.
//
// One workgroup a strip. Where slots have scales, texels change over to that of the destination; a strip that is a whole
// slot and its own source gives the slot another scale.

#import slots

struct Strip {
    // First texel of the payload that is read, and of the border that is written, in their layers.
    source: vec2<u32>,
    destination: vec2<u32>,
    size: vec2<u32>,
    // 1 where the source goes on along an axis, 0 where it repeats.
    step: vec2<u32>,
    source_layer: u32,
    destination_layer: u32,
    // First texel in the staging buffer.
    staging: u32,
    pad: u32,
    // The scale of the source's slot over that of the destination's; 1 where slots have none.
    ratio: vec4<f32>,
}

const WORKGROUP: u32 = 64u;

@group(0) @binding(0) var<storage, read> strips: array<Strip>;
// As floats, in which half floats are exact.
@group(0) @binding(1) var<storage, read_write> staging: array<vec4<f32>>;
@group(0) @binding(2) var payloads: texture_2d_array<f32>;

@compute @workgroup_size(WORKGROUP)
fn stitch_gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) first: u32) {
    let strip = strips[group.x];
    for (var i = first; i < strip.size.x * strip.size.y; i += WORKGROUP) {
        let at = vec2(i % strip.size.x, i / strip.size.x);
        let texel = textureLoad(payloads, strip.source + at * strip.step, strip.source_layer, 0);
        staging[strip.staging + i] = texel * strip.ratio;
    }
}

@compute @workgroup_size(WORKGROUP)
fn stitch_scatter(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) first: u32) {
    let strip = strips[group.x];
    for (var i = first; i < strip.size.x * strip.size.y; i += WORKGROUP) {
        let at = vec2(i % strip.size.x, i / strip.size.x);
        let texel = storable(staging[strip.staging + i]);
        textureStore(borders, strip.destination + at, strip.destination_layer, texel);
    }
}
