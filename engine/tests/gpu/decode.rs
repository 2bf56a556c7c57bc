//! Pages decoded on the GPU against the decoder of tileset, texel by texel and as pictures.

use engine::{
    frame::Decode,
    gpu::{Caches, Renderer, materials::Btf, page_cache::SLOT_BYTES},
    residency::Slot,
};
use half::f16;
use tileset::{
    Archive, ArchiveWriter, Codec, Column, Page, PageId, SLOT_AREA, SLOT_TEXELS, Tile,
    codec::{MipImage, column_steps, columns::encode_columns, pyramid_dct, tables_bytes},
};

use super::*;
use crate::scene::still_life;

/// The archive of a recipe, coded by [`Codec::PyramidDct`].
fn coded(recipe: &Recipe, step: f64) -> Vec<u8> {
    let manifest = tileset::Manifest {
        codec: Codec::PyramidDct { step },
        ..recipe.manifest()
    };
    let pyramid = manifest.pyramid().unwrap();
    let mips = |group| {
        let mut mips: Vec<MipImage> = vec![recipe.finest(group)];
        while mips.len() <= usize::from(pyramid.tail_mip()) {
            mips.push(mips[mips.len() - 1].downsample());
        }
        mips
    };
    let groups: Vec<_> = (0..recipe.groups).map(mips).collect();
    let mut pages = None;
    for _ in 0..3 {
        let count = |(group, mips): (u16, &Vec<MipImage>)| {
            let of = (group, recipe.groups.into());
            pyramid_dct::count_group(step, &pyramid, of, mips, pages.as_ref()).unwrap()
        };
        let sums = (0..).zip(&groups).map(count).reduce(|mut sums, counted| {
            sums.add(&counted);
            sums
        });
        pages = sums.map(|sums| sums.tables());
    }
    let pages = pages.unwrap();
    let columns: Vec<Column> = (0..recipe.groups).map(|group| recipe.column(group)).collect();
    let samples: Vec<f32> = (0..usize::from(recipe.groups) * 4)
        .flat_map(|component| {
            let texels = columns[component / 4].texels.iter();
            texels.map(move |texel| texel[component % 4].to_f32())
        })
        .collect();
    let steps = column_steps(&manifest);
    let columns = encode_columns(&manifest.views, &manifest.lights, &samples, &steps).unwrap();
    let tables = tables_bytes(&pages, &columns.tables).unwrap();
    let mut writer = ArchiveWriter::with_tables(manifest, tables).unwrap();
    for ((group, mips), column) in (0..).zip(&groups).zip(columns.records) {
        for page in pyramid_dct::code_group(step, &pyramid, group, mips, &pages).unwrap() {
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

/// An archive on the GPU, with room for `slots` pages.
struct Bench<'a> {
    archive: Archive<&'a [u8]>,
    renderer: Renderer,
}

impl<'a> Bench<'a> {
    fn new(bytes: &'a [u8], slots: u64) -> Self {
        let mut renderer = Renderer::new(Context::headless().unwrap(), &Scene::default(), (8, 8)).unwrap();
        let archive = open(bytes);
        let btf = Btf::new("coded".into(), archive.index.clone());
        renderer.add_btf(&btf).unwrap();
        let mut bench = Self { archive, renderer };
        bench.resize(slots, &[]);
        bench.renderer.show_btfs(&[]).unwrap();
        bench
    }

    fn resize(&mut self, slots: u64, moves: &[(Slot, Slot)]) {
        let caches = Caches {
            angular: Default::default(),
            page_format: Default::default(),
            page_bytes: slots * SLOT_BYTES,
            column_bytes: 1 << 20,
        };
        let quads = Btf::new("coded".into(), self.archive.index.clone()).column_quads();
        let layout = self.renderer.layout(caches, quads).unwrap();
        self.renderer.resize_caches(layout, moves, &[]).unwrap();
    }

    fn place(&mut self, page: PageId, slot: u32) {
        let record = self.archive.read_page(page).unwrap();
        let decoder = &self.archive.index.decoder;
        if decoder.has_coefficients(page) {
            let coefficients = decoder.coefficients(page, &record).unwrap();
            self.renderer
                .place_coefficients(0, page, Slot(slot), coefficients)
                .unwrap();
        } else {
            let texels = decoder.page(page, &record, None).unwrap();
            self.renderer.place_page(0, page, Slot(slot), &texels);
        }
    }

    fn cached(&self, page: PageId) -> Page {
        self.renderer.page(0, page).unwrap().unwrap()
    }

    /// What the decoder makes of a page, from the parent that is in the cache.
    fn wanted(&self, page: PageId) -> Page {
        let record = self.archive.read_page(page).unwrap();
        let index = &self.archive.index;
        let parent = index.pyramid.parent(page.tile);
        let parent = parent.map(|tile| self.cached(PageId { tile, ..page }));
        index.decoder.page(page, &record, parent.as_ref()).unwrap()
    }

    /// Compares a page, its payload or all of the slot, with what it should be.
    fn check(&self, page: PageId, with_border: bool) {
        let (found, wanted) = (self.cached(page), self.wanted(page));
        let largest = wanted
            .texels
            .as_flattened()
            .iter()
            .map(|value| value.to_f64().abs());
        let largest = largest.fold(0.0, f64::max);
        let payload = self.archive.index.pyramid.payload(page.tile);
        let inside = |at: u32, side: u32| (4..4 + side).contains(&at);
        let mut differ = 0;
        for at in 0..SLOT_AREA {
            let (x, y) = (at as u32 % SLOT_TEXELS, at as u32 / SLOT_TEXELS);
            let in_payload = inside(x, payload.0) && inside(y, payload.1);
            if !with_border && !in_payload {
                continue;
            }
            for (found, wanted) in found.texels[at].iter().zip(wanted.texels[at]) {
                let (found, wanted) = (found.to_f64(), wanted.to_f64());
                // One unit in the last place, and what sums of f32 leave of the largest.
                let limit = wanted.abs() * f16::EPSILON.to_f64() + largest * 2e-6 + 6e-8;
                assert!(
                    (found - wanted).abs() <= limit,
                    "{page} at {x} {y}: {found}, not {wanted}"
                );
                differ += u32::from(found != wanted);
            }
        }
        // Other roundings are rare.
        assert!(differ * 20 <= SLOT_AREA as u32 * 4, "{page}: {differ} differ");
    }
}

fn page(group: u16, mip: u8, x: u16, y: u16) -> PageId {
    PageId {
        group,
        tile: Tile { mip, x, y },
    }
}

#[test]
fn every_page_is_what_the_decoder_makes_of_it() {
    for (width, height, wrap, step) in [
        (346, 335, true, 0.02),
        (130, 200, false, 0.002),
        (65, 129, false, 0.0001),
        (1, 300, true, 0.01),
        (64, 33, false, 0.5),
    ] {
        let recipe = Recipe {
            width,
            height,
            wrap,
            groups: 2,
            ..Default::default()
        };
        let bytes = coded(&recipe, step);
        let mut bench = Bench::new(&bytes, 120);
        let pyramid = bench.archive.index.pyramid;
        // All mips at once, so that parents are decoded beside their children; more than one round of them.
        let pages: Vec<_> = pyramid
            .tiles()
            .flat_map(|tile| [0, 1].map(|group| PageId { group, tile }))
            .collect();
        (0..)
            .zip(&pages)
            .for_each(|(slot, &page)| bench.place(page, slot));
        let strips = bench.renderer.flush();
        bench.renderer.stitch(&strips);
        for &page in pages.iter().filter(|page| page.tile != pyramid.root()) {
            bench.check(page, false);
        }
    }
}

#[test]
fn borders_are_those_of_the_decoder_until_neighbours_come() {
    let recipe = Recipe {
        width: 300,
        height: 270,
        wrap: false,
        groups: 1,
        ..Default::default()
    };
    let bytes = coded(&recipe, 0.01);
    for (x, y) in [(0, 0), (4, 4), (2, 1), (4, 0)] {
        let mut bench = Bench::new(&bytes, 5);
        let top = bench.archive.index.pyramid.tail_mip();
        let chain: Vec<_> = (0..=top)
            .rev()
            .map(|mip| page(0, mip, x >> mip, y >> mip))
            .collect();
        (0..)
            .zip(&chain)
            .for_each(|(slot, &page)| bench.place(page, slot));
        let strips = bench.renderer.flush();
        assert_eq!(bench.renderer.stitch(&strips), 0);
        chain.iter().for_each(|&page| bench.check(page, true));
    }
}

#[test]
fn what_changes_before_it_is_decoded_is_seen_to() {
    let recipe = Recipe {
        groups: 1,
        ..Default::default()
    };
    let bytes = coded(&recipe, 0.01);
    let mut bench = Bench::new(&bytes, 4);
    let (root, coarse) = (page(0, 3, 0, 0), page(0, 2, 0, 0));
    bench.place(root, 0);
    bench.place(coarse, 1);
    // A page that comes and goes, its slot taken by another, and one that comes twice.
    bench.place(page(0, 1, 0, 0), 2);
    bench.renderer.remove_page(0, page(0, 1, 0, 0));
    bench.place(page(0, 1, 1, 0), 2);
    bench.place(page(0, 1, 0, 1), 3);
    bench.renderer.remove_page(0, page(0, 1, 0, 1));
    bench.place(page(0, 1, 0, 1), 3);
    // Slots move.
    let moves = [(0, 5), (1, 4), (2, 0), (3, 1)].map(|(from, to)| (Slot(from), Slot(to)));
    bench.resize(6, &moves);
    let strips = bench.renderer.flush();
    bench.renderer.stitch(&strips);
    for page in [coarse, page(0, 1, 1, 0), page(0, 1, 0, 1)] {
        bench.check(page, false);
    }
    assert!(bench.renderer.page(0, page(0, 1, 0, 0)).unwrap().is_none());
}

#[cfg(debug_assertions)]
#[test]
#[should_panic(expected = "its parent is not resident")]
fn a_page_without_its_parent_is_a_bug() {
    let recipe = Recipe {
        groups: 1,
        ..Default::default()
    };
    let bytes = coded(&recipe, 0.01);
    let mut bench = Bench::new(&bytes, 4);
    bench.place(page(0, 3, 0, 0), 0);
    bench.place(page(0, 1, 0, 0), 1);
}

#[test]
fn both_ways_settle_to_the_same_picture() {
    let archive = coded(&Recipe::default(), 0.01);
    let (scene, camera) = still_life();
    let settled = |decode_on| {
        let options = Options {
            decode_on,
            ..options((240, 135))
        };
        let mut engine = engine(&scene, &[("weave", &archive)], options);
        let last = *settle(&mut engine, &camera).last().unwrap();
        (engine.picture().unwrap(), last)
    };
    let (on_cpu, cpu) = settled(Decode::Cpu);
    let (on_gpu, gpu) = settled(Decode::Gpu);
    // 100 dB below the picture's own root mean square.
    let error = relative_rmse(&on_gpu, &on_cpu);
    assert!(error > 0.0 && error < 1e-5, "{error}");
    assert_eq!(cpu.pages_resident, gpu.pages_resident);
    // No decoded parents on the host.
    assert!(
        gpu.host_bytes * 4 < cpu.host_bytes,
        "{} {}",
        gpu.host_bytes,
        cpu.host_bytes
    );
}
