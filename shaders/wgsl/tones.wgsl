// What a screen shows of linear radiance.
//
// Source: Khronos PBR Neutral tone mapper, specification 2024 (github.com/KhronosGroup/ToneMapping,
// PBR_Neutral): colours up to 0.8 - F90 keep their hue and saturation, highlights are compressed and desaturated.

#import frame

const START_COMPRESSION: f32 = 0.8 - 0.04;
const DESATURATION: f32 = 0.15;
// White long before; what lies above must not overflow on the way.
const BRIGHTEST: f32 = 1e6;

fn pbr_neutral(linear: vec3<f32>) -> vec3<f32> {
    let least = min(linear.r, min(linear.g, linear.b));
    let offset = select(0.04, least - 6.25 * least * least, least < 0.08);
    let color = linear - offset;
    let peak = max(color.r, max(color.g, color.b));
    if peak < START_COMPRESSION {
        return color;
    }
    let d = 1.0 - START_COMPRESSION;
    let compressed = 1.0 - d * d / (peak + d - START_COMPRESSION);
    let share = 1.0 - 1.0 / (DESATURATION * (peak - compressed) + 1.0);
    return mix(color * (compressed / peak), vec3(compressed), share);
}

// IEC 61966-2-1.
fn srgb_from_linear(linear: vec3<f32>) -> vec3<f32> {
    let power = 1.055 * pow(max(linear, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055;
    return select(power, 12.92 * linear, linear <= vec3(0.0031308));
}

// Radiance exposed, tone mapped and encoded.
fn shown(radiance: vec3<f32>) -> vec3<f32> {
    let exposed = clamp(radiance * frame.exposure, vec3(0.0), vec3(BRIGHTEST));
    return srgb_from_linear(clamp(pbr_neutral(exposed), vec3(0.0), vec3(1.0)));
}
