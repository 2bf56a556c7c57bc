//! The page codec of choice: errors within bounds at every mip, few bytes, and no panic on any bytes.

mod common;

use std::collections::HashMap;

use common::{image, manifest, mips, pyramid_archive, train};
use half::f16;
use proptest::prelude::*;
use tileset::{
    Archive, BORDER_TEXELS, Codec, Error, Manifest, PAGE_TEXELS, Page, PageId, Pyramid, SLOT_TEXELS, Tile,
    codec::{
        MipImage,
        pyramid_dct::{CodedPage, PageTables, code_group, count_group},
    },
};

const SIZES: [(u32, u32); 8] = [
    (1, 1),
    (16, 16),
    (33, 1),
    (75, 40),
    (128, 128),
    (150, 70),
    (346, 335),
    (1, 1000),
];

fn pyramid_manifest(width: u32, height: u32, components: u32, step: f64) -> Manifest {
    Manifest {
        codec: Codec::PyramidDct { step },
        ..manifest(width, height, components, step)
    }
}

/// All pages of an archive's first group.
fn decode(archive: &Archive<&[u8]>) -> HashMap<Tile, Page> {
    let index = &archive.index;
    let mut pages = HashMap::new();
    for tile in index.pyramid.tiles() {
        let parent = index.pyramid.parent(tile).map(|parent| &pages[&parent]);
        let id = PageId { group: 0, tile };
        let page = index
            .decoder
            .page(id, &archive.read_page(id).unwrap(), parent)
            .unwrap();
        pages.insert(tile, page);
    }
    pages
}

fn texel(page: &Page, x: u32, y: u32) -> [f16; 4] {
    page.texels[(y * SLOT_TEXELS + x) as usize]
}

/// Root mean square error of a component's samples at a mip.
fn rms_error(pyramid: &Pyramid, pages: &HashMap<Tile, Page>, mip: u8, wanted: &MipImage) -> f64 {
    let mut sum = 0.0;
    for (tile, page) in pages.iter().filter(|(tile, _)| tile.mip == mip) {
        let (width, height) = pyramid.payload(*tile);
        let (left, top) = pyramid.payload_origin(*tile, mip);
        for y in 0..height {
            for x in 0..width {
                let at = |page: u16, local: u32| u32::from(page) * PAGE_TEXELS + local;
                let wanted = wanted.texels[(at(tile.y, y) * wanted.width + at(tile.x, x)) as usize];
                let found = texel(page, left + x, top + y);
                sum += (0..4)
                    .map(|c| f64::from(found[c].to_f32() - wanted[c]).powi(2))
                    .sum::<f64>();
            }
        }
    }
    (sum / wanted.texels.len() as f64 / 4.0).sqrt()
}

#[test]
fn every_mip_is_as_good_as_the_step_says() {
    for (width, height) in SIZES {
        for step in [0.3, 0.02] {
            let bytes = pyramid_archive(&pyramid_manifest(width, height, 4, step));
            let archive = Archive::open(&bytes[..]).unwrap();
            let pyramid = archive.index.pyramid;
            let images = mips(image(width, height, 0), &pyramid);
            let pages = decode(&archive);
            for mip in 0..=pyramid.tail_mip() {
                let error = rms_error(&pyramid, &pages, mip, &images[usize::from(mip)]);
                // Rounding to the nearest would leave √(1/12) of a step, and choice by rate and distortion and half
                // floats add a little; pages may be left out whose samples hold less than a dozen squared steps.
                let samples = 4.0 * images[usize::from(mip)].texels.len() as f64 / pyramid.grid(mip).0 as f64;
                let bound = (0.25 + 12.0 / samples).sqrt() * step / f64::from(1 << mip) + 1e-3;
                assert!(
                    error < bound,
                    "{width}x{height} step {step} mip {mip}: {error}, bound {bound}"
                );
            }
        }
    }
}

#[test]
fn nothing_is_sent_for_what_the_parent_says() {
    let constant = MipImage {
        width: 256,
        height: 200,
        texels: vec![[0.5, -2.0, 0.0, 100.0]; 256 * 200],
    };
    let pyramid = Pyramid::new(256, 200, false).unwrap();
    let images = [mips(constant, &pyramid)];
    let tables = train(0.01, &pyramid, &images);
    let pages = code_group(0.01, &pyramid, 0, &images[0], &tables).unwrap();
    for page in &pages[1..] {
        assert!(page.bytes.is_empty() && page.weight == 0.0, "{page:?}");
    }
    let energy = 0.25 + 4.0 + 10_000.0;
    assert!((pages[0].weight / energy - 1.0).abs() < 1e-5);
}

