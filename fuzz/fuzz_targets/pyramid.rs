//! Any bytes as the records of an archive of the pyramid codec, under the tables of the fixture: refused, or decoded
//! to finite values.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use tileset::{Archive, PageId};

static FIXTURE: LazyLock<Archive<&'static [u8]>> = LazyLock::new(|| {
    Archive::open(&include_bytes!("../../tileset/tests/fixtures/v6-pyramid-dct.bsvtf")[..]).expect("the fixture is whole")
});

fuzz_target!(|bytes: &[u8]| {
    let index = &FIXTURE.index;
    let finite = |texels: &[[half::f16; 4]]| texels.iter().flatten().all(|value| value.is_finite());
    for group in 0..index.manifest.groups() as u16 {
        if let Ok(column) = index.decoder.column(group, bytes) {
            assert!(finite(&column.texels));
        }
        let mut tile = index.pyramid.root();
        let mut parent = None;
        // From the root down to one of the finest pages, each with the same bytes.
        while let Ok(page) = index.decoder.page(PageId { group, tile }, bytes, parent.as_ref()) {
            assert!(finite(&page.texels));
            parent = Some(page);
            match index.pyramid.children(tile).last() {
                Some(child) => tile = child,
                None => break,
            }
        }
    }
});
