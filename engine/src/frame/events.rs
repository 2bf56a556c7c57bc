//! What a program wants to be told about, in the order in which it happened.

use std::{collections::VecDeque, sync::Arc};

use super::FrameStats;

/// Most events that are kept for a program that never takes them; older ones go.
const KEPT: usize = 1024;

/// Something that happened once.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// The index of an archive is here: its materials show their mean colour, and more from now on.
    MaterialKnown {
        /// Name of the archive.
        archive: Arc<str>,
    },
    /// The first picture with streamed texels in it has been drawn; of a scene without BTFs, the first of all.
    FirstPicture(FrameStats),
    /// The picture is as good as it gets, and nothing is in flight. Comes once for each view, and again if something
    /// has moved in between.
    Settled(FrameStats),
    /// Something went wrong without stopping the picture.
    Problem(String),
}

/// Events that nobody has taken yet.
#[derive(Default)]
pub(super) struct Events {
    waiting: VecDeque<Event>,
    shown: bool,
    /// The view that has settled, while it stays so.
    settled: Option<u64>,
}

impl Events {
    pub(super) fn add(&mut self, event: Event) {
        if self.waiting.len() == KEPT {
            self.waiting.pop_front();
        }
        self.waiting.push_back(event);
    }

    /// After a frame of this view; `btfs` says whether the scene has any.
    pub(super) fn frame(&mut self, stats: &FrameStats, view: u64, btfs: bool) {
        let streamed = stats.pages_resident > 0 && stats.columns_resident > 0;
        if stats.drawn && !self.shown && (streamed || !btfs) {
            self.shown = true;
            self.add(Event::FirstPicture(*stats));
        }
        let settled = stats.settled.then_some(view);
        if settled != self.settled && stats.settled {
            self.add(Event::Settled(*stats));
        }
        self.settled = settled;
    }

    /// The oldest.
    pub(super) fn take(&mut self) -> Option<Event> {
        self.waiting.pop_front()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn events(frames: &[(u64, bool)]) -> usize {
        let mut events = Events::default();
        for &(view, settled) in frames {
            let stats = FrameStats {
                settled,
                ..Default::default()
            };
            events.frame(&stats, view, true);
        }
        std::iter::from_fn(|| events.take()).count()
    }

    #[test]
    fn settling_is_told_once_for_each_time() {
        assert_eq!(events(&[(1, false), (1, true), (1, true), (1, true)]), 1);
        assert_eq!(events(&[(1, true), (1, false), (1, true)]), 2);
        assert_eq!(events(&[(1, true), (2, true), (2, true)]), 2);
        assert_eq!(events(&[(1, false), (2, false)]), 0);
    }

    #[test]
    fn events_that_nobody_takes_are_bounded() {
        let mut events = Events::default();
        for n in 0..2 * KEPT {
            events.add(Event::Problem(n.to_string()));
        }
        assert_eq!(events.take(), Some(Event::Problem(KEPT.to_string())));
        assert_eq!(std::iter::from_fn(|| events.take()).count(), KEPT - 1);
    }
}