#[test]
fn weights_are_what_pages_add_to_their_parents() {
    let pyramid = Pyramid::new(256, 256, true).unwrap();
    let images = [mips(image(256, 256, 3), &pyramid)];
    let tables = train(0.01, &pyramid, &images);
    let pages = code_group(0.01, &pyramid, 0, &images[0], &tables).unwrap();
    // The transform is orthonormal: the mean squares of all mips, each over as much of the picture as it shows, add up.
    let share = |page: &CodedPage| {
        let (width, height) = pyramid.payload(page.tile);
        let (all_width, all_height) = pyramid.mip_size(page.tile.mip);
        f64::from(width * height) / f64::from(all_width * all_height)
    };
    let sum: f64 = pages.iter().map(|page| page.weight * share(page)).sum();
    let squares = images[0][0]
        .texels
        .as_flattened()
        .iter()
        .map(|&value| f64::from(value).powi(2));
    let wanted = squares.sum::<f64>() / f64::from(256 * 256);
    assert!((sum / wanted - 1.0).abs() < 1e-3, "{sum} {wanted}");
}

#[test]
fn borders_repeat_the_edge_where_the_picture_ends_and_come_close_elsewhere() {
    let value = |x: f32, y: f32| [x * 0.01, y * 0.02, (x + y) * 0.005, 1.0];
    let texels = (0..200 * 150)
        .map(|i| value((i % 200) as f32, (i / 200) as f32))
        .collect();
    let finest = MipImage {
        width: 200,
        height: 150,
        texels,
    };
    let pyramid = Pyramid::new(200, 150, false).unwrap();
    let images = [mips(finest, &pyramid)];
    let step = 1e-3;
    let tables = train(step, &pyramid, &images);
    let mut pages: HashMap<Tile, Page> = HashMap::new();
    let manifest = Manifest {
        wrap: false,
        ..pyramid_manifest(200, 150, 4, step)
    };
    let decoder = decoder_of(&manifest, &tables);
    for page in code_group(step, &pyramid, 0, &images[0], &tables).unwrap() {
        let parent = pyramid.parent(page.tile).map(|parent| &pages[&parent]);
        let id = PageId {
            group: 0,
            tile: page.tile,
        };
        let decoded = decoder.page(id, &page.bytes, parent).unwrap();
        pages.insert(page.tile, decoded);
    }
    for (tile, page) in pages.iter().filter(|(tile, _)| tile.mip == 0) {
        let (width, height) = pyramid.payload(*tile);
        for y in 0..height + 2 * BORDER_TEXELS {
            for x in 0..width + 2 * BORDER_TEXELS {
                let at = |page: u16, local: u32| i64::from(page) * 64 + i64::from(local) - 4;
                let (column, row) = (at(tile.x, x), at(tile.y, y));
                let wanted = value(column.clamp(0, 199) as f32, row.clamp(0, 149) as f32);
                let found = texel(page, x, y);
                for c in 0..4 {
                    assert!(
                        (found[c].to_f32() - wanted[c]).abs() < 0.08,
                        "{tile:?} {x} {y}: {found:?} {wanted:?}"
                    );
                }
                let inside = (0..200).contains(&column) && (0..150).contains(&row);
                if !inside {
                    let local = |position: i64, page: u16, side: i64| {
                        (position.clamp(0, side - 1) - i64::from(page) * 64 + 4) as u32
                    };
                    let (x, y) = (local(column, tile.x, 200), local(row, tile.y, 150));
                    if (4..width + 4).contains(&x) && (4..height + 4).contains(&y) {
                        assert_eq!(found, texel(page, x, y), "the edge is repeated");
                    }
                }
            }
        }
    }
}

/// The decoder of an archive with these tables of pages and any columns.
fn decoder_of(manifest: &Manifest, pages: &PageTables) -> tileset::codec::Decoder {
    let samples = vec![0.5; manifest.column_texels() * manifest.components as usize];
    let steps = tileset::codec::column_steps(manifest);
    let columns =
        tileset::codec::columns::encode_columns(&manifest.views, &manifest.lights, &samples, &steps).unwrap();
    let tables = tileset::codec::tables_bytes(pages, &columns.tables).unwrap();
    tileset::codec::Decoder::new(manifest, &tables).unwrap()
}

#[test]
fn fewer_bytes_than_differences_and_zstd_at_less_error() {
    let (step, pyramid) = (0.05, Pyramid::new(256, 256, true).unwrap());
    let images: Vec<_> = (0..3)
        .map(|group| mips(image(256, 256, group), &pyramid))
        .collect();
    let tables = train(step, &pyramid, &images);
    let ours: usize = (0..3)
        .flat_map(|group| code_group(step, &pyramid, group, &images[usize::from(group)], &tables).unwrap())
        .map(|page| page.bytes.len())
        .sum();
    let theirs: usize = images
        .iter()
        .flat_map(|mips| common::encode_group(Codec::DctDeltaZstd { step }, &pyramid, mips))
        .map(|page| page.bytes.len())
        .sum();
    let ours = ours + tables.to_bytes().unwrap().len();
    assert!(10 * ours < 7 * theirs, "{ours} and {theirs} bytes");
}

