//! One row after the other.

use std::time::{Duration, Instant};

use engine::frame::{Budgets, Engine, FrameStats, Options};
use engine::gpu::{Context, PageFormat};
use engine::stream::MemorySource;
use glam::{Affine3A, Vec2, Vec3};
use scenes::{Camera, Instance, Light, Material, Mesh, Scene, Shape, Surface};
use serde::{Deserialize, Serialize};
use tileset::Archive;

use super::archive;
use crate::engine::{median, thread_time};
use crate::memory::resident_bytes;
use crate::{Error, Result};

/// Longest time until all has settled.
const LIMIT: Duration = Duration::from_secs(120);

/// What is measured.
#[derive(Clone, Debug, Serialize)]
pub struct Plan {
    /// Materials and texels along a side of each, a power of two from 32 on.
    pub cases: Vec<(usize, u32)>,
    /// Width and height of the picture, pixels.
    pub size: (u32, u32),
    /// Frames of a moving camera, and frames that stand still.
    pub frames: usize,
    /// Bytes of the page cache, and of the column cache: the same in every row.
    pub cache_bytes: [u64; 2],
}

/// All that was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Results {
    /// By case of the plan.
    pub rows: Vec<Row>,
}

/// So many materials of a size.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// Materials.
    pub materials: usize,
    /// Texels along a side of each.
    pub side_texels: u32,
    /// Tiles of all materials: pages of a component group.
    pub tiles: u64,
    /// Bytes of one archive, and of these those that are read first: header, manifest, tables, directory.
    pub archive_bytes: u64,
    /// See above.
    pub index_bytes: u64,
    /// Bytes on the GPU besides the caches: page tables, counters, materials, meshes, targets.
    pub gpu_bytes: u64,
    /// Bytes of records and decoded pages on the host.
    pub host_bytes: u64,
    /// What the memory of this process grew by, that of a GPU that is a program on the same processor included; where the system tells.
    pub resident_bytes: Option<u64>,
    /// Milliseconds until all archives were known, and until the first view had settled.
    pub known_ms: f64,
    /// See above.
    pub settled_ms: f64,
    /// Milliseconds of processor time of the frames' thread in a frame, besides the submission of work to the GPU: the median of the
    /// moving camera.
    pub moving_ms: f64,
    /// The same with the submission, and both of a view that has settled.
    pub moving_submit_ms: f64,
    /// See above.
    pub still_ms: f64,
    /// See above.
    pub still_submit_ms: f64,
}

/// Measures. `progress` gets words on what is next.
///
/// # Errors
/// [`Error::Invalid`] for sizes that cannot be and views that do not settle; those of the engine, of which
/// [`engine::Error::Budget`] says that the adapter cannot hold the tables of so much.
pub fn measure(plan: &Plan, progress: &dyn Fn(&str)) -> Result<Results> {
    let context = Context::headless()?;
    let mut rows = Vec::new();
    for &(materials, side) in &plan.cases {
        if materials == 0 || !side.is_power_of_two() || side < 32 {
            return Err(Error::Invalid {
                what: "a case",
                found: format!("{materials} materials of {side} texels"),
                expected: "one material or more, and a power of two from 32 on",
            });
        }
        progress(&format!("{materials} materials of {side}²"));
        rows.push(row(&context, plan, materials, side)?);
    }
    Ok(Results { rows })
}

