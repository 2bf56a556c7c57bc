// Slots of the page cache that are written: signed bytes of -127 to 127, relative to the scale of the slot.

@group(0) @binding(2) var borders: texture_storage_2d_array<rgba8snorm, write>;

// Rounded here: adapters may round in either direction.
fn storable(texel: vec4<f32>) -> vec4<f32> {
    return round(clamp(texel, vec4(-1.0), vec4(1.0)) * 127.0) / 127.0;
}
