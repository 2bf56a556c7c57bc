// Outgoing radiance of a BTF, from the groups that are resident.
//
// Source: Schwartz, Ruiters, Klein 2013, section 4: ρ = Σ_c U_c(ωi, ωo) V_c(x), equation 5. V is sampled once per
// group for LIGHT_BLOCK lights; directions are looked up once for all groups (`angular`, which stands for `delaunay` or
// `hemisphere`, says how columns are interpolated there). Nothing is fetched for groups that are
// not resident, that matter less than the error that is allowed (by tile), or where no light falls. `textures` says where
// pages and columns lie.

#import angular
#import textures

const LIGHT_BLOCK: u32 = 4u;

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
    let rows = tile_rows(m, wanted);
    // Trailing groups that have no column, or that together make less than the error that a pixel may have.
    let present = groups_present(m);
    let groups = min(present, groups_that_matter(rows));
    groups_absent = materials[m].groups - present;
    groups_left_out = present - groups;

    let view = view_taps(m, tangent_from_world(seen, -unit(seen.position, -seen.normal)));

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
            let slot = column_slot(m, group);
            let page = page_entry(rows, group);
            if slot == NONE || page == NONE {
                groups_absent += u32(first == 0u);
                continue;
            }
            groups_fetched++;
            let eigen = eigen_texture(m, group, wanted, rows, page);
            shown = max(shown, eigen.shown);
            for (var i = 0u; i < used; i++) {
                radiance += block[i].factor * reflectance(slot, view, block[i], eigen.texture);
            }
            if ambient {
                radiance += frame.ambient * ambient_reflectance(slot, view, eigen.texture);
            }
        }
    }
    return vec4(radiance * materials[m].texture_scale, shown);
}
