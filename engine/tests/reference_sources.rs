//! The sources of the CPU reference: factors from an archive, and mips of samples.

use engine::{
    angular::Triangulation,
    reference::{FactorReflectance, Footprint, Mipped, Reflectance, Samples},
};
use glam::DVec2;
use half::f16;
use tileset::{
    Archive, ArchiveWriter, Codec, Column, Direction, Factorization, Ledger, Manifest, Page, PageId, Pyramid,
    codec::{MipImage, encode_column, encode_page},
};

const STEP: f64 = 1e-3;

fn directions(count: u32) -> Vec<Direction> {
    let direction = |i: u32| Direction {
        theta: f64::from(i) * 0.2,
        phi: f64::from(i) * 2.4,
    };
    (0..count).map(direction).collect()
}

/// U'_c of a view, light and colour.
fn abrdf(component: u32, view: u32, light: u32, colour: u32) -> f16 {
    let phase = component * 7 + view * 5 + light * 3 + colour;
    f16::from_f64((f64::from(phase) * 0.9).sin() / f64::from(component + 1))
}

/// V'_c of a texel of the finest mip.
fn texture(component: u32, x: u32, y: u32, size: (u32, u32)) -> f32 {
    let (s, t) = (x as f32 / size.0 as f32, y as f32 / size.1 as f32);
    (std::f32::consts::TAU * (s * (component % 3) as f32 + t)).sin() / (component + 1) as f32
        + 0.2 * (x % 3) as f32
}

struct Parts {
    archive: Archive<Vec<u8>>,
    /// Wanted mips of each group.
    mips: Vec<Vec<MipImage>>,
}

fn build(size: (u32, u32), wrap: bool, cosine: bool, components: u32, scale: f64) -> Parts {
    let codec = Codec::DctDeltaZstd { step: STEP };
    let (views, lights) = (directions(5), directions(6));
    let manifest = Manifest {
        name: "test".into(),
        generator: "test".into(),
        width: size.0,
        height: size.1,
        wrap,
        cosine,
        views,
        lights,
        components,
        factorization: Factorization::Fmf,
        codec,
        texture_scale: scale,
        mean_rgb: [0.5; 3],
        singular_values: vec![1.0; components as usize],
        errors: Ledger::default(),
    };
    let pyramid = Pyramid::new(size.0, size.1, wrap).unwrap();
    let mut writer = ArchiveWriter::new(manifest.clone()).unwrap();
    let mut mips = Vec::new();
    for group in 0..manifest.groups() as u16 {
        let component = |c: u32| u32::from(group) * 4 + c;
        let mut images = vec![MipImage {
            width: size.0,
            height: size.1,
            texels: (0..size.1)
                .flat_map(|y| (0..size.0).map(move |x| (x, y)))
                .map(|(x, y)| {
                    [0, 1, 2, 3].map(|c| {
                        if component(c) < components {
                            texture(component(c), x, y, size)
                        } else {
                            0.0
                        }
                    })
                })
                .collect(),
        }];
        for mip in 1..usize::from(pyramid.mip_count()) {
            images.push(images[mip - 1].downsample());
        }
        let mut decoded: Vec<Page> = Vec::new();
        for tile in pyramid.tiles() {
            let parent = pyramid
                .parent(tile)
                .map(|parent| &decoded[pyramid.tile_index(parent).unwrap() as usize]);
            let page = encode_page(codec, &pyramid, tile, &images[usize::from(tile.mip)], parent).unwrap();
            writer
                .add_page(PageId { group, tile }, page.bytes, page.weight)
                .unwrap();
            decoded.push(page.decoded);
        }
        let mut texels = Vec::new();
        for view in 0..5 {
            for light in 0..6 {
                for colour in 0..3 {
                    let value = |c: u32| {
                        if component(c) < components {
                            abrdf(component(c), view, light, colour)
                        } else {
                            f16::ZERO
                        }
                    };
                    texels.push([0, 1, 2, 3].map(value));
                }
            }
        }
        writer
            .add_column(group, encode_column(&Column { texels }).unwrap(), 1.0)
            .unwrap();
        mips.push(images);
    }
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    Parts {
        archive: Archive::open(bytes).unwrap(),
        mips,
    }
}

