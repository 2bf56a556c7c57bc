// Pages from what their records say and from their parents in the page cache: the parallel half of decoding.
// What the words hold, and the transform, stand in tileset/src/codec/pyramid_dct/page/coefficients.rs.
//
// Pages wait in a buffer between reading the cache and writing it, which no pass may do at once. One workgroup makes a
// block of 16 × 16 texels; borders are guesses until neighbours are stitched in.

struct DecodedPage {
    // First texel of the slot in its layer, and the parent's texel under the first of the payload.
    slot: vec2<u32>,
    parent: vec2<u32>,
    // Texels of the payload.
    size: vec2<u32>,
    // Along each axis bit 0 where the picture ends before the payload, bit 1 where it ends behind.
    ends: vec2<u32>,
    layer: u32,
    parent_layer: u32,
    // First of its words.
    words: u32,
    // By which coefficients are multiplied.
    step: f32,
}

const SIDE: u32 = 16u;
const BORDER: u32 = 4u;
const SLOT: u32 = 72u;
const HALF_MAX: f32 = 65504.0;

@group(0) @binding(0) var<storage, read> decoded: array<DecodedPage>;
@group(0) @binding(1) var<storage, read> words: array<u32>;
// [length][k][x], 16 of each.
@group(0) @binding(2) var<storage, read> basis: array<f32>;
// Slots of half floats.
@group(0) @binding(3) var<storage, read_write> texels: array<vec2<u32>>;
@group(0) @binding(4) var parents: texture_2d_array<f32>;
@group(0) @binding(4) var slots: texture_storage_2d_array<rgba16float, write>;

var<workgroup> even: array<vec4<f32>, 256>;
var<workgroup> odd: array<vec4<f32>, 256>;

// Rounded to half floats by their bits, to nearest even: adapters may round in either direction.
fn halves(texel: vec4<f32>) -> vec2<u32> {
    let bits = bitcast<vec4<u32>>(clamp(texel, vec4(-HALF_MAX), vec4(HALF_MAX)));
    let rounded = bitcast<vec4<f32>>((bits + 0xfffu + ((bits >> vec4(13u)) & vec4(1u))) & vec4(0xffffe000u));
    return vec2(pack2x16float(rounded.xy), pack2x16float(rounded.zw));
}

fn triangle(n: i32) -> i32 {
    return max(n, 0) * (max(n, 0) + 1) / 2;
}

// Places (u, v) of a rectangle that come before `place` in the order of diagonals.
fn places_before(size: vec2<u32>, place: vec2<u32>) -> i32 {
    let s = vec2<i32>(size);
    let v = i32(place.y);
    let diagonal = i32(place.x + place.y);
    let diagonals = triangle(diagonal) - triangle(diagonal - s.x) - triangle(diagonal - s.y)
        + triangle(diagonal - s.x - s.y);
    return diagonals + max(min(v, min(s.y, diagonal + 1)) - max(diagonal - s.x + 1, 0), 0);
}

// A coefficient of a block that the parent does not give, by its number in the scan.
fn coefficient(page: DecodedPage, block: u32, number: u32) -> vec4<f32> {
    let word = words[page.words + block];
    if number >= (word & 0xffu) {
        return vec4(0.0);
    }
    let first = page.words + (word >> 16u);
    // The first of them are whole floats.
    let whole = (word >> 8u) & 0xffu;
    if number < whole {
        let at = first + 4u * number;
        return bitcast<vec4<f32>>(vec4(words[at], words[at + 1u], words[at + 2u], words[at + 3u]));
    }
    let at = first + 2u * (number + whole);
    return vec4(unpack2x16float(words[at]), unpack2x16float(words[at + 1u]));
}

