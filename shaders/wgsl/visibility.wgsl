// Which triangle of which instance each pixel sees.
//
// A draw per instance, not indexed: vertex_index / 3 is the triangle, so nothing beyond core WebGPU is needed.

#import geometry

struct Varyings {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat, either) ids: vec2<u32>,
}

@vertex
fn visibility_vertex(@builtin(vertex_index) corner: u32, @builtin(instance_index) instance: u32) -> Varyings {
    let position = vertices[vertex_index(instance, corner)].position;
    return Varyings(
        frame.clip_from_eye * vec4(eye_from_position(instance, position), 1.0),
        vec2(instance + 1u, corner / 3u),
    );
}

@fragment
fn visibility_fragment(varyings: Varyings) -> @location(0) vec2<u32> {
    return varyings.ids;
}
