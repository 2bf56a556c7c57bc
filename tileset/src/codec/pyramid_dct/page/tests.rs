use std::collections::HashMap;

use half::f16;
use proptest::prelude::*;

use super::decode::{Payload, parent_of};
use super::*;
use crate::codec::MipImage;
use crate::codec::pyramid_dct::dispatch::{self, Any, Work};
use crate::codec::pyramid_dct::tables::{PageTables, Statistics};
use crate::codec::rans::Model;
use crate::{PAGE_TEXELS, Page, PageId, Result, SLOT_AREA, SLOT_TEXELS};

/// A group's pages, and what they decode with.
pub(super) struct Coded {
    pub(super) step: f64,
    pub(super) pyramid: Pyramid,
    mips: Vec<MipImage>,
    pub(super) tables: PageTables,
    pub(super) pages: Vec<CodedPage>,
}

/// A picture of waves and noise, with some values far larger than the rest, coded.
pub(super) fn coded(width: u32, height: u32, step: f64, seed: u32) -> Coded {
    repeated(width, height, (width, height), step, seed)
}

/// The same, cut to this size and repeated.
pub(super) fn repeated(width: u32, height: u32, (across, down): (u32, u32), step: f64, seed: u32) -> Coded {
    let pyramid = Pyramid::new(width, height, false).unwrap();
    let mut state = seed;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32 - 0.5
    };
    let texels = (0..across * down).map(|i| {
        let wave = ((i % across) as f32 * 0.07).sin() + ((i / across) as f32 * 0.31).cos();
        let peak = if i % 997 == 0 { 900.0 } else { 1.0 };
        [
            wave,
            wave * 0.3 + noise(),
            noise() * peak,
            if i % 5 == 0 { noise() } else { 0.0 },
        ]
    });
    let one: Vec<[f32; 4]> = texels.collect();
    let texels = (0..width * height).map(|i| one[(i / width % down * across + i % width % across) as usize]);
    let mut mips = vec![MipImage {
        width,
        height,
        texels: texels.collect(),
    }];
    for mip in 0..usize::from(pyramid.tail_mip()) {
        mips.push(mips[mip].downsample());
    }
    let mut tables = None;
    for _ in 0..3 {
        let statistics = count_group(step, &pyramid, (0, 1), &mips, tables.as_ref()).unwrap();
        tables = Some(statistics.tables());
    }
    let tables = tables.unwrap();
    let pages = code_group(step, &pyramid, 0, &mips, &tables).unwrap();
    Coded {
        step,
        pyramid,
        mips,
        tables,
        pages,
    }
}

impl Coded {
    /// The payload alone, with or without the best of the processor.
    fn payload(
        &self,
        tile: Tile,
        bytes: &[u8],
        parent: Option<&Page>,
        best: bool,
    ) -> std::result::Result<Page, String> {
        let parent = parent_of(&self.pyramid, tile, parent).unwrap();
        let page = PageId { group: 0, tile };
        let mut texels = vec![[f16::ZERO; 4]; SLOT_AREA];
        let payload = Payload::new(
            self.step,
            &self.pyramid,
            page,
            bytes,
            parent,
            &self.tables,
            &mut texels,
        );
        let payload = payload.map_err(|error| error.to_string())?;
        if best {
            dispatch::run(payload)
        } else {
            payload.run(Any)
        }?;
        Ok(Page { texels })
    }

    pub(super) fn decode(&self, tile: Tile, bytes: &[u8], parent: Option<&Page>) -> Result<Page> {
        let mut page = Page { texels: Vec::new() };
        self.decode_into(tile, bytes, parent, &mut page)?;
        Ok(page)
    }

    fn decode_into(&self, tile: Tile, bytes: &[u8], parent: Option<&Page>, page: &mut Page) -> Result<()> {
        let id = PageId { group: 0, tile };
        decode_into(self.step, &self.pyramid, id, bytes, parent, &self.tables, page)
    }

    pub(super) fn decode_all(&self) -> HashMap<Tile, Page> {
        let mut decoded = HashMap::new();
        for page in &self.pages {
            let parent = self.pyramid.parent(page.tile).map(|parent| &decoded[&parent]);
            let page_texels = self.decode(page.tile, &page.bytes, parent).unwrap();
            decoded.insert(page.tile, page_texels);
        }
        decoded
    }
}

#[test]
fn errors_are_those_of_the_step() {
    for (width, height, tile) in [
        (128, 128, None),
        (150, 77, None),
        (33, 200, None),
        (5, 3, None),
        (128, 128, Some((16, 32))),
        (100, 200, Some((32, 16))),
    ] {
        let coded = repeated(width, height, tile.unwrap_or((width, height)), 0.05, 1);
        assert!(tile.is_none() || coded.tables.has_sources());
        let decoded = coded.decode_all();
        let (mut sum, mut count) = (0.0, 0);
        for (tile, page) in decoded.iter().filter(|(tile, _)| tile.mip == 0) {
            let (wide, high) = coded.pyramid.payload(*tile);
            let origin = coded.pyramid.payload_origin(*tile, 0);
            for (x, y) in (0..high).flat_map(|y| (0..wide).map(move |x| (x, y))) {
                let found = page.texels[((origin.1 + y) * SLOT_TEXELS + origin.0 + x) as usize];
                let (mip_x, mip_y) = (
                    u32::from(tile.x) * PAGE_TEXELS + x,
                    u32::from(tile.y) * PAGE_TEXELS + y,
                );
                let wanted = coded.mips[0].texels[(mip_y * width + mip_x) as usize];
                for c in [0, 1, 3] {
                    sum += (f64::from(found[c].to_f32()) - f64::from(wanted[c])).powi(2);
                    count += 1;
                }
            }
        }
        let error = (sum / f64::from(count)).sqrt();
        // That of rounding is step/√12; the search for few bits may double its square, and half floats add a little.
        assert!(
            error < 0.05 / 12f64.sqrt() * 1.5 + 1e-3,
            "{width}x{height}: {error}"
        );
    }
}

