// The picture as a screen shows it, and over it what the engine knows of each pixel's pages. Takes the place of `tonemap`.
//
// Pixels are looked at as shading does: the same footprint, the same rows of the page table.

#import eigen
#import light
#import tones

struct Overlay {
    // One of the kinds below.
    kind: u32,
    // 1 covers the picture.
    opacity: f32,
    // Frames so far, of which ages are counted.
    now: u32,
    pad: u32,
    // A scale from 0 to 1 in equal steps.
    scale: array<vec4<f32>, 9>,
    // Colours beside the scale.
    marks: array<vec4<f32>, 4>,
}

const MIP: u32 = 1u;
const COMPONENTS: u32 = 2u;
const BORDERS: u32 = 3u;
const AGE: u32 = 4u;
const PREDICTED_ERROR: u32 = 5u;
const SKIPPED: u32 = 6u;

// Of `marks`: nothing resident, all shaded, left out for the error that is allowed, background.
const ABSENT: u32 = 0u;
const SHADED: u32 = 1u;
const LEFT_OUT: u32 = 2u;
const BACKGROUND: u32 = 3u;

const STEPS: u32 = 8u;
const STRIPE_PIXELS: u32 = 4u;

@group(2) @binding(0) var radiance: texture_2d<f32>;
@group(2) @binding(1) var screen: texture_storage_2d<rgba8unorm, write>;
@group(2) @binding(2) var visibility: texture_2d<u32>;
@group(2) @binding(3) var<uniform> overlay_choice: Overlay;
// AGE: by slot the frame in which its page came. PREDICTED_ERROR: beside each entry of the page table the energy of its group
// over the tile, a float.
@group(2) @binding(4) var<storage, read> knowledge: array<u32>;

fn mark(which: u32) -> vec4<f32> {
    return vec4(overlay_choice.marks[which].rgb, 1.0);
}

fn on_scale(value: f32) -> vec4<f32> {
    let place = clamp(value, 0.0, 1.0) * f32(STEPS);
    let below = min(u32(place), STEPS - 1u);
    let colour = mix(overlay_choice.scale[below], overlay_choice.scale[below + 1u], place - f32(below));
    return vec4(colour.rgb, 1.0);
}

// A BTF under a pixel.
struct Seen {
    material: u32,
    wanted: Footprint,
    rows: vec2<u32>,
    // Leading groups that shading goes through.
    groups: u32,
}

fn is_shown(seen: Seen, group: u32) -> bool {
    return column_slot(seen.material, group) != NONE && page_entry(seen.rows, group) != NONE;
}

// Mip of which the first group that is shown has a page; NONE if there is none.
fn leading_mip(seen: Seen) -> u32 {
    for (var group = 0u; group < seen.groups; group++) {
        if is_shown(seen, group) {
            return max(seen.wanted.mip, page_entry(seen.rows, group) >> 27u);
        }
    }
    return NONE;
}

fn groups_shown(seen: Seen) -> u32 {
    var shown = 0u;
    for (var group = 0u; group < seen.groups; group++) {
        shown += u32(is_shown(seen, group));
    }
    return shown;
}

fn is_lit(surface: Surface) -> bool {
    if any(frame.ambient > vec3(0.0)) {
        return true;
    }
    for (var i = 0u; i < frame.light_count; i++) {
        if incident(surface, i).direction.z > 0.0 {
            return true;
        }
    }
    return false;
}

fn mip_colour(mip: u32) -> vec4<f32> {
    return on_scale(f32(mip) / f32(STEPS));
}

// Stripes of the colour of the mip that is wanted, where it is not there.
fn over_mip(seen: Seen, pixel: vec2<u32>) -> vec4<f32> {
    let mip = leading_mip(seen);
    if mip == NONE {
        return mark(ABSENT);
    }
    let striped = ((pixel.x + pixel.y) / STRIPE_PIXELS) % 2u == 1u;
    return mip_colour(select(mip, seen.wanted.mip, striped));
}

fn over_components(seen: Seen, surface: Surface) -> vec4<f32> {
    let groups = select(0u, groups_shown(seen), is_lit(surface));
    return on_scale(log2(1.0 + f32(groups)) / 6.0);
}

