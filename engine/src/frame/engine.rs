//! The frame itself: feedback → votes → residency → requests → answers → decode → placement → picture.

use std::time::Duration;

use scenes::{Camera, Scene};

use super::{
    archives::Archives,
    options::Options,
    problems::Problems,
    records::Records,
    stats::{Counters, FrameStats, Milliseconds, Stopwatch},
    votes::Window,
};
use crate::{
    Error, Result,
    decode::{Decoded, PAGE_BYTES},
    gpu::{Ask, Caches, Context, GpuMilliseconds, Renderer, Shading, materials::Btf},
    residency::{Item, Limits, MaterialInfo, Placement, Residency, Summary},
    stream::{Request, TileSource},
};

/// A scene, what of it is on the GPU, and where the rest comes from.
pub struct Engine {
    pub(super) options: Options,
    pub(super) renderer: Renderer,
    pub(super) source: Box<dyn TileSource>,
    pub(super) archives: Archives,
    /// There once all archives are known.
    pub(super) streaming: Option<Streaming>,
    pub(super) records: Records,
    pub(super) problems: Problems,
    pub(super) counters: Counters,
    pub(super) camera: Option<Camera>,
    /// Counts views: cameras that differ from the one before.
    pub(super) view: u64,
    pub(super) frames: u64,
    pub(super) wire_bytes: u64,
    /// Something else than the camera has changed since the last picture.
    pub(super) changed: bool,
    pub(super) gpu: Option<GpuMilliseconds>,
}

/// What is there once the archives are known.
pub(super) struct Streaming {
    pub(super) btfs: Vec<Btf>,
    pub(super) residency: Residency,
    pub(super) window: Window,
    pub(super) vote_bases: Vec<u32>,
}

impl Engine {
    /// Prepares a scene and asks for the indices of its archives. Nothing waits: until they are there, BTF
    /// materials are grey.
    ///
    /// # Errors
    /// [`Error::Scene`] if the scene does not hold together, [`Error::Budget`] for options that cannot work.
    pub fn new(
        context: Context,
        scene: &Scene,
        source: Box<dyn TileSource>,
        options: Options,
    ) -> Result<Self> {
        options.check()?;
        let mut engine = Self {
            renderer: Renderer::new(context, scene, options.size)?,
            archives: Archives::new(scene)?,
            streaming: None,
            records: Records::new(options.host_bytes),
            problems: Problems::default(),
            counters: Counters::default(),
            camera: None,
            view: 0,
            frames: 0,
            wire_bytes: 0,
            changed: true,
            gpu: None,
            source,
            options,
        };
        engine.archives.submit(&mut *engine.source);
        Ok(engine)
    }

    /// Waits until all archives are known, at most `limit`.
    ///
    /// # Errors
    /// [`Error::Source`] if one cannot be had, or not in time; [`Error::Budget`] if the caches do not hold one page
    /// and one column.
    pub fn wait_for_materials(&mut self, limit: Duration) -> Result<()> {
        let watch = Stopwatch::start();
        loop {
            self.receive();
            self.start_streaming()?;
            if self.streaming.is_some() {
                return self.archives.check();
            }
            let left = limit.saturating_sub(watch.elapsed());
            if left.is_zero() {
                return Err(Error::Source {
                    what: "archives of the scene".into(),
                    detail: format!("not all indices arrived in {limit:?}"),
                });
            }
            self.source.wait(left);
        }
    }

    /// Draws what a camera sees, with what is there, and sees to it that more is there the next time.
    ///
    /// # Errors
    /// [`Error::Scene`] for an unusable camera, [`Error::Budget`] as [`Engine::wait_for_materials`],
    /// [`Error::Adapter`] if the device fails. Failures of the source are no errors here: see [`Engine::problems`].
    pub fn frame(&mut self, camera: &Camera) -> Result<FrameStats> {
        self.advance(camera, true)
    }

