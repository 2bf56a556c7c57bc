//! The pictures of the demo: refinement by bytes, three caches, and the flight.

use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, ensure};
use engine::frame::{Engine, FrameStats};
use engine::gpu::Context;
use engine::metrics::{Comparison, compare};
use engine::stream::{HttpOptions, HttpSource, Network, NetworkSource, TileSource};
use scenes::lone::Shape;
use scenes::{Camera, CameraPath, Scene};
use serde::Serialize;

use crate::progress;
use crate::render::picture::{write_png, write_shown};
use crate::render::reference::Truth;
use crate::render::{budgeted, settle};

/// Shares of all bytes after which a picture is kept, percent.
const SHARES: [u32; 4] = [1, 5, 25, 100];
/// Frames from one of these pictures to the next, about.
const STEPS: u64 = 4;
/// Longest time for one refinement.
const PATIENCE: Duration = Duration::from_secs(600);
/// Pixels of thumbnails, and what may be used for them.
const THUMBNAIL: (u32, u32) = (240, 180);
const THUMBNAIL_CACHE_BYTES: u64 = 64 << 20;
/// How long to let the network work when a frame brought nothing.
const PAUSE: Duration = Duration::from_millis(20);

/// What all shots share.
pub(crate) struct Studio<'a> {
    pub(crate) context: Context,
    pub(crate) scene: &'a Scene,
    pub(crate) camera: Camera,
    pub(crate) size: (u32, u32),
    pub(crate) address: &'a str,
    pub(crate) folder: &'a Path,
    pub(crate) quiet: bool,
}

/// A picture, what it took, and how far it is from the reference.
#[derive(Serialize)]
pub(crate) struct Shot {
    pub(crate) file: String,
    pub(crate) label: String,
    /// Budget of the caches.
    pub(crate) cache_bytes: u64,
    /// Bytes over the wire until then.
    pub(crate) wire_bytes: u64,
    /// Bytes allocated on the GPU and on the host.
    pub(crate) gpu_bytes: u64,
    pub(crate) host_bytes: u64,
    pub(crate) pages_resident: u32,
    pub(crate) columns_resident: u32,
    /// Error of reflectance that is predicted for what is not resident.
    pub(crate) predicted_rms: f64,
    pub(crate) seconds: f64,
    pub(crate) quality: Comparison,
}

