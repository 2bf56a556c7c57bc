// The page cache and its table: eigen-textures at any texture coordinate and mip, from what is resident.
//
// Source: Schwartz, Ruiters, Klein 2013, section 3 (equation 3: from virtual to cached texels). A table entry
// names the finest resident page among a tile and its ancestors, so one load finds it.

#import finite
#import surface

// Rows of groups + 1 words. A material's first row: how many groups may have a column, then the columns by group. A row
// for each of its tiles: how many groups matter there, then the pages by group.
//
// Entries of pages: mip in the upper 5 bits, then layer (11), row (8) and column (8) of the slot; NONE if nothing is
// there.
@group(1) @binding(0) var<storage, read> page_table: array<u32>;
@group(1) @binding(2) var pages: texture_2d_array<f32>;
@group(1) @binding(3) var page_sampler: sampler;
// By slot, 256 in a row: by what each component's texels are multiplied where the cache holds bytes.
@group(1) @binding(5) var slot_scales: texture_2d<f32>;

const SLOT_TEXELS: f32 = 72.0;
const PAGE_TEXELS: f32 = 64.0;
// Largest size accepted for a step in texture coordinates: beyond it lies only the coarsest mip.
const MAX_STEP: f32 = 1e9;

// What a pixel wants of a material: the two mips of trilinear filtering and the tiles in them.
struct Footprint {
    // Inside [0, 1].
    st: vec2<f32>,
    // The finer mip, and the share of the next coarser one.
    mip: u32,
    blend: f32,
    // Column and row of the finer mip's tile; the coarser mip's tile is its parent.
    tile: vec2<u32>,
}

// Level of detail (paper, section 3, equation 1, with mip 0 the finest).
fn footprint(surface: Surface) -> Footprint {
    let m = surface.material;
    let texels = materials[m].mips[0].size;
    let step = max(length(surface.st_dx * texels), length(surface.st_dy * texels)) * frame.pixel_scale;
    let coarsest = f32(materials[m].mip_count - 1u);
    // Written so that a step that is no number ends at the coarsest mip.
    let exact = select(coarsest, clamp(log2(max(step, 1e-9)), 0.0, coarsest), step < MAX_STEP);
    let lod = select(exact, floor(exact + 0.5), frame.nearest_mip != 0u);
    var result: Footprint;
    result.mip = u32(lod);
    result.blend = lod - floor(lod);
    let repeats = (materials[m].flags & REPEATS) != 0u;
    let st = select(vec2(0.0), surface.st, is_finite(surface.st.x) && is_finite(surface.st.y));
    result.st = select(clamp(st, vec2(0.0), vec2(1.0)), fract(st), repeats);
    let page = vec2<u32>(result.st * materials[m].mips[result.mip].size / PAGE_TEXELS);
    result.tile = min(page, materials[m].mips[result.mip].tiles - 1u);
    return result;
}

// Index of the tile of `mip` that lies over the footprint's.
fn tile_index(material: u32, footprint: Footprint, mip: u32) -> u32 {
    let columns = materials[material].mips[mip].tiles.x;
    let tile = select((footprint.tile >> vec2(mip - footprint.mip)), vec2(0u), mip >= materials[material].tail_mip);
    return materials[material].mips[mip].first_tile + tile.y * columns + tile.x;
}

// First word of a tile's row in the page table.
fn page_row(material: u32, footprint: Footprint, mip: u32) -> u32 {
    let tile = tile_index(material, footprint, mip);
    return materials[material].page_table + (1u + tile) * (materials[material].groups + 1u);
}

// Where a page's slot stands in a texture of slots, 256 in a row.
fn slot_place(entry: u32) -> vec2<u32> {
    let place = ((entry >> 16u) & 0x7ffu) * frame.layer_slots + ((entry >> 8u) & 0xffu) * frame.slot_columns + (entry & 0xffu);
    return vec2(place & 0xffu, place >> 8u);
}

// One page's texel, bilinear, at a mip that the page holds.
fn page_texel(material: u32, footprint: Footprint, entry: u32, mip: u32) -> vec4<f32> {
    let tile = select((footprint.tile >> vec2(mip - footprint.mip)), vec2(0u), mip >= materials[material].tail_mip);
    let inside = footprint.st * materials[material].mips[mip].size - vec2<f32>(tile) * PAGE_TEXELS;
    let slot = vec2<f32>(vec2(entry & 0xffu, (entry >> 8u) & 0xffu)) * SLOT_TEXELS;
    let texel = slot + materials[material].mips[mip].origin + inside;
    let stored = textureSampleLevel(pages, page_sampler, texel * frame.page_scale, (entry >> 16u) & 0x7ffu, 0.0);
    if frame.scaled == 0u {
        return stored;
    }
    return stored * textureLoad(slot_scales, slot_place(entry), 0);
}
