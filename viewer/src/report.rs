//! What there is to tell: figures of the last frame, their course, materials on their way, and whether the host answers.

use std::collections::VecDeque;

use engine::{
    frame::{Counters, FrameStats, MaterialState, MaterialStatus, Milliseconds},
    stream::SourceStats,
};
use serde::Serialize;

/// Frames of which the course is kept.
pub const KEPT_FRAMES: usize = 360;
/// Problems that are kept.
const KEPT_PROBLEMS: usize = 16;

/// Whether the host of the archives answers.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "state", content = "message")]
pub enum Connection {
    /// As far as is known.
    #[default]
    Fine,
    /// It has not answered, and is being asked again.
    Waiting,
    /// It has failed for good, or until it is asked to be tried again; why.
    Lost(String),
}

/// All there is to tell after a frame.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// What the frame did.
    pub frame: FrameStats,
    /// Work that was not needed, and work that went wrong, since the start.
    pub counters: Counters,
    /// What was asked of the source.
    pub source: SourceStats,
    /// Where the archives come from.
    pub origin: String,
    /// Whether that answers.
    pub connection: Connection,
    /// Archives of the scene.
    pub materials: Vec<MaterialReport>,
    /// What went wrong, the newest last.
    pub problems: VecDeque<String>,
    /// A first picture with streamed texels has been drawn.
    pub shown: bool,
}

/// How far an archive is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MaterialReport {
    /// Name of the archive.
    pub name: String,
    /// unknown, loading, shown, settled or failed.
    pub state: &'static str,
    /// Why it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
    /// Bytes over the wire for it since the start.
    pub wire_bytes: u64,
    /// Pages in the cache.
    pub pages_resident: u32,
    /// Of the squared error that the view would have without it, the part that is gone; `None` where it is not in view.
    pub progress: Option<f64>,
}

impl From<MaterialStatus> for MaterialReport {
    fn from(status: MaterialStatus) -> Self {
        let (state, failure) = match status.state {
            MaterialState::Unknown => ("unknown", None),
            MaterialState::Loading => ("loading", None),
            MaterialState::Shown => ("shown", None),
            MaterialState::Settled => ("settled", None),
            MaterialState::Failed(why) => ("failed", Some(why)),
        };
        Self {
            name: status.name.to_string(),
            state,
            failure,
            wire_bytes: status.wire_bytes,
            pages_resident: status.pages_resident,
            progress: status.progress,
        }
    }
}

/// A frame in the course of things.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Sample {
    /// Predicted root mean square error against full residency.
    pub predicted_rms: f64,
    /// Bytes over the wire since the start.
    pub wire_bytes_total: u64,
    /// Pages with votes.
    pub pages_wanted: u32,
    /// Pages in the cache.
    pub pages_resident: u32,
    /// By phase.
    pub ms: Milliseconds,
}

/// The last [`KEPT_FRAMES`] frames in which something happened.
#[derive(Clone, Debug, Default)]
pub struct History {
    samples: VecDeque<Sample>,
}

impl History {
    /// Takes a frame down. Settled frames that do nothing are not: they would push out what led to them.
    pub fn add(&mut self, stats: &FrameStats) {
        let sample = Sample {
            predicted_rms: stats.predicted_rms,
            wire_bytes_total: stats.wire_bytes_total,
            pages_wanted: stats.pages_wanted,
            pages_resident: stats.pages_resident,
            ms: stats.ms,
        };
        let still = stats.settled && !stats.drawn;
        let same = |last: &Sample| {
            last.pages_resident == sample.pages_resident && last.wire_bytes_total == sample.wire_bytes_total
        };
        if still && self.samples.back().is_some_and(same) {
            return;
        }
        if self.samples.len() == KEPT_FRAMES {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
    }

    /// The oldest first.
    pub fn samples(&self) -> impl ExactSizeIterator<Item = &Sample> {
        self.samples.iter()
    }
}

/// Finds out whether the host answers, from what the source counts and the engine tells.
#[derive(Clone, Debug, Default)]
pub struct Watch {
    connection: Connection,
    retried: u64,
    wire_bytes: u64,
    failed: u64,
    problem: Option<String>,
}

impl Watch {
    /// The engine has told of a problem.
    pub fn problem(&mut self, message: &str) {
        self.problem = Some(message.to_owned());
    }

    /// Looks at the figures after a frame.
    pub fn update(&mut self, stats: &FrameStats, counters: &Counters, source: &SourceStats) -> &Connection {
        let arrived =
            std::mem::replace(&mut self.wire_bytes, stats.wire_bytes_total) < stats.wire_bytes_total;
        let again = std::mem::replace(&mut self.retried, source.retried) < source.retried;
        let failed = std::mem::replace(&mut self.failed, counters.requests_failed) < counters.requests_failed;
        let lost = stats.archives_failed > 0 || failed;
        if lost {
            let why = self.problem.clone();
            self.connection = Connection::Lost(why.unwrap_or_else(|| "the host does not answer".into()));
        } else if arrived || (stats.settled && self.connection == Connection::Waiting) {
            self.connection = Connection::Fine;
        } else if again && self.connection == Connection::Fine {
            self.connection = Connection::Waiting;
        }
        &self.connection
    }

    /// All is asked for again: it may be fine.
    pub fn retry(&mut self) {
        self.problem = None;
        self.connection = Connection::Waiting;
    }
}

impl Report {
    /// Keeps a message.
    pub(crate) fn add_problem(&mut self, message: String) {
        if self.problems.back() == Some(&message) {
            return;
        }
        if self.problems.len() == KEPT_PROBLEMS {
            self.problems.pop_front();
        }
        self.problems.push_back(message);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_that_goes_away_and_comes_back_is_noticed() {
        let mut watch = Watch::default();
        let (mut stats, mut counters) = (FrameStats::default(), Counters::default());
        let mut source = SourceStats::default();
        stats.wire_bytes_total = 100;
        assert_eq!(watch.update(&stats, &counters, &source), &Connection::Fine);
        source.retried = 1;
        assert_eq!(watch.update(&stats, &counters, &source), &Connection::Waiting);
        watch.problem("refused");
        counters.requests_failed = 3;
        assert_eq!(
            watch.update(&stats, &counters, &source),
            &Connection::Lost("refused".into())
        );
        source.retried = 2;
        assert_eq!(
            watch.update(&stats, &counters, &source),
            &Connection::Lost("refused".into())
        );
        watch.retry();
        assert_eq!(watch.update(&stats, &counters, &source), &Connection::Waiting);
        stats.wire_bytes_total = 200;
        assert_eq!(watch.update(&stats, &counters, &source), &Connection::Fine);
        stats.archives_failed = 1;
        let lost = watch.update(&stats, &counters, &source);
        assert_eq!(lost, &Connection::Lost("the host does not answer".into()));
    }

    #[test]
    fn the_course_is_bounded_and_rests_with_the_picture() {
        let mut history = History::default();
        for frame in 0..3 * KEPT_FRAMES as u64 {
            history.add(&FrameStats {
                wire_bytes_total: frame,
                drawn: true,
                ..FrameStats::default()
            });
        }
        assert_eq!(history.samples().len(), KEPT_FRAMES);
        let last = *history.samples().last().unwrap();
        let settled = FrameStats {
            wire_bytes_total: last.wire_bytes_total,
            settled: true,
            ..FrameStats::default()
        };
        (0..50).for_each(|_| history.add(&settled));
        assert_eq!(history.samples().last(), Some(&last));
    }
}
