//! Overlays against what the tables say at each pixel.

use std::collections::HashMap;

use engine::{
    Overlay,
    gpu::cutoff::groups_that_matter,
    reference::{Placed, Rays},
};
use glam::DVec2;
use tileset::{PageId, Tile, archive::Index};

use super::*;
use crate::{
    material::weave,
    scene::{btf, still_life},
};

const SIZE: (u32, u32) = (160, 90);
const COMPONENT_ERROR: f64 = 0.08;

/// What an engine has of its only archive.
struct Known {
    index: Index,
    /// Ages of the resident pages.
    pages: HashMap<PageId, u64>,
    columns: Vec<bool>,
    matter: Vec<u16>,
}

impl Known {
    fn new(engine: &Engine, archive: &[u8]) -> Self {
        let index = open(archive).index;
        let map = engine.cache_map();
        let mut columns = vec![false; index.manifest.groups() as usize];
        for column in map.columns.iter().flatten() {
            columns[usize::from(column.group)] = true;
        }
        Self {
            pages: map
                .pages
                .iter()
                .flatten()
                .map(|page| (page.page, page.age))
                .collect(),
            columns,
            matter: groups_that_matter(&index, COMPONENT_ERROR),
            index,
        }
    }

    /// The finest resident page among a tile and its ancestors.
    fn shown(&self, group: u16, tile: Tile) -> Option<PageId> {
        let mut at = Some(tile);
        while let Some(tile) = at {
            let page = PageId { group, tile };
            if self.pages.contains_key(&page) {
                return self.columns[usize::from(group)].then_some(page);
            }
            at = self.index.pyramid.parent(tile);
        }
        None
    }

    /// Up to the last column.
    fn present(&self) -> u16 {
        self.columns
            .iter()
            .rposition(|column| *column)
            .map_or(0, |last| last as u16 + 1)
    }

    /// Groups that shading goes through.
    fn groups(&self, tile: Tile) -> u16 {
        let tile = self.index.pyramid.tile_index(tile).unwrap();
        self.present().min(self.matter[tile as usize])
    }

    /// Mean square of what is not there.
    fn missing(&self, tile: Tile) -> f64 {
        let mut missing = 0.0;
        for group in 0..self.columns.len() as u16 {
            let shown = self.shown(group, tile).map(|page| page.tile);
            let mut at = Some(tile);
            while let Some(tile) = at.filter(|tile| shown != Some(*tile)) {
                missing += f64::from(self.index.page(PageId { group, tile }).unwrap().weight);
                at = self.index.pyramid.parent(tile);
            }
        }
        missing
    }
}

/// What a pixel sees of a BTF.
struct Pixel {
    x: u32,
    y: u32,
    st: DVec2,
    st_dx: DVec2,
    st_dy: DVec2,
    mip: u8,
    tile: Tile,
}

impl Pixel {
    /// `None` where no BTF is seen.
    fn new(scene: &Scene, camera: &Camera, known: &Known, at: usize, ids: [u32; 2]) -> Option<Self> {
        let rays = Rays::new(camera, SIZE);
        let (x, y) = (at as u32 % SIZE.0, at as u32 / SIZE.0);
        let placed = Placed::new(scene, (ids[0] as usize).checked_sub(1)?, camera.eye.as_dvec3())?;
        let point = placed.meet(ids[1], &rays, x, y)?;
        let Surface::Btf {
            uv_scale, uv_offset, ..
        } = scene.materials[point.material].surface
        else {
            return None;
        };
        let scale = uv_scale.as_dvec2();
        let (st, st_dx, st_dy) = (
            point.uv * scale + uv_offset.as_dvec2(),
            point.uv_dx * scale,
            point.uv_dy * scale,
        );
        let pyramid = &known.index.pyramid;
        let (width, height) = pyramid.mip_size(0);
        let size = DVec2::new(width.into(), height.into());
        let step = (st_dx * size).length().max((st_dy * size).length());
        let mip = step.log2().clamp(0.0, f64::from(pyramid.mip_count() - 1)) as u8;
        let st = st - st.floor();
        let tile = if mip >= pyramid.tail_mip() {
            pyramid.root()
        } else {
            let (width, height) = pyramid.mip_size(mip);
            let tile = |s: f64, side: u32| (s * f64::from(side) / 64.0) as u16;
            Tile {
                mip,
                x: tile(st.x, width),
                y: tile(st.y, height),
            }
        };
        Some(Self {
            x,
            y,
            st,
            st_dx,
            st_dy,
            mip,
            tile,
        })
    }

    fn leading(&self, known: &Known) -> Option<PageId> {
        (0..known.groups(self.tile)).find_map(|group| known.shown(group, self.tile))
    }

