//! Sessions of the viewer over a real engine, without a window.

use std::{sync::LazyLock, time::Instant};

use engine::{
    Overlay,
    frame::{Budgets, Options},
    gpu::{Area, Context},
    metrics::Picture,
    stream::{self, TileSource},
};
use glam::Vec2;
use scenes::Shape;
use tests::Fixture;
use viewer::{
    Command, Connection, Input, Link, Subject, Viewer,
    input::{Button, Modifiers},
    quality::Quality,
};

const SIZE: (u32, u32) = (160, 120);
const PATIENCE: std::time::Duration = std::time::Duration::from_secs(60);

static FIXTURE: LazyLock<Fixture> = LazyLock::new(Fixture::new);

fn source() -> Box<dyn TileSource> {
    stream::open(FIXTURE.tiles().to_str().unwrap()).unwrap()
}

fn options() -> Options {
    Options {
        size: SIZE,
        budgets: Budgets {
            page_cache_bytes: 16 << 20,
            column_cache_bytes: 16 << 20,
            ..Budgets::default()
        },
        ..Options::default()
    }
}

fn viewer() -> Viewer {
    let subject = Subject::Archive("leather".into());
    Viewer::new(Context::headless().unwrap(), subject, source(), options()).unwrap()
}

/// Frames until nothing moves any more.
fn settle(viewer: &mut Viewer) -> Picture {
    let start = Instant::now();
    loop {
        viewer.frame(1.0 / 60.0).unwrap();
        let beside = viewer.reference().is_none_or(|(_, stats)| stats.settled);
        if viewer.report().frame.settled && beside {
            return viewer.engine().picture().unwrap();
        }
        assert!(start.elapsed() < PATIENCE, "{:?}", viewer.report());
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
}

/// Largest difference of two pictures, in radiance.
fn difference(a: &Picture, b: &Picture) -> f32 {
    let pairs = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

fn rms(a: &Picture, b: &Picture) -> f32 {
    let pairs = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened());
    let sum: f32 = pairs.map(|(a, b)| (a - b).powi(2)).sum();
    (sum / (3 * a.pixels.len()) as f32).sqrt()
}

#[test]
fn shapes_and_lights_change_without_streaming_anew() {
    let mut viewer = viewer();
    assert!(viewer.report().materials.is_empty());
    let plane = settle(&mut viewer);
    assert_eq!(viewer.report().materials[0].name, "leather");
    assert_eq!(viewer.report().materials[0].state, "settled");
    assert_eq!(viewer.shape(), Some(Shape::Plane));
    let requested = viewer.report().source.requested;

    // All of a light's way is the GPU's.
    let control = Modifiers {
        control: true,
        ..Modifiers::default()
    };
    let at = Vec2::new(80.0, 60.0);
    let down = Input::Down {
        button: Button::Primary,
        at,
        modifiers: control,
    };
    for input in [
        down,
        Input::Move {
            at: at + Vec2::X * 30.0,
        },
        Input::Up,
    ] {
        assert_eq!(viewer.input(input).unwrap(), None);
    }
    let lit = settle(&mut viewer);
    assert!(difference(&plane, &lit) > 0.05);
    assert_eq!(viewer.report().source.requested, requested);
    viewer.command(Command::AddLight).unwrap();
    let brighter = settle(&mut viewer);
    let sum = |picture: &Picture| picture.pixels.as_flattened().iter().sum::<f32>();
    assert!(sum(&brighter) > sum(&lit) * 1.05);

    for _ in 1..Shape::ALL.len() {
        viewer.command(Command::NextShape).unwrap();
        let shown = settle(&mut viewer);
        assert!(difference(&plane, &shown) > 0.05, "{:?}", viewer.shape());
        let lit = shown.pixels.iter().filter(|pixel| pixel[0] > 0.03).count();
        assert!(lit > shown.pixels.len() / 8, "{:?}: {lit}", viewer.shape());
    }
    // Its index was not asked for again.
    assert_eq!(viewer.report().frame.archives_known, 1);
    viewer.command(Command::NextShape).unwrap();
    viewer.command(Command::Reset).unwrap();
    assert!(difference(&plane, &settle(&mut viewer)) < 1e-5);
}

#[test]
fn a_link_shows_the_same_elsewhere() {
    let mut here = viewer();
    here.set_shape(Shape::Cylinder).unwrap();
    here.input(Input::Wheel { pixels: 120.0 }).unwrap();
    here.command(Command::AddLight).unwrap();
    here.command(Command::Brighter).unwrap();
    here.command(Command::NextOverlay).unwrap();
    let picture = settle(&mut here);
    let link = here.link().to_string();
    assert!(
        link.contains("shape=cylinder") && link.contains("overlay=mip"),
        "{link}"
    );
    let mut there = viewer();
    there.follow(&Link::parse(&link).unwrap()).unwrap();
    assert_eq!(there.engine().overlay(), Overlay::Mip);
    // Six digits of a camera are a hundredth of a pixel.
    let shown = settle(&mut there);
    let rms = rms(&picture, &shown);
    assert!(rms < 2e-3, "{rms}");
    assert_eq!(there.link().to_string(), link);
}

#[test]
fn a_target_error_finds_its_budgets() {
    let mut viewer = viewer();
    let (finest, coarse) = (1e-4, 0.05);
    let quality = |target_rms| {
        Some(Quality {
            target_rms,
            most_bytes: 64 << 20,
        })
    };
    viewer.set_quality(quality(coarse)).unwrap();
    settle(&mut viewer);
    assert!(viewer.report().frame.predicted_rms <= coarse);
    viewer.set_quality(quality(finest)).unwrap();
    settle(&mut viewer);
    let budgets = viewer.budgets();
    assert!(viewer.report().frame.predicted_rms <= finest);
    assert!(budgets.page_cache_bytes + budgets.column_cache_bytes <= 64 << 20);
    assert!(viewer.set_quality(quality(f64::NAN)).is_err());
    viewer.set_budgets(budgets).unwrap();
    assert_eq!(viewer.quality(), None);
}

#[test]
fn what_is_left_out_changes_as_if_it_had_been_so_from_the_start() {
    let mut changed = viewer();
    let exact = settle(&mut changed);
    changed.engine_mut().set_component_error(0.05).unwrap();
    let left_out = settle(&mut changed);
    assert!(difference(&exact, &left_out) > 0.0);
    let from_start = Options {
        component_error: 0.05,
        ..options()
    };
    let subject = Subject::Archive("leather".into());
    let context = Context::headless().unwrap();
    let mut same = Viewer::new(context, subject, source(), from_start).unwrap();
    assert_eq!(difference(&left_out, &settle(&mut same)), 0.0);
    changed
        .engine_mut()
        .set_component_error(options().component_error)
        .unwrap();
    assert_eq!(difference(&exact, &settle(&mut changed)), 0.0);
    assert!(changed.engine_mut().set_component_error(f64::NAN).is_err());
}

#[test]
fn an_archive_that_comes_late_is_shown_when_asked_again() {
    let folder = tempfile::tempdir().unwrap();
    let source = stream::open(folder.path().to_str().unwrap()).unwrap();
    let subject = Subject::Archive("leather".into());
    let mut viewer = Viewer::new(Context::headless().unwrap(), subject, source, options()).unwrap();
    let grey = settle(&mut viewer);
    let Connection::Lost(why) = &viewer.report().connection else {
        panic!("{:?}", viewer.report().connection);
    };
    assert!(why.contains("leather"), "{why}");
    assert_eq!(viewer.report().materials[0].state, "failed");
    std::fs::copy(FIXTURE.archive("leather"), folder.path().join("leather.bsvtf")).unwrap();
    viewer.command(Command::Retry).unwrap();
    let start = Instant::now();
    while viewer.report().frame.archives_known == 0 && start.elapsed() < PATIENCE {
        viewer.frame(0.02).unwrap();
    }
    let shown = settle(&mut viewer);
    assert_eq!(viewer.report().connection, Connection::Fine);
    assert!(difference(&grey, &shown) > 0.05);
}

#[test]
fn both_pictures_of_a_split_view_are_where_they_belong() {
    let mut viewer = viewer();
    let small = Budgets {
        page_cache_bytes: 1,
        ..viewer.budgets()
    };
    // Too small for anything is refused, and all stays as it is.
    assert!(
        viewer
            .set_budgets(Budgets {
                host_bytes: 0,
                ..small
            })
            .is_err()
    );
    settle(&mut viewer);
    viewer.set_reference(Some(source())).unwrap();
    settle(&mut viewer);
    let own = viewer.engine().tonemapped().unwrap();
    viewer.engine_mut().set_overlay(Overlay::Mip).unwrap();
    settle(&mut viewer);
    let covered = viewer.engine().tonemapped().unwrap();
    let (width, height) = SIZE;
    let context = viewer.engine().context().clone();
    let target = context.device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d {
            width: 256,
            height: 200,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let mut encoder = context.device().create_command_encoder(&Default::default());
    let (view, area) = (
        target.create_view(&Default::default()),
        Area {
            x: 20,
            y: 30,
            width,
            height,
        },
    );
    viewer
        .present(&mut encoder, &view, target.format(), (256, 200), area, 0.5)
        .unwrap();
    let buffer = context.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 256 * 4 * 200,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    encoder.copy_texture_to_buffer(
        target.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(256 * 4),
                rows_per_image: None,
            },
        },
        target.size(),
    );
    context.queue().submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |mapped| mapped.unwrap());
    context
        .device()
        .poll(wgpu::PollType::wait_indefinitely())
        .unwrap();
    let shown = buffer.get_mapped_range(..).unwrap();
    let pixel = |x: u32, y: u32| &shown[((y * 256 + x) * 4) as usize..][..3];
    assert_eq!(pixel(5, 5), [0, 0, 0]);
    let own_pixel = |own: &[u8], x: u32, y: u32| {
        let at = ((y * width + x) * 4) as usize;
        [own[at], own[at + 1], own[at + 2]]
    };
    let (mut left, mut right) = (0, 0);
    for y in (4..height).step_by(7) {
        for x in (4..width).step_by(7) {
            let got = pixel(20 + x, 30 + y);
            if x < width / 2 {
                assert_eq!(got, own_pixel(&covered, x, y), "{x} {y}");
                left += 1;
            } else {
                // The overlay is the left picture's alone.
                let beside = own_pixel(&own, x, y);
                let near = got.iter().zip(beside).all(|(a, b)| a.abs_diff(b) <= 3);
                assert!(near, "{x} {y}: {got:?} {beside:?}");
                right += 1;
            }
        }
    }
    assert!(left > 50 && right > 50);
}
