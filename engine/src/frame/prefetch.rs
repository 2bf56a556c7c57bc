//! Fetching for views that are not shown: the only place where they are looked at, and the only one where their votes
//! count.

use scenes::Camera;

use super::Engine;
use crate::{Error, Result, residency::Plan};

/// A moving camera is looked ahead of in one of so many frames, since that takes rasterizing the scene in small.
const FRAMES_BETWEEN: u64 = 4;
/// Seconds of a frame where there is no clock, or none may count.
const FRAME_SECONDS: f64 = 1.0 / 60.0;

impl Engine {
    /// Fetches what a view will need, as far as the view that is shown leaves room for it, until
    /// [`Engine::cancel_prefetch`]. At most [`super::MAX_PREFETCHED_VIEWS`] views; with more, the one named first is
    /// forgotten.
    ///
    /// # Errors
    /// [`Error::Scene`] for an unusable camera.
    pub fn prefetch(&mut self, view: &Camera) -> Result<()> {
        if let Some(problem) = view.problem() {
            return Err(Error::Scene(format!("the camera to prefetch for {problem}")));
        }
        self.ahead.add(*view);
        Ok(())
    }

    /// Forgets all views that were to be prefetched.
    pub fn cancel_prefetch(&mut self) {
        self.ahead.cancel();
    }

    /// Seconds since the start; where every frame is to do the same with the same inputs, and in browsers, they are
    /// counted in frames.
    pub(super) fn now(&self) -> f64 {
        if self.options.wait || cfg!(target_arch = "wasm32") {
            self.frames as f64 * FRAME_SECONDS
        } else {
            self.clock.elapsed().as_secs_f64()
        }
    }

    /// Asks for votes of a view ahead, if one is due.
    pub(super) fn look_ahead(&mut self, moved: bool) {
        let Some(camera) = self.camera.filter(|_| !self.btfs.is_empty()) else {
            return;
        };
        if !moved || self.frames.is_multiple_of(FRAMES_BETWEEN) {
            let horizon = self.records.latency().min(self.options.prefetch_seconds.into());
            self.ahead.follow(&camera, self.now(), horizon);
        }
        let Some((view, tag)) = self.ahead.next(self.renderer.votes_pending()) else {
            return;
        };
        if self.renderer.look_ahead(&view, tag) {
            self.ahead.asked(tag);
            self.counters.looks_ahead += 1;
        }
    }

    /// Votes of the view that is shown, and of those ahead, to residency.
    pub(super) fn update_residency(&mut self) -> Plan {
        self.votes_ahead.clear();
        let ahead = self.ahead.votes().map(|vote| self.window.vote(vote));
        self.votes_ahead.extend(ahead);
        self.residency.update(self.window.votes(), &self.votes_ahead)
    }
}