    /// Whether it lies within a pixel of an edge of the page that is shown.
    fn at_border(&self, known: &Known, shown: PageId) -> bool {
        let pyramid = &known.index.pyramid;
        let mip = self.mip.max(shown.tile.mip);
        let (width, height) = pyramid.mip_size(mip);
        let size = DVec2::new(width.into(), height.into());
        let side = if mip >= pyramid.tail_mip() {
            f64::INFINITY
        } else {
            64.0
        };
        let inside = |axis: usize| {
            let texel = self.st[axis] * size[axis];
            let first = if side.is_finite() {
                (texel / side).floor() * side
            } else {
                0.0
            };
            let edge = (texel - first).min(size[axis].min(first + side) - texel);
            edge < self.st_dx[axis].hypot(self.st_dy[axis]) * size[axis]
        };
        inside(0) || inside(1)
    }

    /// What is drawn over the picture; `None`: nothing.
    fn over(&self, overlay: Overlay, known: &Known) -> Option<[u8; 3]> {
        let groups = || (0..known.groups(self.tile)).filter_map(|group| known.shown(group, self.tile));
        let absent = [213, 94, 0];
        match overlay {
            Overlay::None => None,
            Overlay::Mip => Some(self.leading(known).map_or(absent, |page| {
                let striped = (self.x + self.y) / 4 % 2 == 1;
                let mip = if striped {
                    self.mip
                } else {
                    self.mip.max(page.tile.mip)
                };
                overlay.colour(mip.into())
            })),
            Overlay::Components => Some(overlay.colour(groups().count() as f64)),
            Overlay::Borders => self
                .leading(known)
                .filter(|page| self.at_border(known, *page))
                .map(|page| overlay.colour(self.mip.max(page.tile.mip).into())),
            Overlay::Age => {
                let newest = groups().map(|page| known.pages[&page]).min();
                Some(newest.map_or(absent, |age| overlay.colour(age as f64)))
            }
            Overlay::PredictedError => Some(overlay.colour(known.missing(self.tile).sqrt())),
            Overlay::Skipped => {
                let all = known.columns.len() as f64;
                let shaded = groups().count() as f64 / all;
                let left_out = f64::from(known.present() - known.groups(self.tile)) / all;
                Some(std::array::from_fn(|channel| {
                    let colours =
                        [[230, 230, 230], [0, 114, 178], absent].map(|c: [u8; 3]| f64::from(c[channel]));
                    let shares = [shaded, left_out, 1.0 - shaded - left_out];
                    colours
                        .iter()
                        .zip(shares)
                        .map(|(colour, share)| colour * share)
                        .sum::<f64>()
                        .round() as u8
                }))
            }
        }
    }
}

/// An engine that has taken so many frames with few uploads in each: some pages are missing, and ages differ.
fn underway(archive: &[u8], frames: u32) -> (Engine, Scene, Camera) {
    let (mut scene, camera) = still_life();
    scene.materials[..2].fill(btf("weave", 1.0));
    let options = Options {
        component_error: COMPONENT_ERROR,
        budgets: Budgets {
            uploads_per_frame: 3,
            ..options(SIZE).budgets
        },
        ..options(SIZE)
    };
    let mut engine = engine(&scene, &[("weave", archive)], options);
    for _ in 0..frames {
        engine.frame(&camera).unwrap();
    }
    (engine, scene, camera)
}

/// On the right the first group alone has anything.
fn half_weave(component: u32, s: f64, t: f64) -> f64 {
    if component < 4 || s < 0.5 {
        weave(component, s, t)
    } else {
        0.0
    }
}

fn recipe() -> Recipe {
    Recipe {
        groups: 5,
        texture: half_weave,
        ..Default::default()
    }
}