#[test]
fn what_was_in_the_slot_does_not_matter() {
    for (width, height) in [(128, 64), (150, 77), (33, 200), (5, 3)] {
        let coded = coded(width, height, 0.05, 5);
        let decoded = coded.decode_all();
        for page in &coded.pages {
            let parent = coded.pyramid.parent(page.tile).map(|parent| &decoded[&parent]);
            for length in [0, 7, SLOT_AREA] {
                let mut found = Page {
                    texels: vec![[f16::NAN; 4]; length],
                };
                coded
                    .decode_into(page.tile, &page.bytes, parent, &mut found)
                    .unwrap();
                assert!(
                    found == decoded[&page.tile],
                    "{width}x{height} {:?} {length}",
                    page.tile
                );
            }
        }
    }
}

#[test]
fn what_repeats_takes_few_bytes() {
    let bytes = |coded: &Coded| coded.pages.iter().map(|page| page.bytes.len()).sum::<usize>();
    let (noise, tiles) = (coded(256, 128, 0.05, 1), repeated(256, 128, (32, 64), 0.05, 1));
    let (noise_bytes, tiles_bytes) = (bytes(&noise), bytes(&tiles));
    assert!(
        2 * tiles_bytes < noise_bytes,
        "{tiles_bytes} of {noise_bytes} bytes"
    );
}

#[test]
fn sources_outside_the_page_are_an_error() {
    // Blocks of (48, 64) and, at the end of each row of blocks, of (2, 64) texels.
    let mut coded = repeated(50, 128, (16, 16), 0.05, 1);
    let decoded = coded.decode_all();
    let page = coded
        .pages
        .iter()
        .find(|page| page.tile.mip == 0)
        .unwrap()
        .clone();
    let parent = coded.pyramid.parent(page.tile).map(|parent| &decoded[&parent]);
    assert!(coded.tables.has_sources());
    // With the models of another archive, streams say anything.
    let mut said = Vec::new();
    for shift in 1..16 {
        let counts = std::array::from_fn::<u32, 16, _>(|source| if source == shift { 1000 } else { 1 });
        coded.tables.sources = vec![Model::from_counts(&counts); 2];
        if let Err(error) = coded.decode(page.tile, &page.bytes, parent) {
            said.push(error.to_string());
        }
    }
    assert!(said.iter().any(|said| said.contains("before it")), "{said:?}");
}

#[test]
fn missing_models_are_an_error() {
    let coded = coded(64, 64, 0.1, 3);
    let untrained = Statistics::new(&coded.pyramid, 1, false).tables();
    let root = PageId {
        group: 0,
        tile: coded.pyramid.root(),
    };
    let (bytes, mut page) = (&coded.pages[0].bytes, Page { texels: Vec::new() });
    assert!(decode_into(0.1, &coded.pyramid, root, bytes, None, &untrained, &mut page).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn every_processor_decodes_the_same_bits(
        width in 1u32..180, height in 1u32..100, tile in 1u32..5, log_step in -9f64..1.0, seed: u32,
    ) {
        let coded = repeated(width, height, (16 * tile, 16), log_step.exp2(), seed);
        let decoded = coded.decode_all();
        for page in &coded.pages {
            let parent = coded.pyramid.parent(page.tile).map(|parent| &decoded[&parent]);
            for bytes in [&page.bytes[..], &[]] {
                let best = coded.payload(page.tile, bytes, parent, true).unwrap();
                let any = coded.payload(page.tile, bytes, parent, false).unwrap();
                let bits = |page: &Page| page.texels.as_flattened().iter().map(|value| value.to_bits()).collect::<Vec<_>>();
                prop_assert_eq!(bits(&best), bits(&any));
            }
        }
    }

    #[test]
    fn damage_is_no_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
        noise in prop::collection::vec(any::<u8>(), 0..600),
        cut: prop::sample::Index,
        log_step in -9f64..100.0,
        tile in prop::sample::select(vec![(100, 70), (16, 32)]),
    ) {
        let mut coded = repeated(100, 70, tile, 0.02, 7);
        let decoded = coded.decode_all();
        coded.step = log_step.exp2();
        for page in &coded.pages {
            let parent = coded.pyramid.parent(page.tile).map(|parent| &decoded[&parent]);
            let mut bytes = page.bytes.clone();
            for (index, value) in damage.iter().filter(|_| !page.bytes.is_empty()) {
                let place = index.index(bytes.len());
                bytes[place] ^= value;
            }
            let short = if bytes.is_empty() { 0 } else { cut.index(bytes.len()) };
            for bytes in [&bytes[..], &noise, &page.bytes[..short]] {
                let best = coded.payload(page.tile, bytes, parent, true);
                let any = coded.payload(page.tile, bytes, parent, false);
                prop_assert_eq!(best.is_ok(), any.is_ok());
                if let (Ok(best), Ok(any)) = (best, any) {
                    let texels = best.texels.as_flattened().iter().zip(any.texels.as_flattened());
                    prop_assert!(texels.clone().all(|(a, b)| a.to_bits() == b.to_bits() && a.is_finite()));
                }
                let _ = coded.decode(page.tile, bytes, parent);
            }
        }
    }
}
