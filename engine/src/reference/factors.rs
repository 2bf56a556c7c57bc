//! A BTF from the decoded factors of an archive.

use half::f16;
use tileset::{Archive, Direction, GROUP_COMPONENTS, Page, PageId, ReadAt, SLOT_TEXELS, Tile};

use super::{Footprint, Reflectance, reflectance::taps};
use crate::{
    Result,
    angular::{Taps, Triangulation},
};

/// All eigen-textures and eigen-ABRDFs of an archive, decoded: ρ = Σ_c U'_c V'_c (Schwartz, Ruiters, Klein
/// 2013, equation 5), summed in f64.
///
/// Takes width · height · components · 2⅔ bytes and views · lights · components · 12 bytes.
pub struct FactorReflectance {
    size: (u32, u32),
    wrap: bool,
    cosine: bool,
    views: Vec<Direction>,
    lights: Vec<Direction>,
    /// Components, filled up to whole groups.
    components: usize,
    texture_scale: f64,
    /// Widths of the mips.
    widths: Vec<u32>,
    /// Of each mip `[y][x][component]`, as decoded.
    textures: Vec<Vec<f16>>,
    /// `[view][light][rgb][component]`; after the last light the pre-integrated ambient light.
    abrdfs: Vec<f32>,
}

impl FactorReflectance {
    /// Decodes all pages, mips and columns.
    ///
    /// # Errors
    /// Of reading and decoding the records.
    pub fn new<R: ReadAt>(archive: &Archive<R>) -> Result<Self> {
        let manifest = &archive.index.manifest;
        let pyramid = &archive.index.pyramid;
        let groups = manifest.groups() as u16;
        let components = usize::from(groups) * GROUP_COMPONENTS;
        let mips = 0..pyramid.mip_count();
        let texels = |mip| {
            let (width, height) = pyramid.mip_size(mip);
            width as usize * height as usize
        };
        let mut textures: Vec<_> = mips
            .clone()
            .map(|mip| vec![f16::ZERO; texels(mip) * components])
            .collect();
        for group in 0..groups {
            decode_group(archive, group, |mip, x, y, texel| {
                let width = pyramid.mip_size(mip).0 as usize;
                let at =
                    (y as usize * width + x as usize) * components + usize::from(group) * GROUP_COMPONENTS;
                textures[usize::from(mip)][at..at + GROUP_COMPONENTS].copy_from_slice(&texel);
            })?;
        }
        Ok(Self {
            size: (manifest.width, manifest.height),
            wrap: manifest.wrap,
            cosine: manifest.cosine,
            views: manifest.views.clone(),
            lights: manifest.lights.clone(),
            components,
            texture_scale: manifest.texture_scale,
            widths: mips.map(|mip| pyramid.mip_size(mip).0).collect(),
            textures,
            abrdfs: decode_abrdfs(archive, components)?,
        })
    }

    /// Components of a texel.
    fn texture(&self, mip: u8, x: u32, y: u32) -> &[f16] {
        let at = y as usize * self.widths[usize::from(mip)] as usize + x as usize;
        &self.textures[usize::from(mip)][at * self.components..][..self.components]
    }

    /// Components of the three colours at sampled directions, one colour after the other.
    fn abrdf(&self, view: u32, light: u32) -> &[f32] {
        let at = view as usize * (self.lights.len() + 1) + light as usize;
        &self.abrdfs[at * 3 * self.components..][..3 * self.components]
    }

    fn filtered_texture(&self, footprint: &Footprint) -> Vec<f64> {
        let mut texture = vec![0.0; self.components];
        for texel in footprint.texels() {
            for (sum, value) in texture.iter_mut().zip(self.texture(texel.mip, texel.x, texel.y)) {
                *sum += texel.weight * f64::from(*value);
            }
        }
        texture
    }

    fn dot(&self, texture: &[f64], view: u32, light: u32) -> [f64; 3] {
        let abrdf = self.abrdf(view, light);
        [0, 1, 2].map(|colour| {
            let abrdf = &abrdf[colour * self.components..][..self.components];
            let sum: f64 = abrdf.iter().zip(texture).map(|(u, v)| f64::from(*u) * v).sum();
            sum * self.texture_scale
        })
    }
}

impl Reflectance for FactorReflectance {
    fn size(&self) -> (u32, u32) {
        self.size
    }

    fn wrap(&self) -> bool {
        self.wrap
    }

    fn cosine(&self) -> bool {
        self.cosine
    }

    fn views(&self) -> &[Direction] {
        &self.views
    }

    fn lights(&self) -> &[Direction] {
        &self.lights
    }

    fn texel(&self, mip: u8, x: u32, y: u32, view: u32, light: u32) -> [f64; 3] {
        let texture: Vec<f64> = self
            .texture(mip, x, y)
            .iter()
            .map(|value| f64::from(*value))
            .collect();
        self.dot(&texture, view, light)
    }

