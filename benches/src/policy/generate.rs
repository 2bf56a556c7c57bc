//! A trace made by formula: a camera over a plane of materials.

use engine::residency::{MaterialId, Vote};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use tileset::Pyramid;

use super::{Trace, TraceMaterial};

/// Size of the picture whose pixels vote, and how many pixels one of them stands for in each direction.
const PICTURE: (u32, u32) = (1280, 720);
const STRIDE: u32 = 8;

/// What is made.
#[derive(Clone, Copy, Debug)]
pub struct Synthetic {
    /// Materials, side by side on a square plane.
    pub materials: u16,
    /// Width and height of each.
    pub side_texels: u32,
    /// Component groups of each.
    pub groups: u16,
    /// Frames of the way.
    pub frames: u32,
    /// Of the weights.
    pub seed: u64,
}

impl Default for Synthetic {
    fn default() -> Self {
        Self {
            materials: 100,
            side_texels: 1024,
            groups: 25,
            frames: 180,
            seed: 1,
        }
    }
}

/// Makes a trace. Sizes that no material has give materials of 64 texels a side.
pub fn generate(what: &Synthetic) -> Trace {
    let side_texels = Pyramid::new(what.side_texels, what.side_texels, true).map_or(64, |_| what.side_texels);
    let pyramid = Pyramid::new(side_texels, side_texels, true).expect("a valid size");
    let mut random = ChaCha8Rng::seed_from_u64(what.seed);
    let materials = (0..what.materials).map(|_| TraceMaterial {
        width: side_texels,
        height: side_texels,
        wrap: true,
        groups: what.groups,
        weights: weights(&pyramid, what.groups, &mut random),
    });
    Trace {
        name: format!(
            "camera over {} materials of {side_texels}² texels and {} groups",
            what.materials, what.groups
        ),
        materials: materials.collect(),
        frames: (0..what.frames)
            .map(|frame| votes(what, &pyramid, frame))
            .collect(),
    }
}

fn unit(random: &mut ChaCha8Rng) -> f64 {
    f64::from(random.next_u32()) / f64::from(u32::MAX)
}

/// Weights as factorized materials have them: the variances of the groups fall by a power law, that of an octave of the
/// spectrum by another (1/f²-like pictures have the same in each octave), from the octave on where the structure
/// begins; above it a weave or a foam has next to nothing. Pages of one mip differ as places of a material do.
fn weights(pyramid: &Pyramid, groups: u16, random: &mut ChaCha8Rng) -> Vec<f32> {
    let variance = 0.02 * (0.5 + unit(random));
    let group_power = 1.0 + 1.2 * unit(random);
    let octave_fall = 0.35 + 0.6 * unit(random);
    // One material in three has a scale at which its structure begins.
    let begins = (unit(random) < 1.0 / 3.0).then(|| f64::from(pyramid.tail_mip()) * unit(random));
    let mut weights = Vec::new();
    for group in 0..groups {
        let of_group = variance * f64::from(group + 1).powf(-group_power);
        for tile in pyramid.tiles() {
            let octave = i32::from(pyramid.tail_mip() - tile.mip);
            let before = begins.is_some_and(|mip| f64::from(tile.mip) > mip) && octave > 0;
            let place = 0.5 + unit(random);
            weights
                .push((of_group * octave_fall.powi(octave) * place * if before { 0.02 } else { 1.0 }) as f32);
        }
    }
    weights
}

/// Pixels of a pinhole camera at 60 degrees that look at the plane, by tile.
fn votes(what: &Synthetic, pyramid: &Pyramid, frame: u32) -> Vec<Vote> {
    let side = f64::from(what.materials).sqrt().ceil().max(1.0);
    let time = f64::from(frame) / f64::from(what.frames.max(1));
    // A flight over the plane that sinks, turns, and rises again, in units of a material's side.
    let turn = std::f64::consts::TAU * time;
    let eye = [
        side * (0.5 + 0.35 * turn.cos()),
        side * (0.5 + 0.35 * turn.sin()),
        0.6 + 0.8 * (1.0 + (2.0 * turn).cos()),
    ];
    let heading = turn + 2.2 + 0.4 * (3.0 * turn).sin();
    let pitch: f64 = 0.55;
    let forward = [
        heading.cos() * pitch.cos(),
        heading.sin() * pitch.cos(),
        -pitch.sin(),
    ];
    let right = [heading.sin(), -heading.cos(), 0.0];
    let up = [
        heading.cos() * pitch.sin(),
        heading.sin() * pitch.sin(),
        pitch.cos(),
    ];
    let (width, height) = (f64::from(PICTURE.0), f64::from(PICTURE.1));
    let pixel = 2.0 * (std::f64::consts::PI / 6.0).tan() / height;
    let mut pixels = std::collections::BTreeMap::new();
    for row in 0..PICTURE.1 / STRIDE {
        for column in 0..PICTURE.0 / STRIDE {
            let x = (f64::from(column * STRIDE) + 0.5 - width / 2.0) * pixel;
            let y = (height / 2.0 - f64::from(row * STRIDE) - 0.5) * pixel;
            let way: [f64; 3] = std::array::from_fn(|i| forward[i] + x * right[i] + y * up[i]);
            if way[2] >= -1e-3 {
                continue;
            }
            let distance = eye[2] / -way[2];
            let (u, v) = (eye[0] + distance * way[0], eye[1] + distance * way[1]);
            let at = v.floor() * side + u.floor();
            if !(0.0..side).contains(&u) || !(0.0..side).contains(&v) || at >= f64::from(what.materials) {
                continue;
            }
            // A pixel's longer side on the plane, in texels of mip 0.
            let length = way.iter().map(|w| w * w).sum::<f64>().sqrt();
            let texels = f64::from(pyramid.mip_size(0).0) * distance * pixel * length / -way[2];
            let mip = (texels.log2().max(0.0) as u8).min(pyramid.tail_mip());
            let (columns, rows) = pyramid.grid(mip);
            let cell = |s: f64, cells: u32| ((s.fract() * f64::from(cells)) as u32).min(cells - 1);
            let tile = pyramid.mip_base(mip) + cell(v, rows) * columns + cell(u, columns);
            *pixels.entry((at as u16, tile)).or_insert(0) += STRIDE * STRIDE;
        }
    }
    let vote = |((material, tile), pixels)| Vote {
        material: MaterialId(material),
        tile,
        pixels,
    };
    pixels.into_iter().map(vote).collect()
}
