// What is the same for every pixel of a frame: camera, picture, caches.

struct Frame {
    // Clip space from positions relative to the eye.
    clip_from_eye: mat4x4<f32>,
    // World space. All geometry is moved so that the eye is the origin before anything is computed from it.
    eye: vec3<f32>,
    light_count: u32,
    // Direction through the centre of pixel (x, y): ray_origin + x * ray_dx + y * ray_dy, not normalized.
    ray_origin: vec3<f32>,
    exposure: f32,
    ray_dx: vec3<f32>,
    // A feedback cell is stride by stride pixels, of which one votes.
    feedback_stride: u32,
    ray_dy: vec3<f32>,
    feedback_phase: u32,
    ambient: vec3<f32>,
    // The column cache is column_mask + 1 = 2^column_shift texels wide.
    column_shift: u32,
    background: vec3<f32>,
    column_mask: u32,
    size: vec2<u32>,
    // One over the texels of a layer of the page cache.
    page_scale: vec2<f32>,
    // How many slots a row and a layer of the page cache have.
    slot_columns: u32,
    layer_slots: u32,
    // Pixels of the picture that is shown, per pixel of this one; less than one for pictures that only vote.
    pixel_scale: f32,
    // 1 if shading is to count what it fetches.
    count_work: u32,
    // 1 if pages are bytes, to be multiplied by the scales of their slots.
    scaled: u32,
    // 1 if the nearest mip is read alone, without the other of the two around the level of detail.
    nearest_mip: u32,
    pads: vec2<u32>,
}

const NONE: u32 = 0xffffffffu;

@group(0) @binding(0) var<uniform> frame: Frame;
