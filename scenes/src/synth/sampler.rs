//! The samples of a material: which texels, under which views and lights, is asked for bit by bit.
//!
//! A view takes three steps, each parallel over texels: rays down through the reference plane find cells of the surface;
//! cells seen for the first time get their content; all lights are added up per texel. What cells hold is shared by all
//! that is asked for later. The first two steps are taken for several views at once.

use super::bounce::Bounce;
use super::ceiling::Ceilings;
use super::march::PACKET;
use super::materials::{self, Material};
use super::options::SynthOptions;
use super::random::{mix, unit};
use super::reflectance::{Lights, View, shade};
use super::surface::{CellKey, Surface};
use super::synthesize::SynthReport;
use super::volume::Volume;
use crate::Result;
use glam::{Vec3, vec3};
use half::{f16, slice::HalfFloatSliceExt};
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;
use tileset::Direction;

/// Voxels per texel, so that a cell of the surface is half a texel wide.
const VOXELS_PER_TEXEL: u32 = 2;
/// Voxels along a side of the patch at least, so that a small picture is one of the same material.
const MIN_VOXELS: u32 = 128;
/// Voxels along a side of the patch at most.
const MAX_VOXELS: u32 = 768;
/// Largest half float.
const LARGEST: f32 = 65504.0;
/// Rows that are traced together.
const BAND: usize = 8;
/// Texels that are transposed together from lights-of-a-texel to texels-of-a-light.
const TRANSPOSED_TEXELS: usize = 32;

/// Rays that are traced ahead at most, but for those of one view: 32 MiB of what they find.
const RAYS_AHEAD: usize = 1 << 23;

/// Texels of a list that are worked on together.
const LISTED: usize = 64;

/// Makes the solid of `material` and gives what samples it to `work`, which is run on the options' threads.
///
/// # Errors
///
/// [`crate::Error::UnknownMaterial`]; [`crate::Error::Invalid`] for options outside of their limits; [`crate::Error::Io`] where
/// threads cannot be started.
pub fn sample<T: Send>(
    material: &str,
    options: &SynthOptions,
    work: impl FnOnce(&mut Sampler<'_>) -> T + Send,
) -> Result<T> {
    let kind = materials::find(material)?;
    options.check(material)?;
    let pool = options.pool(material)?;
    Ok(pool.install(|| with_sampler(kind, options, work)))
}

/// Samples of a material.
///
/// They are radiance factors with the light's cosine in: π·L/E, where E is the irradiance on a plane that faces the light.
/// Finite, not negative, linear RGB, not limited to 1. The patch repeats seamlessly in x and y; row 0 is the
/// top. A sample does not depend on what else was asked for, or in which order.
pub struct Sampler<'a> {
    options: &'a SynthOptions,
    surface: Surface<'a>,
    ahead: Ahead,
    report: SynthReport,
    sums: [f64; 3],
    began: Instant,
}

/// What rays have found that were traced ahead. Neighbouring cells have their lights traced together, and there are more neighbours in what
/// several views see than in what one sees that the ones before did not.
#[derive(Default)]
struct Ahead {
    views: Range<usize>,
    /// Which texels; none: all.
    texels: Option<Vec<u32>>,
    /// Cells, `[view][texel][sample]`.
    keys: Vec<CellKey>,
}

