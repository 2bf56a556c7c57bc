// Interpolation of columns that are maps of the light hemisphere: three filtered taps a colour, one for each view.
//
// Source: Schwartz, Ruiters, Weinmann, Klein 2011, section 3. Stands for `angular`; `delaunay` is the other way. Maps are
// made in `engine::angular::hemisphere`, without the light's cosine, and the ambient light in the first texel of each.

#import directions
#import light
#import pages

// In each slot, view by view, the maps of red, green and blue below each other; as many views side by side as there is
// room for.
@group(2) @binding(3) var columns: texture_2d_array<f32>;

// Texels from the centres of a map's outermost texels inwards to the horizon.
const MAP_INSET: f32 = 0.015625;

// A view as the sum over groups needs it.
struct ViewTaps {
    // Where the maps of three views begin in a slot, and how far it is from one colour to the next; texels.
    maps: array<vec2<u32>, 3>,
    side: u32,
    weights: vec3<f32>,
    // Texture coordinates of a texel.
    texel: vec2<f32>,
}

// A light as the sum over groups needs it.
struct LightTaps {
    // Where it lies in a map, in texels.
    place: vec2<f32>,
    // By which the interpolated reflectance is multiplied.
    factor: vec3<f32>,
}

fn view_taps(material: u32, direction: vec3<f32>) -> ViewTaps {
    let taps = direction_taps(materials[material].view_directions, direction);
    let side = materials[material].map_side;
    let size = textureDimensions(columns);
    let across = max(size.x / side, 1u);
    var maps: array<vec2<u32>, 3>;
    for (var i = 0u; i < 3u; i++) {
        let view = taps.indices[i];
        maps[i] = vec2(view % across, view / across * 3u) * side;
    }
    return ViewTaps(maps, side, taps.weights, 1.0 / vec2<f32>(size));
}

fn light_taps(material: u32, light: Incident) -> LightTaps {
    let half_side = 0.5 * f32(materials[material].map_side);
    let place = half_side + parabolic(light.direction) * (half_side - 0.5 - MAP_INSET);
    return LightTaps(place, light.irradiance * (light.direction.z / PI));
}

// `slot` holds the layer in its upper and the first row in its lower half.
fn reflectance(slot: u32, view: ViewTaps, light: LightTaps, texture: vec4<f32>) -> vec3<f32> {
    let slot_row = vec2(0u, slot & 0xffffu);
    var sum = mat3x4<f32>();
    for (var i = 0u; i < 3u; i++) {
        let at = (vec2<f32>(view.maps[i] + slot_row) + light.place) * view.texel;
        let colour = vec2(0.0, f32(view.side) * view.texel.y);
        let red = textureSampleLevel(columns, page_sampler, at, slot >> 16u, 0.0);
        let green = textureSampleLevel(columns, page_sampler, at + colour, slot >> 16u, 0.0);
        let blue = textureSampleLevel(columns, page_sampler, at + 2.0 * colour, slot >> 16u, 0.0);
        sum += view.weights[i] * mat3x4(red, green, blue);
    }
    return texture * sum;
}

// The same for the ambient light, which has one direction.
fn ambient_reflectance(slot: u32, view: ViewTaps, texture: vec4<f32>) -> vec3<f32> {
    let slot_row = vec2(0u, slot & 0xffffu);
    var sum = mat3x4<f32>();
    for (var i = 0u; i < 3u; i++) {
        let at = view.maps[i] + slot_row;
        let red = textureLoad(columns, at, slot >> 16u, 0);
        let green = textureLoad(columns, at + vec2(0u, view.side), slot >> 16u, 0);
        let blue = textureLoad(columns, at + vec2(0u, 2u * view.side), slot >> 16u, 0);
        sum += view.weights[i] * mat3x4(red, green, blue);
    }
    return texture * sum;
}
