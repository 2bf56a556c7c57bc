// Which materials each tile of the picture shows, and the background.
//
// Shading then runs over workgroups whose pixels all show one material, so that its tables are read and its loops run
// in step, and none over the background.

#import geometry
#import material
#import work

@group(1) @binding(0) var visibility: texture_2d<u32>;
@group(1) @binding(1) var picture: texture_storage_2d<rgba32float, write>;
@group(1) @binding(2) var<storage, read_write> work: Work;
// For each kind the workgroups to dispatch. The first number stands, the second grows.
@group(1) @binding(3) var<storage, read_write> workgroups: array<atomic<u32>, 9>;

var<workgroup> shown: array<u32, 64>;
var<workgroup> distinct: atomic<u32>;

// Whether no pixel before this one shows its material. Neighbours are asked first: few pixels have to ask them all.
fn is_first(index: u32) -> bool {
    let mine = shown[index];
    if mine == NONE || (index % 8u > 0u && shown[index - 1u] == mine) || (index >= 8u && shown[index - 8u] == mine) {
        return false;
    }
    for (var before = 0u; before < index; before++) {
        if shown[before] == mine {
            return false;
        }
    }
    return true;
}

fn append(kind: u32, tile: vec2<u32>, material: u32) {
    let index = atomicAdd(&work.items[kind], 1u);
    work.list[item_place(kind, index, arrayLength(&work.list))] = vec2(tile.x | (tile.y << 16u), material);
    if index % atomicLoad(&workgroups[kind * 3u]) == 0u {
        atomicAdd(&workgroups[kind * 3u + 1u], 1u);
    }
}

@compute @workgroup_size(8, 8)
fn classify(
    @builtin(global_invocation_id) pixel: vec3<u32>,
    @builtin(workgroup_id) tile: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
) {
    var material = NONE;
    if all(pixel.xy < frame.size) {
        let instance = textureLoad(visibility, pixel.xy, 0).x;
        if instance == 0u {
            textureStore(picture, pixel.xy, vec4(frame.background, 1.0));
        } else {
            material = instances[instance - 1u].material;
        }
    }
    shown[index] = material;
    workgroupBarrier();
    let first = is_first(index);
    if first {
        atomicAdd(&distinct, 1u);
    }
    workgroupBarrier();
    if atomicLoad(&distinct) > MOST_ITEMS {
        if index == 0u {
            append(MIXED, tile.xy, NONE);
        }
    } else if first {
        append(select(DIFFUSE, BTF, materials[material].groups > 0u), tile.xy, material);
    }
}