pub(super) fn with_sampler<T>(
    kind: materials::Kind,
    options: &SynthOptions,
    work: impl FnOnce(&mut Sampler<'_>) -> T,
) -> T {
    let began = Instant::now();
    let directions: Vec<Vec3> = options.lights.iter().map(unit_vector).collect();
    let lights = Lights::new(&directions);
    let voxels = (options.size * VOXELS_PER_TEXEL).clamp(MIN_VOXELS, MAX_VOXELS);
    let material: Box<dyn Material> = kind.make(options.seed, 1.0 / voxels as f32, &options.style);
    let volume = Volume::build(material.as_solid(), voxels as usize);
    let ceilings = Ceilings::new(&volume, &lights);
    let bounce = options
        .interreflection
        .then(|| Bounce::new(&volume, &*material, &lights, &ceilings));
    let report = SynthReport {
        bounce_rays: bounce.as_ref().map_or(0, |b| b.bounce_rays),
        shadow_rays: bounce.as_ref().map_or(0, |b| b.shadow_rays),
        build_seconds: began.elapsed().as_secs_f64(),
        ..SynthReport::default()
    };
    work(&mut Sampler {
        options,
        surface: Surface::new(&volume, &*material, &lights, &ceilings, bounce),
        ahead: Ahead::default(),
        report,
        sums: [0.0; 3],
        began,
    })
}

fn unit_vector(direction: &Direction) -> Vec3 {
    let [x, y, z] = direction.to_vector();
    vec3(x as f32, y as f32, z as f32)
}

impl Sampler<'_> {
    /// From now on the first `lights` lights only, which saves the time that the others take. There is no way back: cells that
    /// are found from now on do not know whether the others reach them.
    pub fn narrow(&mut self, lights: usize) {
        self.surface.narrow(lights);
    }

    /// Samples of all texels from one view, `[light][rgb][y][x]`.
    ///
    /// # Panics
    ///
    /// If there is no such view, or the block has another size.
    pub fn all(&mut self, view: usize, block: &mut [f16]) {
        let size = self.options.size as usize;
        self.look(view, None);
        self.shade(view, size * size, size, block);
    }

    /// Samples of some texels, named by y·size + x, from one view: `[light][rgb][texel]`, in the order of `texels`.
    ///
    /// # Panics
    ///
    /// If there is no such view or texel, or the block has another size.
    pub fn some(&mut self, view: usize, texels: &[u32], block: &mut [f16]) {
        let size = self.options.size;
        assert!(
            texels.iter().all(|&texel| texel < size * size),
            "texels of the patch"
        );
        self.look(view, Some(texels));
        self.shade(view, texels.len(), LISTED, block);
    }

    /// What was done so far.
    pub fn report(&self) -> SynthReport {
        SynthReport {
            shadow_rays: self.report.shadow_rays + self.surface.shadow_rays(),
            surface_cells: self.surface.cells() as u64,
            mean_rgb: self.sums.map(|sum| sum / self.report.samples.max(1) as f64),
            seconds: self.began.elapsed().as_secs_f64(),
            ..self.report
        }
    }

    /// Traces the rays of the view and of those that will be asked for next, unless that was done before.
    fn look(&mut self, view: usize, texels: Option<&[u32]>) {
        if self.ahead.views.contains(&view) && self.ahead.texels.as_deref() == texels {
            return;
        }
        let (options, size) = (self.options, self.options.size as usize);
        let count = texels.map_or(size * size, <[u32]>::len);
        let rays = (count * options.samples_per_texel as usize).max(1);
        assert!(view < options.views.len(), "a view of the options");
        let last = options.views.len().min(view + (RAYS_AHEAD / rays).max(1));
        self.ahead.views = view..last;
        self.ahead.texels = texels.map(<[u32]>::to_vec);
        self.ahead.keys.resize((last - view) * rays, 0);
        let (surface, mut new) = (&self.surface, Vec::new());
        for (view, keys) in (view..last).zip(self.ahead.keys.chunks_exact_mut(rays)) {
            let direction = unit_vector(&options.views[view]);
            new.extend(match texels {
                None => trace_all(surface, direction, options, keys),
                Some(texels) => trace_some(surface, direction, options, texels, keys),
            });
        }
        new.par_sort_unstable();
        new.dedup();
        self.surface.extend(&new);
    }

    /// One view, whose rays are traced, of so many texels, in rows of `width`.
    fn shade(&mut self, view: usize, texels: usize, width: usize, block: &mut [f16]) {
        let lights = self.surface.active.count;
        assert_eq!(block.len(), lights * 3 * texels, "samples of a view");
        let samples = self.options.samples_per_texel as usize;
        let keys = &self.ahead.keys[(view - self.ahead.views.start) * texels * samples..][..texels * samples];
        let view = View::new(unit_vector(&self.options.views[view]), &self.surface.active);
        // A block is planes of rows; a row of texels needs its row in each plane.
        let mut rows: Vec<Vec<&mut [f16]>> = (0..texels.div_ceil(width))
            .map(|_| Vec::with_capacity(lights * 3))
            .collect();
        for plane in block.chunks_mut(texels.max(1)) {
            for (rows, row) in rows.iter_mut().zip(plane.chunks_mut(width)) {
                rows.push(row);
            }
        }
        let work = rows.into_par_iter().zip(keys.par_chunks(width * samples));
        let found: Vec<RowSums> = work
            .map(|(mut row, keys)| shade_row(&self.surface, &view, keys, &mut row))
            .collect();
        for row in found {
            self.report.max_value = self.report.max_value.max(row.max);
            (0..3).for_each(|c| self.sums[c] += row.sum[c]);
        }
        self.report.primary_rays += keys.len() as u64;
        self.report.samples += (texels * lights) as u64;
    }
}

