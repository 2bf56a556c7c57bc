// Outgoing radiance of a BTF, from the groups that are resident.
//
// Source: Schwartz, Ruiters, Klein 2013, section 4: ρ = Σ_c U_c(ωi, ωo) V_c(x), equation 5. V is sampled once per
// group for LIGHT_BLOCK lights; directions are interpolated once for all groups. Nothing is fetched for groups that are
// not resident, that matter less than the error that is allowed (`page_table`, by tile), or where no light falls.

#import columns
#import directions
#import eigen
#import light

const PI: f32 = 3.14159265358979;
const LIGHT_BLOCK: u32 = 4u;

// A light as the sum over groups needs it.
struct LightTaps {
    // Offsets into a row of a column, and weights.
    offsets: vec3<u32>,
    weights: vec3<f32>,
    // By which the interpolated reflectance is multiplied.
    factor: vec3<f32>,
}

fn light_taps(material: u32, light: Incident) -> LightTaps {
    let taps = direction_taps(materials[material].light_directions, light.direction);
    var cosine = light.direction.z;
    if (materials[material].flags & INCLUDES_COSINE) != 0u {
        // The samples include the cosine of where they were taken; outside the hull that is another angle.
        cosine = select(1.0, cosine / max(taps.cosine, 1e-4), taps.outside);
    }
    return LightTaps(taps.indices * 3u, taps.weights, light.irradiance * (cosine / PI));
}

// Reflectance of a group at nine taps: three of the view (`rows`: offsets of their first light) by three lights.
fn interpolate(slot: u32, rows: vec3<u32>, row_weights: vec3<f32>, light: LightTaps, texture: vec4<f32>) -> vec3<f32> {
    var sum = mat3x4<f32>();
    for (var view = 0u; view < 3u; view++) {
        sum += (row_weights[view] * light.weights.x) * eigen_abrdf(slot, rows[view] + light.offsets.x);
        sum += (row_weights[view] * light.weights.y) * eigen_abrdf(slot, rows[view] + light.offsets.y);
        sum += (row_weights[view] * light.weights.z) * eigen_abrdf(slot, rows[view] + light.offsets.z);
    }
    return texture * sum;
}

// The same for the ambient light, which has one direction.
fn interpolate_ambient(slot: u32, rows: vec3<u32>, row_weights: vec3<f32>, offset: u32, texture: vec4<f32>) -> vec3<f32> {
    let sum = row_weights.x * eigen_abrdf(slot, rows.x + offset)
        + row_weights.y * eigen_abrdf(slot, rows.y + offset)
        + row_weights.z * eigen_abrdf(slot, rows.z + offset);
    return texture * sum;
}

// Groups of the pixel whose textures were fetched, that were left out for the error they make, and that were not
// resident.
var<private> groups_fetched: u32;
var<private> groups_left_out: u32;
var<private> groups_absent: u32;

// Radiance, and in w the share of the material that is shown: 1 if any group is resident, else 0; between while the
// first one fades in.
fn btf_radiance(seen: Surface) -> vec4<f32> {
    let m = seen.material;
    let wanted = footprint(seen);
    let coarser = min(wanted.mip + 1u, materials[m].mip_count - 1u);
    let rows = vec2(page_row(m, wanted, wanted.mip), page_row(m, wanted, coarser));
    let columns = materials[m].page_table;
    // Trailing groups that have no column, or that together make less than the error that a pixel may have.
    let present = page_table[columns];
    let groups = min(present, page_table[rows.x]);
    groups_absent = materials[m].groups - present;
    groups_left_out = present - groups;

    let row = (materials[m].lights + 1u) * 3u;
    let view = direction_taps(materials[m].view_directions, tangent_from_world(seen, -unit(seen.position, -seen.normal)));
    let view_offsets = view.indices * row;

    var radiance = vec3(0.0);
    var shown = 0.0;
    for (var first = 0u; first == 0u || first < frame.light_count; first += LIGHT_BLOCK) {
        var block: array<LightTaps, LIGHT_BLOCK>;
        var used = 0u;
        for (var i = first; i < min(first + LIGHT_BLOCK, frame.light_count); i++) {
            let light = incident(seen, i);
            if light.direction.z > 0.0 {
                block[used] = light_taps(m, light);
                used++;
            }
        }
        let ambient = first == 0u && any(frame.ambient > vec3(0.0));
        if used == 0u && !ambient {
            continue;
        }
        for (var group = 0u; group < groups; group++) {
            let slot = page_table[columns + 1u + group];
            if slot == NONE || page_table[rows.x + 1u + group] == NONE {
                groups_absent += u32(first == 0u);
                continue;
            }
            groups_fetched++;
            let eigen = eigen_texture(m, group, wanted, rows);
            shown = max(shown, eigen.shown);
            for (var i = 0u; i < used; i++) {
                radiance += block[i].factor * interpolate(slot, view_offsets, view.weights, block[i], eigen.texture);
            }
            if ambient {
                radiance += frame.ambient * interpolate_ambient(slot, view_offsets, view.weights, row - 3u, eigen.texture);
            }
        }
    }
    return vec4(radiance * materials[m].texture_scale, shown);
}
