// From linear radiance to 8-bit sRGB.

#import tones

@group(2) @binding(0) var radiance: texture_2d<f32>;
@group(2) @binding(1) var screen: texture_storage_2d<rgba8unorm, write>;

@compute @workgroup_size(8, 8)
fn tonemap(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= frame.size) {
        return;
    }
    textureStore(screen, id.xy, vec4(shown(textureLoad(radiance, id.xy, 0).rgb), 1.0));
}