#[test]
fn what_cannot_be_coded_is_refused() {
    let pyramid = Pyramid::new(64, 64, true).unwrap();
    let good = mips(image(64, 64, 1), &pyramid);
    let count = |step: f64, mips: &[MipImage]| count_group(step, &pyramid, (0, 1), mips, None).map(|_| ());
    count(0.1, &good).unwrap();
    for step in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e7] {
        assert!(matches!(count(step, &good), Err(Error::Invalid { .. })), "{step}");
    }
    for bad in [f32::NAN, f32::INFINITY, 70_000.0] {
        let mut mips = good.clone();
        mips[0].texels[77][2] = bad;
        assert!(matches!(count(0.1, &mips), Err(Error::Invalid { .. })), "{bad}");
    }
    let mut large = good.clone();
    large[0].texels.fill([60_000.0; 4]);
    let message = count(1e-6, &mips(large[0].clone(), &pyramid))
        .unwrap_err()
        .to_string();
    assert!(message.contains("too small"), "{message}");
    assert!(matches!(count(0.1, &good[1..]), Err(Error::Invalid { .. })));
    assert!(matches!(count(0.1, &[]), Err(Error::Invalid { .. })));
    let untrained = count_group(0.1, &pyramid, (0, 1), &good, None).unwrap().tables();
    assert!(matches!(
        code_group(0.1, &pyramid, 0, &good, &untrained),
        Err(Error::Invalid { .. })
    ));
}

#[test]
fn parents_are_checked() {
    let bytes = pyramid_archive(&pyramid_manifest(150, 70, 4, 0.1));
    let archive = Archive::open(&bytes[..]).unwrap();
    let index = &archive.index;
    let root = PageId {
        group: 0,
        tile: index.pyramid.root(),
    };
    let child = PageId {
        group: 0,
        tile: index.pyramid.children(root.tile).next().unwrap(),
    };
    let decoded = index
        .decoder
        .page(root, &archive.read_page(root).unwrap(), None)
        .unwrap();
    let short = Page {
        texels: vec![[f16::ZERO; 4]; 7],
    };
    for (page, parent) in [(root, Some(&decoded)), (child, None), (child, Some(&short))] {
        assert!(matches!(
            index.decoder.page(page, &[], parent),
            Err(Error::Invalid { .. })
        ));
    }
    let beyond = PageId {
        group: 0,
        tile: Tile { mip: 0, x: 9, y: 0 },
    };
    assert!(matches!(
        index.decoder.page(beyond, &[], Some(&decoded)),
        Err(Error::NotFound { .. })
    ));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever the bytes say, decoding ends, in a page of finite values or an error.
    #[test]
    fn any_bytes_decode_or_are_refused(
        noise in prop::collection::vec(any::<u8>(), 0..600),
        cut in 0usize..400, flip in any::<prop::sample::Index>(),
    ) {
        let bytes = pyramid_archive(&pyramid_manifest(75, 40, 4, 0.1));
        let archive = Archive::open(&bytes[..]).unwrap();
        let index = &archive.index;
        let id = PageId { group: 0, tile: index.pyramid.root() };
        let good = archive.read_page(id).unwrap();
        let mut flipped = good.clone();
        let at = flip.index(flipped.len());
        flipped[at] ^= 1 << (at % 8);
        for bytes in [&noise[..], &good[..cut.min(good.len() - 1)], &flipped] {
            if let Ok(page) = index.decoder.page(id, bytes, None) {
                prop_assert!(page.texels.iter().flatten().all(|value| value.is_finite()));
            }
        }
    }

    #[test]
    fn any_tables_are_read_or_refused(noise in prop::collection::vec(any::<u8>(), 0..600), at in any::<prop::sample::Index>()) {
        let pyramid = Pyramid::new(75, 40, true).unwrap();
        let images = [mips(image(75, 40, 1), &pyramid)];
        let tables = train(0.1, &pyramid, &images);
        let raw = tables.to_bytes().unwrap();
        prop_assert!(PageTables::from_bytes(&raw, &pyramid, 1).unwrap() == tables);
        prop_assert!(PageTables::from_bytes(&noise, &pyramid, 1).is_err());
        prop_assert!(PageTables::from_bytes(&raw, &pyramid, 9).is_err());
        // Damage behind zstd's frame, as a checksum would not find it.
        let mut plain = zstd::bulk::decompress(&raw, 1 << 20).unwrap();
        let at = at.index(plain.len());
        plain[at] = plain[at].wrapping_add(noise.first().copied().unwrap_or(1));
        let damaged = zstd::bulk::compress(&plain, 3).unwrap();
        if let Ok(tables) = PageTables::from_bytes(&damaged, &pyramid, 1) {
            let good = code_group(0.1, &pyramid, 0, &images[0], &train(0.1, &pyramid, &images)).unwrap();
            let decoder = decoder_of(&pyramid_manifest(75, 40, 4, 0.1), &tables);
            let _ = decoder.page(PageId { group: 0, tile: pyramid.root() }, &good[0].bytes, None);
        }
    }
}
