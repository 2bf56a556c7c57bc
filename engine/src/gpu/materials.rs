//! The table of materials, and where each one's parts lie in the shared tables.

use glam::{UVec2, Vec2, Vec3};
use scenes::{Material, Surface};
use shaders::mirror;
use tileset::{Manifest, Pyramid, archive::Index};

use super::page_table::Region;
use crate::{Error, Result, angular::Triangulation};

/// A BTF of the scene: an archive whose index is known. Materials that name the same archive share it.
#[derive(Clone, Debug)]
pub struct Btf {
    /// Name of the archive.
    pub archive: std::sync::Arc<str>,
    /// Manifest and directory.
    pub index: Index,
    /// View directions.
    pub views: Triangulation,
    /// Light directions.
    pub lights: Triangulation,
    /// By light: its share of the pre-integrated ambient light.
    pub ambient_weights: Vec<f64>,
}

impl Btf {
    /// Prepares the directions of an archive.
    pub fn new(archive: std::sync::Arc<str>, index: Index) -> Self {
        let Manifest {
            views,
            lights,
            cosine,
            ..
        } = &index.manifest;
        let triangulated_lights = Triangulation::new(lights);
        let ambient_weights = triangulated_lights.ambient_weights(lights, *cosine);
        Self {
            archive,
            views: Triangulation::new(views),
            lights: triangulated_lights,
            ambient_weights,
            index,
        }
    }

    /// Component groups.
    pub fn groups(&self) -> u16 {
        self.index.manifest.groups() as u16
    }

    /// Geometry of the pages.
    pub fn pyramid(&self) -> &Pyramid {
        &self.index.pyramid
    }

    /// Four half floats each of a column in the cache: views × (lights and the ambient light) × 3.
    pub fn column_quads(&self) -> u64 {
        let Manifest { views, lights, .. } = &self.index.manifest;
        views.len() as u64 * (lights.len() as u64 + 1) * 3
    }
}

/// Where a BTF begins in the tables.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bases {
    /// First entry in the page table.
    pub page_table: u32,
    /// First counter in the votes.
    pub votes: u32,
}

/// Contents of the tables that depend on the materials.
#[derive(Debug, Default)]
pub struct Tables {
    /// One for each material of the scene.
    pub materials: Vec<mirror::Material>,
    /// Triangulations of all directions.
    pub directions: Vec<u32>,
    /// One for each BTF.
    pub bases: Vec<Bases>,
    /// Counters of the votes.
    pub votes: u32,
}

/// Packs the tables. `btf_of` names for each material of the scene its BTF; a BTF material without one shows
/// `unknown`.
///
/// # Errors
/// [`Error::Budget`] if a table has more entries than 32 bits can count.
pub fn pack(materials: &[Material], btfs: &[Btf], btf_of: &[Option<usize>], unknown: Vec3) -> Result<Tables> {
    let mut tables = Tables::default();
    let mut templates = Vec::with_capacity(btfs.len());
    let (mut entries, mut votes) = (0u64, 0u64);
    for btf in btfs {
        let bases = Bases {
            page_table: entries as u32,
            votes: votes as u32,
        };
        let tiles = btf.pyramid().tile_count();
        entries += Region::words(btf.groups(), tiles);
        votes += u64::from(tiles);
        if entries.max(votes) > u64::from(u32::MAX) {
            return Err(Error::Budget(format!(
                "the pages of {} and others are more than 32 bits can count",
                btf.archive
            )));
        }
        templates.push(template(btf, bases, &mut tables.directions));
        tables.bases.push(bases);
    }
    tables.votes = votes as u32;
    for (material, btf) in materials.iter().zip(btf_of) {
        let mut packed = btf.map(|btf| templates[btf]).unwrap_or_default();
        match &material.surface {
            Surface::Btf {
                uv_scale, uv_offset, ..
            } => {
                (packed.uv_scale, packed.uv_offset) = (*uv_scale, *uv_offset);
                if btf.is_none() {
                    packed.albedo = unknown;
                }
            }
            Surface::Diffuse { albedo } => packed.albedo = *albedo,
        }
        tables.materials.push(packed);
    }
    Ok(tables)
}

fn template(btf: &Btf, bases: Bases, directions: &mut Vec<u32>) -> mirror::Material {
    let (manifest, pyramid) = (&btf.index.manifest, btf.pyramid());
    let mut mips = [mirror::Mip::default(); mirror::MAX_MIPS];
    for (mip, packed) in (0..pyramid.mip_count()).zip(&mut mips) {
        *packed = self::mip(pyramid, mip);
    }
    let [r, g, b] = manifest.mean_rgb.map(|mean| mean as f32);
    mirror::Material {
        albedo: Vec3::new(r, g, b),
        texture_scale: manifest.texture_scale as f32,
        groups: u32::from(btf.groups()),
        page_table: bases.page_table,
        votes: bases.votes,
        flags: u32::from(manifest.wrap) * mirror::REPEATS
            + u32::from(manifest.cosine) * mirror::INCLUDES_COSINE,
        mip_count: pyramid.mip_count().into(),
        tail_mip: pyramid.tail_mip().into(),
        lights: manifest.lights.len() as u32,
        view_directions: pack_directions(&btf.views, directions),
        light_directions: pack_directions(&btf.lights, directions),
        mips,
        ..Default::default()
    }
}

fn mip(pyramid: &Pyramid, mip: u8) -> mirror::Mip {
    let tail = pyramid.tail_mip();
    let tile = if mip >= tail {
        pyramid.root()
    } else {
        tileset::Tile { mip, x: 0, y: 0 }
    };
    let (width, height) = pyramid.mip_size(mip);
    let (x, y) = pyramid.payload_origin(tile, mip);
    let (columns, rows) = pyramid.grid(mip);
    mirror::Mip {
        size: Vec2::new(width as f32, height as f32),
        origin: Vec2::new(x as f32, y as f32),
        tiles: UVec2::new(columns, rows),
        first_tile: if mip >= tail { 0 } else { pyramid.mip_base(mip) },
        pad: 0,
    }
}

fn pack_directions(triangulation: &Triangulation, words: &mut Vec<u32>) -> mirror::Triangulation {
    let points = words.len() as u32;
    words.extend(
        triangulation
            .points
            .iter()
            .flatten()
            .map(|&coordinate| (coordinate as f32).to_bits()),
    );
    let triangles = words.len() as u32;
    words.extend(
        triangulation
            .triangles
            .iter()
            .flat_map(|triangle| [triangle.vertices, triangle.neighbours])
            .flatten(),
    );
    let hull = words.len() as u32;
    words.extend(triangulation.hull.iter().flatten());
    let start = words.len() as u32;
    words.extend(&triangulation.start);
    mirror::Triangulation {
        points,
        triangles,
        hull,
        start,
        triangle_count: triangulation.triangles.len() as u32,
        hull_count: triangulation.hull.len() as u32,
    }
}
