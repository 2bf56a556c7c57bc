//! Archives of version 6 as they were once written, one of each codec, kept as bytes: whatever changes in this crate,
//! they must decode to the same values, on every platform.
//!
//! A change of the format is a new version, new fixtures beside these, and docs/format.md.

mod common;

use common::read_all;
use half::f16;
use tileset::{Archive, Column, Error, Page, PageId};
use xxhash_rust::xxh3::Xxh3;

/// What a fixture must say and decode to.
struct Fixture {
    bytes: &'static [u8],
    /// XXH3-128 of header, manifest, tables and directory.
    id: u128,
    /// XXH3-64 of the decoded columns, and of the decoded pages, as little-endian half floats.
    columns: u64,
    pages: u64,
}

const FIXTURES: [Fixture; 2] = [
    Fixture {
        bytes: include_bytes!("fixtures/v6-pyramid-dct.bsvtf"),
        id: 0x1727_7d57_e0e1_8da5_6bc3_7eeb_1eda_48b4,
        columns: 0x3d65_5871_0ead_6fc6,
        pages: 0xcbad_b32d_8678_e23f,
    },
    Fixture {
        bytes: include_bytes!("fixtures/v6-dct-delta-zstd.bsvtf"),
        id: 0xcbe6_0a31_6eaf_b129_8e42_93a7_67fc_a71c,
        columns: 0xe3df_0bbd_ee3d_f103,
        pages: 0x043e_3e5b_f1c3_ac91,
    },
];

fn hash<'a>(texels: impl Iterator<Item = &'a [f16; 4]>) -> u64 {
    let mut hasher = Xxh3::new();
    for value in texels.flatten() {
        hasher.update(&value.to_le_bytes());
    }
    hasher.digest()
}

/// Hashes of all columns and all pages.
fn decode(archive: &Archive<&[u8]>) -> (u64, u64) {
    let (manifest, pyramid) = (&archive.index.manifest, archive.index.pyramid);
    let mut columns: Vec<Column> = Vec::new();
    let mut pages: Vec<Page> = Vec::new();
    for group in 0..manifest.groups() as u16 {
        let record = archive.read_column(group).unwrap();
        columns.push(archive.index.decoder.column(group, &record).unwrap());
        let first = pages.len();
        for tile in pyramid.tiles() {
            let parent = pyramid
                .parent(tile)
                .map(|tile| &pages[first + pyramid.tile_index(tile).unwrap() as usize]);
            let page = PageId { group, tile };
            let record = archive.read_page(page).unwrap();
            pages.push(archive.index.decoder.page(page, &record, parent).unwrap());
        }
    }
    (
        hash(columns.iter().flat_map(|column| &column.texels)),
        hash(pages.iter().flat_map(|page| &page.texels)),
    )
}

#[test]
fn version_6_decodes_to_the_same_bits() {
    for fixture in &FIXTURES {
        let archive = Archive::open(fixture.bytes).unwrap();
        let manifest = &archive.index.manifest;
        assert_eq!((manifest.width, manifest.height, manifest.wrap), (75, 40, true));
        assert_eq!((manifest.components, manifest.name.as_str()), (6, "fixture"));
        let found = decode(&archive);
        assert_eq!(
            (archive.index.id, found),
            (fixture.id, (fixture.columns, fixture.pages)),
            "{:?} {:#x} {:#x} {:#x}",
            manifest.codec,
            archive.index.id,
            found.0,
            found.1
        );
    }
}

#[test]
fn every_cut_and_every_flipped_byte_is_found() {
    for Fixture { bytes, .. } in &FIXTURES {
        for length in 0..bytes.len() {
            assert!(
                matches!(read_all(&bytes[..length]), Err(Error::Corrupt { .. })),
                "cut at {length}"
            );
        }
        for extra in [&[0][..], bytes] {
            assert!(matches!(
                read_all(&[bytes, extra].concat()),
                Err(Error::Corrupt { .. })
            ));
        }
        let mut damaged = bytes.to_vec();
        for i in 0..bytes.len() {
            damaged[i] ^= 1 << (i % 8);
            assert!(read_all(&damaged).is_err(), "byte {i}");
            damaged[i] = bytes[i];
        }
        read_all(&damaged).unwrap();
    }
}
