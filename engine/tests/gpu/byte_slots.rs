//! Slots of bytes by themselves: scales, borders between pages of different strength, odd values.

use engine::{
    gpu::{Caches, Renderer, materials::Btf, page_format::rounding_mse},
    residency::Slot,
};
use half::f16;
use tileset::{ArchiveWriter, Page, PageId, SLOT_AREA, Tile};

use super::*;

/// A renderer for a BTF of this size, whose pages the test makes.
fn bench(width: u32, height: u32, format: PageFormat) -> (Renderer, Btf) {
    let recipe = Recipe {
        width,
        height,
        groups: 1,
        ..Default::default()
    };
    let mut writer = ArchiveWriter::new(recipe.manifest()).unwrap();
    writer.add_column(0, vec![0; 4], 1.0).unwrap();
    for tile in recipe.manifest().pyramid().unwrap().tiles() {
        writer
            .add_page(PageId { group: 0, tile }, Vec::new(), 0.0)
            .unwrap();
    }
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    let btf = Btf::new("bytes".into(), open(&bytes).index);
    let mut renderer = Renderer::new(Context::headless().unwrap(), &Scene::default(), (8, 8)).unwrap();
    renderer.add_btf(&btf).unwrap();
    let caches = Caches {
        page_format: format,
        page_bytes: 40 * format.slot_bytes(),
        column_bytes: 1 << 20,
        angular: Default::default(),
    };
    let layout = renderer.layout(caches, btf.column_quads()).unwrap();
    renderer.resize_caches(layout, &[], &[]).unwrap();
    renderer.show_btfs(&[]).unwrap();
    (renderer, btf)
}

fn page(mip: u8, x: u16, y: u16) -> PageId {
    PageId {
        group: 0,
        tile: Tile { mip, x, y },
    }
}

/// A slot by a formula of column and row.
fn texels(value: impl Fn(u32, u32) -> [f32; 4]) -> Page {
    let texel = |at| value(at % 72, at / 72).map(f16::from_f32);
    Page {
        texels: (0..SLOT_AREA as u32).map(texel).collect(),
    }
}

#[test]
fn borders_hold_what_neighbours_bring_however_much_stronger_they_are() {
    for (width, height) in [(192, 128), (346, 335), (66, 200)] {
        let (mut renderer, btf) = bench(width, height, PageFormat::Byte);
        let pyramid = *btf.pyramid();
        // Each tile has its own strength, from weak to strong and back; the third component is nothing anywhere.
        let strength = |tile: Tile| 10f32.powi(i32::from(tile.x * 5 + tile.y * 3) % 7 - 3);
        let tiles: Vec<Tile> = pyramid.tiles().filter(|tile| tile.mip == 0).collect();
        let value = |tile: Tile, x: u32, y: u32| {
            let wave = ((x * 7 + y * 13 + u32::from(tile.x)) as f32).sin();
            [strength(tile) * wave, -wave, 0.0, strength(tile)]
        };
        for (slot, &tile) in (0..).zip(&tiles) {
            let id = PageId { group: 0, tile };
            renderer.place_page(0, id, Slot(slot), &texels(|x, y| value(tile, x, y)));
            // A few in a frame: some scales are raised later.
            if slot % 3 == 0 {
                let strips = renderer.flush();
                renderer.stitch(&strips);
            }
        }
        let strips = renderer.flush();
        renderer.stitch(&strips);
        let found = |tile| {
            renderer
                .page(0, PageId { group: 0, tile })
                .unwrap()
                .unwrap()
                .texels
        };
        let pages: Vec<_> = tiles.iter().map(|&tile| found(tile)).collect();
        let mut checked = 0;
        for (&tile, texels) in tiles.iter().zip(&pages) {
            let largest = |c: usize| {
                let values = texels.iter().map(|texel| texel[c].to_f32().abs());
                values.fold(0.0, f32::max)
            };
            let scale: [f32; 4] = std::array::from_fn(largest);
            assert_eq!(scale[2], 0.0);
            for strip in engine::gpu::borders::into(&pyramid, tile) {
                for at in 0..strip.size.0 * strip.size.1 {
                    let (x, y) = (at % strip.size.0, at / strip.size.0);
                    let (from_x, from_y) = (strip.from.0 + x * strip.step.0, strip.from.1 + y * strip.step.1);
                    let wanted = value(strip.source, from_x, from_y);
                    let found = texels[((strip.to.1 + y) * 72 + strip.to.0 + x) as usize];
                    for c in 0..4 {
                        // Rounded in both slots, each up to twice; 1 / 1024 for half floats.
                        let step = (scale[c].max(strength(strip.source)) + 1.0) / 127.0;
                        let error = (found[c].to_f32() - wanted[c]).abs();
                        let limit = step * 1.5 + wanted[c].abs() / 1024.0;
                        assert!(
                            error <= limit,
                            "{tile:?} {strip:?} {c}: {found:?}, not {wanted:?}"
                        );
                        checked += 1;
                    }
                }
            }
        }
        assert!(checked > 4000);
    }
}

#[test]
fn odd_pages_come_back_within_half_a_step() {
    let (mut renderer, btf) = bench(256, 256, PageFormat::Byte);
    let one = |x: u32, y: u32, value: f32| if (x, y) == (30, 40) { value } else { 0.0 };
    let odd = [
        texels(|_, _| [0.0; 4]),
        texels(|x, y| [one(x, y, 65504.0), one(x, y, -65504.0), one(x, y, 6e-8), 1.0]),
        texels(|x, y| [6e-8, -6e-8, (x % 2) as f32 * 6e-8, y as f32 * 6e-8]),
        texels(|x, _| [65504.0, -65504.0, x as f32 * 900.0, 6e-5]),
    ];
    for (slot, page_texels) in (0..).zip(&odd) {
        // Far from each other.
        let id = page(0, 2 * (slot % 2), 2 * (slot / 2));
        renderer.place_page(0, id, Slot(u32::from(slot)), page_texels);
    }
    let strips = renderer.flush();
    assert_eq!(strips.len(), 0);
    renderer.stitch(&strips);
    for (slot, wanted) in (0..).zip(&odd) {
        let found = renderer
            .page(0, page(0, 2 * (slot % 2), 2 * (slot / 2)))
            .unwrap()
            .unwrap();
        for c in 0..4 {
            let values = wanted.texels.iter().map(|texel| texel[c].to_f32().abs());
            let scale = values.fold(0.0, f32::max);
            for (found, wanted) in found.texels.iter().zip(&wanted.texels) {
                let (found, wanted) = (found[c].to_f32(), wanted[c].to_f32());
                let error = (found - wanted).abs();
                assert!(found.is_finite() && error <= scale / 254.0 + wanted.abs() / 2048.0 + 6e-8);
            }
        }
    }
    // The error that is counted: nothing for nothing, and the sum over components else; the column must be there.
    let pyramid = *btf.pyramid();
    let index = |id: PageId| pyramid.tile_index(id.tile).unwrap();
    assert_eq!(renderer.rounding_mse(0, index(page(0, 2, 0))), 0.0);
    renderer.place_column(0, 0, Slot(0), Vec::new());
    assert_eq!(renderer.rounding_mse(0, index(page(0, 0, 0))), 0.0);
    let expected =
        2.0 * rounding_mse(65504.0) + rounding_mse(f16::from_f32(6e-8).to_f32()) + rounding_mse(1.0);
    let found = renderer.rounding_mse(0, index(page(0, 2, 0)));
    assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
}