fn row(context: &Context, plan: &Plan, materials: usize, side: u32) -> Result<Row> {
    let bytes = bytes_of(side)?;
    let opened = Archive::open(bytes.to_vec()).map_err(engine::Error::from)?;
    let tiles = opened.index.pyramid.tile_count();
    let index_bytes = opened.prefix().map_err(engine::Error::from)?.len() as u64;
    drop(opened);
    let mut source = MemorySource::with_capacity(256);
    for material in 0..materials {
        source.insert(&name(material), bytes.clone())?;
    }
    let scene = scene(materials);
    let before = resident_bytes("self");
    let begin = Instant::now();
    let mut engine = Engine::new(context.clone(), &scene, Box::new(source), options(plan))?;
    engine.wait_for_materials(LIMIT)?;
    let known_ms = begin.elapsed().as_secs_f64() * 1e3;
    let settled = |frames: Vec<FrameStats>| match frames.last() {
        Some(stats) if stats.settled => Ok(*stats),
        _ => Err(Error::Invalid {
            what: "a view",
            found: format!("still loading with {materials} materials of {side} texels"),
            expected: "settled within two minutes",
        }),
    };
    let first = settled(engine.settle(&camera(0.0), LIMIT)?)?;
    let settled_ms = begin.elapsed().as_secs_f64() * 1e3;
    let resident = before
        .zip(resident_bytes("self"))
        .map(|(before, after)| after.saturating_sub(before));
    engine.time_with(thread_time);
    let count = plan.frames.max(1);
    let moving = (1..=count).map(|frame| camera(frame as f32 / count as f32));
    let [moving_ms, moving_submit_ms] = cpu(&mut engine, moving)?;
    settled(engine.settle(&camera(1.0), LIMIT)?)?;
    let [still_ms, still_submit_ms] = cpu(&mut engine, std::iter::repeat_n(camera(1.0), count))?;
    Ok(Row {
        materials,
        side_texels: side,
        tiles: u64::from(tiles) * materials as u64,
        archive_bytes: bytes.len() as u64,
        index_bytes,
        gpu_bytes: first.gpu_bytes.saturating_sub(cache_bytes(&engine)),
        host_bytes: first.host_bytes,
        resident_bytes: resident,
        known_ms,
        settled_ms,
        moving_ms,
        moving_submit_ms,
        still_ms,
        still_submit_ms,
    })
}

/// Medians of the work of the frames' thread, and of its submissions.
fn cpu(engine: &mut Engine, cameras: impl Iterator<Item = Camera>) -> Result<[f64; 2]> {
    let (mut work, mut submit) = (Vec::new(), Vec::new());
    for camera in cameras {
        let ms = engine.step(&camera)?.ms;
        // A driver that works on the CPU would compete with the next frame.
        engine.wait()?;
        work.push(ms.votes + ms.residency + ms.source + ms.decode + ms.upload);
        submit.push(ms.draw);
    }
    Ok([median(&mut work), median(&mut submit)])
}

/// Bytes of both caches, which are no larger than all that could be in them.
fn cache_bytes(engine: &Engine) -> u64 {
    let (columns, column_bytes) = engine.column_slots();
    engine.cache_map().pages.len() as u64 * PageFormat::Half.slot_bytes() + u64::from(columns) * column_bytes
}

/// Shared by all who have it.
fn bytes_of(side: u32) -> Result<bytes::Bytes> {
    Ok(archive::make(side).map_err(engine::Error::from)?.into())
}

fn options(plan: &Plan) -> Options {
    Options {
        size: plan.size,
        budgets: Budgets {
            page_cache_bytes: plan.cache_bytes[0],
            column_cache_bytes: plan.cache_bytes[1],
            ..Budgets::default()
        },
        page_format: Some(PageFormat::Half),
        wait: false,
        ..Options::default()
    }
}

fn name(material: usize) -> String {
    format!("virtual-{material}")
}

/// A square of each material, side by side in a square of one metre in the plane z = 0.
fn scene(materials: usize) -> Scene {
    let across = (materials as f64).sqrt().ceil().max(1.0) as usize;
    let step = 1.0 / across as f32;
    let mut scene = Scene {
        lights: vec![Light::Directional {
            to_light: Vec3::new(0.3, 0.4, 1.0).normalize(),
            irradiance: Vec3::splat(std::f32::consts::PI),
        }],
        ..Scene::default()
    };
    for material in 0..materials {
        scene.meshes.push(Mesh {
            material,
            ..Shape::Plane.mesh()
        });
        let place = Vec3::new(
            (material % across) as f32 + 0.5,
            (material / across) as f32 + 0.5,
            0.0,
        ) * step;
        scene.instances.push(Instance {
            mesh: material,
            world_from_mesh: Affine3A::from_translation(place - Vec3::new(0.5, 0.5, 0.0))
                * Affine3A::from_scale(Vec3::splat(0.95 * step)),
        });
        scene.materials.push(Material {
            name: name(material),
            surface: Surface::Btf {
                archive: name(material),
                uv_scale: Vec2::ONE,
                uv_offset: Vec2::ZERO,
            },
        });
    }
    scene
}

/// From all of the square to a quarter of it.
fn camera(time: f32) -> Camera {
    let target = 0.2 * time * Vec3::new(1.0, 0.5, 0.0);
    Camera {
        eye: target + Vec3::Z * (1.4 - 0.7 * time),
        target,
        up: Vec3::Y,
        fov_y: 0.7,
        near: 0.01,
    }
}
