//! An archive as plain numpy files, for anything that does not read archives.
//!
//! - `u.npy` `[components][views][lights][3]` f32: eigen-ABRDFs;
//! - `v.npy` `[components][height][width]` f32: eigen-textures, decoded at the finest mip;
//! - `meta.json`: directions, scaling, wrap, cosine, errors.
//!
//! They multiply to the BTF: `ρ[view][light][rgb][y][x] ≈ Σ_c u[c][view][light][rgb]·v[c][y][x]`.

use std::collections::HashMap;
use std::fs::File;
use std::path::Path;

use serde::Serialize;
use tileset::{
    Archive, Column, Direction, GROUP_COMPONENTS, Ledger, Manifest, Page, PageId, Pyramid, ReadAt, Tile,
};

use crate::build::DecodedMip;
use crate::npy::{Dtype, NpyWriter};
use crate::output::AtomicFile;
use crate::progress::{Phase, Progress, ProgressFn};
use crate::{Error, Result};

/// `meta.json`.
#[derive(Serialize)]
struct Meta<'a> {
    name: &'a str,
    generator: &'a str,
    components: u32,
    views: Vec<[f64; 2]>,
    lights: Vec<[f64; 2]>,
    width: u32,
    height: u32,
    wrap: bool,
    cosine: bool,
    scaling: &'static str,
    singular_values: &'a [f64],
    mean_rgb: [f64; 3],
    errors: Ledger,
    relative_error: f64,
}

const SCALING: &str = "rho[view][light][rgb][y][x] = sum over c of u[c][view][light][rgb] * v[c][y][x], radiance factors; \
     u has unit root mean square per component, v the unit of rho; directions are [theta, phi] in radians";

/// Decodes the archive `path` into `folder`, which is created if need be. Memory: one group at a time.
///
/// # Errors
/// [`Error::Archive`] if the archive is damaged, [`Error::Io`]. Each file is complete or not there.
pub fn export(path: &Path, folder: &Path, progress: ProgressFn<'_>) -> Result<()> {
    let file = File::open(path).map_err(Error::io(path, "open"))?;
    let archive = Archive::open(file).map_err(Error::archive(path))?;
    archive.check().map_err(Error::archive(path))?;
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "create"))?;
    let manifest = &archive.index.manifest;
    let components = manifest.components as usize;

    let shape = [components, manifest.views.len(), manifest.lights.len(), 3];
    let mut u = NpyWriter::create(&folder.join("u.npy"), Dtype::F32, &shape)?;
    let shape = [components, manifest.height as usize, manifest.width as usize];
    let mut v = NpyWriter::create(&folder.join("v.npy"), Dtype::F32, &shape)?;
    let scale = manifest.texture_scale as f32;
    let total = u64::from(manifest.groups());
    for group in 0..manifest.groups() as u16 {
        progress(Progress {
            phase: Phase::Decoding,
            done: group.into(),
            total,
        });
        let (column, finest) = decode_group(&archive, group).map_err(Error::archive(path))?;
        let first = usize::from(group) * GROUP_COMPONENTS;
        for channel in 0..GROUP_COMPONENTS.min(components - first) {
            let abrdf: Vec<f32> = column
                .texels
                .iter()
                .map(|texel| texel[channel].to_f32())
                .collect();
            u.write_f32(&abrdf)?;
            let texture: Vec<f32> = finest
                .texels
                .iter()
                .map(|texel| texel[channel].to_f32() * scale)
                .collect();
            v.write_f32(&texture)?;
        }
    }
    progress(Progress {
        phase: Phase::Decoding,
        done: total,
        total,
    });
    u.finish()?;
    v.finish()?;
    write_meta(manifest, &folder.join("meta.json"))
}

/// The column of a group and the finest mip of its textures, as every reader of the archive sees them.
pub(crate) fn decode_group<R: ReadAt>(
    archive: &Archive<R>,
    group: u16,
) -> tileset::Result<(Column, DecodedMip)> {
    let column = archive
        .index
        .decoder
        .column(group, &archive.read_column(group)?)?;
    Ok((column, decode_finest(archive, group)?))
}

/// All pages of one group, coarse to fine; what is kept is the finest mip.
fn decode_finest<R: ReadAt>(archive: &Archive<R>, group: u16) -> tileset::Result<DecodedMip> {
    let pyramid: &Pyramid = &archive.index.pyramid;
    let mut finest = DecodedMip::new(pyramid, 0);
    let mut parents: HashMap<Tile, Page> = HashMap::new();
    for mip in (0..=pyramid.tail_mip()).rev() {
        let (columns, rows) = pyramid.grid(mip);
        let mut decoded = HashMap::with_capacity((columns * rows) as usize);
        for (x, y) in (0..rows as u16).flat_map(|y| (0..columns as u16).map(move |x| (x, y))) {
            let tile = Tile { mip, x, y };
            let id = PageId { group, tile };
            let parent = pyramid.parent(tile).and_then(|parent| parents.get(&parent));
            let page = archive.index.decoder.page(id, &archive.read_page(id)?, parent)?;
            finest.put(pyramid, tile, &page);
            decoded.insert(tile, page);
        }
        parents = decoded;
    }
    Ok(finest)
}

fn write_meta(manifest: &Manifest, path: &Path) -> Result<()> {
    let angles = |directions: &[Direction]| -> Vec<[f64; 2]> {
        directions
            .iter()
            .map(|direction| [direction.theta, direction.phi])
            .collect()
    };
    let meta = Meta {
        name: &manifest.name,
        generator: &manifest.generator,
        components: manifest.components,
        views: angles(&manifest.views),
        lights: angles(&manifest.lights),
        width: manifest.width,
        height: manifest.height,
        wrap: manifest.wrap,
        cosine: manifest.cosine,
        scaling: SCALING,
        singular_values: &manifest.singular_values,
        mean_rgb: manifest.mean_rgb,
        errors: manifest.errors,
        relative_error: manifest.errors.total_relative(),
    };
    let text = serde_json::to_vec_pretty(&meta).expect("a validated manifest has only finite numbers");
    let mut file = AtomicFile::create(path)?;
    file.write_all(&text)?;
    file.commit()
}