/// Traces the rays of all texels; the cells that have no content yet.
fn trace_all(
    surface: &Surface<'_>,
    view: Vec3,
    options: &SynthOptions,
    keys: &mut [CellKey],
) -> Vec<CellKey> {
    let band = options.size as usize * options.samples_per_texel as usize * BAND;
    let bands = keys.par_chunks_mut(band).enumerate();
    bands
        .flat_map_iter(|(band, keys)| {
            trace_band(surface, view, options, band * BAND, keys);
            unknown(surface, keys)
        })
        .collect()
}

/// Traces the rays of some texels; the cells that have no content yet.
fn trace_some(
    surface: &Surface<'_>,
    view: Vec3,
    options: &SynthOptions,
    texels: &[u32],
    keys: &mut [CellKey],
) -> Vec<CellKey> {
    let (size, samples) = (options.size, options.samples_per_texel as usize);
    let lists = keys
        .par_chunks_mut(LISTED * samples)
        .zip(texels.par_chunks(LISTED));
    lists
        .flat_map_iter(|(keys, texels)| {
            let mut rays = Rays::new(surface, view, options);
            for (n, &texel) in texels.iter().enumerate() {
                let (x, y) = ((texel % size) as usize, (texel / size) as usize);
                rays.texel(x, y, n * samples, keys);
            }
            rays.trace(keys);
            unknown(surface, keys)
        })
        .collect()
}

/// The cells that have no content yet, ascending and each once.
fn unknown(surface: &Surface<'_>, keys: &[CellKey]) -> Vec<CellKey> {
    let mut new: Vec<CellKey> = keys.iter().copied().filter(|&key| !surface.knows(key)).collect();
    new.sort_unstable();
    new.dedup();
    new
}

/// Traces the rays of the rows from `top` on; `keys` is `[y][x][sample]`. Square by square, because rays that start
/// close together meet the same part of the volume while it is in the cache.
fn trace_band(surface: &Surface<'_>, view: Vec3, options: &SynthOptions, top: usize, keys: &mut [CellKey]) {
    let (size, samples) = (options.size as usize, options.samples_per_texel as usize);
    let rows = keys.len() / (size * samples);
    let mut rays = Rays::new(surface, view, options);
    for left in (0..size).step_by(BAND) {
        let width = BAND.min(size - left);
        for y in 0..rows {
            for x in left..left + width {
                rays.texel(x, top + y, (y * size + x) * samples, keys);
            }
        }
    }
    rays.trace(keys);
}

/// Rays that wait to be traced together.
struct Rays<'a> {
    surface: &'a Surface<'a>,
    view: Vec3,
    options: &'a SynthOptions,
    origins: Vec<Vec3>,
    /// Where their cells are wanted.
    places: Vec<usize>,
}

