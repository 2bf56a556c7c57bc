// Light sources.

#import surface

const PI: f32 = 3.14159265358979;

struct Light {
    // Unit vector towards a directional light, position of a point light; world space.
    vector: vec3<f32>,
    kind: u32,
    // Irradiance of a directional, radiant intensity of a point light.
    intensity: vec3<f32>,
    pad: u32,
}

const POINT: u32 = 1u;

@group(0) @binding(5) var<storage, read> lights: array<Light>;

struct Incident {
    // Unit vector towards the light, tangent frame.
    direction: vec3<f32>,
    // On a plane that faces the light.
    irradiance: vec3<f32>,
}

fn incident(surface: Surface, light: u32) -> Incident {
    var to_light = lights[light].vector;
    var irradiance = lights[light].intensity;
    if lights[light].kind == POINT {
        to_light = (to_light - frame.eye) - surface.position;
        // The bound keeps a light that lies on a surface finite.
        irradiance /= max(dot(to_light, to_light), 1e-12);
    }
    return Incident(normalize(tangent_from_world(surface, to_light)), irradiance);
}
