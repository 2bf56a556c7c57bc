//! What of a session can be set while it runs.

use engine::{
    Result,
    angular::Angular,
    frame::{Budgets, FrameStats},
};

use super::{Viewer, budget};
use crate::{link::MOST_STOPS, quality::Quality};

impl Viewer {
    /// What may be used of each resource.
    pub fn budgets(&self) -> Budgets {
        self.engine.budgets()
    }

    /// Changes it, at once. A quality target, which would change it again, is forgotten.
    ///
    /// # Errors
    /// Those of [`engine::frame::Engine::set_budgets`]; then all stays as it is.
    pub fn set_budgets(&mut self, budgets: Budgets) -> Result<()> {
        self.engine.set_budgets(budgets)?;
        self.quality = None;
        Ok(())
    }

    /// The error that may be seen, if one was set.
    pub fn quality(&self) -> Option<Quality> {
        self.quality
    }

    /// Lets the budgets of the caches follow from an error that may be seen; `None` leaves them as they are.
    ///
    /// # Errors
    /// [`engine::Error::Budget`] for a target that is not positive, or those of
    /// [`engine::frame::Engine::set_budgets`].
    pub fn set_quality(&mut self, quality: Option<Quality>) -> Result<()> {
        if let Some(quality) = quality {
            if !(quality.target_rms > 0.0 && quality.target_rms.is_finite()) {
                return Err(budget(format!(
                    "a target error of {}: a positive number is needed",
                    quality.target_rms
                )));
            }
            self.engine.set_component_error(quality.component_error())?;
            // Where even the first page or column has no room, it begins larger.
            let mut budgets = quality.first(self.engine.budgets());
            while let Err(error) = self.engine.set_budgets(budgets) {
                let settled = FrameStats {
                    settled: true,
                    predicted_rms: f64::INFINITY,
                    ..FrameStats::default()
                };
                budgets = quality.next(budgets, &settled).ok_or(error)?;
            }
        }
        self.quality = quality;
        Ok(())
    }

    pub(super) fn follow_quality(&mut self, stats: &FrameStats) {
        let budgets = self.engine.budgets();
        if let Some(budgets) = self.quality.and_then(|quality| quality.next(budgets, stats))
            && let Err(error) = self.engine.set_budgets(budgets)
        {
            // The adapter has no more: what there is stays.
            self.quality = None;
            self.report
                .add_problem(format!("the target error is not reached: {error}"));
        }
    }

    /// Chooses how columns are interpolated between directions.
    ///
    /// # Errors
    /// Those of [`engine::frame::Engine::set_angular`].
    pub fn set_angular(&mut self, angular: Angular) -> Result<()> {
        self.engine.set_angular(angular)
    }

    /// Stops by which pictures are brightened.
    pub fn exposure_stops(&self) -> f32 {
        self.engine.options().exposure_stops
    }

    /// Brightens or darkens pictures, within limits.
    pub fn set_exposure_stops(&mut self, stops: f32) {
        let stops = if stops.is_nan() { 0.0 } else { stops };
        let stops = stops.clamp(-MOST_STOPS, MOST_STOPS);
        self.engine.set_exposure_stops(stops);
        if let Some((reference, _)) = &mut self.reference {
            reference.set_exposure_stops(stops);
        }
    }
}