impl Studio<'_> {
    pub(crate) fn engine(
        &self,
        cache_bytes: u64,
        source: Box<dyn TileSource>,
        size: (u32, u32),
    ) -> Result<Engine> {
        Ok(Engine::new(
            self.context.clone(),
            self.scene,
            source,
            budgeted(size, cache_bytes),
        )?)
    }

    pub(crate) fn http(&self) -> Result<HttpSource> {
        Ok(HttpSource::new(self.address, &HttpOptions::default())?)
    }

    /// Small pictures of the scene and of each archive on a ball, for the tile server's list.
    pub(crate) fn thumbnails(&self, tiles: &Path) -> Result<()> {
        let lone = |name: &str| scenes::lone::lone(name, Shape::Sphere);
        let archives = self.scene.archives();
        let subjects = archives.iter().map(|name| (*name, lone(name)));
        for (name, scene) in subjects.chain([("scene", self.scene.clone())]) {
            let camera = *scene.cameras.first().context("the scene has no camera")?;
            let options = budgeted(THUMBNAIL, THUMBNAIL_CACHE_BYTES);
            let mut engine = Engine::new(self.context.clone(), &scene, Box::new(self.http()?), options)?;
            engine.wait_for_materials(PATIENCE)?;
            settle(&mut engine, &camera)?;
            write_png(
                &tiles.join(format!("{name}.png")),
                THUMBNAIL,
                &engine.tonemapped()?,
            )?;
        }
        Ok(())
    }

    /// Settles with a cache of this size.
    pub(crate) fn settled(&self, cache_bytes: u64, truth: &Truth, file: &str) -> Result<Shot> {
        let start = Instant::now();
        let mut engine = self.engine(cache_bytes, Box::new(self.http()?), self.size)?;
        let bar = progress::spinner(
            &format!("cache of {}", crate::bytes::text(cache_bytes)),
            self.quiet,
        );
        let frames = settle(&mut engine, &self.camera);
        bar.finish_and_clear();
        let stats = frames?.last().copied().context("no frame was drawn")?;
        let label = format!("cache of {}", crate::bytes::text(cache_bytes));
        self.keep(&mut engine, &stats, truth, file.into(), label, cache_bytes, start)
    }

    /// Pictures after given shares of `total_bytes` have come over a line that is as slow as the pictures are.
    pub(crate) fn refinement(&self, cache_bytes: u64, total_bytes: u64, truth: &Truth) -> Result<Vec<Shot>> {
        let start = Instant::now();
        // A byte in a microsecond.
        let network = Network {
            bits_per_second: 8_000_000,
            ..Network::default()
        };
        // The engine has one end of it, and the demo a hand on the valve.
        let line = Rc::new(RefCell::new(NetworkSource::new(self.http()?, network, 0)));
        let mut engine = self.engine(cache_bytes, Box::new(line.clone()), self.size)?;
        let bar = progress::bar("refinement (bytes)", total_bytes, self.quiet);
        let mut shots = Vec::new();
        for share in SHARES {
            let target = total_bytes * u64::from(share) / 100;
            // A few frames from one picture to the next.
            let step = target.saturating_sub(line.borrow().network_stats().delivered_bytes) / STEPS + 1;
            let stats = loop {
                let delivered = line.borrow().network_stats().delivered_bytes;
                line.borrow_mut().advance(Duration::from_micros(step));
                let stats = engine.frame(&self.camera)?;
                bar.set_position(line.borrow().network_stats().delivered_bytes);
                let arrived = line.borrow().network_stats().delivered_bytes;
                if stats.settled || (arrived >= target && share < 100) {
                    break stats;
                }
                ensure!(
                    start.elapsed() < PATIENCE,
                    "the refinement has not ended within {} s",
                    PATIENCE.as_secs()
                );
                if arrived == delivered {
                    line.borrow_mut().wait(PAUSE);
                }
            };
            let (file, label) = (
                format!("refinement_{share:03}.png"),
                format!("{share} % of the bytes"),
            );
            shots.push(self.keep(&mut engine, &stats, truth, file, label, cache_bytes, start)?);
        }
        bar.finish_and_clear();
        Ok(shots)
    }

    /// Frames along a path with a small cache, as they are while materials arrive.
    pub(crate) fn flight(
        &self,
        path: &CameraPath,
        count: usize,
        size: (u32, u32),
        cache_bytes: u64,
    ) -> Result<Vec<FrameStats>> {
        let mut engine = self.engine(cache_bytes, Box::new(self.http()?), size)?;
        let bar = progress::bar("flight", count as u64, self.quiet);
        let mut frames = Vec::with_capacity(count);
        for (number, camera) in path.frames(count).enumerate() {
            frames.push(engine.frame(&camera)?);
            write_png(
                &self.folder.join(format!("flight_{number:03}.png")),
                size,
                &engine.tonemapped()?,
            )?;
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(frames)
    }

    #[allow(clippy::too_many_arguments, reason = "one row of the table")]
    fn keep(
        &self,
        engine: &mut Engine,
        stats: &FrameStats,
        truth: &Truth,
        file: String,
        label: String,
        cache_bytes: u64,
        start: Instant,
    ) -> Result<Shot> {
        let picture = engine.picture()?;
        write_shown(&self.folder.join(&file), &picture, 0.0)?;
        let quality =
            compare(&picture, &truth.picture, Some(&truth.covered), 0.0).context("nothing is seen")?;
        Ok(Shot {
            file,
            label,
            cache_bytes,
            wire_bytes: stats.wire_bytes_total,
            gpu_bytes: stats.gpu_bytes,
            host_bytes: stats.host_bytes,
            pages_resident: stats.pages_resident,
            columns_resident: stats.columns_resident,
            predicted_rms: stats.predicted_rms,
            seconds: start.elapsed().as_secs_f64(),
            quality,
        })
    }
}