    /// A frame. Without `show` the picture is drawn only if nothing more is to come.
    fn advance(&mut self, camera: &Camera, show: bool) -> Result<FrameStats> {
        if let Some(problem) = camera.problem() {
            return Err(Error::Scene(format!("the camera {problem}")));
        }
        let before = self.summary();
        let wire_bytes_before = self.wire_bytes;
        let mut ms = Milliseconds::default();
        let mut watch = Stopwatch::start();

        let moved = self.camera.replace(*camera) != Some(*camera);
        self.view += u64::from(moved);
        self.changed |= moved;
        self.look(moved)?;
        ms.draw = watch.lap();

        self.decide();
        ms.residency = watch.lap();

        self.receive();
        self.start_streaming()?;
        ms.source = watch.lap();

        let arrived = self.decode();
        ms.decode = watch.lap();

        self.place(arrived);
        self.changed |= self.renderer.fading();
        let texels_stitched = self.renderer.flush();
        ms.upload = watch.lap();

        let after = self.summary();
        let settled = self.settled(&after);
        let drawn = (show || settled) && self.draw()?;
        ms.draw += watch.lap();
        ms.gpu = self.gpu;
        self.frames += 1;
        Ok(FrameStats {
            frame: self.frames - 1,
            pages_wanted: after.pages_wanted,
            pages_resident: after.pages_resident,
            columns_resident: after.columns_resident,
            added: (after.added - before.added) as u32,
            swapped: (after.swapped - before.swapped) as u32,
            in_flight: after.in_flight,
            texels_stitched,
            wire_bytes: self.wire_bytes - wire_bytes_before,
            wire_bytes_total: self.wire_bytes,
            gpu_bytes: self.renderer.bytes(),
            host_bytes: self.records.bytes(),
            predicted_rms: after.predicted_mse.abs().sqrt(),
            settled,
            drawn,
            ms,
        })
    }

    /// Runs frames, waiting for the source in between, until nothing changes any more or `limit` has passed; the
    /// last one, which tells by [`FrameStats::settled`], is drawn, the others only decide and stream.
    ///
    /// # Errors
    /// Those of [`Engine::frame`].
    pub fn settle(&mut self, camera: &Camera, limit: Duration) -> Result<Vec<FrameStats>> {
        let watch = Stopwatch::start();
        let mut frames = Vec::new();
        loop {
            let late = watch.elapsed() >= limit;
            let stats = self.advance(camera, late)?;
            frames.push(stats);
            if stats.settled || late {
                return Ok(frames);
            }
            self.renderer.wait()?;
            if stats.added + stats.swapped == 0 && self.source.in_flight() > 0 {
                self.source.wait(limit.saturating_sub(watch.elapsed()));
            }
        }
    }

    /// Visibility, where the view is new, and votes, where some are missing; takes the votes that are there.
    fn look(&mut self, moved: bool) -> Result<()> {
        let pending = self.renderer.votes_pending();
        let stride = self.options.feedback_stride;
        let ask = self.streaming.as_mut().and_then(|Streaming { window, .. }| {
            let phase = window.next(self.view, pending)?;
            Some(Ask {
                stride,
                phase,
                tag: window.tag(self.view, phase),
            })
        });
        let asked = self.renderer.look(self.camera.as_ref().filter(|_| moved), ask);
        match (&mut self.streaming, ask) {
            (Some(streaming), Some(ask)) if asked => streaming.window.asked(self.view, ask.phase),
            _ => self.counters.feedback_skipped += 1,
        }
        self.poll()
    }

    /// Takes what has come back from the GPU; waits for it, if so chosen.
    fn poll(&mut self) -> Result<()> {
        if self.options.wait {
            self.renderer.wait()?;
        }
        let (counted, gpu) = self.renderer.poll()?;
        self.gpu = gpu.or(self.gpu);
        if let Some(streaming) = &mut self.streaming {
            counted
                .into_iter()
                .filter(|counted| !counted.ahead)
                .for_each(|counted| streaming.window.insert(counted));
        }
        Ok(())
    }

    /// Votes to residency; its plan to the records.
    fn decide(&mut self) {
        let Some(Streaming {
            btfs,
            residency,
            window,
            vote_bases,
        }) = &mut self.streaming
        else {
            return;
        };
        let plan = residency.update(&window.votes(vote_bases));
        self.records
            .follow(&plan, btfs, &mut *self.source, &mut self.counters);
    }

