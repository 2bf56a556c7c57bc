// The column cache with columns as they were sampled: eigen-ABRDFs of resident groups.
//
// A column is a run of half floats [view][light][rgb][component], eight to a texel, stored row by row from the first
// row of its slot. The light after the last is the pre-integrated ambient light. Texels are as large as they can be:
// a load costs software adapters more than the bytes it reads.

#import arithmetic
#import frame

@group(2) @binding(3) var columns: texture_2d_array<u32>;

// `slot` holds the layer in its upper and the first row in its lower half.
fn column_texel(slot: u32, index: u32) -> vec4<u32> {
    let position = vec2(index & frame.column_mask, (slot & 0xffffu) + (index >> frame.column_shift));
    return textureLoad(columns, position, slot >> 16u, 0);
}

fn halves(words: vec2<u32>) -> vec4<Real> {
    return vec4<Real>(vec4(unpack2x16float(words.x), unpack2x16float(words.y)));
}

// The three colour channels of a group at one view and light: twelve half floats from `index` on, counted in fours.
// They are one and a half texels, and begin at one or in its middle.
fn eigen_abrdf(slot: u32, index: u32) -> mat3x4<Real> {
    let first = column_texel(slot, index / 2u);
    let second = column_texel(slot, index / 2u + 1u);
    let whole = (index & 1u) == 0u;
    return mat3x4(
        halves(select(first.zw, first.xy, whole)),
        halves(select(second.xy, first.zw, whole)),
        halves(select(second.zw, second.xy, whole)),
    );
}
