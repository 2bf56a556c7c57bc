//! From a material's name to the samples of its BTF, one view at a time.
//!
//! A view takes three steps, each parallel over rows: rays down through the reference plane find cells of the surface; cells
//! seen for the first time get their content; all lights are added up per texel. The next view is traced while
//! the caller writes the last one.

use super::bounce::Bounce;
use super::materials::{self, Material};
use super::options::SynthOptions;
use super::random::{mix, unit};
use super::reflectance::{Lights, View, shade};
use super::surface::{CellKey, Surface};
use super::volume::Volume;
use crate::{Error, Result};
use glam::{Vec3, vec3};
use half::{f16, slice::HalfFloatSliceExt};
use rayon::prelude::*;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
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

/// What was done, and how fast.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SynthReport {
    /// Rays traced from above through texels.
    pub primary_rays: u64,
    /// Rays traced from the surface towards lights; each result is shared by all views.
    pub shadow_rays: u64,
    /// Rays traced from the surface to other places of the surface.
    pub bounce_rays: u64,
    /// Samples written: views · lights · texels, each of three numbers.
    pub samples: u64,
    /// Cells of the surface, each with its own reflectance and visible lights.
    pub surface_cells: u64,
    /// Seconds until the last block was handed over, waiting for the caller included.
    pub seconds: f64,
    /// Seconds of these before the first view: building the solid, and the bounce.
    pub build_seconds: f64,
    /// Largest sample.
    pub max_value: f32,
    /// Mean of all samples, linear RGB.
    pub mean_rgb: [f64; 3],
}

impl SynthReport {
    /// Rays of all kinds that were really traced, per second of the whole.
    pub fn rays_per_second(&self) -> f64 {
        (self.primary_rays + self.shadow_rays + self.bounce_rays) as f64 / self.seconds
    }

    /// Samples (one texel, view and light, three colours) per second of the whole.
    pub fn samples_per_second(&self) -> f64 {
        self.samples as f64 / self.seconds
    }
}

/// Ray traces `material` and hands the views to `sink` in order, each as one block `[light][rgb][y][x]`.
///
/// Samples are radiance factors with the light's cosine in: π·L/E, where E is the irradiance on a plane that faces
/// the light. Finite, not negative, linear RGB, not limited to 1. The patch repeats seamlessly in x and y; row
/// 0 is the top. `progress` hears how many views of how many are done. Both are called on the caller's thread.
///
/// # Errors
///
/// [`Error::UnknownMaterial`]; [`Error::Invalid`] for options outside of their limits; [`Error::Io`] with what `sink`
/// returned.
pub fn synthesize(
    material: &str,
    options: &SynthOptions,
    sink: &mut dyn FnMut(usize, &[f16]) -> std::io::Result<()>,
    progress: &dyn Fn(usize, usize),
) -> Result<SynthReport> {
    let start = Instant::now();
    let kind = materials::find(material)?;
    options.check(material)?;
    let failed = |source| Error::Io {
        path: material.into(),
        source,
    };
    let threads = rayon::ThreadPoolBuilder::new().num_threads(options.threads.unwrap_or(0));
    let pool = threads.build().map_err(|e| failed(std::io::Error::other(e)))?;

    // One block is written by the caller, one waits, one is being traced.
    let (send, receive) = sync_channel(1);
    let (give_back, spare) = sync_channel(3);
    let mut written = Ok(());
    let mut report = std::thread::scope(|scope| {
        let worker = scope.spawn(|| pool.install(|| trace(kind, options, send, spare)));
        for (view, block) in receive {
            written = sink(view, &block);
            if written.is_err() {
                break; // the worker's next send fails, and it stops
            }
            progress(view + 1, options.views.len());
            let _ = give_back.try_send(block);
        }
        worker
            .join()
            .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    });
    written.map_err(failed)?;
    report.seconds = start.elapsed().as_secs_f64();
    Ok(report)
}

fn unit_vector(direction: &Direction) -> Vec3 {
    let [x, y, z] = direction.to_vector();
    vec3(x as f32, y as f32, z as f32)
}

