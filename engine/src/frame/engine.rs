//! An engine's life: start, wait, frame after frame. What a frame consists of stands in `phases`.

use std::{sync::Arc, time::Duration};

use scenes::{Camera, Scene};

use super::{
    ahead::Ahead,
    archives::Archives,
    events::{Event, Events},
    options::Options,
    overlays::Chosen,
    page_format::{Review, Worths},
    placed::Placed,
    policy::Policy,
    problems::Problems,
    records::Records,
    stats::{Clock, Counters, FrameStats, Milliseconds, Stopwatch, wall_clock},
    votes::Window,
    workers::Workers,
};
use crate::{
    Error, Result,
    gpu::{Context, GpuMilliseconds, PageFormat, Renderer, materials::Btf},
    residency::{Limits, Residency, Vote},
    stream::{SourceStats, TileSource},
};

/// A scene, what of it is on the GPU, and where the rest comes from.
pub struct Engine {
    pub(super) options: Options,
    pub(super) renderer: Renderer,
    pub(super) source: Box<dyn TileSource>,
    pub(super) archives: Archives,
    /// The BTFs that are known, in the order in which they became so; residency and renderer count them alike.
    pub(super) btfs: Vec<Arc<Btf>>,
    pub(super) residency: Box<dyn Policy>,
    /// What the page cache holds, and what that is chosen by.
    pub(super) format: PageFormat,
    pub(super) worths: Worths,
    pub(super) review: Review,
    pub(super) window: Window,
    pub(super) ahead: Ahead,
    pub(super) records: Records,
    pub(super) problems: Problems,
    pub(super) events: Events,
    pub(super) counters: Counters,
    pub(super) camera: Option<Camera>,
    /// Counts views: cameras that differ from the one before, and materials that were not there before.
    pub(super) view: u64,
    pub(super) frames: u64,
    /// Since the start.
    pub(super) clock: Stopwatch,
    /// What the phases of a frame are timed with.
    pub(super) phase_clock: Clock,
    pub(super) wire_bytes: u64,
    /// Something else than the camera has changed since the last picture.
    pub(super) changed: bool,
    pub(super) gpu: Option<GpuMilliseconds>,
    /// Since when slots hold what they hold.
    pub(super) placed: Placed,
    /// What covers the picture.
    pub(super) chosen: Chosen,
    /// The last frame had settled.
    pub(super) was_settled: bool,
    /// Working memory: votes of views that are not shown yet.
    pub(super) votes_ahead: Vec<Vote>,
}

impl Engine {
    /// Prepares a scene and asks for the indices of its archives. Nothing waits: until its index is there, a BTF
    /// material is grey.
    ///
    /// # Errors
    /// [`Error::Scene`] if the scene does not hold together, [`Error::Budget`] for options that cannot work.
    pub fn new(
        context: Context,
        scene: &Scene,
        source: Box<dyn TileSource>,
        options: Options,
    ) -> Result<Self> {
        let residency = Residency::new(Limits {
            page_slots: 0,
            column_slots: 0,
            in_flight: 1,
            bytes_in_flight: 1,
        });
        Self::with_policy(context, scene, source, options, Box::new(residency))
    }

    /// As [`Engine::new`], where something else than residency decides: to measure beside it.
    ///
    /// # Errors
    /// Those of [`Engine::new`].
    pub fn with_policy(
        context: Context,
        scene: &Scene,
        source: Box<dyn TileSource>,
        options: Options,
        mut residency: Box<dyn Policy>,
    ) -> Result<Self> {
        options.check()?;
        let format = options.page_format.unwrap_or_default();
        let on_gpu = options.decodes_on_gpu(&context, format);
        let mut renderer = Renderer::new(context, scene, options.size)?;
        renderer.set_shading(options.shading());
        renderer.set_half_arithmetic(options.half_arithmetic(renderer.context())?)?;
        let (page_slots, column_slots) = renderer.layout(options.caches(), 0)?.slots();
        residency.set_limits(Limits {
            page_slots,
            column_slots,
            in_flight: 1,
            bytes_in_flight: options.budgets.bytes_in_flight,
        });
        let mut engine = Self {
            renderer,
            archives: Archives::new(scene, workers(&options))?,
            btfs: Vec::new(),
            residency,
            format,
            worths: Worths::default(),
            review: Review::default(),
            window: Window::new(options.feedback_stride),
            ahead: Ahead::default(),
            records: Records::new(options.budgets, workers(&options), on_gpu),
            problems: Problems::default(),
            events: Events::default(),
            counters: Counters::default(),
            camera: None,
            view: 0,
            frames: 0,
            clock: Stopwatch::start(),
            phase_clock: wall_clock,
            wire_bytes: 0,
            changed: true,
            gpu: None,
            placed: Placed::default(),
            chosen: Chosen::default(),
            was_settled: false,
            votes_ahead: Vec::new(),
            source,
            options,
        };
        engine.archives.submit(&mut *engine.source);
        Ok(engine)
    }

