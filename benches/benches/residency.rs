//! Decisions of one frame: 100 materials of 1024² texels and 25 groups, in the caches that are the default
//! (256 MiB of pages, 128 MiB of columns of 81×81 directions), at 1280×720 pixels.

use criterion::{Criterion, criterion_group, criterion_main};
use engine::residency::{Limits, MaterialId, MaterialInfo, Residency, Vote};
use tileset::Pyramid;

const MATERIALS: u16 = 100;
const GROUPS: u16 = 25;
const PIXELS: u32 = 1280 * 720;

/// A number from 0 to 1 that looks random: the finalizer of MurmurHash3.
fn noise(seed: u64) -> f32 {
    let mut bits = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ bits >> 33).wrapping_mul(0xff51_afd7_ed55_8ccd);
    (bits >> 40) as f32 / (1u64 << 24) as f32
}

/// Weights that fall from group to group; from mip to mip as well, but for every fourth material, which has nothing to
/// speak of above its two finest mips, as a weave does.
fn material(pyramid: Pyramid, number: u16) -> MaterialInfo {
    let weave = number % 4 == 3;
    let weight = |group: u16, at: u32, mip: u8| {
        let coarse = pyramid.tail_mip() - mip;
        let spectrum = match (weave, mip) {
            (true, 0..=1) => 0.3,
            (true, _) if coarse > 0 => 0.001,
            _ => 0.5f32.powi(coarse.into()),
        };
        let seed = u64::from(number) << 32 | u64::from(group) << 20 | u64::from(at);
        0.1 * 0.7f32.powi(group.into()) * spectrum * (0.5 + noise(seed))
    };
    let weights = (0..GROUPS).flat_map(|group| {
        (0..)
            .zip(pyramid.tiles())
            .map(move |(at, tile)| weight(group, at, tile.mip))
    });
    MaterialInfo {
        pyramid,
        groups: GROUPS,
        weights: weights.collect(),
        visibility: Vec::new(),
        page_bytes: Vec::new(),
        column_bytes: Vec::new(),
    }
}

/// Votes for `tiles` tiles of every material, from mip `finest` on to the coarser ones; `share` of them differ from
/// frame to frame.
fn votes(pyramid: &Pyramid, finest: u8, tiles: u32, frame: u64, share: f32) -> Vec<Vote> {
    let end = pyramid.mip_base(finest) + pyramid.grid(finest).0 * pyramid.grid(finest).1;
    let pixels = PIXELS / u32::from(MATERIALS) / tiles;
    let vote = |material: u16, tile: u32| {
        let seed = u64::from(material) << 32 | u64::from(tile);
        // As it was when it changed last.
        let changed = (1..=frame).rev().find(|frame| noise(seed << 8 | frame) < share);
        let jitter = changed.map_or(1.0, |frame| 0.8 + 0.4 * noise(seed ^ (frame << 40)));
        let pixels = pixels as f32 * (0.5 + noise(seed)) * jitter;
        Vote {
            material: MaterialId(material),
            tile,
            pixels: pixels as u32 + 1,
        }
    };
    let tiles = end.saturating_sub(tiles)..end;
    (0..MATERIALS)
        .flat_map(|material| tiles.clone().map(move |tile| vote(material, tile)))
        .collect()
}

fn frame(residency: &mut Residency, votes: &[Vote]) {
    let plan = residency.update(votes, &[]);
    for item in plan.request {
        residency.arrived(item);
    }
}

fn update(criterion: &mut Criterion) {
    let pyramid = Pyramid::new(1024, 1024, true).expect("a valid size");
    let limits = Limits {
        page_slots: 6_300,
        column_slots: 840,
        in_flight: 64,
        bytes_in_flight: u64::MAX,
    };
    // The finest mip that votes, tiles that vote in each material, share of the votes that change in a frame.
    let cases = [
        ("static", 1, 16, 0.0),
        ("5 % of the votes of a picture", 1, 16, 0.05),
        ("all votes of a picture", 1, 16, 1.0),
        ("5 % of votes for every tile", 0, 342, 0.05),
    ];
    let mut group = criterion.benchmark_group("residency");
    for (name, finest, tiles, share) in cases {
        let mut residency = Residency::new(limits);
        for number in 0..MATERIALS {
            residency.add_material(material(pyramid, number));
        }
        let frames: Vec<Vec<Vote>> = (0..64)
            .map(|number| votes(&pyramid, finest, tiles, number, share))
            .collect();
        for _ in 0..400 {
            frame(&mut residency, &frames[0]);
        }
        let mut number = 0;
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                number += 1;
                frame(&mut residency, &frames[number % frames.len()]);
            });
        });
        let summary = residency.summary();
        eprintln!(
            "{name}: {} pages wanted, {} resident, {} columns",
            summary.pages_wanted, summary.pages_resident, summary.columns_resident
        );
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).measurement_time(std::time::Duration::from_secs(2)).warm_up_time(std::time::Duration::from_millis(500));
    targets = update
}
criterion_main!(benches);