    /// Submits requests and takes the answers that are there: at most as many as can be in flight, so that a
    /// source that answers at once cannot hold up a frame.
    fn receive(&mut self) {
        let btfs = self
            .streaming
            .as_ref()
            .map_or(&[][..], |streaming| &streaming.btfs);
        self.archives.submit(&mut *self.source);
        self.records.submit(btfs, &mut *self.source);
        for _ in 0..self.source.capacity() {
            let Some(answer) = self.source.poll() else { break };
            self.wire_bytes += answer.wire_bytes;
            match answer.request {
                Request::Index { .. } => self.archives.receive(answer, &mut self.problems),
                _ => self
                    .records
                    .receive(answer, btfs, &mut self.counters, &mut self.problems),
            }
        }
    }

    /// Once all archives are known: tables, caches, residency.
    fn start_streaming(&mut self) -> Result<()> {
        if self.streaming.is_some() {
            return Ok(());
        }
        let Some((btfs, btf_of_material)) = self.archives.finish() else {
            return Ok(());
        };
        let caches = Caches {
            page_bytes: self.options.page_cache_bytes,
            column_bytes: self.options.column_cache_bytes,
        };
        let shading = Shading {
            component_error: self.options.component_error,
            fade_frames: self.options.fade_frames,
        };
        self.renderer
            .set_materials(&btfs, &btf_of_material, caches, shading)?;
        let (page_slots, column_slots) = self.renderer.slots();
        let mut residency = Residency::new(Limits {
            page_slots,
            column_slots,
            in_flight: self.in_flight_limit(),
        });
        for btf in &btfs {
            residency.add_material(MaterialInfo {
                pyramid: *btf.pyramid(),
                groups: btf.groups(),
                weights: btf.index.pages().iter().map(|record| record.weight).collect(),
            });
        }
        let vote_bases: Vec<u32> = self.renderer.vote_bases().collect();
        let counters = btfs.iter().map(|btf| btf.pyramid().tile_count()).sum();
        let window = Window::new(self.options.feedback_stride, counters);
        self.streaming = Some(Streaming {
            btfs,
            residency,
            window,
            vote_bases,
        });
        self.changed = true;
        Ok(())
    }

    /// What waits to be decoded takes at most a quarter of the host's memory: a record and a page each.
    fn in_flight_limit(&self) -> usize {
        let host = self.options.host_bytes / 4 / (2 * PAGE_BYTES);
        self.options
            .requests_in_flight
            .min(self.source.capacity())
            .min(host as usize)
            .max(1)
    }

    fn decode(&mut self) -> Vec<(Item, Decoded)> {
        let Some(Streaming { btfs, residency, .. }) = &mut self.streaming else {
            return Vec::new();
        };
        let limit = self.options.uploads_per_frame;
        let decoded = self
            .records
            .decode(limit, btfs, &mut self.counters, &mut self.problems);
        self.records
            .take_failed()
            .into_iter()
            .for_each(|item| residency.failed(item));
        decoded
    }

    /// Puts what has arrived where residency says.
    fn place(&mut self, arrived: Vec<(Item, Decoded)>) {
        let Some(Streaming { residency, .. }) = &mut self.streaming else {
            return;
        };
        for (item, decoded) in arrived {
            let Placement::Place { slot, evicted } = residency.arrived(item) else {
                self.counters.arrivals_dropped += 1;
                continue;
            };
            match evicted {
                Some(Item::Page(material, page)) => self.renderer.remove_page(material.0.into(), page),
                Some(Item::Column(material, group)) => self.renderer.remove_column(material.0.into(), group),
                None => {}
            }
            match (item, &decoded) {
                (Item::Page(material, page), Decoded::Page(texels)) => {
                    self.renderer.place_page(material.0.into(), page, slot, texels);
                }
                (Item::Column(material, group), Decoded::Column(column)) => {
                    self.renderer.place_column(material.0.into(), group, slot, column);
                }
                _ => unreachable!("pages decode to pages, columns to columns"),
            }
            self.changed = true;
        }
    }

    /// Draws, if anything has changed. Returns whether it did.
    fn draw(&mut self) -> Result<bool> {
        if !self.changed {
            self.counters.draws_skipped += 1;
            return Ok(false);
        }
        self.renderer.draw(self.options.exposure_stops.exp2());
        self.changed = false;
        self.poll()?;
        Ok(true)
    }

    fn settled(&self, summary: &Summary) -> bool {
        self.streaming.as_ref().is_some_and(|streaming| {
            streaming.window.complete(self.view)
                && summary.settled
                && self.records.idle()
                && !self.renderer.fading()
        })
    }
}
