// What is no number, told by its bits: compilers may take for granted that arithmetic never meets such values.
//
// Meshes come with everything. What is defined, and where it is seen to:
// - Triangles with a corner that is not finite are not drawn; normals, tangents and texture coordinates that are
//   not finite count as zero (engine::gpu::geometry). Triangles without area cover no pixel.
// - Without a normal the triangle's own stands in, without that z; without a tangent any direction across the normal
//   (`unit` and `any_tangent` in surface.wgsl). Seen from behind the frame is turned.
// - Texture coordinates that overflow count as zero, steps that overflow as infinite: the coarsest mip (pages.wgsl).
// - Views below the horizon count as the horizon (directions.wgsl). Lights there, and lights in the point itself, give
//   nothing (btf.wgsl, shade.wgsl).
// - Radiance that overflows all the same is black (shade.wgsl).

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}
