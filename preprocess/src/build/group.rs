//! One group of four components: its mips, and its pages as a decoder will see them.

use std::collections::HashMap;

use tileset::codec::pyramid_dct::{PageTables, Statistics, code_group, count_group};
use tileset::codec::{Decoder, MipImage};
use tileset::{Column, GROUP_COMPONENTS, Manifest, Page, PageId, Pyramid, Result, Tile};

use super::DecodedMip;
use super::decoded::Loss;
use crate::Factors;

/// A page without a record of which no texel is missed by more, in steps of the quantizer, weighs nothing, and nobody gives a slot to
/// it: at the default step that is 0.008 % of the BTF's root mean square, which the ledger does not count.
const NOT_WORTH_A_SLOT: f64 = 1.0 / 256.0;

/// What all groups share.
pub(super) struct Material<'a> {
    pub(super) factors: &'a Factors,
    pub(super) manifest: &'a Manifest,
    pub(super) pyramid: Pyramid,
}

/// The records of one group, and what a decoder will make of them.
pub(super) struct GroupRecords {
    /// Page, its bytes, its weight in squared units of reflectance: what is lost where it is missing and its parent is drawn.
    pub(super) pages: Vec<(PageId, Vec<u8>, f64)>,
    pub(super) column: Vec<u8>,
    /// Mean square of the group's eigen-textures, in squared units of reflectance.
    pub(super) column_weight: f64,
    pub(super) finest: DecodedMip,
    pub(super) abrdfs: Column,
}

impl Material<'_> {
    /// Counts a group's levels for the tables to be; `None` in the first round.
    pub(super) fn count(&self, group: u16, tables: Option<&PageTables>) -> Result<Statistics> {
        let of = (group, self.manifest.groups());
        count_group(
            self.manifest.codec.step(),
            &self.pyramid,
            of,
            &self.mips(group),
            tables,
        )
    }

    /// Codes a group's pages and decodes them again. Components beyond the rank are zero.
    pub(super) fn encode(
        &self,
        group: u16,
        tables: &PageTables,
        decoder: &Decoder,
        column: Vec<u8>,
    ) -> Result<GroupRecords> {
        let mips = self.mips(group);
        let squared_scale = self.manifest.texture_scale.powi(2);
        let squares = mips[0]
            .texels
            .as_flattened()
            .iter()
            .map(|&value| f64::from(value).powi(2));
        let column_weight = squares.sum::<f64>() / mips[0].texels.len() as f64 * squared_scale;

        let coded = code_group(self.manifest.codec.step(), &self.pyramid, group, &mips, tables)?;
        let mut losses = Vec::with_capacity(coded.len());
        // Coarse to fine; of the decoded pages, and of what they are put together to, only those of two mips are kept.
        let mut decoded: HashMap<Tile, Page> = HashMap::new();
        let mut finest = DecodedMip::new(&self.pyramid, self.pyramid.tail_mip());
        for coded in coded.chunk_by(|a, b| a.tile.mip == b.tile.mip) {
            let mip = coded[0].tile.mip;
            let coarser = std::mem::replace(&mut finest, DecodedMip::new(&self.pyramid, mip));
            decoded.retain(|kept, _| kept.mip == mip + 1);
            for page in coded {
                let tile = page.tile;
                let parent = self.pyramid.parent(tile).and_then(|parent| decoded.get(&parent));
                let texels = decoder.page(PageId { group, tile }, &page.bytes, parent)?;
                finest.put(&self.pyramid, tile, &texels);
                if mip > 0 {
                    decoded.insert(tile, texels);
                }
            }
            // In the order of pages: row by row.
            losses.extend(match losses.is_empty() {
                true => vec![Loss {
                    mean: coded[0].weight,
                    largest: f64::INFINITY,
                }],
                false => finest.lost_without(&coarser, &self.pyramid),
            });
        }
        let least = (NOT_WORTH_A_SLOT * self.manifest.codec.step()).powi(2);
        let pages = coded.into_iter().zip(losses).map(|(page, loss)| {
            let id = PageId {
                group,
                tile: page.tile,
            };
            let counts = !page.bytes.is_empty() || loss.largest > least;
            (
                id,
                page.bytes,
                if counts { loss.mean * squared_scale } else { 0.0 },
            )
        });
        let pages = pages.collect();
        Ok(GroupRecords {
            pages,
            abrdfs: decoder.column(group, &column)?,
            column,
            column_weight,
            finest,
        })
    }

    /// The group's eigen-textures, scaled as they are stored, down to the tail.
    fn mips(&self, group: u16) -> Vec<MipImage> {
        let mut mips = vec![self.finest_mip(group)];
        for _ in 0..self.pyramid.tail_mip() {
            mips.push(mips[mips.len() - 1].downsample());
        }
        mips
    }

    fn finest_mip(&self, group: u16) -> MipImage {
        let Material {
            factors, manifest, ..
        } = self;
        let mut texels = vec![[0f32; 4]; factors.columns];
        let inverse_scale = manifest.texture_scale.recip() as f32;
        let first = usize::from(group) * GROUP_COMPONENTS;
        for (channel, component) in (0..GROUP_COMPONENTS).zip(first..factors.components) {
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
}
