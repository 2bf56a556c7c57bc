//! An archive of version 1 as it was once written, kept as bytes: whatever changes in this crate, it must
//! decode to the same values, on every platform.
//!
//! A change of the format is a new version, a new fixture beside this one, and docs/format.md.

mod common;

use common::read_all;
use half::f16;
use tileset::{
    Archive, Column, Error, Page, PageId,
    codec::{decode_column, decode_page},
};
use xxhash_rust::xxh3::Xxh3;

const V1: &[u8] = include_bytes!("fixtures/v1.bsvtf");
/// XXH3-128 of header, manifest and directory.
const ID: u128 = 0x363d_50bf_f51b_51a0_cea9_9765_6e2a_d59c;
/// XXH3-64 of the decoded columns, and of the decoded pages, as little-endian half floats.
const COLUMNS: u64 = 0x3e71_2393_febe_6da3;
const PAGES: u64 = 0xca6f_0637_477b_557a;

fn hash<'a>(texels: impl Iterator<Item = &'a [f16; 4]>) -> u64 {
    let mut hasher = Xxh3::new();
    for value in texels.flatten() {
        hasher.update(&value.to_le_bytes());
    }
    hasher.digest()
}

/// Hashes of all columns and all pages.
fn decode(bytes: &[u8]) -> (u64, u64) {
    let archive = Archive::open(bytes).unwrap();
    let (manifest, pyramid) = (&archive.index.manifest, archive.index.pyramid);
    let mut columns: Vec<Column> = Vec::new();
    let mut pages: Vec<Page> = Vec::new();
    for group in 0..manifest.groups() as u16 {
        columns.push(decode_column(manifest, group, &archive.read_column(group).unwrap()).unwrap());
        let first = pages.len();
        for tile in pyramid.tiles() {
            let parent = pyramid
                .parent(tile)
                .map(|tile| &pages[first + pyramid.tile_index(tile).unwrap() as usize]);
            let page = PageId { group, tile };
            let record = archive.read_page(page).unwrap();
            pages.push(decode_page(manifest.codec, &pyramid, page, &record, parent).unwrap());
        }
    }
    (
        hash(columns.iter().flat_map(|column| &column.texels)),
        hash(pages.iter().flat_map(|page| &page.texels)),
    )
}

#[test]
fn version_1_decodes_to_the_same_bits() {
    let archive = Archive::open(V1).unwrap();
    let manifest = &archive.index.manifest;
    assert_eq!(
        (
            manifest.width,
            manifest.height,
            manifest.wrap,
            manifest.components
        ),
        (75, 40, true, 6)
    );
    assert_eq!(manifest.name, "fixture");
    assert_eq!(archive.index.id, ID);
    assert_eq!(
        archive
            .index
            .pages()
            .iter()
            .filter(|record| record.length == 0)
            .count(),
        3
    );
    assert_eq!(decode(V1), (COLUMNS, PAGES));
}

#[test]
fn every_cut_and_every_flipped_byte_is_found() {
    for length in 0..V1.len() {
        assert!(
            matches!(read_all(&V1[..length]), Err(Error::Corrupt { .. })),
            "cut at {length}"
        );
    }
    for extra in [&[0][..], V1] {
        assert!(matches!(
            read_all(&[V1, extra].concat()),
            Err(Error::Corrupt { .. })
        ));
    }
    let mut damaged = V1.to_vec();
    for i in 0..V1.len() {
        damaged[i] ^= 1 << (i % 8);
        assert!(read_all(&damaged).is_err(), "byte {i}");
        damaged[i] = V1[i];
    }
    read_all(&damaged).unwrap();
}
