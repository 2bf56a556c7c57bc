//! Small archives of analytic factors.

use engine::stream::MemorySource;
use half::f16;
use tileset::{
    Archive, ArchiveWriter, Codec, Column, Direction, Factorization, Ledger, Manifest, Page, PageId, Pyramid,
    codec::{MipImage, encode_column, encode_page},
};

/// An archive to build.
#[derive(Clone, Copy)]
pub(crate) struct Recipe {
    pub width: u32,
    pub height: u32,
    pub wrap: bool,
    pub cosine: bool,
    pub groups: u16,
    /// Of the views and of the lights.
    pub directions: fn() -> Vec<Direction>,
    /// Eigen-texture `component` at texture coordinates.
    pub texture: fn(component: u32, s: f64, t: f64) -> f64,
    /// Eigen-ABRDF `component` for view, light and colour, without the cosine.
    pub abrdf: fn(component: u32, view: [f64; 3], light: [f64; 3], rgb: usize) -> f64,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            width: 256,
            height: 256,
            wrap: true,
            cosine: false,
            groups: 3,
            directions,
            texture: weave,
            abrdf: glossy,
        }
    }
}

/// Periodic, with detail at every scale, weaker with every component.
pub(crate) fn weave(component: u32, s: f64, t: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    let c = f64::from(component);
    let strength = 0.9 / (1.0 + c);
    let coarse = (turn * (3.0 + c) * s).sin() * (turn * (2.0 + c) * t).cos();
    let fine = (turn * 37.0 * s + c).sin() * (turn * 41.0 * t).sin();
    let offset = if component == 0 { 0.6 } else { 0.0 };
    offset + strength * (0.5 * coarse + 0.25 * fine)
}

/// Directions in rings: what measured BTFs have, with fewer of them.
pub(crate) fn directions() -> Vec<Direction> {
    let rings = [
        (0.0, 1, 0.0),
        (20.0, 6, 0.0),
        (40.0, 12, 10.0),
        (60.0, 12, 0.0),
        (75.0, 18, 5.0),
    ];
    let ring = |(theta, count, offset): (f64, u32, f64)| {
        (0..count).map(move |i| Direction {
            theta: theta.to_radians(),
            phi: (f64::from(i) * 360.0 / f64::from(count) + offset).to_radians(),
        })
    };
    rings.into_iter().flat_map(ring).collect()
}

/// Coloured, with a lobe around the mirror direction.
pub(crate) fn glossy(component: u32, view: [f64; 3], light: [f64; 3], rgb: usize) -> f64 {
    let half: [f64; 3] = std::array::from_fn(|axis| view[axis] + light[axis]);
    let length = half.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-9);
    let lobe = (half[2] / length).powi(20);
    let c = f64::from(component);
    let colour = [1.0, 0.7, 0.45][rgb];
    let lean = (c * 1.7).cos() * view[0] + (c * 0.9).sin() * light[1];
    if component == 0 {
        colour * 0.7 + 0.5 * lobe
    } else {
        colour * lean + 0.3 * lobe * (c + rgb as f64).sin()
    }
}

/// The first component white and diffuse, the others nothing: pictures show the first eigen-texture.
pub(crate) fn white(component: u32, _view: [f64; 3], _light: [f64; 3], _rgb: usize) -> f64 {
    if component == 0 { 1.0 } else { 0.0 }
}

fn column(recipe: &Recipe, manifest: &Manifest, group: u16) -> Column {
    let mut texels = Vec::with_capacity(manifest.column_texels());
    for view in &manifest.views {
        for light in &manifest.lights {
            let (view, light_vector) = (view.to_vector(), light.to_vector());
            for rgb in 0..3 {
                let cosine = if manifest.cosine { light_vector[2] } else { 1.0 };
                texels.push(std::array::from_fn(|component| {
                    let component = u32::from(group) * 4 + component as u32;
                    f16::from_f64((recipe.abrdf)(component, view, light_vector, rgb) * cosine)
                }));
            }
        }
    }
    Column { texels }
}

impl Recipe {
    pub(crate) fn manifest(&self) -> Manifest {
        let components = u32::from(self.groups) * 4;
        Manifest {
            name: "analytic".into(),
            generator: "test".into(),
            width: self.width,
            height: self.height,
            wrap: self.wrap,
            cosine: self.cosine,
            views: (self.directions)(),
            lights: (self.directions)(),
            components,
            factorization: Factorization::Fmf,
            codec: Codec::DctDeltaZstd { step: 0.002 },
            texture_scale: 1.0,
            mean_rgb: [0.42, 0.3, 0.2],
            singular_values: (0..components).map(|c| 1.0 / f64::from(c + 1)).collect(),
            errors: Ledger::default(),
        }
    }

    pub(crate) fn column(&self, group: u16) -> Column {
        column(self, &self.manifest(), group)
    }

    pub(crate) fn finest(&self, group: u16) -> MipImage {
        let texel = |at: u32| {
            let (x, y) = (at % self.width, at / self.width);
            let s = (f64::from(x) + 0.5) / f64::from(self.width);
            let t = (f64::from(y) + 0.5) / f64::from(self.height);
            std::array::from_fn(|c| (self.texture)(u32::from(group) * 4 + c as u32, s, t) as f32)
        };
        MipImage {
            width: self.width,
            height: self.height,
            texels: (0..self.width * self.height).map(texel).collect(),
        }
    }

    /// The whole archive.
    pub(crate) fn build(&self) -> Vec<u8> {
        let manifest = self.manifest();
        let pyramid = manifest.pyramid().unwrap();
        let mut writer = ArchiveWriter::new(manifest.clone()).unwrap();
        for group in 0..self.groups {
            let mut mips = vec![self.finest(group)];
            while mips.len() <= usize::from(pyramid.tail_mip()) {
                mips.push(mips.last().unwrap().downsample());
            }
            let square: f32 = mips[0].texels.iter().flatten().map(|v| v * v).sum();
            let weight = f64::from(square) / f64::from(self.width * self.height);
            writer
                .add_column(
                    group,
                    encode_column(&column(self, &manifest, group)).unwrap(),
                    weight,
                )
                .unwrap();
            let mut decoded: Vec<Page> = Vec::new();
            for tile in pyramid.tiles() {
                let parent = pyramid
                    .parent(tile)
                    .map(|parent| &decoded[index(&pyramid, parent)]);
                let mip = &mips[usize::from(tile.mip)];
                let page = encode_page(manifest.codec, &pyramid, tile, mip, parent).unwrap();
                writer
                    .add_page(PageId { group, tile }, page.bytes, page.weight)
                    .unwrap();
                decoded.push(page.decoded);
            }
        }
        let mut bytes = Vec::new();
        writer.write(&mut bytes).unwrap();
        bytes
    }
}

fn index(pyramid: &Pyramid, tile: tileset::Tile) -> usize {
    pyramid.tile_index(tile).unwrap() as usize
}

/// A source of these archives, and the archives themselves for the reference.
pub(crate) fn source(archives: &[(&str, &[u8])]) -> Box<MemorySource> {
    let mut source = MemorySource::new();
    for (name, bytes) in archives {
        source.insert(name, bytes.to_vec()).unwrap();
    }
    Box::new(source)
}

/// An archive opened for the reference.
pub(crate) fn open(bytes: &[u8]) -> Archive<&[u8]> {
    Archive::open(bytes).unwrap()
}
