//! Borders in the page cache, read back: the payloads of the neighbours that were there, and nothing else.

use std::collections::BTreeMap;

use engine::{
    gpu::{
        Caches, Renderer,
        borders::{MOST_INTO, MOST_OUT},
        materials::Btf,
        page_cache::SLOT_BYTES,
    },
    residency::Slot,
};
use half::f16;
use tileset::{ArchiveWriter, BORDER_TEXELS, PAGE_TEXELS, Page, PageId, Pyramid, SLOT_AREA, SLOT_TEXELS};

use super::*;
use crate::scene::still_life;

type Texel = [f16; 4];

/// Numbers that look like chance.
fn scramble(parts: &[u64]) -> u64 {
    parts.iter().fold(0x9e37_79b9_7f4a_7c15, |state, part| {
        let mixed = (state ^ part).wrapping_mul(0xff51_afd7_ed55_8ccd);
        (mixed ^ mixed >> 29).wrapping_mul(0xc4ce_b9fe_1a85_ec53)
    }) >> 8
}

/// Four half floats of either sign, neither subnormal (an adapter may take those for zero) nor infinite.
fn texel(parts: &[u64]) -> Texel {
    std::array::from_fn(|component| {
        let bits = scramble(&[parts, &[component as u64]].concat());
        let exponent = 1 + (bits >> 16) % 30;
        f16::from_bits((bits as u16 & 0x83ff) | (exponent as u16) << 10)
    })
}

/// A BTF whose pages nobody decodes.
fn btf(width: u32, height: u32, wrap: bool, groups: u16) -> Btf {
    let recipe = Recipe {
        width,
        height,
        wrap,
        groups,
        ..Default::default()
    };
    let mut writer = ArchiveWriter::new(recipe.manifest()).unwrap();
    for group in 0..groups {
        writer.add_column(group, vec![0; 4], 1.0).unwrap();
        for tile in recipe.manifest().pyramid().unwrap().tiles() {
            writer.add_page(PageId { group, tile }, Vec::new(), 0.0).unwrap();
        }
    }
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    Btf::new("borders".into(), open(&bytes).index)
}

/// The cache as it should be.
struct Model {
    btfs: Vec<Btf>,
    renderer: Renderer,
    slots: BTreeMap<(usize, PageId), (Slot, Vec<Texel>)>,
    steps: u64,
    placed: u64,
}

impl Model {
    fn new(btfs: Vec<Btf>, slots: u64) -> Self {
        let mut renderer = Renderer::new(Context::headless().unwrap(), &Scene::default(), (8, 8)).unwrap();
        let caches = Caches {
            page_format: Default::default(),
            page_bytes: slots * SLOT_BYTES,
            column_bytes: 1 << 20,
            angular: Default::default(),
        };
        for btf in &btfs {
            renderer.add_btf(btf).unwrap();
        }
        let column_quads = btfs.iter().map(Btf::column_quads).max().unwrap();
        let layout = renderer.layout(caches, column_quads).unwrap();
        renderer.resize_caches(layout, &[], &[]).unwrap();
        renderer.show_btfs(&[]).unwrap();
        assert_eq!(u64::from(renderer.slots().0), slots);
        Self {
            btfs,
            renderer,
            slots: BTreeMap::new(),
            steps: 0,
            placed: 0,
        }
    }

    fn pyramid(&self, btf: usize) -> Pyramid {
        *self.btfs[btf].pyramid()
    }

    /// All pages of all BTFs.
    fn pages(&self) -> Vec<(usize, PageId)> {
        let mut pages = Vec::new();
        for (btf, of) in self.btfs.iter().enumerate() {
            for group in 0..of.groups() {
                pages.extend(of.pyramid().tiles().map(|tile| (btf, PageId { group, tile })));
            }
        }
        pages
    }

    /// A number below `below` that looks like chance.
    fn chance(&mut self, below: usize) -> usize {
        self.steps += 1;
        scramble(&[self.steps, 77]) as usize % below
    }

    /// What the archive has at a texel of a mip.
    fn payload(btf: usize, page: PageId, x: u32, y: u32) -> Texel {
        texel(&[
            btf as u64,
            page.group.into(),
            page.tile.mip.into(),
            x.into(),
            y.into(),
        ])
    }

