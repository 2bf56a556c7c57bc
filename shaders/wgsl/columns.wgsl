// The column cache: eigen-ABRDFs of resident groups.
//
// A column is a run of texels [view][light][rgb] of four components, stored row by row from the first row of its
// slot. The light after the last is the pre-integrated ambient light.

#import frame

@group(1) @binding(4) var columns: texture_2d_array<f32>;

// `slot` holds the layer in its upper and the first row in its lower half.
fn column_texel(slot: u32, index: u32) -> vec4<f32> {
    let position = vec2(index & frame.column_mask, (slot & 0xffffu) + (index >> frame.column_shift));
    return textureLoad(columns, position, slot >> 16u, 0);
}

// The three colour channels of a group at one view and light; `index` is that of red.
fn eigen_abrdf(slot: u32, index: u32) -> mat3x4<f32> {
    return mat3x4(column_texel(slot, index), column_texel(slot, index + 1u), column_texel(slot, index + 2u));
}
