// Materials and where their parts lie in the shared tables.

struct Mip {
    // Texels.
    size: vec2<f32>,
    // Where in a slot the payload of this mip begins, in texels.
    origin: vec2<f32>,
    // Columns and rows of pages.
    tiles: vec2<u32>,
    // Index of the mip's first tile.
    first_tile: u32,
    pad: u32,
}

// Offsets into the words of `directions`.
struct Triangulation {
    points: u32,
    triangles: u32,
    hull: u32,
    start: u32,
    triangle_count: u32,
    hull_count: u32,
}

struct Material {
    uv_scale: vec2<f32>,
    uv_offset: vec2<f32>,
    // Of a diffuse material, or the mean of a BTF.
    albedo: vec3<f32>,
    // By which decoded eigen-textures are multiplied.
    texture_scale: f32,
    // Component groups; 0 for a material that is not a BTF, or whose archive is not known yet.
    groups: u32,
    // The material's first entry in the page table; see `pages`.
    page_table: u32,
    // The material's first counter in the votes, which are by tile.
    votes: u32,
    // Bit 0: repeats. Bit 1: the samples include the light's cosine.
    flags: u32,
    mip_count: u32,
    tail_mip: u32,
    // Light directions; the pre-integrated ambient light follows them in a column.
    lights: u32,
    // Texels along a side of a map of the light hemisphere, where columns are such maps.
    map_side: u32,
    view_directions: Triangulation,
    light_directions: Triangulation,
    mips: array<Mip, 17>,
}

const REPEATS: u32 = 1u;
const INCLUDES_COSINE: u32 = 2u;

@group(0) @binding(4) var<storage, read> materials: array<Material>;