/// Traces all views; stops early when nobody takes them any more.
fn trace(
    kind: materials::Kind,
    options: &SynthOptions,
    send: SyncSender<(usize, Vec<f16>)>,
    spare: Receiver<Vec<f16>>,
) -> SynthReport {
    let start = Instant::now();
    let directions: Vec<Vec3> = options.lights.iter().map(unit_vector).collect();
    let lights = Lights::new(&directions);
    let voxels = (options.size * VOXELS_PER_TEXEL).clamp(MIN_VOXELS, MAX_VOXELS);
    let material: Box<dyn Material> = kind.make(options.seed, 1.0 / voxels as f32, &options.style);
    let volume = Volume::build(material.as_solid(), voxels as usize);
    let bounce = options
        .interreflection
        .then(|| Bounce::new(&volume, &*material, &lights));
    let mut report = SynthReport {
        bounce_rays: bounce.as_ref().map_or(0, |b| b.bounce_rays),
        shadow_rays: bounce.as_ref().map_or(0, |b| b.shadow_rays),
        build_seconds: start.elapsed().as_secs_f64(),
        ..SynthReport::default()
    };
    let mut surface = Surface::new(&volume, &*material, &lights, bounce);
    let size = options.size as usize;
    let texels = size * size;
    let samples = options.samples_per_texel as usize;
    let mut keys = vec![0; texels * samples];
    let mut sum_rgb = [0.0; 3];
    for (number, direction) in options.views.iter().enumerate() {
        let view = View::new(unit_vector(direction), &lights);
        surface.extend(&find_cells(&surface, &view, options, &mut keys));
        let mut block = spare
            .try_recv()
            .unwrap_or_else(|_| vec![f16::ZERO; lights.count * 3 * texels]);
        // A block is planes of rows; a row of texels needs its row in each plane.
        let mut rows: Vec<Vec<&mut [f16]>> =
            (0..size).map(|_| Vec::with_capacity(lights.count * 3)).collect();
        for (n, row) in block.chunks_mut(size).enumerate() {
            rows[n % size].push(row);
        }
        let work = rows.into_par_iter().zip(keys.par_chunks(size * samples));
        let found: Vec<RowSums> = work
            .map(|(mut row, keys)| shade_row(&surface, &view, keys, &mut row))
            .collect();
        for row in found {
            report.max_value = report.max_value.max(row.max);
            (0..3).for_each(|c| sum_rgb[c] += row.sum[c]);
        }
        report.primary_rays += keys.len() as u64;
        report.samples += (texels * lights.count) as u64;
        if send.send((number, block)).is_err() {
            break;
        }
    }
    report.shadow_rays += surface.shadow_rays();
    report.surface_cells = surface.cells() as u64;
    report.mean_rgb = sum_rgb.map(|s| s / report.samples as f64);
    report
}

/// Traces the rays of one view, writes `keys` as `[y][x][sample]`, and returns the new ones, ascending.
fn find_cells(
    surface: &Surface<'_>,
    view: &View,
    options: &SynthOptions,
    keys: &mut [CellKey],
) -> Vec<CellKey> {
    let (size, samples) = (options.size as usize, options.samples_per_texel as usize);
    let bands = keys.par_chunks_mut(size * samples * BAND).enumerate();
    let mut new: Vec<CellKey> = bands
        .flat_map_iter(|(band, keys)| {
            trace_band(surface, view, options, band * BAND, keys);
            let mut new: Vec<CellKey> = keys.iter().copied().filter(|&key| !surface.knows(key)).collect();
            new.sort_unstable();
            new.dedup();
            new
        })
        .collect();
    new.par_sort_unstable();
    new.dedup();
    new
}

/// Traces the rays of the rows from `top` on; `keys` is `[y][x][sample]`. Square by square, because rays that start
/// close together meet the same part of the volume while it is in the cache.
fn trace_band(surface: &Surface<'_>, view: &View, options: &SynthOptions, top: usize, keys: &mut [CellKey]) {
    let volume = surface.volume;
    let (size, samples) = (options.size as usize, options.samples_per_texel as usize);
    let voxels_per_texel = volume.side as f32 / size as f32;
    for left in (0..size).step_by(BAND) {
        for (y, row) in (top..).zip(keys.chunks_exact_mut(size * samples)) {
            for x in left..(left + BAND).min(size) {
                for (sample, key) in row[x * samples..][..samples].iter_mut().enumerate() {
                    let [sx, sy] = position_in_texel(options.seed, x, y, sample, samples);
                    // Row 0 is the top, y points up; grid samples lie at half voxels.
                    let across = (x as f32 + sx) * voxels_per_texel - 0.5;
                    let up = (size as f32 - y as f32 - sy) * voxels_per_texel - 0.5;
                    let origin = volume.above(vec3(across, up, volume.reference), view.direction);
                    // Downwards there is always the floor.
                    *key = surface.key(volume.march(origin, -view.direction).unwrap_or(origin));
                }
            }
        }
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
    let lights = surface.lights;
    let (padded, width) = (lights.padded(), planes[0].len());
    let samples = keys.len() / width;
    let scale = 1.0 / samples as f32;
    let mut sum = vec![0.0f32; 3 * padded];
    let mut scratch = vec![0.0f32; 4 * padded];
    let mut halves = vec![f16::ZERO; 3 * padded * TRANSPOSED_TEXELS];
    let mut found = RowSums {
        sum: [0.0; 3],
        max: 0.0,
    };
    for (first, keys) in (0..width)
        .step_by(TRANSPOSED_TEXELS)
        .zip(keys.chunks(TRANSPOSED_TEXELS * samples))
    {
        for (keys, halves) in keys.chunks(samples).zip(halves.chunks_mut(3 * padded)) {
            sum.fill(0.0);
            for &key in keys {
                let (point, lit, bounced) = surface.content(key);
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
