//! What a view shows when all has settled.

use std::collections::BTreeSet;
use std::time::Duration;

use engine::frame::{Engine, Options};
use engine::gpu::Context;
use engine::metrics::{Comparison, Picture, compare};
use scenes::Camera;

use crate::engine::Subject;
use crate::{Error, Result};

/// Longest time until a view has settled.
const LIMIT: Duration = Duration::from_secs(300);

/// A settled view.
pub(super) struct Truth {
    pub(super) camera: Camera,
    picture: Picture,
    covered: Vec<bool>,
    /// Archives of which something is seen.
    pub(super) visible: BTreeSet<String>,
}

impl Truth {
    /// How far a picture is from it; `None` if nothing is seen.
    pub(super) fn compare(&self, picture: &Picture) -> Option<Comparison> {
        compare(picture, &self.picture, Some(&self.covered), 0.0)
    }
}

/// Settles the views one after the other, with the same budgets as all contenders.
///
/// # Errors
/// Those of the engine; [`Error::Invalid`] for a view that does not settle.
pub(super) fn settle(
    context: &Context,
    subject: &Subject,
    options: &Options,
    cameras: &[Camera],
) -> Result<Vec<Truth>> {
    let source = subject.archives.source()?;
    let mut engine = Engine::new(context.clone(), &subject.scene, source, options.clone())?;
    engine.wait_for_materials(LIMIT)?;
    let mut truths = Vec::new();
    for camera in cameras {
        let frames = engine.settle(camera, LIMIT)?;
        if !frames.last().is_some_and(|stats| stats.settled) {
            return Err(Error::Invalid {
                what: "a view",
                found: engine.problems().last().unwrap_or("still loading").to_owned(),
                expected: "settled within five minutes; are all archives there?",
            });
        }
        let picture = engine.show()?;
        let covered = engine.visibility()?.iter().map(|ids| ids[0] != 0).collect();
        let seen: BTreeSet<u16> = engine.votes().iter().map(|vote| vote.material.0).collect();
        let names = engine.shown().zip(0..);
        let visible = names
            .filter(|(_, id)| seen.contains(id))
            .map(|((name, _), _)| name.to_owned());
        truths.push(Truth {
            camera: *camera,
            visible: visible.collect(),
            picture,
            covered,
        });
    }
    Ok(truths)
}
