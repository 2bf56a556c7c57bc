//! Light that reaches a point by way of one other point of the surface.
//!
//! It varies slowly, so it is computed for patches: cubes of [`PATCH`] voxels through which the surface passes. Each
//! patch shoots rays over the hemisphere, distributed like the cosine, and adds up what the patches there reflect
//! diffusely of each light. A cell takes the patch at a place moved at random by up to half a patch, which blends
//! neighbouring patches over the samples of a texel.

use super::ceiling::Ceilings;
use super::materials::Material;
use super::random::{mix, unit};
use super::reflectance::{BOUNCE_UNIT, LANES, Lights};
use super::surface::{LIFT, Place, attributes, project, visible};
use super::volume::Volume;
use glam::Vec3;
use rayon::prelude::*;

/// Side of a patch in voxels.
const PATCH: usize = 4;
/// Patches whose shadow rays are traced together.
const BLOCK: usize = 64;
/// Rays per patch.
const RAYS: usize = 24;

/// Bounced light of all patches.
pub(super) struct Bounce {
    /// Patches, ascending.
    keys: Vec<u32>,
    /// Normals of the patches.
    normals: Vec<Vec3>,
    /// `[patch][rgb][light]`, padded lights, in [`BOUNCE_UNIT`].
    light: Vec<u16>,
    stride: usize,
    /// Rays traced over hemispheres.
    pub(super) bounce_rays: u64,
    /// Rays traced towards lights.
    pub(super) shadow_rays: u64,
}

impl Bounce {
    pub(super) fn new(
        volume: &Volume,
        material: &dyn Material,
        lights: &Lights,
        ceilings: &Ceilings,
    ) -> Bounce {
        let keys = occupied(volume);
        let padded = lights.padded();
        let places: Vec<Place> = keys.par_iter().map(|&key| place(volume, key)).collect();
        let albedo: Vec<Vec3> = places
            .par_iter()
            .map(|place| mean_albedo(volume, material, place))
            .collect();
        // Cosine, or 0 where the light is not visible, per padded light.
        let mut lit = vec![0.0f32; keys.len() * padded];
        let work = lit.par_chunks_mut(BLOCK * padded).zip(places.par_chunks(BLOCK));
        let shadow_rays = work
            .map(|(lit, places)| direct_light(volume, lights, ceilings, places, lit))
            .sum();
        let mut light = vec![0; keys.len() * 3 * padded];
        light
            .par_chunks_mut(3 * padded)
            .zip(&places)
            .zip(&keys)
            .for_each(|((light, place), &key)| {
                let mut sum = vec![0.0; 3 * padded];
                for hit in hemisphere(place.normal, key)
                    .filter_map(|direction| volume.march(place.position + LIFT * place.normal, direction))
                    .filter_map(|p| keys.binary_search(&key_of(volume, p)).ok())
                {
                    let lit = &lit[hit * padded..][..padded];
                    for (sum, albedo) in sum.chunks_mut(padded).zip(albedo[hit].to_array()) {
                        for (sum, lit) in sum.iter_mut().zip(lit) {
                            *sum += albedo * lit;
                        }
                    }
                }
                for (light, sum) in light.iter_mut().zip(&sum) {
                    *light = (sum * (1.0 / (RAYS as f32 * BOUNCE_UNIT)) + 0.5) as u16;
                }
            });
        let bounce_rays = (keys.len() * RAYS) as u64;
        let normals = places.iter().map(|place| place.normal).collect();
        Bounce {
            keys,
            normals,
            light,
            stride: 3 * padded,
            bounce_rays,
            shadow_rays,
        }
    }

    /// The patch whose light a cell at `place` takes; `seed` picks the random move.
    pub(super) fn patch_near(&self, volume: &Volume, place: &Place, seed: u32) -> u32 {
        let Place { position, normal } = *place;
        let random = |n: u32| unit(mix(seed ^ mix(n))) - 0.5;
        let moved = PATCH as f32 * Vec3::new(random(1), random(2), random(3));
        let along = moved - normal * normal.dot(moved);
        let find = |p: Vec3| self.keys.binary_search(&key_of(volume, volume.wrap(p))).ok();
        find(position + along)
            .filter(|&patch| self.normals[patch].dot(normal) > 0.3)
            .or_else(|| find(position))
            .map_or(u32::MAX, |patch| patch as u32)
    }

    /// Bounced light of a patch, `[rgb][light]`; empty if there is no such patch.
    #[inline(always)]
    pub(super) fn light(&self, patch: u32) -> &[u16] {
        if patch == u32::MAX {
            &[]
        } else {
            &self.light[patch as usize * self.stride..][..self.stride]
        }
    }
}

