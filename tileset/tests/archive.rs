//! Whole archives: written, read back, ordered for streaming, and refused where they are damaged.

mod common;

use common::{archive, column, encode_group, image, manifest, mips, read_all};
use tileset::{
    Archive, ArchiveWriter, Error, Index, Manifest, PageId, Pyramid, ReadAt, Tile,
    archive::{HEADER_BYTES, contents},
    codec::{decode_column, decode_page},
};
use xxhash_rust::xxh3::{xxh3_64, xxh3_64_with_seed};

/// An archive's bytes with the header's checksum made right again after a change.
fn with_header_hash(mut bytes: Vec<u8>) -> Vec<u8> {
    let hash = xxh3_64(&bytes[..56]);
    bytes[56..64].copy_from_slice(&hash.to_le_bytes());
    bytes
}

/// The u32 at an offset.
fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

/// An archive with another manifest of any length; the checksums of header, prefix, and records are right, so that what is said of
/// it comes from the manifest.
fn with_manifest(bytes: &[u8], text: &str) -> Vec<u8> {
    let text = zstd::bulk::compress(text.as_bytes(), 3).unwrap();
    let old = u32_at(bytes, 24);
    let mut changed = [&bytes[..HEADER_BYTES], &text, &bytes[HEADER_BYTES + old..]].concat();
    let prefix = HEADER_BYTES + text.len() + u32_at(bytes, 12) + u32_at(bytes, 28);
    let length = changed.len() as u64;
    changed[16..24].copy_from_slice(&length.to_le_bytes());
    changed[24..28].copy_from_slice(&(text.len() as u32).to_le_bytes());
    let hash = xxh3_64(&changed[HEADER_BYTES..prefix]);
    changed[32..40].copy_from_slice(&hash.to_le_bytes());
    let mut changed = with_header_hash(changed);
    if let Ok(index) = Index::parse(&changed[..prefix]) {
        for record in index.stored() {
            let end = (record.offset + u64::from(record.length)) as usize;
            let checksum = xxh3_64_with_seed(&changed[record.offset as usize..end - 4], index.id as u64);
            changed[end - 4..end].copy_from_slice(&(checksum as u32).to_le_bytes());
        }
    }
    changed
}

#[test]
fn an_archive_gives_back_what_was_written() {
    let manifest = manifest(150, 70, 10, 0.02);
    let bytes = archive(&manifest);
    let archive = Archive::open(bytes.as_slice()).unwrap();
    assert_eq!(archive.index.manifest, manifest);
    let prefix = archive.prefix().unwrap();
    assert_eq!(
        prefix.len() as u64,
        Index::prefix_bytes(&bytes[..HEADER_BYTES]).unwrap()
    );
    assert_eq!(Index::parse(&prefix).unwrap(), archive.index);
    assert_eq!(
        archive.index.id,
        xxhash_rust::xxh3::xxh3_128(&bytes[..prefix.len()])
    );

    let pyramid = archive.index.pyramid;
    for group in 0..manifest.groups() as u16 {
        let record = archive.read_column(group).unwrap();
        assert_eq!(
            decode_column(&manifest, group, &record).unwrap(),
            column(&manifest, group)
        );
        let pages = encode_group(
            manifest.codec,
            &pyramid,
            &mips(image(150, 70, group.into()), &pyramid),
        );
        for (tile, page) in pyramid.tiles().zip(&pages) {
            let id = PageId { group, tile };
            let bytes = archive.read_page(id).unwrap();
            assert_eq!(bytes, page.bytes);
            let weight = f64::from(archive.index.page(id).unwrap().weight);
            assert!((weight - page.weight).abs() <= page.weight / 31.0);
            let parent = pyramid
                .parent(tile)
                .map(|tile| &pages[pyramid.tile_index(tile).unwrap() as usize].decoded);
            assert_eq!(
                decode_page(manifest.codec, &pyramid, id, &bytes, parent).unwrap(),
                page.decoded
            );
        }
    }
    let beyond = PageId {
        group: 3,
        tile: pyramid.root(),
    };
    assert!(matches!(archive.read_page(beyond), Err(Error::NotFound { .. })));
    let beyond = PageId {
        group: 0,
        tile: Tile { mip: 0, x: 3, y: 0 },
    };
    assert!(matches!(archive.read_page(beyond), Err(Error::NotFound { .. })));
    assert!(matches!(archive.read_column(3), Err(Error::NotFound { .. })));
}