/// Every mip, also in the packed tail, at every page border, is Σ U'_c V'_c up to the codec's error.
#[test]
fn factors_multiply_to_the_btf() {
    for (size, wrap, scale) in [
        ((150, 70), true, 1.0),
        ((65, 130), false, 4.0),
        ((5, 3), true, 1.0),
        ((1, 1), false, 1.0),
    ] {
        let components = 6;
        let parts = build(size, wrap, false, components, scale);
        let btf = FactorReflectance::new(&parts.archive).unwrap();
        assert_eq!((btf.size(), btf.wrap(), btf.cosine()), (size, wrap, false));
        assert_eq!((btf.views().len(), btf.lights().len()), (5, 6));
        for mip in 0..parts.archive.index.pyramid.mip_count() {
            let (width, height) = parts.archive.index.pyramid.mip_size(mip);
            for y in 0..height {
                for x in 0..width {
                    let (view, light) = ((x + y) % 5, (x * 2 + y) % 6);
                    let found = btf.texel(mip, x, y, view, light);
                    for (colour, found) in (0..3).zip(found) {
                        let expected: f64 = (0..components)
                            .map(|c| {
                                let image = &parts.mips[(c / 4) as usize][usize::from(mip)];
                                let texel = image.texels[(y * width + x) as usize][(c % 4) as usize];
                                abrdf(c, view, light, colour).to_f64() * f64::from(texel) * scale
                            })
                            .sum();
                        // Quantizer and half floats.
                        let tolerance = 12.0 * STEP * scale;
                        assert!(
                            (found - expected).abs() < tolerance,
                            "mip {mip} ({x}, {y}): {found} for {expected}"
                        );
                    }
                }
            }
        }
    }
}

/// Sources may interpolate in their own way, but not to another result.
struct TexelByTexel<'a>(&'a dyn Reflectance);

impl Reflectance for TexelByTexel<'_> {
    fn size(&self) -> (u32, u32) {
        self.0.size()
    }

    fn wrap(&self) -> bool {
        self.0.wrap()
    }

    fn cosine(&self) -> bool {
        self.0.cosine()
    }

    fn views(&self) -> &[Direction] {
        self.0.views()
    }

    fn lights(&self) -> &[Direction] {
        self.0.lights()
    }

    fn texel(&self, mip: u8, x: u32, y: u32, view: u32, light: u32) -> [f64; 3] {
        self.0.texel(mip, x, y, view, light)
    }
}

fn assert_interpolates_as_its_texels(btf: &dyn Reflectance) {
    let (width, height) = btf.size();
    let pyramid = Pyramid::new(width, height, btf.wrap()).unwrap();
    let (views, lights) = (Triangulation::new(btf.views()), Triangulation::new(btf.lights()));
    let weights = lights.ambient_weights(btf.lights(), btf.cosine());
    let plain = TexelByTexel(btf);
    for i in 0..200 {
        let t = f64::from(i);
        let step = DVec2::new((t * 0.1).exp() / 1e6, 0.3 / f64::from(width));
        let footprint = Footprint::new(
            &pyramid,
            DVec2::new(t * 0.37, t * 0.71),
            step,
            DVec2::new(step.y, step.x),
        );
        let view = views.taps([(t * 0.3).sin(), (t * 0.7).cos(), 0.1 + (t * 0.11).sin().abs()]);
        let light = lights.taps([(t * 0.5).cos(), (t * 0.2).sin(), 0.2 + (t * 0.13).cos().abs()]);
        let close = |a: [f64; 3], b: [f64; 3]| {
            assert!(
                // Mips of sums and sums of mips are rounded to f32 at different places; samples reach 8.
                a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5),
                "{i}: {a:?} {b:?}"
            );
        };
        close(
            btf.interpolate(&footprint, &view, &light),
            plain.interpolate(&footprint, &view, &light),
        );
        close(
            btf.ambient(&footprint, &view, &weights),
            plain.ambient(&footprint, &view, &weights),
        );
    }
}

#[test]
fn factors_interpolate_as_their_texels() {
    for cosine in [false, true] {
        let parts = build((100, 37), true, cosine, 7, 1.0);
        assert_interpolates_as_its_texels(&FactorReflectance::new(&parts.archive).unwrap());
    }
}

#[test]
fn damaged_archives_are_an_error() {
    let parts = build((100, 37), true, false, 4, 1.0);
    let index = parts.archive.index.clone();
    let mut reader = parts.archive.reader;
    let last = reader.len() - 1;
    reader[last] ^= 1;
    assert!(FactorReflectance::new(&Archive { index, reader }).is_err());
}