impl<'a> Rays<'a> {
    fn new(surface: &'a Surface<'_>, view: Vec3, options: &'a SynthOptions) -> Rays<'a> {
        Rays {
            surface,
            view,
            options,
            origins: Vec::with_capacity(PACKET),
            places: Vec::with_capacity(PACKET),
        }
    }

    /// Adds the rays of one texel, whose cells are wanted from `place` in `keys` on.
    fn texel(&mut self, x: usize, y: usize, place: usize, keys: &mut [CellKey]) {
        let (volume, size) = (self.surface.volume, self.options.size as usize);
        let samples = self.options.samples_per_texel as usize;
        let voxels_per_texel = volume.side as f32 / size as f32;
        for sample in 0..samples {
            if self.origins.len() == PACKET {
                self.trace(keys);
            }
            let [sx, sy] = position_in_texel(self.options.seed, x, y, sample, samples);
            // Row 0 is the top, y points up; grid samples lie at half voxels.
            let across = (x as f32 + sx) * voxels_per_texel - 0.5;
            let up = (size as f32 - y as f32 - sy) * voxels_per_texel - 0.5;
            let origin = volume.above(vec3(across, up, volume.reference), self.view);
            self.origins.push(origin);
            self.places.push(place + sample);
        }
    }

    /// Traces what waits.
    fn trace(&mut self, keys: &mut [CellKey]) {
        let (surface, origins, places) = (self.surface, &self.origins, &self.places);
        let volume = surface.volume;
        volume.march_all(origins, -self.view, |n, end| {
            // Downwards there is always the floor.
            keys[places[n]] = surface.key(end.unwrap_or(origins[n]));
        });
        self.origins.clear();
        self.places.clear();
    }
}

/// Where in its texel a sample lies: stratified in both axes (Hammersley points), and moved around by a random offset
/// per texel that is the same for all views.
fn position_in_texel(seed: u64, x: usize, y: usize, sample: usize, samples: usize) -> [f32; 2] {
    let random = mix(mix(seed as u32 ^ (x as u32) << 16 ^ y as u32) ^ (seed >> 32) as u32);
    let stratum = (sample as f32 + 0.5) / samples as f32;
    let inverse = unit((sample as u32).reverse_bits());
    [
        (stratum + unit(random)).fract(),
        (inverse + unit(mix(random))).fract(),
    ]
}

/// What the report wants to know of a row.
struct RowSums {
    sum: [f64; 3],
    max: f32,
}

/// Shades one row of texels; `keys` is `[x][sample]`, `planes` the row in each plane `[light][rgb]`.
fn shade_row(surface: &Surface<'_>, view: &View, keys: &[CellKey], planes: &mut [&mut [f16]]) -> RowSums {
    #[cfg(target_arch = "x86_64")]
    {
        /// The same code for wider registers. Without fused multiplication, so that the result is the same.
        #[target_feature(enable = "avx2")]
        fn wide(surface: &Surface<'_>, view: &View, keys: &[CellKey], planes: &mut [&mut [f16]]) -> RowSums {
            shade_row_generic(surface, view, keys, planes)
        }
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has the feature.
            return unsafe { wide(surface, view, keys, planes) };
        }
    }
    shade_row_generic(surface, view, keys, planes)
}

#[inline(always)]
fn shade_row_generic(
    surface: &Surface<'_>,
    view: &View,
    keys: &[CellKey],
    planes: &mut [&mut [f16]],
) -> RowSums {
    let lights = &surface.active;
    let (padded, width) = (lights.padded(), planes[0].len());
    let samples = keys.len() / width;
    let scale = 1.0 / samples as f32;
    let mut sum = vec![0.0f32; 3 * padded];
    let mut scratch = vec![0.0f32; 4 * padded];
    let mut halves = vec![f16::ZERO; 3 * padded * TRANSPOSED_TEXELS];
    let mut cells = Vec::with_capacity(TRANSPOSED_TEXELS * samples);
    let mut contents = Vec::with_capacity(TRANSPOSED_TEXELS * samples);
    let mut found = RowSums {
        sum: [0.0; 3],
        max: 0.0,
    };
    for (first, keys) in (0..width)
        .step_by(TRANSPOSED_TEXELS)
        .zip(keys.chunks(TRANSPOSED_TEXELS * samples))
    {
        // Cells lie anywhere in memory: of many at once first where, then what.
        cells.clear();
        cells.extend(keys.iter().map(|&key| surface.place(key)));
        contents.clear();
        contents.extend(cells.iter().map(|&cell| surface.content(cell)));
        for (contents, halves) in contents.chunks(samples).zip(halves.chunks_mut(3 * padded)) {
            sum.fill(0.0);
            for (point, lit, bounced) in contents {
                shade(point, lit, bounced, view, lights, &mut scratch, &mut sum);
            }
            for (channel, total) in sum.chunks_mut(padded).zip(&mut found.sum) {
                let mut channel_sum = [0.0; 8];
                for value in channel.chunks_exact_mut(8) {
                    for (value, channel_sum) in value.iter_mut().zip(&mut channel_sum) {
                        *value = (*value * scale).min(LARGEST);
                        *channel_sum += *value;
                    }
                }
                *total += f64::from(channel_sum.iter().sum::<f32>());
            }
            found.max = sum.iter().fold(found.max, |max, &value| max.max(value));
            halves.convert_from_f32_slice(&sum);
        }
        let count = keys.len() / samples;
        for (n, plane) in planes.iter_mut().enumerate() {
            let (light, channel) = (n / 3, n % 3);
            for (texel, value) in plane[first..first + count].iter_mut().enumerate() {
                *value = halves[(texel * 3 + channel) * padded + light];
            }
        }
    }
    found
}