#[test]
fn records_of_other_archives_are_refused() {
    let good = manifest(40, 40, 3, 0.1);
    let bytes = archive(&good);
    let here = Archive::open(bytes.as_slice()).unwrap();
    let other = archive(&Manifest {
        name: "jumps".into(),
        ..good.clone()
    });
    let other = Archive::open(other.as_slice()).unwrap();
    for (of, group) in [(&here.index, 0), (&other.index, 0)] {
        let record = of.column(group).unwrap();
        let [own, foreign] = [&here, &other].map(|archive| archive.column_record(group).unwrap());
        assert_eq!(contents(&own), contents(&foreign), "only the checksums differ");
        assert_eq!(of.verify("column", record, &own).is_ok(), of.id == here.index.id);
        assert_eq!(
            of.verify("column", record, &foreign).is_ok(),
            of.id == other.index.id
        );
    }
    let page = PageId {
        group: 0,
        tile: good.pyramid().unwrap().root(),
    };
    let record = here.page_record(page).unwrap();
    assert_eq!(record.len(), here.index.page(page).unwrap().length as usize);
    assert_eq!(contents(&record), here.read_page(page).unwrap());
}

/// What passes all checksums of records, as one damaged record of 4 billion does, is found by that of all contents.
#[test]
fn the_contents_as_a_whole_are_checked() {
    let mut bytes = archive(&manifest(40, 40, 3, 0.1));
    Archive::open(bytes.as_slice()).unwrap().check().unwrap();
    let index = Archive::open(bytes.as_slice()).unwrap().index;
    let record = index.stored()[1];
    let (start, end) = (
        record.offset as usize,
        record.offset as usize + record.length as usize,
    );
    bytes[start] ^= 1;
    assert!(Archive::open(bytes.as_slice()).unwrap().check().is_err());
    let checksum = xxh3_64_with_seed(&bytes[start..end - 4], index.id as u64) as u32;
    bytes[end - 4..end].copy_from_slice(&checksum.to_le_bytes());
    read_all(&bytes).unwrap();
    let error = Archive::open(bytes.as_slice()).unwrap().check().unwrap_err();
    assert!(error.to_string().contains("of all of them together"), "{error}");
}

#[test]
fn slices_vectors_and_files_read_alike() {
    let bytes = archive(&manifest(40, 40, 3, 0.1));
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("small.bsvtf");
    std::fs::write(&path, &bytes).unwrap();
    let file = std::fs::File::open(&path).unwrap();
    fn middle(reader: impl ReadAt) -> (u64, Vec<u8>) {
        let mut buffer = vec![0; 30];
        reader.read_exact_at(100, &mut buffer).unwrap();
        let mut more = [0; 30];
        assert!(
            reader
                .read_exact_at(reader.len().unwrap() - 29, &mut more)
                .is_err()
        );
        assert!(reader.read_exact_at(u64::MAX - 3, &mut more).is_err());
        (reader.len().unwrap(), buffer)
    }
    let wanted = (bytes.len() as u64, bytes[100..130].to_vec());
    assert_eq!(middle(bytes.as_slice()), wanted);
    assert_eq!(middle(&file), wanted);
    assert_eq!(middle(bytes.clone()), wanted);
    assert_eq!(
        Archive::open(file).unwrap().index,
        Archive::open(bytes).unwrap().index
    );
}

