//! The table of materials, and where each one's parts lie in the shared tables.

use std::sync::OnceLock;

use glam::{UVec2, Vec2, Vec3};
use half::f16;
use scenes::{Material, Surface};
use shaders::mirror;
use tileset::{Column, Manifest, Pyramid, archive::Index};

use super::{column_cache::with_ambient, page_format::PageFormat, page_table::Region};
use crate::{
    Error, Result,
    angular::{Angular, Hemisphere, Triangulation, map_side, map_texels},
};

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
    /// What its columns are in the cache.
    pub angular: Angular,
    /// What its pages are in theirs.
    pub page_format: PageFormat,
    /// Made when it is needed.
    hemisphere: OnceLock<Hemisphere>,
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
            angular: Angular::default(),
            page_format: PageFormat::default(),
            hemisphere: OnceLock::new(),
            index,
        }
    }

    /// w of each page in squared reflectance (paper, equation 8): group by group, within a group by tile index.
    pub fn weights(&self) -> impl Iterator<Item = f32> + '_ {
        // A power of two: exact.
        let scale = self.index.manifest.texture_scale as f32;
        self.index
            .pages()
            .iter()
            .map(move |record| record.weight * scale * scale)
    }

    /// Component groups.
    pub fn groups(&self) -> u16 {
        self.index.manifest.groups() as u16
    }

    /// Geometry of the pages.
    pub fn pyramid(&self) -> &Pyramid {
        &self.index.pyramid
    }

    /// Four half floats each of a column in the cache: views × (lights and the ambient light) × 3, or texels of maps.
    pub fn column_quads(&self) -> u64 {
        self.column_quads_as(self.angular)
    }

    /// The same if columns were something else.
    pub fn column_quads_as(&self, angular: Angular) -> u64 {
        let Manifest { views, lights, .. } = &self.index.manifest;
        match angular {
            Angular::Delaunay => views.len() as u64 * (lights.len() as u64 + 1) * 3,
            Angular::Hemisphere => map_texels(views.len(), map_side(lights.len())),
        }
    }

    /// A decoded column as the cache holds it.
    pub fn cached_column(&self, column: &Column) -> Vec<[f16; 4]> {
        let samples = with_ambient(column, &self.ambient_weights);
        match self.angular {
            Angular::Delaunay => samples,
            Angular::Hemisphere => self.hemisphere().maps(&samples),
        }
    }

    fn hemisphere(&self) -> &Hemisphere {
        let cosine = self.index.manifest.cosine;
        self.hemisphere
            .get_or_init(|| Hemisphere::new(&self.lights, cosine))
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

/// The tables that depend on the BTFs. They only grow: what is known of a BTF stays where it is when others become
/// known.
#[derive(Debug, Default)]
pub struct Tables {
    templates: Vec<mirror::Material>,
    /// Where each BTF begins.
    pub bases: Vec<Bases>,
    /// Words of all triangulations.
    pub direction_words: u32,
    /// Entries of the page table.
    pub page_entries: u32,
    /// Counters of the votes.
    pub votes: u32,
}

/// What a BTF adds to the tables.
#[derive(Debug)]
pub struct Added {
    template: mirror::Material,
    bases: Bases,
    /// Words of its directions' triangulations, which belong behind the others'.
    pub directions: Vec<u32>,
    page_entries: u32,
    votes: u32,
}

impl Tables {
    /// What a BTF would add.
    ///
    /// # Errors
    /// [`Error::Budget`] if a table would have more than `most_words` entries.
    pub fn pack(&self, btf: &Btf, most_words: u32) -> Result<Added> {
        let tiles = u64::from(btf.pyramid().tile_count());
        let entries = u64::from(self.page_entries) + Region::words(btf.groups(), btf.pyramid().tile_count());
        let votes = u64::from(self.votes) + tiles;
        if entries.max(votes) > u64::from(most_words) {
            return Err(Error::Budget(format!(
                "the page tables of {} and the materials before it have {entries} entries, but this adapter's buffers \
                 hold at most {most_words}: draw fewer or smaller materials at once",
                btf.archive
            )));
        }
        let bases = Bases {
            page_table: self.page_entries,
            votes: self.votes,
        };
        let mut directions = Vec::new();
        Ok(Added {
            template: template(btf, bases, self.direction_words, &mut directions),
            bases,
            directions,
            page_entries: entries as u32,
            votes: votes as u32,
        })
    }

    /// Adds it.
    pub fn push(&mut self, added: &Added) {
        self.templates.push(added.template);
        self.bases.push(added.bases);
        self.direction_words += added.directions.len() as u32;
        (self.page_entries, self.votes) = (added.page_entries, added.votes);
    }

    /// One entry for each material of the scene. `btf_of` names its BTF; a BTF material without one shows `unknown`.
    pub fn materials(
        &self,
        materials: &[Material],
        btf_of: &[Option<usize>],
        unknown: Vec3,
    ) -> Vec<mirror::Material> {
        let pack = |(material, btf): (&Material, &Option<usize>)| {
            let mut packed = btf.map(|btf| self.templates[btf]).unwrap_or_default();
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
            packed
        };
        materials.iter().zip(btf_of).map(pack).collect()
    }
}

fn template(btf: &Btf, bases: Bases, base: u32, directions: &mut Vec<u32>) -> mirror::Material {
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
        map_side: map_side(manifest.lights.len()),
        view_directions: pack_directions(&btf.views, base, directions),
        light_directions: pack_directions(&btf.lights, base, directions),
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

/// Appends the words of a triangulation; `base` is the place of the first of `words` in the table.
fn pack_directions(triangulation: &Triangulation, base: u32, words: &mut Vec<u32>) -> mirror::Triangulation {
    let points = base + words.len() as u32;
    words.extend(
        triangulation
            .points
            .iter()
            .flatten()
            .map(|&coordinate| (coordinate as f32).to_bits()),
    );
    let triangles = base + words.len() as u32;
    words.extend(
        triangulation
            .triangles
            .iter()
            .flat_map(|triangle| [triangle.vertices, triangle.neighbours])
            .flatten(),
    );
    let hull = base + words.len() as u32;
    words.extend(triangulation.hull.iter().flatten());
    let start = base + words.len() as u32;
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