    /// Where a texel of the slot lies: `None` in the payload, else the mip's texel that is seen there.
    fn seen(pyramid: &Pyramid, page: PageId, x: u32, y: u32) -> Option<(u32, u32)> {
        let (width, height) = pyramid.mip_size(page.tile.mip);
        let along = |tile: u16, at: u32, side: u32| {
            let position = i64::from(tile) * 64 + i64::from(at) - 4;
            if pyramid.wrap() {
                position.rem_euclid(side.into()) as u32
            } else {
                position.clamp(0, i64::from(side) - 1) as u32
            }
        };
        let payload = pyramid.payload(page.tile);
        let inside = |at: u32, side: u32| (BORDER_TEXELS..BORDER_TEXELS + side).contains(&at);
        (!inside(x, payload.0) || !inside(y, payload.1))
            .then(|| (along(page.tile.x, x, width), along(page.tile.y, y, height)))
    }

    /// A page as a decoder might hand it over: right payload, any border.
    fn decoded(&mut self, btf: usize, page: PageId) -> Page {
        self.steps += 1;
        let (pyramid, guess) = (self.pyramid(btf), self.steps);
        let (width, height) = pyramid.payload(page.tile);
        let texels = (0..SLOT_AREA as u32).map(|at| {
            let (x, y) = (at % SLOT_TEXELS, at / SLOT_TEXELS);
            if x >= width + 2 * BORDER_TEXELS || y >= height + 2 * BORDER_TEXELS {
                [f16::ZERO; 4]
            } else if page.tile == pyramid.root() || Self::seen(&pyramid, page, x, y).is_some() {
                texel(&[guess, 1 << 40, at.into()])
            } else {
                let (left, top) = (u32::from(page.tile.x) * 64, u32::from(page.tile.y) * 64);
                Self::payload(btf, page, left + x - BORDER_TEXELS, top + y - BORDER_TEXELS)
            }
        });
        Page {
            texels: texels.collect(),
        }
    }

    fn place(&mut self, btf: usize, page: PageId, slot: Slot) {
        let decoded = self.decoded(btf, page);
        self.renderer.place_page(btf, page, slot, &decoded);
        self.slots.insert((btf, page), (slot, decoded.texels));
        self.placed += 1;
    }

    fn remove(&mut self, btf: usize, page: PageId) -> Slot {
        self.renderer.remove_page(btf, page);
        self.slots.remove(&(btf, page)).unwrap().0
    }

    /// Places a page in a free slot, or in one that it takes from another page.
    fn arrive(&mut self, btf: usize, page: PageId) {
        if self.slots.contains_key(&(btf, page)) {
            return;
        }
        let mut free = (0..self.renderer.slots().0).map(Slot);
        let slot = match free.find(|free| self.slots.values().all(|(slot, _)| slot != free)) {
            Some(slot) => slot,
            None => {
                let victim = self.chance(self.slots.len());
                let (btf, page) = *self.slots.keys().nth(victim).unwrap();
                self.remove(btf, page)
            }
        };
        self.place(btf, page, slot);
    }

    /// Lets the renderer stitch, and compares every texel of every resident page. Returns how many border texels
    /// show a neighbour and how many a guess.
    fn check(&mut self) -> (u64, u64) {
        let strips = self.renderer.flush();
        let stitched = self.renderer.stitch(&strips);
        assert!(
            stitched <= self.placed * u64::from(MOST_INTO + MOST_OUT),
            "{stitched} texels for {} pages",
            self.placed
        );
        self.placed = 0;
        let (mut exact, mut guessed) = (0, 0);
        for (btf, page) in self.slots.keys().copied().collect::<Vec<_>>() {
            let pyramid = self.pyramid(btf);
            for at in (0..SLOT_AREA as u32).filter(|_| page.tile != pyramid.root()) {
                let (x, y) = (at % SLOT_TEXELS, at / SLOT_TEXELS);
                let (width, height) = pyramid.payload(page.tile);
                if x >= width + 2 * BORDER_TEXELS || y >= height + 2 * BORDER_TEXELS {
                    continue;
                }
                let Some((x, y)) = Self::seen(&pyramid, page, x, y) else {
                    continue;
                };
                let mut source = page;
                (source.tile.x, source.tile.y) = ((x / PAGE_TEXELS) as u16, (y / PAGE_TEXELS) as u16);
                if (pyramid.wrap() || source != page) && self.slots.contains_key(&(btf, source)) {
                    let texels = &mut self.slots.get_mut(&(btf, page)).unwrap().1;
                    texels[at as usize] = Self::payload(btf, page, x, y);
                    exact += 1;
                } else {
                    guessed += 1;
                }
            }
            let found = self.renderer.page(btf, page).unwrap().unwrap().texels;
            let wanted = &self.slots[&(btf, page)].1;
            // Only what a page makes use of is brought to its slot.
            let (width, height) = if page.tile == pyramid.root() {
                (PAGE_TEXELS, PAGE_TEXELS)
            } else {
                pyramid.payload(page.tile)
            };
            let used = |at: &usize| {
                let (x, y) = (*at as u32 % SLOT_TEXELS, *at as u32 / SLOT_TEXELS);
                x < width + 2 * BORDER_TEXELS && y < height + 2 * BORDER_TEXELS
            };
            let mut all = (0..SLOT_AREA).filter(used);
            let wrong = all.find(|&at| found[at].map(f16::to_bits) != wanted[at].map(f16::to_bits));
            assert_eq!(wrong, None, "btf {btf} {page}: slot texel, {pyramid:?}");
        }
        (exact, guessed)
    }
}

