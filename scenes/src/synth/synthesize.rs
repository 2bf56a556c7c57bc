//! From a material's name to all samples of its BTF, one view at a time: the next view is traced while the caller
//! writes the last one.

use super::materials;
use super::options::SynthOptions;
use super::sampler::{Sampler, with_sampler};
use crate::{Error, Result};
use half::f16;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Instant;

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
    let pool = options.pool(material)?;

    // One block is written by the caller, one waits, one is being traced.
    let (send, receive) = sync_channel(1);
    let (give_back, spare) = sync_channel(3);
    let mut written = Ok(());
    let mut report = std::thread::scope(|scope| {
        let trace = move |sampler: &mut Sampler<'_>| trace(sampler, options, &send, &spare);
        let worker = scope.spawn(move || pool.install(move || with_sampler(kind, options, trace)));
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

/// Traces all views; stops early when nobody takes them any more.
fn trace(
    sampler: &mut Sampler<'_>,
    options: &SynthOptions,
    send: &SyncSender<(usize, Vec<f16>)>,
    spare: &Receiver<Vec<f16>>,
) -> SynthReport {
    let samples = options.lights.len() * 3 * (options.size as usize).pow(2);
    for view in 0..options.views.len() {
        let mut block = spare.try_recv().unwrap_or_else(|_| vec![f16::ZERO; samples]);
        sampler.all(view, &mut block);
        if send.send((view, block)).is_err() {
            break;
        }
    }
    sampler.report()
}
