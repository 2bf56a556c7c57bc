// Outgoing radiance of each pixel, linear RGB. One workgroup an item of the work that `classify` has found.

#import btf
#import finite
#import work

@group(2) @binding(0) var visibility: texture_2d<u32>;
@group(2) @binding(1) var picture: texture_storage_2d<rgba32float, write>;
@group(2) @binding(2) var<storage, read_write> work: Work;

// Also stands for a BTF of which nothing is resident, with its mean.
fn diffuse_radiance(seen: Surface) -> vec3<f32> {
    var irradiance = PI * frame.ambient;
    for (var i = 0u; i < frame.light_count; i++) {
        let light = incident(seen, i);
        if light.direction.z > 0.0 {
            irradiance += light.irradiance * light.direction.z;
        }
    }
    return materials[seen.material].albedo * irradiance / PI;
}

// What of a BTF is not shown yet is its mean.
fn material_radiance(seen: Surface) -> vec3<f32> {
    let btf = btf_radiance(seen);
    if btf.a == 1.0 {
        return btf.rgb;
    }
    return btf.rgb + (1.0 - btf.a) * diffuse_radiance(seen);
}

fn store(pixel: vec2<u32>, radiance: vec3<f32>) {
    let defined = is_finite(radiance.r) && is_finite(radiance.g) && is_finite(radiance.b);
    textureStore(picture, pixel, vec4(select(vec3(0.0), radiance, defined), 1.0));
    if frame.count_work != 0u {
        atomicAdd(&work.groups[0], groups_fetched);
        atomicAdd(&work.groups[1], groups_left_out);
        atomicAdd(&work.groups[2], groups_absent);
    }
}

// Tile and material of a workgroup's item. There is none for the last workgroups of the last row.
fn item(kind: u32, group: vec3<u32>, groups: vec3<u32>) -> vec2<u32> {
    let index = group.y * groups.x + group.x;
    if index >= atomicLoad(&work.items[kind]) {
        return vec2(NONE);
    }
    return work.list[item_place(kind, index, arrayLength(&work.list))];
}

// What a pixel of an item sees: instance and triangle, instance 0 if nothing of the item's material.
fn seen_by(pixel: vec2<u32>, material: u32) -> vec2<u32> {
    if any(pixel >= frame.size) {
        return vec2(0u);
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == 0u || (material != NONE && instances[ids.x - 1u].material != material) {
        return vec2(0u);
    }
    return ids;
}

fn pixel_of(tile: u32, local: vec3<u32>) -> vec2<u32> {
    return vec2(tile & 0xffffu, tile >> 16u) * 8u + local.xy;
}

@compute @workgroup_size(8, 8)
fn shade_btf(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
) {
    let item = item(BTF, group, groups);
    let pixel = pixel_of(item.x, local);
    let ids = seen_by(pixel, item.y);
    if ids.x != 0u {
        store(pixel, material_radiance(surface(pixel, ids.x - 1u, ids.y, item.y)));
    }
}

@compute @workgroup_size(8, 8)
fn shade_diffuse(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
) {
    let item = item(DIFFUSE, group, groups);
    let pixel = pixel_of(item.x, local);
    let ids = seen_by(pixel, item.y);
    if ids.x != 0u {
        store(pixel, diffuse_radiance(surface(pixel, ids.x - 1u, ids.y, item.y)));
    }
}

@compute @workgroup_size(8, 8)
fn shade_mixed(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
) {
    let item = item(MIXED, group, groups);
    let pixel = pixel_of(item.x, local);
    let ids = seen_by(pixel, NONE);
    if ids.x != 0u {
        let material = instances[ids.x - 1u].material;
        let seen = surface(pixel, ids.x - 1u, ids.y, material);
        if materials[material].groups > 0u {
            store(pixel, material_radiance(seen));
        } else {
            store(pixel, diffuse_radiance(seen));
        }
    }
}
