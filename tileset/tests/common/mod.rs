//! A small synthetic material, coded the way a preprocessor does it.

#![allow(dead_code, reason = "each test program uses a part")]

use half::f16;
use tileset::{
    ArchiveWriter, Codec, Column, Direction, Factorization, Ledger, Manifest, PageId, Pyramid,
    codec::{
        EncodedPage, MipImage, column_steps,
        columns::encode_columns,
        encode_column, encode_page,
        pyramid_dct::{PageTables, Statistics, code_group, count_group},
        tables_bytes,
    },
};

/// Random numbers in -1/2..1/2 that are the same everywhere.
pub(crate) struct Noise(pub(crate) u32);

impl Noise {
    pub(crate) fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / (1 << 24) as f32 - 0.5
    }
}

/// Bumps of two sizes and some noise, all from rational functions, so that they have the same bits
/// everywhere.
pub(crate) fn image(width: u32, height: u32, seed: u32) -> MipImage {
    let mut noise = Noise(seed);
    let bump = |t: f32| {
        let t = (t - t.floor()) * 2.0 - 1.0;
        1.0 - t * t
    };
    let mut texels = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let (u, v) = (x as f32 / width as f32, y as f32 / height as f32);
            texels.push(std::array::from_fn(|c| {
                let c = c as f32 + 1.0;
                bump(u * 2.0 * c) * bump(v * c + 0.25)
                    + 0.3 / c * bump(u * 9.0 + v * 7.0)
                    + 0.1 * noise.next()
            }));
        }
    }
    MipImage {
        width,
        height,
        texels,
    }
}

/// All mips of an image, finest first.
pub(crate) fn mips(finest: MipImage, pyramid: &Pyramid) -> Vec<MipImage> {
    let mut mips = vec![finest];
    for _ in 1..pyramid.mip_count() {
        mips.push(mips.last().unwrap().downsample());
    }
    mips
}

/// Every page of a group, in the order of the tiles.
pub(crate) fn encode_group(codec: Codec, pyramid: &Pyramid, mips: &[MipImage]) -> Vec<EncodedPage> {
    let mut pages: Vec<EncodedPage> = Vec::new();
    for tile in pyramid.tiles() {
        let parent = pyramid
            .parent(tile)
            .map(|parent| &pages[pyramid.tile_index(parent).unwrap() as usize].decoded);
        pages.push(encode_page(codec, pyramid, tile, &mips[usize::from(tile.mip)], parent).unwrap());
    }
    pages
}

pub(crate) fn manifest(width: u32, height: u32, components: u32, step: f64) -> Manifest {
    let directions = |count: u32| {
        let direction = |i: u32| Direction {
            theta: 0.1 + 0.3 * f64::from(i),
            phi: 1.7 * f64::from(i),
        };
        (0..count).map(direction).collect()
    };
    Manifest {
        name: "bumps".into(),
        generator: "tileset tests".into(),
        width,
        height,
        wrap: true,
        cosine: false,
        views: directions(4),
        lights: directions(5),
        components,
        factorization: Factorization::Fmf,
        codec: Codec::DctDeltaZstd { step },
        texture_scale: 1.0,
        mean_rgb: [0.1, 0.2, 1.0 / 3.0],
        singular_values: (0..components).map(|i| 1.0 / f64::from(i + 3)).collect(),
        errors: Ledger {
            btf_rms: 0.7,
            rank_rms: 0.01,
            half_rms: 1e-4 / 3.0,
            codec_rms: 0.02,
            measured_rms: 0.0224,
        },
    }
}

pub(crate) fn column(manifest: &Manifest, group: u16) -> Column {
    let mut noise = Noise(group.into());
    let texels = (0..manifest.column_texels())
        .map(|i| std::array::from_fn(|c| f16::from_f32(1.0 / (i + c + 1) as f32 + 0.1 * noise.next())));
    Column {
        texels: texels.collect(),
    }
}

/// The bytes of a whole archive.
pub(crate) fn archive(manifest: &Manifest) -> Vec<u8> {
    let pyramid = manifest.pyramid().unwrap();
    let mut writer = ArchiveWriter::new(manifest.clone()).unwrap();
    for group in 0..manifest.groups() as u16 {
        let mips = mips(image(manifest.width, manifest.height, group.into()), &pyramid);
        for (tile, page) in pyramid.tiles().zip(encode_group(manifest.codec, &pyramid, &mips)) {
            writer
                .add_page(PageId { group, tile }, page.bytes, page.weight)
                .unwrap();
        }
        writer
            .add_column(group, encode_column(&column(manifest, group)).unwrap(), 1.0)
            .unwrap();
    }
    let mut bytes = Vec::new();
    assert_eq!(writer.write(&mut bytes).unwrap(), bytes.len() as u64);
    bytes
}

/// The same, coded by [`Codec::PyramidDct`].
pub(crate) fn pyramid_archive(manifest: &Manifest) -> Vec<u8> {
    let pyramid = manifest.pyramid().unwrap();
    let step = manifest.codec.step();
    let groups = manifest.groups();
    let images: Vec<_> = (0..groups)
        .map(|group| mips(image(manifest.width, manifest.height, group), &pyramid))
        .collect();
    let pages = train(step, &pyramid, &images);
    let mut samples = Vec::new();
    for component in 0..manifest.components {
        let column = column(manifest, (component / 4) as u16);
        samples.extend(
            column
                .texels
                .iter()
                .map(|texel| texel[component as usize % 4].to_f32()),
        );
    }
    let columns = encode_columns(
        &manifest.views,
        &manifest.lights,
        &samples,
        &column_steps(manifest),
    )
    .unwrap();
    let tables = tables_bytes(&pages, &columns.tables).unwrap();
    let mut writer = ArchiveWriter::with_tables(manifest.clone(), tables).unwrap();
    for ((group, mips), column) in (0..).zip(&images).zip(columns.records) {
        for page in code_group(step, &pyramid, group, mips, &pages).unwrap() {
            let id = PageId {
                group,
                tile: page.tile,
            };
            writer.add_page(id, page.bytes, page.weight).unwrap();
        }
        writer.add_column(group, column, 1.0).unwrap();
    }
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    bytes
}

/// Tables for images of all groups.
pub(crate) fn train(step: f64, pyramid: &Pyramid, images: &[Vec<MipImage>]) -> PageTables {
    let mut tables = None;
    for _ in 0..3 {
        let mut sums: Option<Statistics> = None;
        for (group, mips) in (0..).zip(images) {
            let of = (group, images.len() as u32);
            let counted = count_group(step, pyramid, of, mips, tables.as_ref()).unwrap();
            match &mut sums {
                None => sums = Some(counted),
                Some(sums) => sums.add(&counted),
            }
        }
        tables = sums.map(|sums| sums.tables());
    }
    tables.unwrap()
}

/// Reads all records.
pub(crate) fn read_all(bytes: &[u8]) -> Result<(), tileset::Error> {
    let archive = tileset::Archive::open(bytes)?;
    for group in 0..archive.index.manifest.groups() as u16 {
        archive.read_column(group)?;
        for tile in archive.index.pyramid.tiles() {
            archive.read_page(tileset::PageId { group, tile })?;
        }
    }
    Ok(())
}
