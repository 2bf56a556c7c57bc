// Outgoing radiance of each pixel, linear RGB.

#import btf

@group(2) @binding(0) var visibility: texture_2d<u32>;
@group(2) @binding(1) var picture: texture_storage_2d<rgba32float, write>;

// Also stands for a BTF of which nothing is resident, with its mean.
fn shade_diffuse(seen: Surface) -> vec3<f32> {
    var irradiance = PI * frame.ambient;
    for (var i = 0u; i < frame.light_count; i++) {
        let light = incident(seen, i);
        if light.direction.z > 0.0 {
            irradiance += light.irradiance * light.direction.z;
        }
    }
    return materials[seen.material].albedo * irradiance / PI;
}

@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= frame.size) {
        return;
    }
    let ids = textureLoad(visibility, id.xy, 0).xy;
    var radiance = frame.background;
    if ids.x != 0u {
        let seen = surface(id.xy, ids.x - 1u, ids.y);
        let btf = shade_btf(seen);
        radiance = btf.rgb;
        if btf.a == 0.0 {
            radiance = shade_diffuse(seen);
        }
    }
    textureStore(picture, id.xy, vec4(radiance, 1.0));
}
