//! Small archives by formula: eigen-textures with detail at every scale, eigen-ABRDFs with a lobe.

use half::f16;
use tileset::codec::{MipImage, encode_column, encode_page};
use tileset::{ArchiveWriter, Codec, Column, Direction, Factorization, Ledger, Manifest, Page, PageId};

/// Texels along a side, and component groups.
const SIDE: u32 = 256;
const GROUPS: u16 = 4;
/// Of the sampled directions: degrees from the normal, and how many.
const RINGS: [(f64, u32); 4] = [(0.0, 1), (30.0, 6), (55.0, 12), (75.0, 18)];

fn directions() -> Vec<Direction> {
    let ring = |(theta, count): (f64, u32)| {
        (0..count).map(move |step| Direction {
            theta: theta.to_radians(),
            phi: std::f64::consts::TAU * f64::from(step) / f64::from(count),
        })
    };
    RINGS.into_iter().flat_map(ring).collect()
}

fn manifest() -> Manifest {
    let components = u32::from(GROUPS) * 4;
    Manifest {
        name: "formula".into(),
        generator: "eigentile bench".into(),
        width: SIDE,
        height: SIDE,
        wrap: true,
        cosine: false,
        views: directions(),
        lights: directions(),
        components,
        factorization: Factorization::Fmf,
        codec: Codec::DctDeltaZstd { step: 0.01 },
        texture_scale: 1.0,
        mean_rgb: [0.4, 0.3, 0.2],
        singular_values: (0..components).map(|c| 1.0 / f64::from(c + 1)).collect(),
        errors: Ledger::default(),
    }
}

/// Eigen-texture `component` of variant `seed`: periodic, sums of waves whose amplitudes fall with frequency.
fn texture(seed: u32, component: u32, s: f64, t: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    let strength = 0.5 / f64::from(1 + component);
    let wave = |octave: u32| {
        let k = f64::from((1 << octave) + (seed * 7 + component * 3 + octave) % 5);
        let phase = f64::from(seed + 2 * component + octave);
        (turn * k * s + phase).sin() * (turn * k * t + 2.0 * phase).cos() * 0.7f64.powi(octave as i32)
    };
    let offset = if component == 0 { 0.6 } else { 0.0 };
    offset + strength * (0..7).map(wave).sum::<f64>()
}

fn abrdf(seed: u32, component: u32, view: [f64; 3], light: [f64; 3], rgb: usize) -> f64 {
    let half: [f64; 3] = std::array::from_fn(|axis| view[axis] + light[axis]);
    let length = half.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-9);
    let lobe = (half[2] / length).powi(12);
    let colour = 0.7 + 0.3 * f64::from(seed + 2 * rgb as u32).sin();
    let lean = (f64::from(component) * 1.7).cos() * view[0] + (f64::from(component) * 0.9).sin() * light[1];
    colour
        * if component == 0 {
            0.7 + 0.5 * lobe
        } else {
            lean + 0.3 * lobe
        }
}

fn column(manifest: &Manifest, seed: u32, group: u16) -> Column {
    let mut texels = Vec::with_capacity(manifest.column_texels());
    for view in &manifest.views {
        for light in &manifest.lights {
            for rgb in 0..3 {
                texels.push(std::array::from_fn(|component| {
                    let component = u32::from(group) * 4 + component as u32;
                    f16::from_f64(abrdf(seed, component, view.to_vector(), light.to_vector(), rgb))
                }));
            }
        }
    }
    Column { texels }
}

/// The archive of variant `seed`.
///
/// # Errors
/// Of the codec; there are none with what is made here.
pub(super) fn make(seed: u32) -> tileset::Result<Vec<u8>> {
    let manifest = manifest();
    let pyramid = manifest.pyramid()?;
    let mut writer = ArchiveWriter::new(manifest.clone())?;
    for group in 0..GROUPS {
        let texel = |at: u32| {
            let place = |at: u32| (f64::from(at) + 0.5) / f64::from(SIDE);
            let (s, t) = (place(at % SIDE), place(at / SIDE));
            std::array::from_fn(|c| texture(seed, u32::from(group) * 4 + c as u32, s, t) as f32)
        };
        let mut mips = vec![MipImage {
            width: SIDE,
            height: SIDE,
            texels: (0..SIDE * SIDE).map(texel).collect(),
        }];
        for mip in 0..usize::from(pyramid.tail_mip()) {
            mips.push(mips[mip].downsample());
        }
        let square: f32 = mips[0].texels.iter().flatten().map(|v| v * v).sum();
        let weight = f64::from(square) / f64::from(SIDE * SIDE);
        writer.add_column(group, encode_column(&column(&manifest, seed, group))?, weight)?;
        let mut decoded: Vec<Page> = Vec::new();
        for tile in pyramid.tiles() {
            let index = pyramid.parent(tile).and_then(|parent| pyramid.tile_index(parent));
            let parent = index.and_then(|index| decoded.get(index as usize));
            let page = encode_page(
                manifest.codec,
                &pyramid,
                tile,
                &mips[usize::from(tile.mip)],
                parent,
            )?;
            writer.add_page(PageId { group, tile }, page.bytes, page.weight)?;
            decoded.push(page.decoded);
        }
    }
    let mut bytes = Vec::new();
    writer.write(&mut bytes)?;
    Ok(bytes)
}