struct Noise {
    size: (u32, u32),
    directions: Vec<Direction>,
}

impl Samples for Noise {
    fn size(&self) -> (u32, u32) {
        self.size
    }

    fn wrap(&self) -> bool {
        true
    }

    fn cosine(&self) -> bool {
        true
    }

    fn views(&self) -> &[Direction] {
        &self.directions
    }

    fn lights(&self) -> &[Direction] {
        &self.directions
    }

    fn texel(&self, x: u32, y: u32, view: u32, light: u32) -> [f64; 3] {
        let value = |c: u32| f64::from((x * 31 + y * 17 + view * 7 + light * 3 + c * 5) % 64) / 8.0;
        [value(0), value(1), value(2)]
    }
}

fn noise(size: (u32, u32)) -> Noise {
    Noise {
        size,
        directions: directions(6),
    }
}

/// A picture of half the sides by way of the DCT, from its definition in f64: blocks of up to 16×16 keep the lower half
/// of their frequencies.
fn halved(picture: &[f64], width: usize, height: usize) -> Vec<f64> {
    // The kept coefficients of n texels, transformed back onto ⌈n/2⌉.
    let line = |texels: &[f64]| -> Vec<f64> {
        let (fine, coarse) = (texels.len(), texels.len().div_ceil(2));
        let basis = |k: usize, x: usize, n: usize| {
            let norm = (if k == 0 { 1.0 } else { 2.0 } / n as f64).sqrt();
            norm * (std::f64::consts::PI * (x as f64 + 0.5) * k as f64 / n as f64).cos()
        };
        let scale = (coarse as f64 / fine as f64).sqrt();
        (0..coarse)
            .map(|to| {
                let kept = (0..coarse).map(|k| {
                    let coefficient: f64 = (0..fine).map(|x| texels[x] * basis(k, x, fine)).sum();
                    coefficient * basis(k, to, coarse)
                });
                kept.sum::<f64>() * scale
            })
            .collect()
    };
    let rows: Vec<f64> = picture
        .chunks(width)
        .flat_map(|row| row.chunks(16).flat_map(line))
        .collect();
    let coarse_width = width.div_ceil(2);
    let mut coarse = vec![0.0; coarse_width * height.div_ceil(2)];
    for x in 0..coarse_width {
        let column: Vec<f64> = (0..height).map(|y| rows[y * coarse_width + x]).collect();
        for (y, value) in column.chunks(16).flat_map(line).enumerate() {
            coarse[y * coarse_width + x] = value;
        }
    }
    coarse
}

#[test]
fn mips_keep_the_lower_frequencies_of_each_block() {
    for size in [(64u32, 32u32), (5, 1), (33, 20)] {
        let btf = Mipped::new(noise(size), 1 << 20).unwrap();
        let (mut width, mut height) = (size.0 as usize, size.1 as usize);
        let mut picture: Vec<f64> = (0..size.1)
            .flat_map(|y| (0..size.0).map(move |x| (x, y)))
            .map(|(x, y)| noise(size).texel(x, y, 2, 4)[1])
            .collect();
        let mean = picture.iter().sum::<f64>() / picture.len() as f64;
        for mip in 1..Pyramid::new(size.0, size.1, true).unwrap().mip_count() {
            picture = halved(&picture, width, height);
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
            for (i, wanted) in picture.iter().enumerate() {
                let found = btf.texel(mip, (i % width) as u32, (i / width) as u32, 2, 4)[1];
                assert!(
                    (found - wanted).abs() < 1e-5,
                    "{size:?} mip {mip} texel {i}: {found} {wanted}"
                );
            }
        }
        if size == (64, 32) {
            assert!(
                (picture[0] - mean).abs() < 1e-9,
                "halves of powers of two keep the mean"
            );
        }
    }
}

#[test]
fn mipped_samples_interpolate_as_their_texels_with_any_cache() {
    for cache_bytes in [0, 100_000, 1 << 30] {
        assert_interpolates_as_its_texels(&Mipped::new(noise((33, 20)), cache_bytes).unwrap());
    }
}

#[test]
fn samples_of_no_size_are_refused() {
    assert!(Mipped::new(noise((0, 20)), 0).is_err());
    assert!(Mipped::new(noise((1 << 20, 20)), 0).is_err());
}
