//! Inputs that several benchmarks share, made by formula, the same on every platform.

use tileset::codec::MipImage;

/// Four eigen-textures of `side` × `side` texels with the statistics of natural images: sums of plane waves whose
/// amplitudes fall with frequency, each component at a third of the one before.
pub fn eigen_textures(side: u32) -> MipImage {
    let wave = |x: f32, y: f32, component: usize| {
        (1..24).fold(0.0, |sum, k| {
            let frequency = k as f32 * std::f32::consts::TAU / side as f32;
            let turn = (k * 7 + component * 5) as f32;
            let phase = frequency * (x * turn.cos() * k as f32 + y * turn.sin() * k as f32);
            sum + (phase + turn).sin() / k as f32
        })
    };
    let texel = |i: u32| {
        let (x, y) = ((i % side) as f32, (i / side) as f32);
        std::array::from_fn(|component| 0.3 * wave(x, y, component) / 3f32.powi(component as i32))
    };
    MipImage {
        width: side,
        height: side,
        texels: (0..side * side).map(texel).collect(),
    }
}