@compute @workgroup_size(256)
fn decode_block(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let page = decoded[group.y];
    let blocks = (page.size + SIDE - 1u) / SIDE;
    if group.x >= blocks.x * blocks.y {
        return;
    }
    let corner = vec2(group.x % blocks.x, group.x / blocks.x) * SIDE;
    let size = min(vec2(SIDE), page.size - corner);
    let low = (size + 1u) / 2u;
    // Row and column of [y][x], [u][y], [u][v], [x][v], and [y][x] again.
    let row = local / SIDE;
    let column = local % SIDE;

    if row < low.y && column < low.x {
        let at = page.parent + corner / 2u + vec2(column, row);
        even[local] = textureLoad(parents, at, page.parent_layer, 0);
    }
    workgroupBarrier();
    var sum = vec4(0.0);
    if row < low.x && column < low.y {
        let wave = low.x * 256u + row * SIDE;
        for (var x = 0u; x < low.x; x++) {
            sum += even[column * SIDE + x] * basis[wave + x];
        }
        odd[local] = sum;
    }
    workgroupBarrier();
    sum = vec4(0.0);
    if row < low.x && column < low.y {
        let wave = low.y * 256u + column * SIDE;
        for (var y = 0u; y < low.y; y++) {
            sum += odd[row * SIDE + y] * basis[wave + y];
        }
        sum *= sqrt(f32(size.x * size.y) / f32(low.x * low.y));
    } else if row < size.x && column < size.y {
        let place = vec2(row, column);
        let number = places_before(size, place) - places_before(low, place);
        sum = coefficient(page, group.x, u32(number)) * page.step;
    }
    even[local] = sum;
    workgroupBarrier();
    sum = vec4(0.0);
    if row < size.x && column < size.y {
        let wave = size.x * 256u + row;
        for (var u = 0u; u < size.x; u++) {
            sum += even[u * SIDE + column] * basis[wave + u * SIDE];
        }
        odd[local] = sum;
    }
    workgroupBarrier();
    sum = vec4(0.0);
    if row < size.y && column < size.x {
        let wave = size.y * 256u + row;
        for (var v = 0u; v < size.y; v++) {
            sum += odd[column * SIDE + v] * basis[wave + v * SIDE];
        }
        let at = corner + BORDER + vec2(column, row);
        texels[group.y * SLOT * SLOT + at.y * SLOT + at.x] = halves(sum);
    }
}

// First and last position of a slot that the payload determines: its own, and where the picture ends the border's.
fn known(page: DecodedPage) -> array<vec2<u32>, 2> {
    let first = BORDER - (page.ends & vec2(1u)) * BORDER;
    return array(first, BORDER + page.size - 1u + (page.ends >> vec2(1u)) * BORDER);
}

// Elsewhere the parent stands in for the neighbours, up-sampled linearly.
@compute @workgroup_size(256)
fn decode_border(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let page = decoded[group.y];
    let at = vec2((group.x * 256u + local) % SLOT, (group.x * 256u + local) / SLOT);
    let bounds = known(page);
    let inside = all(at >= bounds[0]) && all(at <= bounds[1]);
    if inside || any(at >= page.size + 2u * BORDER) {
        return;
    }
    // In quarters of the parent's texels: a texel's centre lies half way to the border, and a quarter of a texel off.
    let quarters = 4u * page.parent + 2u * at - (2u * BORDER + 1u);
    let first = quarters / 4u;
    let along = vec2<f32>(quarters % 4u) * 0.25;
    let layer = page.parent_layer;
    let corners = array(
        textureLoad(parents, first, layer, 0),
        textureLoad(parents, first + vec2(1u, 0u), layer, 0),
        textureLoad(parents, first + vec2(0u, 1u), layer, 0),
        textureLoad(parents, first + vec2(1u), layer, 0),
    );
    let above = corners[0] + (corners[1] - corners[0]) * along.x;
    let below = corners[2] + (corners[3] - corners[2]) * along.x;
    texels[group.y * SLOT * SLOT + at.y * SLOT + at.x] = halves(above + (below - above) * along.y);
}

// Into the cache; outside payload and border lie zeros.
@compute @workgroup_size(256)
fn decode_store(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let page = decoded[group.y];
    let at = vec2((group.x * 256u + local) % SLOT, (group.x * 256u + local) / SLOT);
    if at.y >= SLOT {
        return;
    }
    var texel = vec4(0.0);
    if all(at < page.size + 2u * BORDER) {
        let bounds = known(page);
        let inside = all(at >= bounds[0]) && all(at <= bounds[1]);
        let edge = clamp(at, vec2(BORDER), BORDER + page.size - 1u);
        let source = select(at, edge, inside);
        let packed = texels[group.y * SLOT * SLOT + source.y * SLOT + source.x];
        texel = vec4(unpack2x16float(packed.x), unpack2x16float(packed.y));
    }
    textureStore(slots, page.slot + at, page.layer, texel);
}