#[test]
fn with_all_pages_there_every_border_is_exact() {
    let sizes = [
        (346, 335),
        (65, 66),
        (129, 64),
        (66, 200),
        (1, 1000),
        (64, 64),
        (32, 32),
    ];
    for wrap in [true, false] {
        let btfs = sizes.map(|(width, height)| btf(width, height, wrap, 1));
        let mut model = Model::new(btfs.into(), 120);
        let mut pages = model.pages();
        let mut guessed = u64::MAX;
        while !pages.is_empty() {
            // In any order, few or many in a frame.
            for _ in 0..1 + model.chance(25) {
                if !pages.is_empty() {
                    let at = model.chance(pages.len());
                    let (btf, page) = pages.swap_remove(at);
                    model.arrive(btf, page);
                }
            }
            guessed = model.check().1;
        }
        // What repeats the edge of a clamped mip is the decoder's.
        assert_eq!(guessed == 0, wrap, "{guessed}");
        // Nothing new, nothing to do.
        assert!(model.renderer.flush().is_empty());
    }
}

#[test]
fn slots_change_hands_and_no_page_shows_another_ones_neighbour() {
    // 17 slots lie in 17 layers, 16 in one; two materials and groups share them.
    for slots in [16, 17] {
        let btfs = vec![btf(200, 130, true, 2), btf(150, 65, false, 1)];
        let mut model = Model::new(btfs, slots);
        let pages = model.pages();
        let (mut exact, mut guessed) = (0, 0);
        for _ in 0..40 {
            for _ in 0..model.chance(9) {
                let (btf, page) = pages[model.chance(pages.len())];
                model.arrive(btf, page);
            }
            let checked = model.check();
            (exact, guessed) = (exact + checked.0, guessed + checked.1);
        }
        assert!(exact > 1000 && guessed > 1000, "{exact} {guessed}");
    }
}

#[test]
fn a_border_is_a_guess_until_the_neighbour_comes_and_stays_when_it_goes() {
    let mut model = Model::new(vec![btf(128, 64, true, 1)], 3);
    let page = |x| PageId {
        group: 0,
        tile: tileset::Tile { mip: 0, x, y: 0 },
    };
    model.place(0, page(0), Slot(0));
    // Above and below the page meets itself.
    let alone = (64 * 8, 72 * 72 - 64 * 64 - 64 * 8);
    assert_eq!(model.check(), alone);
    model.place(0, page(1), Slot(2));
    let whole = u64::from(MOST_INTO);
    assert_eq!(model.check(), (2 * whole, 0));
    let before = model.renderer.page(0, page(0)).unwrap();
    model.remove(0, page(1));
    model.check();
    assert!(model.renderer.page(0, page(0)).unwrap() == before);
    assert_eq!(model.renderer.page(0, page(1)).unwrap(), None);
    // In and out again within a frame.
    model.place(0, page(1), Slot(1));
    model.remove(0, page(1));
    model.place(0, page(1), Slot(2));
    assert_eq!(model.check(), (2 * whole, 0));
}

#[test]
fn frames_count_what_they_stitch() {
    let archive = Recipe::default().build();
    let (scene, camera) = still_life();
    let few = Options {
        budgets: Budgets {
            uploads_per_frame: 7,
            ..options((160, 90)).budgets
        },
        ..options((160, 90))
    };
    let mut engine = engine(&scene, &[("weave", &archive)], few);
    let frames = settle(&mut engine, &camera);
    for frame in &frames {
        let placed = u64::from(frame.added + frame.swapped);
        assert!(
            frame.texels_stitched <= placed * u64::from(MOST_INTO + MOST_OUT),
            "{frame:?}"
        );
    }
    assert!(frames.iter().map(|frame| frame.texels_stitched).sum::<u64>() > u64::from(MOST_INTO));
    assert_eq!(engine.frame(&camera).unwrap().texels_stitched, 0);
}
