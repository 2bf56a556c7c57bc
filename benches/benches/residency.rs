//! Decisions of one frame: 100 materials of 512² texels and 25 groups, all votes changing.

use criterion::{Criterion, criterion_group, criterion_main};
use engine::residency::{Limits, MaterialId, MaterialInfo, Residency, Vote};
use tileset::Pyramid;

const MATERIALS: u16 = 100;
const GROUPS: u16 = 25;

/// Weights that fall from group to group and from mip to mip, as a factorized material's do.
fn material(pyramid: Pyramid) -> MaterialInfo {
    let weights = (0..GROUPS)
        .flat_map(|group| {
            pyramid
                .tiles()
                .map(move |tile| 0.1 * 0.7f32.powi(group.into()) * 0.5f32.powi((8 - tile.mip).into()))
        })
        .collect();
    MaterialInfo {
        pyramid,
        groups: GROUPS,
        weights,
    }
}

/// Votes for every tile of every material; they differ from frame to frame.
fn votes(pyramid: &Pyramid, frame: u32) -> Vec<Vote> {
    let tiles = pyramid.tile_count();
    (0..MATERIALS)
        .flat_map(|material| {
            (0..tiles).map(move |tile| Vote {
                material: MaterialId(material),
                tile,
                pixels: (u32::from(material) * 31 + tile * 17 + frame * 7) % 97,
            })
        })
        .collect()
}

fn update(criterion: &mut Criterion) {
    let pyramid = Pyramid::new(512, 512, true).expect("a valid size");
    let limits = Limits {
        page_slots: 20_000,
        column_slots: 2_500,
        in_flight: 64,
    };
    let mut residency = Residency::new(limits);
    for _ in 0..MATERIALS {
        residency.add_material(material(pyramid));
    }
    let frames: Vec<Vec<Vote>> = (0..8).map(|frame| votes(&pyramid, frame)).collect();
    let mut frame = 0;
    criterion.bench_function("residency: update and arrivals, 100 materials", |bencher| {
        bencher.iter(|| {
            frame += 1;
            let plan = residency.update(&frames[frame % frames.len()]);
            for item in plan.request {
                residency.arrived(item);
            }
        });
    });
}

criterion_group!(benches, update);
criterion_main!(benches);