#[test]
fn each_overlay_shows_what_the_tables_say() {
    let archive = recipe().build();
    let (mut engine, scene, camera) = underway(&archive, 8);
    engine.set_overlay_opacity(1.0);
    for overlay in Overlay::ALL {
        engine.set_overlay(overlay).unwrap();
        let stats = engine.frame(&camera).unwrap();
        println!("{} of {} pages", stats.pages_resident, stats.pages_wanted);
        save(&engine, &format!("overlay_{}.png", overlay.name()));
        let known = Known::new(&engine, &archive);
        let screen = engine.tonemapped().unwrap();
        let picture = engine.picture().unwrap().to_srgb8(0.0);
        let (mut wrong, mut seen, mut colours) = (0, 0, HashMap::new());
        for (at, ids) in engine.visibility().unwrap().into_iter().enumerate() {
            let over = match Pixel::new(&scene, &camera, &known, at, ids) {
                Some(pixel) => {
                    seen += 1;
                    pixel.over(overlay, &known)
                }
                None if ids[0] == 0 && overlay == Overlay::Skipped => Some([0; 3]),
                None => None,
            };
            *colours.entry(over).or_insert(0) += 1;
            let expected = over.unwrap_or(picture[at]);
            let found = &screen[at * 4..][..3];
            wrong += u32::from(found.iter().zip(expected).any(|(a, b)| a.abs_diff(b) > 2));
        }
        println!(
            "{overlay:?}: {wrong} of {seen} pixels differ, {} colours",
            colours.len()
        );
        // Where f32 and f64 fall on different sides of a mip or an edge.
        assert!(
            seen > 8000 && wrong * 250 < seen,
            "{overlay:?}: {wrong} of {seen}"
        );
        assert!(
            overlay == Overlay::None || colours.len() > 2,
            "{overlay:?} shows nothing: {colours:?}"
        );
    }
}

#[test]
fn groups_of_pixels_are_those_that_shading_counts() {
    let archive = recipe().build();
    let (mut engine, scene, camera) = underway(&archive, 0);
    let mut all = [0; 3];
    for _ in 0..4 {
        engine.frame(&camera).unwrap();
        let known = Known::new(&engine, &archive);
        let work = engine.shading_work().unwrap();
        let mut groups = [0; 3];
        for (at, ids) in engine.visibility().unwrap().into_iter().enumerate() {
            if let Some(pixel) = Pixel::new(&scene, &camera, &known, at, ids) {
                let shaded = known.groups(pixel.tile);
                let shown = (0..shaded).filter(|&group| known.shown(group, pixel.tile).is_some());
                let (shown, left_out) = (shown.count() as u32, u32::from(known.present() - shaded));
                groups[0] += shown;
                groups[1] += left_out;
                groups[2] += known.columns.len() as u32 - shown - left_out;
            }
        }
        let counted = [work.groups_fetched, work.groups_left_out, work.groups_absent];
        for (found, counted) in groups.into_iter().zip(counted) {
            assert!(found.abs_diff(counted) * 250 <= counted, "{groups:?} {work:?}");
        }
        all = std::array::from_fn(|kind| all[kind] + groups[kind]);
    }
    assert!(all.iter().all(|groups| *groups > 0), "{all:?}");
}

#[test]
fn without_an_overlay_the_picture_is_the_same_bit_by_bit() {
    let archive = recipe().build();
    let (mut engine, _, camera) = underway(&archive, 0);
    settle(&mut engine, &camera);
    let (screen, picture, bytes) = (
        engine.tonemapped().unwrap(),
        engine.picture().unwrap(),
        engine.frame(&camera).unwrap().gpu_bytes,
    );
    assert!(!engine.frame(&camera).unwrap().drawn);
    for overlay in &Overlay::ALL[1..] {
        engine.set_overlay(*overlay).unwrap();
        assert!(engine.frame(&camera).unwrap().drawn);
        assert!(engine.tonemapped().unwrap() != screen, "{overlay:?}");
        assert!(engine.picture().unwrap() == picture);
        // Ages change in every frame.
        assert_eq!(engine.frame(&camera).unwrap().drawn, *overlay == Overlay::Age);
        engine.set_overlay_opacity(0.0);
        engine.frame(&camera).unwrap();
        let apart = engine.tonemapped().unwrap();
        assert!(apart.iter().zip(&screen).all(|(a, b)| a.abs_diff(*b) <= 1));
        engine.set_overlay_opacity(0.7);
    }
    engine.set_overlay(Overlay::None).unwrap();
    let stats = engine.frame(&camera).unwrap();
    assert!(stats.drawn && stats.settled && stats.gpu_bytes == bytes);
    assert!(engine.tonemapped().unwrap() == screen);
    assert!(!engine.frame(&camera).unwrap().drawn);
}

#[test]
fn overlays_follow_the_size_and_the_budgets() {
    let archive = recipe().build();
    let (mut engine, _, camera) = underway(&archive, 3);
    for overlay in [Overlay::Age, Overlay::PredictedError, Overlay::Borders] {
        engine.set_overlay(overlay).unwrap();
        engine.resize((64, 48)).unwrap();
        engine.frame(&camera).unwrap();
        assert_eq!(engine.tonemapped().unwrap().len(), 64 * 48 * 4);
        for bytes in [1 << 20, 64 << 20] {
            let budgets = Budgets {
                page_cache_bytes: bytes,
                ..engine.budgets()
            };
            engine.set_budgets(budgets).unwrap();
            settle(&mut engine, &camera);
        }
        engine.resize(SIZE).unwrap();
    }
}
