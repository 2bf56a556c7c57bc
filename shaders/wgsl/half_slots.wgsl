// Slots of the page cache that are written: half floats. Stands for `slots`; `byte_slots` is the other way.

@group(0) @binding(2) var borders: texture_storage_2d_array<rgba16float, write>;

fn storable(texel: vec4<f32>) -> vec4<f32> {
    return texel;
}
