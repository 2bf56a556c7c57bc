//! Light that reaches a point by way of one other point of the surface.
//!
//! It varies slowly, so it is computed for patches: cubes of [`PATCH`] voxels through which the surface passes. Each
//! patch shoots rays over the hemisphere, distributed like the cosine, and adds up what the patches there reflect
//! diffusely of each light. A cell takes the patch at a place moved at random by up to half a patch, which blends
//! neighbouring patches over the samples of a texel.

use super::materials::Material;
use super::random::{mix, unit};
use super::reflectance::{BOUNCE_UNIT, LANES, Lights};
use super::surface::{LIFT, attributes, project, visible};
use super::volume::Volume;
use glam::Vec3;
use rayon::prelude::*;

/// Side of a patch in voxels.
const PATCH: usize = 4;
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

/// A patch before its light is known.
struct Patch {
    position: Vec3,
    normal: Vec3,
    albedo: Vec3,
    /// Cosine, or 0 where the light is not visible, per padded light.
    lit: Vec<f32>,
    shadow_rays: u64,
}

impl Bounce {
    pub(super) fn new(volume: &Volume, material: &dyn Material, lights: &Lights) -> Bounce {
        let keys = occupied(volume);
        let patches: Vec<Patch> = keys.par_iter().map(|&key| patch(volume, material, lights, key)).collect();
        let stride = 3 * lights.padded();
        let mut light = vec![0; keys.len() * stride];
        light.par_chunks_mut(stride).zip(&patches).zip(&keys).for_each(|((light, patch), &key)| {
            let mut sum = vec![0.0; stride];
            for hit in hemisphere(patch.normal, key)
                .filter_map(|direction| volume.march(patch.position + LIFT * patch.normal, direction))
                .filter_map(|p| keys.binary_search(&key_of(volume, p)).ok())
            {
                let other = &patches[hit];
                for (sum, albedo) in sum.chunks_mut(lights.padded()).zip(other.albedo.to_array()) {
                    for (sum, lit) in sum.iter_mut().zip(&other.lit) {
                        *sum += albedo * lit;
                    }
                }
            }
            for (light, sum) in light.iter_mut().zip(&sum) {
                *light = (sum * (1.0 / (RAYS as f32 * BOUNCE_UNIT)) + 0.5) as u16;
            }
        });
        let bounce_rays = (keys.len() * RAYS) as u64;
        let shadow_rays = patches.iter().map(|p| p.shadow_rays).sum();
        let normals = patches.iter().map(|p| p.normal).collect();
        Bounce { keys, normals, light, stride, bounce_rays, shadow_rays }
    }

    /// The patch whose light a cell at `position` takes; `seed` picks the random move.
    pub(super) fn patch_near(&self, volume: &Volume, position: Vec3, normal: Vec3, seed: u32) -> u32 {
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
        if patch == u32::MAX { &[] } else { &self.light[patch as usize * self.stride..][..self.stride] }
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
                let offset = Vec3::new((n % span) as f32, (n / span % span) as f32, (n / span / span) as f32);
                volume.nearest(volume.wrap(corner + offset)) < 0.0
            };
            let first = sample(0);
            (1..(PATCH + 1).pow(3)).any(|n| sample(n) != first)
        })
        .collect()
}

fn patch(volume: &Volume, material: &dyn Material, lights: &Lights, key: u32) -> Patch {
    let center = corner(volume, key) + PATCH as f32 * 0.5;
    let (position, normal) = project(volume, project(volume, center).0);
    // The patch's albedo is the mean of a few of its points.
    let frame = normal.any_orthonormal_pair();
    let mut albedo = Vec3::ZERO;
    for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
        let (position, normal) = project(volume, position + frame.0 * x + frame.1 * y);
        let found = attributes(volume, material, position, normal);
        albedo += 0.25 * (found.diffuse + 0.5 * found.specular).min(Vec3::splat(0.95));
    }
    let mut mask = vec![0; lights.mask_bytes()];
    let shadow_rays = visible(volume, lights, position, normal, &mut mask);
    let mut lit = vec![0.0; lights.padded()];
    for (light, lit) in lit.iter_mut().enumerate().take(lights.count) {
        if mask[light / LANES] >> (light % LANES) & 1 == 1 {
            *lit = normal.dot(lights.direction(light)).max(0.0);
        }
    }
    Patch { position, normal, albedo, lit, shadow_rays }
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
