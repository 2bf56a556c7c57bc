// Interpolation of columns as they were sampled: nine taps, three views by three lights.
//
// Source: Schwartz, Ruiters, Klein 2013, section 4. Stands for `angular`; `hemisphere` is the other way.

#import columns
#import directions
#import light

// A view as the sum over groups needs it.
struct ViewTaps {
    // Where the lights of three views begin in a column, and the ambient light in each.
    rows: vec3<u32>,
    ambient: u32,
    weights: vec3<f32>,
}

// A light as the sum over groups needs it.
struct LightTaps {
    // Offsets into a row of a column, and weights.
    offsets: vec3<u32>,
    weights: vec3<f32>,
    // By which the interpolated reflectance is multiplied.
    factor: vec3<f32>,
}

fn view_taps(material: u32, direction: vec3<f32>) -> ViewTaps {
    let taps = direction_taps(materials[material].view_directions, direction);
    let ambient = materials[material].lights * 3u;
    return ViewTaps(taps.indices * (ambient + 3u), ambient, taps.weights);
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

fn reflectance(slot: u32, view: ViewTaps, light: LightTaps, texture: vec4<f32>) -> vec3<f32> {
    var sum = mat3x4<Real>();
    for (var i = 0u; i < 3u; i++) {
        let weights = vec3<Real>(view.weights[i] * light.weights);
        sum += weights.x * eigen_abrdf(slot, view.rows[i] + light.offsets.x);
        sum += weights.y * eigen_abrdf(slot, view.rows[i] + light.offsets.y);
        sum += weights.z * eigen_abrdf(slot, view.rows[i] + light.offsets.z);
    }
    return weighted(texture, sum);
}

// The same for the ambient light, which has one direction.
fn ambient_reflectance(slot: u32, view: ViewTaps, texture: vec4<f32>) -> vec3<f32> {
    let weights = vec3<Real>(view.weights);
    let sum = weights.x * eigen_abrdf(slot, view.rows.x + view.ambient)
        + weights.y * eigen_abrdf(slot, view.rows.y + view.ambient)
        + weights.z * eigen_abrdf(slot, view.rows.z + view.ambient);
    return weighted(texture, sum);
}

// The sum over the components of a group, which may leave the range of half floats.
fn weighted(texture: vec4<f32>, sum: mat3x4<Real>) -> vec3<f32> {
    return texture * mat3x4(vec4<f32>(sum[0]), vec4<f32>(sum[1]), vec4<f32>(sum[2]));
}
