// What there is to shade: items of one material in one 8 × 8 tile of the picture, in lists by kind.

struct Work {
    // Items of each kind.
    items: array<atomic<u32>, 3>,
    pad: u32,
    // Of all pixels, if frame.count_work: groups whose textures were fetched, groups left out because they matter less
    // than the error that is allowed, groups that were not resident.
    groups: array<atomic<u32>, 3>,
    pad2: u32,
    // Tile (column in the lower half, row in the upper) and material. MOST_ITEMS for each tile of the picture, which
    // BTFs fill from the front and diffuse materials from the back, then one for each tile that is mixed.
    list: array<vec2<u32>>,
}

// Kinds: a BTF; a diffuse material; all materials of a tile that has more than MOST_ITEMS. Each item takes a whole
// workgroup, however few of its pixels are the material's: tiles of three and four materials were slower split than mixed.
const BTF: u32 = 0u;
const DIFFUSE: u32 = 1u;
const MIXED: u32 = 2u;
const MOST_ITEMS: u32 = 2u;

// Where in a list of this length the item lies.
fn item_place(kind: u32, index: u32, length: u32) -> u32 {
    let mixed = length / (MOST_ITEMS + 1u) * MOST_ITEMS;
    switch kind {
        case BTF: { return index; }
        case DIFFUSE: { return mixed - 1u - index; }
        default: { return mixed + index; }
    }
}
