// Eigen-textures of one group under a pixel where all is resident and lies in order, so that there is no table: trilinear.
//
// The baseline of measurements, which stands for `textures`; `eigen` is the other way. Pages lie in the order of tiles, then
// groups, from slot `page_table` of their material on, and columns in the order of groups from slot `votes` on. See
// `engine::gpu::resident`.

#import pages

// Slots of a layer of pages: 16 rows of 16. Of columns there is one a layer.
fn page_address(slot: u32) -> u32 {
    return ((slot >> 8u) << 16u) | (((slot >> 4u) & 15u) << 8u) | (slot & 15u);
}

fn groups_present(material: u32) -> u32 {
    return materials[material].groups;
}

fn column_slot(material: u32, group: u32) -> u32 {
    return (materials[material].votes + group) << 16u;
}

// First slots of the footprint's tile and of its parent.
fn tile_rows(material: u32, footprint: Footprint) -> vec2<u32> {
    let coarser = min(footprint.mip + 1u, materials[material].mip_count - 1u);
    let tiles = vec2(tile_index(material, footprint, footprint.mip), tile_index(material, footprint, coarser));
    return materials[material].page_table + tiles * materials[material].groups;
}

fn groups_that_matter(rows: vec2<u32>) -> u32 {
    return NONE;
}

fn page_entry(rows: vec2<u32>, group: u32) -> u32 {
    return page_address(rows.x + group);
}

struct Eigen {
    texture: vec4<f32>,
    shown: f32,
}

fn eigen_texture(material: u32, group: u32, footprint: Footprint, rows: vec2<u32>, fine: u32) -> Eigen {
    var texture = page_texel(material, footprint, fine, footprint.mip);
    let coarser = min(footprint.mip + 1u, materials[material].mip_count - 1u);
    if footprint.blend > 0.0 && coarser != footprint.mip {
        let other = page_texel(material, footprint, page_address(rows.y + group), coarser);
        texture = mix(texture, other, footprint.blend);
    }
    return Eigen(texture, 1.0);
}
