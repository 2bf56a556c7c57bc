//! Votes: counted on the GPU, compacted, read back, and looked ahead.

use std::collections::BTreeMap;

use engine::gpu::{Ask, Caches, Renderer, cutoff::groups_that_matter, feedback::Counted, materials::Btf};
use glam::{Affine3A, Quat, Vec3};
use scenes::Instance;
use tileset::{ArchiveWriter, PageId};

use super::*;
use crate::scene::{btf, square, still_life};

const SIZE: (u32, u32) = (160, 90);

/// A BTF whose pages nobody decodes.
fn empty(side: u32) -> Btf {
    let recipe = Recipe {
        width: side,
        height: side,
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
    let index = open(&bytes).index;
    assert!(groups_that_matter(&index, 0.0).iter().all(|&groups| groups == 1));
    Btf::new("votes".into(), index)
}

fn renderer(scene: &Scene, btfs: &[Btf], btf_of: &[Option<usize>]) -> Renderer {
    let mut renderer = Renderer::new(Context::headless().unwrap(), scene, SIZE).unwrap();
    let caches = Caches {
        page_format: Default::default(),
        page_bytes: 1 << 20,
        column_bytes: 1 << 20,
        angular: Default::default(),
    };
    for btf in btfs {
        renderer.add_btf(btf).unwrap();
    }
    let column_quads = btfs.iter().map(Btf::column_quads).max().unwrap_or(0);
    let layout = renderer.layout(caches, column_quads).unwrap();
    renderer.resize_caches(layout, &[], &[]).unwrap();
    renderer.show_btfs(btf_of).unwrap();
    renderer
}

fn answers(renderer: &mut Renderer) -> Vec<Counted> {
    renderer.wait().unwrap();
    renderer.poll().unwrap().0
}

/// The votes of one phase, which must come.
fn votes(renderer: &mut Renderer, camera: &Camera, stride: u32, phase: u32) -> Vec<(u32, u32)> {
    let tag = u64::from(phase) + 7;
    assert!(renderer.look(Some(camera), Some(Ask { stride, phase, tag })));
    let [counted] = &answers(renderer)[..] else {
        panic!("one answer")
    };
    assert!(counted.tag == tag && !counted.ahead);
    assert!(counted.votes.is_sorted_by_key(|vote| vote.0));
    counted.votes.clone()
}

fn still() -> (Renderer, Camera) {
    let (scene, camera) = still_life();
    let btf_of = [Some(0), Some(1), None];
    (renderer(&scene, &[empty(512), empty(1024)], &btf_of), camera)
}

#[test]
fn every_pixel_votes_once_and_counters_start_at_zero() {
    let (mut renderer, camera) = still();
    let all = votes(&mut renderer, &camera, 1, 0);
    assert_eq!(votes(&mut renderer, &camera, 1, 0), all);
    let seen = renderer.visibility().unwrap();
    // The third instance is diffuse.
    let pixels = seen.iter().filter(|ids| matches!(ids[0], 1 | 2)).count();
    assert_eq!(all.iter().map(|vote| vote.1 as usize).sum::<usize>(), pixels);
    let mut sums = BTreeMap::new();
    for phase in 0..16 {
        for (counter, pixels) in votes(&mut renderer, &camera, 4, phase) {
            *sums.entry(counter).or_insert(0) += pixels;
        }
    }
    assert_eq!(sums.into_iter().collect::<Vec<_>>(), all);
}

#[test]
fn bytes_follow_what_is_seen_and_too_many_pairs_come_the_next_time() {
    // A carpet of 900 small squares of a material each; from close by a few of them.
    let squares = 0..900;
    let scene = Scene {
        meshes: squares.clone().map(square).collect(),
        instances: squares
            .clone()
            .map(|mesh| Instance {
                mesh,
                world_from_mesh: Affine3A::from_scale_rotation_translation(
                    Vec3::splat(0.4),
                    Quat::IDENTITY,
                    Vec3::new((mesh % 30) as f32 - 15.0, 0.0, (mesh / 30) as f32 - 15.0),
                ),
            })
            .collect(),
        materials: squares.clone().map(|_| btf("votes", 1.0)).collect(),
        ..Default::default()
    };
    let btfs = vec![empty(512); 900];
    let btf_of: Vec<_> = squares.map(Some).collect();
    let mut renderer = renderer(&scene, &btfs, &btf_of);
    let above = |height: f32| Camera {
        eye: Vec3::new(0.0, height, 0.1),
        target: Vec3::ZERO,
        up: Vec3::Y,
        fov_y: 1.0,
        near: 0.01,
    };
    let few = votes(&mut renderer, &above(1.0), 1, 0);
    assert!(few.len() < 256, "{}", few.len());
    let before = renderer.vote_bytes();
    votes(&mut renderer, &above(1.0), 1, 0);
    let bytes = renderer.vote_bytes() - before;
    let counters: u32 = btfs.iter().map(|btf| btf.pyramid().tile_count()).sum();
    assert!(
        bytes <= 8 + 512 * 8 && bytes * 50 < u64::from(counters) * 4,
        "{bytes}"
    );

    let ask = Ask {
        stride: 1,
        phase: 0,
        tag: 1,
    };
    assert!(renderer.look(Some(&above(40.0)), Some(ask)));
    // Which pairs came would be chance: none do.
    assert_eq!(answers(&mut renderer), []);
    assert!(!renderer.votes_pending());
    let many = votes(&mut renderer, &above(40.0), 1, 0);
    assert!(many.len() > 600, "{}", many.len());
    assert_eq!(votes(&mut renderer, &above(40.0), 1, 0), many);
}

#[test]
fn looking_ahead_wants_nearly_what_looking_does() {
    let (mut renderer, camera) = still();
    let now: BTreeMap<_, _> = votes(&mut renderer, &camera, 1, 0).into_iter().collect();
    let seen = renderer.visibility().unwrap();
    assert!(renderer.look_ahead(&camera, 77));
    // Votes ahead are not those that a frame waits for, and do not take the last place of the ring.
    assert!(!renderer.votes_pending());
    while renderer.look_ahead(&camera, 78) {}
    let ask = Ask {
        stride: 4,
        phase: 3,
        tag: 5,
    };
    assert!(renderer.look(None, Some(ask)));
    let answers = answers(&mut renderer);
    let tags: Vec<_> = answers
        .iter()
        .map(|counted| (counted.tag, counted.ahead))
        .collect();
    assert_eq!(tags[..2], [(5, false), (77, true)]);
    let ahead: BTreeMap<_, _> = answers[1].votes.iter().copied().collect();
    let pixels = |votes: &BTreeMap<u32, u32>| votes.values().sum::<u32>();
    let shared: u32 = ahead
        .iter()
        .map(|(counter, pixels)| *pixels.min(now.get(counter).unwrap_or(&0)))
        .sum();
    println!("{} {} {shared}", pixels(&now), pixels(&ahead));
    assert!(pixels(&now).abs_diff(pixels(&ahead)) * 20 < pixels(&now));
    assert!(shared * 10 > pixels(&now) * 8, "{shared} of {}", pixels(&now));
    // Nothing of what is drawn has changed.
    assert!(renderer.visibility().unwrap() == seen);
    let after: BTreeMap<_, _> = votes(&mut renderer, &camera, 1, 0).into_iter().collect();
    assert_eq!(after, now);
}
