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

// The counter for which the pixel of a cell votes; NONE if it shows no BTF.
fn counter(cell: vec2<u32>) -> u32 {
    let pixel = voter(cell);
    if any(pixel >= frame.size) {
        return NONE;
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == 0u {
        return NONE;
    }
    let material = instances[ids.x - 1u].material;
    if materials[material].groups == 0u {
        return NONE;
    }
    let wanted = footprint(surface(pixel, ids.x - 1u, ids.y, material));
    return materials[material].votes + tile_index(material, wanted, wanted.mip);
}

var<workgroup> wanted_by: array<u32, 64>;
var<workgroup> cells: array<atomic<u32>, 64>;

// Neighbours mostly want one tile: what they have in common is counted in the workgroup, by the first of them.
@compute @workgroup_size(8, 8)
fn feedback(@builtin(global_invocation_id) cell: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let mine = counter(cell.xy);
    wanted_by[index] = mine;
    workgroupBarrier();
    var first = 0u;
    while first < index && wanted_by[first] != mine {
        first++;
    }
    atomicAdd(&cells[first], 1u);
    workgroupBarrier();
    if first == index && mine != NONE {
        atomicAdd(&votes[mine], atomicLoad(&cells[index]));
    }
}