    /// Texture and ABRDF are interpolated apart, as the sum over components allows.
    fn interpolate(&self, footprint: &Footprint, views: &Taps, lights: &Taps) -> [f64; 3] {
        let texture = self.filtered_texture(footprint);
        let mut sum = [0.0; 3];
        for (view, view_weight) in taps(views) {
            for (light, light_weight) in taps(lights) {
                super::reflectance::add(
                    &mut sum,
                    view_weight * light_weight,
                    self.dot(&texture, view, light),
                );
            }
        }
        sum
    }

    /// From the pre-integrated light; `weights` went into it when the archive was decoded.
    fn ambient(&self, footprint: &Footprint, views: &Taps, _weights: &[f64]) -> [f64; 3] {
        let texture = self.filtered_texture(footprint);
        let mut sum = [0.0; 3];
        for (view, weight) in taps(views) {
            super::reflectance::add(
                &mut sum,
                weight,
                self.dot(&texture, view, self.lights.len() as u32),
            );
        }
        sum
    }
}

/// Decodes a group's pages, parents first, and hands over every texel of every mip: mip, x, y, components.
fn decode_group<R: ReadAt>(
    archive: &Archive<R>,
    group: u16,
    mut texel: impl FnMut(u8, u32, u32, [f16; GROUP_COMPONENTS]),
) -> Result<()> {
    let pyramid = &archive.index.pyramid;
    let mut decoded: Vec<Page> = Vec::with_capacity(pyramid.tile_count() as usize);
    // In the order of their indices, so that each finds its parent decoded.
    for tile in pyramid.tiles() {
        let id = PageId { group, tile };
        let bytes = archive.read_page(id)?;
        let parent = pyramid
            .parent(tile)
            .and_then(|parent| decoded.get(pyramid.tile_index(parent)? as usize));
        let page = archive.index.decoder.page(id, &bytes, parent)?;
        let Tile { mip, x, y } = tile;
        if tile == pyramid.root() {
            for mip in mip..pyramid.mip_count() {
                let area = pyramid.mip_size(mip);
                read_payload(&page, pyramid.payload_origin(tile, mip), area, |x, y, value| {
                    texel(mip, x, y, value)
                });
            }
        } else {
            let (left, top) = (
                u32::from(x) * tileset::PAGE_TEXELS,
                u32::from(y) * tileset::PAGE_TEXELS,
            );
            let origin = pyramid.payload_origin(tile, mip);
            read_payload(&page, origin, pyramid.payload(tile), |x, y, value| {
                texel(mip, left + x, top + y, value)
            });
        }
        decoded.push(page);
    }
    Ok(())
}

fn read_payload(
    page: &Page,
    (left, top): (u32, u32),
    (width, height): (u32, u32),
    mut texel: impl FnMut(u32, u32, [f16; GROUP_COMPONENTS]),
) {
    for y in 0..height {
        for x in 0..width {
            texel(x, y, page.texels[((top + y) * SLOT_TEXELS + left + x) as usize]);
        }
    }
}

/// All columns as `[view][light][rgb][component]`, with the ambient light after the last light.
fn decode_abrdfs<R: ReadAt>(archive: &Archive<R>, components: usize) -> Result<Vec<f32>> {
    let manifest = &archive.index.manifest;
    let (views, lights) = (manifest.views.len(), manifest.lights.len());
    let stride = 3 * components;
    let weights = Triangulation::new(&manifest.lights).ambient_weights(&manifest.lights, manifest.cosine);
    let mut abrdfs = vec![0f32; views * (lights + 1) * stride];
    for group in 0..manifest.groups() as u16 {
        let column = archive
            .index
            .decoder
            .column(group, &archive.read_column(group)?)?;
        for (at, values) in column.texels.iter().enumerate() {
            let (view, light, colour) = (at / 3 / lights, at / 3 % lights, at % 3);
            let to = (view * (lights + 1) + light) * stride
                + colour * components
                + usize::from(group) * GROUP_COMPONENTS;
            for (to, value) in abrdfs[to..to + GROUP_COMPONENTS].iter_mut().zip(values) {
                *to = value.to_f32();
            }
        }
    }
    for view in abrdfs.chunks_exact_mut((lights + 1) * stride) {
        let (of_lights, ambient) = view.split_at_mut(lights * stride);
        for (at, ambient) in ambient.iter_mut().enumerate() {
            let lit = of_lights.iter().skip(at).step_by(stride);
            *ambient = lit
                .zip(&weights)
                .map(|(value, weight)| f64::from(*value) * weight)
                .sum::<f64>() as f32;
        }
    }
    Ok(abrdfs)
}
