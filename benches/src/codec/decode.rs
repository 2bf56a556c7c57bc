//! All pages of an archive, decoded on one core: how fast, and how far from the eigen-textures.

use std::collections::HashMap;
use std::fs::File;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};
use tileset::archive::Index;
use tileset::{Archive, GROUP_COMPONENTS, PAGE_TEXELS, Page, PageId, SLOT_TEXELS, Tile};

use crate::{Error, Result};

/// Speed of decoding all pages on one core, from records in memory to half floats in slots.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DecodeSpeed {
    /// Samples in the payloads of all pages, all mips: texels × components. Borders and the mips that the decoder
    /// derives in the tail are not counted, though they are made.
    pub samples: u64,
    /// Those of the finest mip.
    pub finest_samples: u64,
    /// Median over all runs.
    pub seconds: f64,
    /// Times that all pages were decoded.
    pub runs: usize,
    /// Megabytes (10⁶) of f32 a second: four bytes for each of `samples`.
    pub mb_per_s: f64,
    /// The same for each of `finest_samples`: the coarser mips count as time, not as samples.
    pub finest_mb_per_s: f64,
}

/// The pages of an archive in memory, checked, as they are stored.
pub struct Pages {
    path: PathBuf,
    index: Index,
    /// `[group][tile]`, coarse to fine.
    records: Vec<Vec<(Tile, Vec<u8>)>>,
}

impl Pages {
    /// Reads all pages of the archive at `path`.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Archive`].
    pub fn read(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        let archive = Archive::open(file).map_err(Error::archive(path))?;
        let group = |group: u16| {
            let record = |tile| Ok((tile, archive.read_page(PageId { group, tile })?));
            archive.index.pyramid.tiles().map(record).collect()
        };
        let records = (0..archive.index.manifest.groups() as u16)
            .map(group)
            .collect::<tileset::Result<_>>()
            .map_err(Error::archive(path))?;
        Ok(Self {
            path: path.to_owned(),
            index: archive.index,
            records,
        })
    }

    /// The archive's manifest and directory.
    pub fn index(&self) -> &Index {
        &self.index
    }

    /// Decodes all pages `runs` times, at least once.
    ///
    /// # Errors
    /// [`Error::Archive`] if a page is damaged.
    pub fn speed(&self, runs: usize) -> Result<DecodeSpeed> {
        let (mut seconds, mut spare) = (Vec::new(), Vec::new());
        for _ in 0..runs.max(1) {
            let began = Instant::now();
            for group in 0..self.records.len() {
                self.each_page(group, &mut spare, |_, page| {
                    black_box(page);
                })?;
            }
            seconds.push(began.elapsed().as_secs_f64());
        }
        seconds.sort_by(f64::total_cmp);
        let median = seconds[seconds.len() / 2];
        let components = u64::from(self.index.manifest.components);
        let texels = |tile| {
            let (width, height) = self.index.pyramid.payload(tile);
            u64::from(width) * u64::from(height)
        };
        let samples = components * self.index.pyramid.tiles().map(texels).sum::<u64>();
        let (width, height) = self.index.pyramid.mip_size(0);
        let finest_samples = components * u64::from(width) * u64::from(height);
        let speed = |samples: u64| 4.0 * samples as f64 / median.max(f64::MIN_POSITIVE) * 1e-6;
        Ok(DecodeSpeed {
            samples,
            finest_samples,
            seconds: median,
            runs: seconds.len(),
            mb_per_s: speed(samples),
            finest_mb_per_s: speed(finest_samples),
        })
    }

    /// Σ(decoded − v)² over the finest mip of all components, `v` `[component][y][x]` in the unit of reflectance.
    ///
    /// # Errors
    /// [`Error::Archive`] if a page is damaged.
    ///
    /// # Panics
    /// If `v` has another size than the archive.
    pub fn squared_error(&self, v: &[f32]) -> Result<f64> {
        let manifest = &self.index.manifest;
        let pyramid = &self.index.pyramid;
        let (columns, rows) = pyramid.mip_size(0);
        let texels = columns as usize * rows as usize;
        assert_eq!(v.len(), manifest.components as usize * texels, "samples of V'");
        let (mut sum, mut spare) = (0.0, Vec::new());
        for (group, textures) in v.chunks(GROUP_COMPONENTS * texels).enumerate() {
            self.each_page(group, &mut spare, |tile, page| {
                if tile.mip != 0 {
                    return;
                }
                let (width, height) = pyramid.payload(tile);
                let (left, top) = pyramid.payload_origin(tile, 0);
                for row in 0..height {
                    let slot = ((top + row) * SLOT_TEXELS + left) as usize;
                    let x = u32::from(tile.x) * PAGE_TEXELS;
                    let y = u32::from(tile.y) * PAGE_TEXELS + row;
                    let texel = (y * columns + x) as usize;
                    for (channel, texture) in textures.chunks_exact(texels).enumerate() {
                        let decoded = &page.texels[slot..][..width as usize];
                        for (decoded, &wanted) in decoded.iter().zip(&texture[texel..]) {
                            let decoded = decoded[channel].to_f64() * manifest.texture_scale;
                            sum += (decoded - f64::from(wanted)).powi(2);
                        }
                    }
                }
            })?;
        }
        Ok(sum)
    }

    /// Decodes the pages of a group from coarse to fine. Of these only the last two mips are kept; what is no longer
    /// needed goes to `spare`, and the next ones take its place.
    fn each_page(
        &self,
        group: usize,
        spare: &mut Vec<Page>,
        mut visit: impl FnMut(Tile, &Page),
    ) -> Result<()> {
        let pyramid = &self.index.pyramid;
        let mut parents: HashMap<Tile, Page> = HashMap::new();
        let mut decoded: HashMap<Tile, Page> = HashMap::new();
        let mut mip = pyramid.tail_mip();
        for (tile, bytes) in &self.records[group] {
            if tile.mip != mip {
                spare.extend(parents.drain().map(|(_, page)| page));
                (parents, mip) = (std::mem::take(&mut decoded), tile.mip);
            }
            let id = PageId {
                group: group as u16,
                tile: *tile,
            };
            let parent = pyramid.parent(*tile).and_then(|parent| parents.get(&parent));
            let mut page = spare.pop().unwrap_or(Page { texels: Vec::new() });
            self.index
                .decoder
                .page_into(id, bytes, parent, &mut page)
                .map_err(Error::archive(&self.path))?;
            visit(*tile, &page);
            if tile.mip > 0 {
                decoded.insert(*tile, page);
            } else {
                spare.push(page);
            }
        }
        spare.extend(parents.into_values());
        Ok(())
    }
}
