// Counts for each tile the pixels that want it: the votes.
//
// Source: Schwartz, Ruiters, Klein 2013, sections 3 and 5.2 (equation 9). Instead of an image that is read back
// and evaluated on the CPU, the tiles are counted here.

#import pages

@group(2) @binding(0) var visibility: texture_2d<u32>;
@group(2) @binding(1) var<storage, read_write> votes: array<atomic<u32>>;

// Which pixel of a cell votes: every pixel once in stride² phases, cells out of step with their neighbours so
// that thin things are not missed by all of them at once.
fn voter(cell: vec2<u32>) -> vec2<u32> {
    let stride = frame.feedback_stride;
    let area = stride * stride;
    // 5 is coprime to 16, 4 and 1: consecutive phases lie apart.
    let place = ((frame.feedback_phase + cell.x * 7u + cell.y * 11u) * 5u) % area;
    return cell * stride + vec2(place % stride, place / stride);
}

@compute @workgroup_size(8, 8)
fn feedback(@builtin(global_invocation_id) cell: vec3<u32>) {
    let pixel = voter(cell.xy);
    if any(pixel >= frame.size) {
        return;
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == 0u {
        return;
    }
    let seen = surface(pixel, ids.x - 1u, ids.y);
    if materials[seen.material].groups == 0u {
        return;
    }
    let wanted = footprint(seen);
    atomicAdd(&votes[materials[seen.material].votes + tile_index(seen.material, wanted, wanted.mip)], 1u);
}
