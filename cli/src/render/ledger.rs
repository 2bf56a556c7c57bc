//! From the errors that archives state to the error of a picture that they predict.
//!
//! A material's ledger is the root mean square error of its reflectance ρ over all texels and directions. Outgoing
//! radiance is Σ_lights ρ/π·E (ρ·cos θ where the cosine is left out) and ambient light times a mean of ρ. The
//! errors under several lights at one point come from the same factors, so they are added as they are, not
//! in squares: what is predicted is what is to be expected at most where directions and texels are seen evenly.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use engine::reference::{Incident, Placed, Rays};
use engine::stream::{self, OpenOptions, Request};
use scenes::{Camera, Scene, Surface};
use tileset::SLOT_AREA;
use tileset::archive::Index;

/// Longest time for the manifests.
const PATIENCE: Duration = Duration::from_secs(60);

/// What the archives of a scene say about their errors.
pub(crate) struct Ledgers {
    by_archive: BTreeMap<String, Stated>,
}

/// The error of an archive.
#[derive(Clone, Copy)]
struct Stated {
    rms: f64,
    cosine: bool,
    /// Texels of a column, with one more light for the ambient term.
    column_texels: u64,
    /// Pages and columns of the archive.
    pages: u32,
    columns: u32,
}

impl Ledgers {
    /// Asks for the manifests of all archives that a scene names.
    pub(crate) fn fetch(tiles: &str, options: &OpenOptions, scene: &Scene) -> Result<Self> {
        let mut source = stream::open_with(tiles, options)?;
        let mut wanted: Vec<Arc<str>> = scene.archives().into_iter().map(Arc::from).collect();
        let mut by_archive = BTreeMap::new();
        let (total, start) = (wanted.len(), Instant::now());
        while by_archive.len() < total {
            while let Some(archive) = wanted.pop() {
                if source
                    .submit(Request::Index {
                        archive: archive.clone(),
                    })
                    .is_none()
                {
                    wanted.push(archive);
                    break;
                }
            }
            source.wait(Duration::from_millis(100));
            while let Some(answer) = source.poll() {
                let name = answer.request.archive().to_string();
                let index = Index::parse(&answer.bytes?).with_context(|| name.clone())?;
                let manifest = &index.manifest;
                let column_texels = (manifest.column_texels() + 3 * manifest.views.len()) as u64;
                let rms = manifest.errors.total_rms();
                by_archive.insert(
                    name,
                    Stated {
                        rms,
                        cosine: manifest.cosine,
                        column_texels,
                        pages: index.pages().len() as u32,
                        columns: index.columns().len() as u32,
                    },
                );
            }
            if start.elapsed() > PATIENCE {
                bail!(
                    "{tiles}: the manifests have not come within {} s",
                    PATIENCE.as_secs()
                );
            }
        }
        Ok(Self { by_archive })
    }

    /// A budget that [`super::budgeted`] splits so that as many pages and columns have room.
    pub(crate) fn cache_bytes(&self, pages: u32, columns: u32) -> u64 {
        const TEXEL_BYTES: u64 = 8; // four half floats
        let column_texels = self
            .by_archive
            .values()
            .map(|stated| stated.column_texels)
            .max()
            .unwrap_or(0);
        // One more of each: budgets are rounded down to whole slots.
        let page_bytes = (u64::from(pages) + 1) * SLOT_AREA as u64 * TEXEL_BYTES;
        let column_bytes = (u64::from(columns) + 1) * column_texels * TEXEL_BYTES;
        (page_bytes * 3 / 2).max(column_bytes * 3)
    }

    /// A budget with room for all pages and columns of all archives.
    pub(crate) fn ample_bytes(&self) -> u64 {
        let sum =
            |value: fn(&Stated) -> u32| self.by_archive.values().map(value).fold(0, u32::saturating_add);
        self.cache_bytes(sum(|stated| stated.pages), sum(|stated| stated.columns))
    }

    /// Stated errors by archive.
    pub(crate) fn rms(&self) -> BTreeMap<String, f64> {
        self.by_archive
            .iter()
            .map(|(name, stated)| (name.clone(), stated.rms))
            .collect()
    }

    /// Root mean square error of radiance over the pixels that show a BTF, as the ledgers predict it, with
    /// `residency_rms` of reflectance for what is not resident.
    pub(crate) fn predict(
        &self,
        scene: &Scene,
        camera: &Camera,
        size: (u32, u32),
        visibility: &[[u32; 2]],
        residency_rms: f64,
    ) -> f64 {
        let rays = Rays::new(camera, size);
        let placed: Vec<_> = (0..scene.instances.len())
            .map(|at| Placed::new(scene, at, rays.eye))
            .collect();
        let (mut sum, mut count) = (0.0, 0u64);
        for (at, [instance, triangle]) in visibility.iter().enumerate() {
            let (x, y) = ((at % size.0 as usize) as u32, (at / size.0 as usize) as u32);
            let placed = (*instance as usize)
                .checked_sub(1)
                .and_then(|instance| placed.get(instance)?.as_ref());
            let Some(point) = placed.and_then(|placed| placed.meet(*triangle, &rays, x, y)) else {
                continue;
            };
            let Some(Surface::Btf { archive, .. }) = scene
                .materials
                .get(point.material)
                .map(|material| &material.surface)
            else {
                continue;
            };
            let Some(stated) = self.by_archive.get(archive) else {
                continue;
            };
            // How many units of radiance stand for one of reflectance.
            let mut gain = scene.ambient.as_dvec3();
            for light in &scene.lights {
                if let Some(incident) = Incident::new(light, &point, rays.eye)
                    && incident.direction.z > 0.0
                {
                    let cosine = if stated.cosine { 1.0 } else { incident.direction.z };
                    gain += incident.irradiance * (cosine / PI);
                }
            }
            sum += (stated.rms.powi(2) + residency_rms.powi(2)) * gain.length_squared() / 3.0;
            count += 1;
        }
        if count > 0 {
            (sum / count as f64).sqrt()
        } else {
            0.0
        }
    }
}
