use tileset::{ArchiveWriter, Codec, Column, Factorization, Ledger, Manifest, Tile, codec, codec::MipImage};

use super::store::ENTRY_BYTES;
use super::*;

const MATERIAL: MaterialId = MaterialId(0);

/// An archive of one group and 256² texels, and all pages as the encoder left them.
fn archive() -> (Arc<Btf>, Vec<(PageId, Bytes, Page)>) {
    let up = tileset::Direction { theta: 0.0, phi: 0.0 };
    let manifest = Manifest {
        name: "noise".into(),
        generator: "test".into(),
        width: 256,
        height: 256,
        wrap: true,
        cosine: false,
        views: vec![up],
        lights: vec![up],
        components: 4,
        factorization: Factorization::Fmf,
        codec: Codec::DctDeltaZstd { step: 0.01 },
        texture_scale: 1.0,
        mean_rgb: [0.5; 3],
        singular_values: vec![1.0; 4],
        errors: Ledger::default(),
    };
    let pyramid = manifest.pyramid().unwrap();
    let noise = |at: u32| (at.wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
    let texels = (0..256 * 256)
        .map(|at| std::array::from_fn(|c| noise(at * 4 + c as u32)))
        .collect();
    let mut mips = vec![MipImage {
        width: 256,
        height: 256,
        texels,
    }];
    for _ in 0..pyramid.tail_mip() {
        mips.push(mips[mips.len() - 1].downsample());
    }
    let mut writer = ArchiveWriter::new(manifest.clone()).unwrap();
    let mut pages: Vec<(PageId, Bytes, Page)> = Vec::new();
    for tile in pyramid.tiles() {
        let parent = pyramid.parent(tile).and_then(|parent| pyramid.tile_index(parent));
        let parent = parent.map(|parent| &pages[parent as usize].2);
        let mip = &mips[usize::from(tile.mip)];
        let page = codec::encode_page(manifest.codec, &pyramid, tile, mip, parent).unwrap();
        let id = PageId { group: 0, tile };
        writer.add_page(id, page.bytes.clone(), page.weight).unwrap();
        pages.push((id, page.bytes.into(), page.decoded));
    }
    let column = Column {
        texels: vec![[f16::ONE; 4]; 3],
    };
    writer
        .add_column(0, codec::encode_column(&column).unwrap(), 1.0)
        .unwrap();
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    let index = Index::parse(&bytes[..Index::prefix_bytes(&bytes).unwrap() as usize]).unwrap();
    (Arc::new(Btf::new("noise".into(), index)), pages)
}

#[test]
fn any_page_is_decoded_from_nothing_with_little_room() {
    let (btf, pages) = archive();
    for budget in [PAGE_BYTES / 2, 3 * PAGE_BYTES, 1 << 30] {
        let mut store = HostStore::new(budget);
        for (id, record, wanted) in &pages {
            let mut pending = Pending::new(Item::Page(MATERIAL, *id), record.clone(), false);
            let mut asked = 0;
            let parent = loop {
                match pending.step(&btf.index, &mut store, |_| false).unwrap() {
                    Step::Ready(parent) => break parent,
                    // The record comes, and is used before it is forgotten.
                    Step::Needs(ancestor) => {
                        let (_, record, _) = pages.iter().find(|(id, ..)| *id == ancestor).unwrap();
                        store.put_record(Item::Page(MATERIAL, ancestor), record.clone());
                        asked += 1;
                    }
                    Step::Later => panic!("nobody else decodes"),
                }
            };
            let most = u32::from(btf.pyramid().tail_mip() - id.tile.mip);
            assert!(asked <= most);
            assert!(store.bytes() <= budget);
            let bytes = pending.decoding_bytes(&btf, parent.is_some());
            let above = pending.ancestors().count() as u64;
            assert!(above <= u64::from(most) && bytes >= (1 + above) * PAGE_BYTES);
            let done = pending.job(btf.clone(), parent).run();
            assert_eq!(done.ancestors.len() as u64, above);
            for (ancestor, page) in done.ancestors {
                store.put_page(MATERIAL, ancestor, page);
            }
            let Ok(Decoded::Page(page)) = done.decoded else {
                panic!("{id} is no page")
            };
            assert!(*page == *wanted, "{id}");
        }
    }
}

#[test]
fn what_is_being_decoded_is_waited_for() {
    let (btf, pages) = archive();
    let mut store = HostStore::new(1 << 30);
    for (id, record, _) in &pages {
        store.put_record(Item::Page(MATERIAL, *id), record.clone());
    }
    let root = pages[0].0;
    let (last, record, _) = &pages[pages.len() - 1];
    let mut pending = Pending::new(Item::Page(MATERIAL, *last), record.clone(), false);
    let busy = |item| item == Item::Page(MATERIAL, root);
    assert!(matches!(
        pending.step(&btf.index, &mut store, busy).unwrap(),
        Step::Later
    ));
    store.put_page(MATERIAL, root, Arc::new(pages[0].2.clone()));
    let Step::Ready(parent) = pending.step(&btf.index, &mut store, |_| false).unwrap() else {
        panic!("all records are here")
    };
    assert!(pending.ancestors().all(|page| page != root));
    assert!(pending.job(btf, parent).run().decoded.is_ok());
}

#[test]
fn the_least_recently_used_goes_first_and_reserved_bytes_count() {
    let item = |x| {
        Item::Page(
            MATERIAL,
            PageId {
                group: 0,
                tile: Tile { mip: 0, x, y: 0 },
            },
        )
    };
    let mut store = HostStore::new(3 * (100 + ENTRY_BYTES));
    for x in 0..3 {
        store.put_record(item(x), vec![x as u8; 100].into());
    }
    assert_eq!(store.bytes(), 3 * (100 + ENTRY_BYTES));
    assert!(store.record(item(0)).is_some());
    store.put_record(item(3), vec![3; 100].into());
    assert!(store.record(item(1)).is_none() && store.record(item(0)).is_some());
    // The same again takes no more room.
    store.put_record(item(3), vec![3; 100].into());
    assert_eq!(store.bytes(), 3 * (100 + ENTRY_BYTES));
    store.reserve(100 + ENTRY_BYTES);
    assert!(store.record(item(2)).is_none() && store.record(item(3)).is_some());
    store.reserve(u64::MAX);
    assert_eq!(store.bytes(), 0);
}