    /// Waits until all archives are known or given up, at most `limit`. Programs that draw meanwhile need not: materials
    /// appear as their archives become known.
    ///
    /// # Errors
    /// [`Error::Source`] if one cannot be had, or not in time; [`Error::Budget`] if the caches have no room for one
    /// of its columns.
    pub fn wait_for_materials(&mut self, limit: Duration) -> Result<()> {
        let watch = Stopwatch::start();
        loop {
            self.receive();
            self.learn()?;
            if self.archives.decided() == self.archives.count() {
                return self.archives.check();
            }
            let left = limit.saturating_sub(watch.elapsed());
            if left.is_zero() {
                return Err(Error::Source {
                    what: "archives of the scene".into(),
                    detail: format!("not all indices arrived in {limit:?}"),
                });
            }
            if !self.archives.wait(left) {
                self.source.wait(left);
            }
        }
    }

    /// Draws what a camera sees, with what is there, and sees to it that more is there the next time.
    ///
    /// # Errors
    /// [`Error::Scene`] for an unusable camera, [`Error::Adapter`] if the device fails. Failures of the source are no
    /// errors here: see [`Engine::problems`].
    pub fn frame(&mut self, camera: &Camera) -> Result<FrameStats> {
        self.advance(camera, true)
    }

    /// A frame. Without `show` the picture is drawn only if nothing more is to come.
    pub(super) fn advance(&mut self, camera: &Camera, show: bool) -> Result<FrameStats> {
        if let Some(problem) = camera.problem() {
            return Err(Error::Scene(format!("the camera {problem}")));
        }
        let before = self.summary();
        let wire_bytes_before = self.wire_bytes;
        let mut ms = Milliseconds::default();
        let mut watch = Stopwatch::by(self.phase_clock);

        let moved = self.camera.replace(*camera) != Some(*camera);
        self.view += u64::from(moved);
        self.changed |= moved;
        self.look(moved);
        ms.draw = watch.lap();

        self.poll()?;
        ms.votes = watch.lap();

        self.decide();
        self.review_format();
        ms.residency = watch.lap();

        self.receive();
        self.learn()?;
        ms.source = watch.lap();

        let arrived = self.decode();
        ms.decode = watch.lap();

        self.place(arrived)?;
        self.changed |= self.renderer.fading();
        let strips = self.renderer.flush();
        ms.upload = watch.lap();

        let texels_stitched = self.renderer.stitch(&strips);
        let after = self.summary();
        self.show_filled(&after);
        let settled = self.settled(&after);
        let drawn = (show || settled) && self.draw()?;
        ms.draw += watch.lap();
        ms.gpu = self.gpu;
        let format_mse = self.format_mse();
        let (decided, known) = (self.archives.decided() as u32, self.archives.known() as u32);
        let stats = FrameStats {
            frame: self.frames,
            archives: self.archives.count() as u32,
            archives_known: known,
            archives_failed: decided - known,
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
            predicted_rms: (after.predicted_mse.abs() + format_mse).sqrt(),
            format_rms: format_mse.sqrt(),
            settled,
            drawn,
            ms,
        };
        if settled && (self.was_settled || !show) {
            // Nobody waits for this frame.
            self.renderer.rest();
        }
        self.frames += 1;
        self.was_settled = settled;
        for problem in self.problems.untold() {
            self.events.add(Event::Problem(problem.to_owned()));
        }
        self.events.frame(&stats, self.view, stats.archives > 0);
        self.follow_review()?;
        Ok(stats)
    }

    /// What was asked of the source, and what it took.
    pub fn source_stats(&self) -> SourceStats {
        self.source.stats()
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
            let left = limit.saturating_sub(watch.elapsed());
            if stats.added + stats.swapped > 0 || self.archives.wait(left) {
                continue;
            }
            if self.records.decoding() {
                self.records.wait(left);
            } else if self.source.in_flight() > 0 {
                self.source.wait(left);
            }
        }
    }
}

/// Those of an engine whose frames all do the same with the same inputs work in frames.
fn workers<T: Send + 'static>(options: &Options) -> Workers<T> {
    if options.wait {
        Workers::in_frames()
    } else {
        Workers::beside_frames()
    }
}
