//! What is measured: scenes, their archives, the ways of their cameras.

use engine::stream::{MemorySource, OpenOptions, TileSource, open_with};
use glam::Quat;
use scenes::paper::PaperScene;
use scenes::{Camera, Scene, Surface};

use super::archive;
use crate::Result;

/// Distinct archives among those that are made; names beyond repeat them.
const VARIANTS: u32 = 4;
/// Share of the triangles of the paper's scene.
const DETAIL: f32 = 0.1;

/// Where archives come from.
#[derive(Clone, Debug)]
pub enum Archives {
    /// A folder or the address of a server, and how it is opened.
    At(String, OpenOptions),
    /// Made by formula, by name.
    Made(Vec<(String, Vec<u8>)>),
}

impl Archives {
    /// A new source of them.
    ///
    /// # Errors
    /// If the folder or server cannot be opened.
    pub fn source(&self) -> Result<Box<dyn TileSource>> {
        match self {
            Archives::At(place, options) => Ok(open_with(place, options)?),
            Archives::Made(archives) => {
                let mut source = MemorySource::new();
                for (name, bytes) in archives {
                    source.insert(name, bytes.clone())?;
                }
                Ok(Box::new(source))
            }
        }
    }
}

/// A scene to measure.
#[derive(Clone, Debug)]
pub struct Subject {
    /// Name.
    pub name: String,
    /// What is drawn.
    pub scene: Scene,
    /// Its archives.
    pub archives: Archives,
    /// Views, in the order in which the camera comes to them.
    pub cameras: Vec<Camera>,
    /// The same way in the steps of a camera that moves.
    pub flight: Vec<Camera>,
}

/// The grid of tori of the paper's first scene with at most 100 materials made by formula: 256² texels, 16 components,
/// 37 × 37 directions.
///
/// # Errors
/// None that is expected.
pub fn built_in(materials: usize, frames: usize, flight_frames: usize) -> Result<Subject> {
    let materials = materials.clamp(1, 100);
    let made = (0..VARIANTS.min(materials as u32))
        .map(archive::make)
        .collect::<tileset::Result<Vec<_>>>()
        .map_err(engine::Error::from)?;
    let mut scene = PaperScene::Tori.build(DETAIL);
    let mut next = 0;
    for material in &mut scene.materials {
        if let Surface::Btf { archive, .. } = &mut material.surface {
            *archive = format!("formula-{}", next % materials);
            next += 1;
        }
    }
    let named = (0..materials).map(|at| (format!("formula-{at}"), made[at % made.len()].clone()));
    Ok(Subject {
        name: format!(
            "tori, {materials} material{}",
            if materials == 1 { "" } else { "s" }
        ),
        scene,
        archives: Archives::Made(named.collect()),
        cameras: PaperScene::Tori.flight().frames(frames).collect(),
        flight: PaperScene::Tori.flight().frames(flight_frames).collect(),
    })
}

/// A quarter of a circle around all of a scene; nothing for a scene without a vertex.
pub fn orbit(scene: &Scene, aspect: f32, frames: usize) -> Vec<Camera> {
    let Some((min, max)) = scene.bounds() else {
        return Vec::new();
    };
    let start = Camera::framing(min, max, aspect);
    (0..frames)
        .map(|frame| {
            let turn = std::f32::consts::FRAC_PI_2 * frame as f32 / frames as f32;
            Camera {
                eye: start.target + Quat::from_rotation_y(turn) * (start.eye - start.target),
                ..start
            }
        })
        .collect()
}