// A line a pixel wide on each side of an edge.
fn over_borders(seen: Seen, surface: Surface) -> vec4<f32> {
    let mip = leading_mip(seen);
    if mip == NONE {
        return vec4(0.0);
    }
    let m = seen.material;
    let size = materials[m].mips[mip].size;
    let in_tail = mip >= materials[m].tail_mip;
    let tile = select(seen.wanted.tile >> vec2(mip - seen.wanted.mip), vec2(0u), in_tail);
    let first = vec2<f32>(tile) * PAGE_TEXELS;
    let extent = select(min(vec2(PAGE_TEXELS), size - first), size, in_tail);
    let inside = seen.wanted.st * size - first;
    let edge = min(inside, extent - inside);
    let step = vec2(
        length(vec2(surface.st_dx.x, surface.st_dy.x)),
        length(vec2(surface.st_dx.y, surface.st_dy.y)),
    ) * size;
    if any(edge < step) {
        return mip_colour(mip);
    }
    return vec4(0.0);
}

// By the newest of the pages that are shaded.
fn over_age(seen: Seen) -> vec4<f32> {
    var age = NONE;
    for (var group = 0u; group < seen.groups; group++) {
        if is_shown(seen, group) {
            let entry = page_entry(seen.rows, group);
            let place = slot_place(entry);
            let slot = place.y * 256u + place.x;
            if slot < arrayLength(&knowledge) {
                age = min(age, overlay_choice.now - knowledge[slot]);
            }
        }
    }
    if age == NONE {
        return mark(ABSENT);
    }
    return on_scale(1.0 - log2(1.0 + f32(age)) / 10.0);
}

fn energy(row: u32, group: u32) -> f32 {
    return bitcast<f32>(knowledge[row + 1u + group]);
}

// What is not there of each group: all of its energy over the tile, or what lies below the page that stands for it.
fn over_error(seen: Seen) -> vec4<f32> {
    let m = seen.material;
    var missing = 0.0;
    for (var group = 0u; group < materials[m].groups; group++) {
        let all = energy(seen.rows.x, group);
        if !is_shown(seen, group) {
            missing += all;
            continue;
        }
        let mip = page_entry(seen.rows, group) >> 27u;
        if mip > seen.wanted.mip {
            missing += max(all - energy(page_row(m, seen.wanted, mip), group), 0.0);
        }
    }
    return on_scale((log2(max(sqrt(missing), 1e-9)) / log2(10.0) + 4.0) / 4.0);
}

fn over_skipped(seen: Seen) -> vec4<f32> {
    let all = f32(materials[seen.material].groups);
    let shaded = f32(groups_shown(seen)) / all;
    let left_out = f32(groups_present(seen.material) - seen.groups) / all;
    return shaded * mark(SHADED) + left_out * mark(LEFT_OUT) + (1.0 - shaded - left_out) * mark(ABSENT);
}

// Colour, and how much of it, before the opacity.
fn drawn_over(pixel: vec2<u32>) -> vec4<f32> {
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == 0u {
        return select(vec4(0.0), mark(BACKGROUND), overlay_choice.kind == SKIPPED);
    }
    let material = instances[ids.x - 1u].material;
    if materials[material].groups == 0u {
        return vec4(0.0);
    }
    let surface = surface(pixel, ids.x - 1u, ids.y, material);
    var seen: Seen;
    seen.material = material;
    seen.wanted = footprint(surface);
    seen.rows = tile_rows(material, seen.wanted);
    seen.groups = min(groups_present(material), groups_that_matter(seen.rows));
    switch overlay_choice.kind {
        case MIP: { return over_mip(seen, pixel); }
        case COMPONENTS: { return over_components(seen, surface); }
        case BORDERS: { return over_borders(seen, surface); }
        case AGE: { return over_age(seen); }
        case PREDICTED_ERROR: { return over_error(seen); }
        case SKIPPED: { return over_skipped(seen); }
        default: { return vec4(0.0); }
    }
}

@compute @workgroup_size(8, 8)
fn overlay(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= frame.size) {
        return;
    }
    let picture = shown(textureLoad(radiance, id.xy, 0).rgb);
    let over = drawn_over(id.xy);
    textureStore(screen, id.xy, vec4(mix(picture, over.rgb, over.a * overlay_choice.opacity), 1.0));
}