#[test]
fn records_stand_in_streaming_order() {
    let manifest = manifest(300, 200, 8, 0.02);
    let bytes = archive(&manifest);
    let index = Archive::open(bytes.as_slice()).unwrap().index;
    let pyramid = index.pyramid;
    let mut end = Index::prefix_bytes(&bytes).unwrap();
    let mut records: Vec<_> = index
        .columns()
        .iter()
        .chain(index.pages())
        .filter(|r| r.length > 0)
        .collect();
    records.sort_by_key(|record| record.offset);
    for record in records {
        assert_eq!(record.offset, end, "records follow each other without gaps");
        end += u64::from(record.length);
    }
    assert_eq!(end, bytes.len() as u64);

    for group in 0..2 {
        let place = |tile| index.page(PageId { group, tile }).unwrap();
        assert!(index.column(group).unwrap().offset < place(pyramid.root()).offset);
        for tile in pyramid.tiles().filter(|tile| place(*tile).length > 0) {
            let mut ancestor = pyramid.parent(tile);
            while let Some(parent) = ancestor {
                assert!(place(parent).length == 0 || place(parent).offset < place(tile).offset);
                ancestor = pyramid.parent(parent);
            }
        }
        // All of these have the same parent, hence all are allowed at the same time: the best per byte
        // comes first.
        let gain = |tile: Tile| {
            let ((width, height), record) = (pyramid.payload(tile), place(tile));
            f64::from(width * height) * f64::from(record.weight) / f64::from(record.length)
        };
        for parent in pyramid.tiles() {
            let mut siblings: Vec<_> = pyramid
                .children(parent)
                .filter(|tile| place(*tile).length > 0)
                .collect();
            siblings.sort_by_key(|tile| place(*tile).offset);
            assert!(siblings.is_sorted_by(|a, b| gain(*a) >= gain(*b) * (1.0 - 1e-6)));
        }
    }
}

#[test]
fn the_writer_wants_every_record_once() {
    let manifest = manifest(40, 40, 4, 0.1);
    let root = PageId {
        group: 0,
        tile: manifest.pyramid().unwrap().root(),
    };
    let fine = PageId {
        group: 0,
        tile: Tile { mip: 0, x: 0, y: 0 },
    };
    let mut writer = ArchiveWriter::new(manifest.clone()).unwrap();
    let mut sink = Vec::new();
    writer.add_page(root, vec![1], 1.0).unwrap();
    assert!(matches!(
        writer.add_page(root, vec![1], 1.0),
        Err(Error::Invalid { .. })
    ));
    assert!(matches!(
        writer.add_page(fine, vec![1], f64::NAN),
        Err(Error::Invalid { .. })
    ));
    assert!(matches!(
        writer.add_page(fine, vec![1], -1.0),
        Err(Error::Invalid { .. })
    ));
    assert!(matches!(
        writer.add_page(fine, vec![0; 1 << 20], 1.0),
        Err(Error::OverLimit { .. })
    ));
    assert!(matches!(
        writer.add_page(PageId { group: 1, ..root }, vec![1], 1.0),
        Err(Error::NotFound { .. })
    ));
    assert!(matches!(
        writer.add_column(1, vec![1], 1.0),
        Err(Error::NotFound { .. })
    ));
    assert!(matches!(
        writer.add_column(0, vec![], 1.0),
        Err(Error::Invalid { .. })
    ));
    let error = writer.write(&mut sink).unwrap_err();
    assert!(error.to_string().contains("column of group 0"), "{error}");

    let mut writer = ArchiveWriter::new(manifest).unwrap();
    writer.add_column(0, vec![1], 1.0).unwrap();
    writer.add_page(root, vec![], 0.0).unwrap();
    let error = writer.write(&mut sink).unwrap_err();
    assert!(
        error.to_string().contains("page group 0 mip 0 x 0 y 0"),
        "{error}"
    );
    assert!(sink.is_empty());
}

#[test]
fn other_files_are_not_taken_for_archives() {
    for bytes in [&b""[..], b"GIF89a", &[0; 1000], b"\x89PNG\r\n\x1a\n"] {
        let error = read_all(bytes).unwrap_err();
        assert!(matches!(error, Error::Corrupt { .. }), "{error}");
        assert!(error.to_string().starts_with("header at byte 0"), "{error}");
    }
}

