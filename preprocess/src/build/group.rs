//! One group of four components: its pages from coarse to fine, and its column.

use std::collections::HashMap;

use half::f16;
use tileset::codec::{MipImage, encode_column, encode_page};
use tileset::{Column, GROUP_COMPONENTS, Manifest, Page, PageId, Pyramid, Result, Tile};

use super::Finest;
use crate::Factors;

/// What all groups share.
pub(super) struct Material<'a> {
    pub(super) factors: &'a Factors,
    pub(super) manifest: &'a Manifest,
    pub(super) pyramid: Pyramid,
}

/// The records of one group, and what a decoder will make of them.
pub(super) struct GroupRecords {
    /// Page, its bytes, its weight in squared units of reflectance.
    pub(super) pages: Vec<(PageId, Vec<u8>, f64)>,
    pub(super) column: Vec<u8>,
    /// Mean square of the group's eigen-textures, in squared units of reflectance.
    pub(super) column_weight: f64,
    pub(super) finest: Finest,
}

/// Codes one group. Components beyond the rank are zero.
pub(super) fn encode(material: &Material<'_>, group: u16) -> Result<GroupRecords> {
    let Material {
        manifest, pyramid, ..
    } = material;
    let finest = finest_mip(material, group);
    let sum_of_squares: f64 = finest
        .texels
        .iter()
        .flatten()
        .map(|&value| f64::from(value).powi(2))
        .sum();
    let squared_scale = manifest.texture_scale.powi(2);
    let column_weight = sum_of_squares / finest.texels.len() as f64 * squared_scale;

    let mut mips = vec![finest];
    for _ in 0..pyramid.tail_mip() {
        mips.push(mips[mips.len() - 1].downsample(manifest.wrap));
    }
    let mut records = GroupRecords {
        pages: Vec::with_capacity(pyramid.tile_count() as usize),
        column: encode_column(&column(material, group))?,
        column_weight,
        finest: Finest::new(pyramid),
    };
    // Coarse to fine; of the decoded pages only those of the next coarser mip are kept.
    let mut parents: HashMap<Tile, Page> = HashMap::new();
    let mut mip = pyramid.tail_mip();
    while let Some(image) = mips.pop() {
        let (columns, rows) = pyramid.grid(mip);
        let mut decoded = HashMap::with_capacity((columns * rows) as usize);
        for (x, y) in (0..rows as u16).flat_map(|y| (0..columns as u16).map(move |x| (x, y))) {
            let tile = Tile { mip, x, y };
            let parent = pyramid.parent(tile).and_then(|parent| parents.get(&parent));
            let page = encode_page(manifest.codec, pyramid, tile, &image, parent)?;
            records.finest.put(pyramid, tile, &page.decoded);
            records
                .pages
                .push((PageId { group, tile }, page.bytes, page.weight * squared_scale));
            decoded.insert(tile, page.decoded);
        }
        parents = decoded;
        mip = mip.saturating_sub(1);
    }
    Ok(records)
}

/// The group's eigen-textures, scaled as they are stored.
fn finest_mip(material: &Material<'_>, group: u16) -> MipImage {
    let Material {
        factors, manifest, ..
    } = material;
    let mut texels = vec![[0f32; 4]; factors.columns];
    let inverse_scale = manifest.texture_scale.recip() as f32;
    for (channel, component) in components(factors, group) {
        let texture = &factors.v[component * factors.columns..][..factors.columns];
        for (texel, &value) in texels.iter_mut().zip(texture) {
            texel[channel] = value * inverse_scale;
        }
    }
    MipImage {
        width: manifest.width,
        height: manifest.height,
        texels,
    }
}

/// The group's eigen-ABRDFs, rounded to half floats.
fn column(material: &Material<'_>, group: u16) -> Column {
    let factors = material.factors;
    let mut texels = vec![[f16::ZERO; 4]; factors.rows];
    for (channel, component) in components(factors, group) {
        let abrdf = &factors.u[component * factors.rows..][..factors.rows];
        for (texel, &value) in texels.iter_mut().zip(abrdf) {
            texel[channel] = f16::from_f32(value);
        }
    }
    Column { texels }
}

/// The channels and components of a group that exist.
fn components(factors: &Factors, group: u16) -> impl Iterator<Item = (usize, usize)> + use<> {
    let first = usize::from(group) * GROUP_COMPONENTS;
    (0..GROUP_COMPONENTS).zip(first..factors.components)
}