fn levels(volume: &Volume) -> usize {
    volume.depth.div_ceil(PATCH)
}

fn key_of(volume: &Volume, p: Vec3) -> u32 {
    let side = volume.side / PATCH;
    let axis = |v: f32, count: usize| (v.max(0.0) as usize / PATCH).min(count - 1);
    ((axis(p.y, side) * side + axis(p.x, side)) * levels(volume) + axis(p.z, levels(volume))) as u32
}

/// Corner of a patch in grid coordinates.
fn corner(volume: &Volume, key: u32) -> Vec3 {
    let (column, k) = (key as usize / levels(volume), key as usize % levels(volume));
    let side = volume.side / PATCH;
    Vec3::new((column % side) as f32, (column / side) as f32, k as f32) * PATCH as f32
}

/// Patches that contain both air and solid.
fn occupied(volume: &Volume) -> Vec<u32> {
    let side = volume.side / PATCH;
    (0..(side * side * levels(volume)) as u32)
        .into_par_iter()
        .filter(|&key| {
            let corner = corner(volume, key);
            let center = volume.nearest(corner + PATCH as f32 * 0.5);
            if center > 2.0 * PATCH as f32 {
                return false;
            }
            let sample = |n: usize| {
                let span = PATCH + 1;
                let offset = Vec3::new(
                    (n % span) as f32,
                    (n / span % span) as f32,
                    (n / span / span) as f32,
                );
                volume.nearest(volume.wrap(corner + offset)) < 0.0
            };
            let first = sample(0);
            (1..(PATCH + 1).pow(3)).any(|n| sample(n) != first)
        })
        .collect()
}

fn place(volume: &Volume, key: u32) -> Place {
    let center = corner(volume, key) + PATCH as f32 * 0.5;
    project(volume, project(volume, center).position)
}

/// What a few points of a patch reflect of all light, on average; half of the glossy part counts.
fn mean_albedo(volume: &Volume, material: &dyn Material, place: &Place) -> Vec3 {
    let (right, up) = place.normal.any_orthonormal_pair();
    let corners = [right + up, right - up, -right + up, -right - up];
    let albedo = |offset: Vec3| {
        let found = attributes(volume, material, &project(volume, place.position + offset));
        (found.diffuse + 0.5 * found.specular).clamp(Vec3::ZERO, Vec3::splat(0.95))
    };
    0.25 * corners.into_iter().map(albedo).sum::<Vec3>()
}

/// Writes the cosines of visible lights, `[patch][light]`, and counts the rays that this took.
fn direct_light(
    volume: &Volume,
    lights: &Lights,
    ceilings: &Ceilings,
    places: &[Place],
    lit: &mut [f32],
) -> u64 {
    let (padded, bytes) = (lights.padded(), lights.mask_bytes());
    let mut masks = vec![0; places.len() * bytes];
    let rays = visible(volume, lights, ceilings, places, &mut masks);
    for ((lit, mask), place) in lit.chunks_mut(padded).zip(masks.chunks(bytes)).zip(places) {
        for (light, lit) in lit.iter_mut().enumerate().take(lights.count) {
            if mask[light / LANES] >> (light % LANES) & 1 == 1 {
                *lit = place.normal.dot(lights.direction(light)).max(0.0);
            }
        }
    }
    rays
}

/// Directions around `normal`, distributed like the cosine: a spiral on the disc, turned at random.
fn hemisphere(normal: Vec3, seed: u32) -> impl Iterator<Item = Vec3> {
    /// The golden angle spreads the points of a spiral evenly (Vogel 1979).
    const GOLDEN_ANGLE: f32 = 2.399_963_2;
    let (x, y) = normal.any_orthonormal_pair();
    let turn = unit(mix(seed)) * std::f32::consts::TAU;
    (0..RAYS).map(move |n| {
        let squared = (n as f32 + 0.5) / RAYS as f32;
        let (sin, cos) = (turn + n as f32 * GOLDEN_ANGLE).sin_cos();
        (squared.sqrt() * (cos * x + sin * y) + (1.0 - squared).sqrt() * normal).normalize()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hemisphere_is_cosine_distributed() {
        let normal = Vec3::new(0.6, 0.0, 0.8);
        let mean: f32 = hemisphere(normal, 3).map(|d| d.dot(normal)).sum::<f32>() / RAYS as f32;
        assert!((mean - 2.0 / 3.0).abs() < 0.01, "{mean}");
        assert!(hemisphere(normal, 3).all(|d| d.dot(normal) > 0.0));
    }
}