#[test]
fn other_versions_are_named() {
    for version in [0, 1, 2, 5, 7] {
        let mut bytes = archive(&manifest(8, 8, 1, 0.2));
        bytes[8] = version;
        let error = read_all(&with_header_hash(bytes)).unwrap_err();
        assert!(
            matches!(error, Error::UnsupportedVersion { found, supported: 6 } if found == u32::from(version))
        );
    }
}

#[test]
fn absurd_sizes_in_the_header_are_refused() {
    let bytes = archive(&manifest(8, 8, 1, 0.2));
    for (at, value) in [
        (12, u32::MAX),
        (12, 1),
        (16, 0),
        (20, u32::MAX),
        (24, u32::MAX),
        (24, 1 << 21),
        (24, 5),
        (28, u32::MAX),
        (28, 1 << 26),
        (28, 1),
    ] {
        let mut damaged = bytes.clone();
        damaged[at..at + 4].copy_from_slice(&value.to_le_bytes());
        let error = read_all(&with_header_hash(damaged)).unwrap_err();
        assert!(
            matches!(error, Error::Corrupt { .. } | Error::OverLimit { .. }),
            "{at} {value}: {error}"
        );
    }
}

#[test]
fn absurd_manifests_are_refused() {
    let good = manifest(8, 8, 4, 0.2);
    let bytes = archive(&good);
    let text = serde_json::to_string(&good).unwrap();
    assert!(read_all(&with_manifest(&bytes, &text)).is_ok());
    for (from, to) in [
        ("\"width\":8", "\"width\":0"),
        ("\"width\":8", "\"width\":-8"),
        ("\"width\":8", "\"width\":4294967295"),
        ("\"width\":8", "\"width\":65536"),
        ("\"width\":8", "\"width\":72"),
        ("\"components\":4", "\"components\":0"),
        ("\"components\":4", "\"components\":4000000000"),
        ("\"components\":4", "\"components\":8"),
        ("\"views\":[", "\"views\":[],\"x\":["),
        ("\"step\":0.2", "\"step\":0"),
        ("\"step\":0.2", "\"step\":1e999"),
        ("\"step\":0.2", "\"step\":null"),
        ("\"texture_scale\":1.0", "\"texture_scale\":3.0"),
        ("dct-delta-zstd", "something-else"),
        ("\"fmf\"", "\"magic\""),
        ("{\"name\"", "{\"name\":\"twice\",\"name\""),
        ("{\"name\"", "[{\"name\""),
    ] {
        let changed = text.replacen(from, to, 1);
        assert_ne!(changed, text, "{from}");
        let error = read_all(&with_manifest(&bytes, &changed)).unwrap_err();
        let refused = matches!(
            error,
            Error::Corrupt { .. } | Error::Invalid { .. } | Error::OverLimit { .. }
        );
        assert!(refused, "{to}: {error}");
    }
    let deep = "[".repeat(500_000);
    assert!(matches!(
        read_all(&with_manifest(&bytes, &deep)),
        Err(Error::Corrupt { .. })
    ));
}

#[test]
fn manifests_come_back_exactly() {
    let mut wanted = manifest(8, 8, 1, 0.2);
    wanted.mean_rgb = [0.1 + 0.2, f64::MIN_POSITIVE, 1.0 / 3.0];
    wanted.errors.rank_rms = 2.225_073_858_507_201e-308;
    wanted.singular_values = vec![0.123_456_789_012_345_68];
    wanted.name = "wool \"knitted\" \u{1f9f6}\n".into();
    assert_eq!(Archive::open(archive(&wanted)).unwrap().index.manifest, wanted);
    let Manifest { singular_values, .. } = Archive::open(archive(&wanted)).unwrap().index.manifest;
    assert_eq!(singular_values[0].to_bits(), wanted.singular_values[0].to_bits());
}

#[test]
fn the_pyramid_of_an_index_is_the_manifests() {
    let index = Archive::open(archive(&manifest(40, 33, 3, 0.2))).unwrap().index;
    assert_eq!(index.pyramid, Pyramid::new(40, 33, true).unwrap());
    assert_eq!(index.pages().len(), 2);
    assert_eq!(index.columns().len(), 1);
}
