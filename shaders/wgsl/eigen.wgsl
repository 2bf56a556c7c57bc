// Eigen-textures of one group under a pixel: trilinear, and with new pages fading in. Stands for `textures`; `resident` is
// the other way.
//
// While a page's slot has a weight below one, the page is mixed with what its parent's entry names: what was shown
// before it came. What is missing after the root is missing from the sum over groups.

#import pages

// By slot, 256 in a row.
@group(1) @binding(4) var slot_weights: texture_2d<f32>;

// Groups of a material up to the last that has a column.
fn groups_present(material: u32) -> u32 {
    return page_table[materials[material].page_table];
}

// Where a group's column lies; NONE if it is not resident.
fn column_slot(material: u32, group: u32) -> u32 {
    return page_table[materials[material].page_table + 1u + group];
}

// Rows of the footprint's tile and of its parent.
fn tile_rows(material: u32, footprint: Footprint) -> vec2<u32> {
    let coarser = min(footprint.mip + 1u, materials[material].mip_count - 1u);
    return vec2(page_row(material, footprint, footprint.mip), page_row(material, footprint, coarser));
}

// Leading groups that make all but the error that a pixel may have.
fn groups_that_matter(rows: vec2<u32>) -> u32 {
    return page_table[rows.x];
}

// The entry of the footprint's tile.
fn page_entry(rows: vec2<u32>, group: u32) -> u32 {
    return page_table[rows.x + 1u + group];
}

// Whether the weight of any slot may be below one: frames in which nothing fades do without all that is needed for it.
override fading: bool = true;

struct Eigen {
    texture: vec4<f32>,
    // The share that is shown: 1 but for roots that fade in.
    shown: f32,
}

// One mip from the page of an entry, which is that mip's or a coarser one's.
fn eigen_mip(material: u32, group: u32, footprint: Footprint, entry: u32, mip: u32) -> Eigen {
    if !fading {
        return Eigen(page_texel(material, footprint, entry, mip), 1.0);
    }
    var sum = vec4(0.0);
    var left = 1.0;
    var page = entry;
    while page != NONE && left > 0.0 {
        let page_mip = page >> 27u;
        let weight = textureLoad(slot_weights, slot_place(page), 0).x;
        sum += left * weight * page_texel(material, footprint, page, max(mip, page_mip));
        left *= 1.0 - weight;
        if page_mip >= materials[material].tail_mip {
            break;
        }
        page = page_table[page_row(material, footprint, page_mip + 1u) + 1u + group];
    }
    return Eigen(sum, 1.0 - left);
}

// `rows` are those of `tile_rows`, `fine` the `page_entry` that is there. Where both mips fall back to one resident mip it
// is sampled once.
fn eigen_texture(material: u32, group: u32, footprint: Footprint, rows: vec2<u32>, fine: u32) -> Eigen {
    let coarsest = materials[material].mip_count - 1u;
    let fine_mip = max(footprint.mip, fine >> 27u);
    var result = eigen_mip(material, group, footprint, fine, fine_mip);
    if footprint.blend > 0.0 {
        let coarse = page_table[rows.y + 1u + group];
        let coarse_mip = max(min(footprint.mip + 1u, coarsest), coarse >> 27u);
        if coarse_mip != fine_mip {
            let other = eigen_mip(material, group, footprint, coarse, coarse_mip);
            result.texture = mix(result.texture, other.texture, footprint.blend);
            result.shown = mix(result.shown, other.shown, footprint.blend);
        }
    }
    return result;
}
