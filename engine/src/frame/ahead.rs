//! Views that are not shown, but may be soon: where the moving camera will be, and those that a program names.
//!
//! Each is looked at in small, by one pixel of sixteen, and its votes are of a lower class: they fetch what the shown view
//! leaves room for.

use std::collections::VecDeque;

use scenes::Camera;

use super::motion::extrapolate;
use crate::gpu::feedback::Counted;

/// Most views that a program can name at once; with more, the one named first is forgotten.
pub const MAX_PREFETCHED_VIEWS: usize = 8;

/// Marks tags of these views.
const AHEAD: u64 = 1 << 63;

/// A view and its votes.
struct View {
    /// Names it; larger for newer ones.
    tag: u64,
    camera: Camera,
    asked: bool,
    counted: bool,
    votes: Vec<(u32, u32)>,
}

/// The views.
#[derive(Default)]
pub(super) struct Ahead {
    named: VecDeque<View>,
    /// Where the camera will be.
    next: Option<View>,
    /// The last camera and when it was.
    last: Option<(Camera, f64)>,
    views: u64,
}

impl Ahead {
    fn view(&mut self, camera: Camera, votes: Vec<(u32, u32)>) -> View {
        self.views += 1;
        View {
            tag: AHEAD | self.views,
            camera,
            asked: false,
            counted: false,
            votes,
        }
    }

    /// Adds a view until it is cancelled.
    pub(super) fn add(&mut self, camera: Camera) {
        if self.named.iter().any(|view| view.camera == camera) {
            return;
        }
        if self.named.len() == MAX_PREFETCHED_VIEWS {
            self.named.pop_front();
        }
        let view = self.view(camera, Vec::new());
        self.named.push_back(view);
    }

    /// Forgets all views that were added.
    pub(super) fn cancel(&mut self) {
        self.named.clear();
    }

    /// Tables have changed, votes are to be counted anew.
    pub(super) fn ask_again(&mut self) {
        for view in self.named.iter_mut().chain(&mut self.next) {
            (view.asked, view.counted) = (false, false);
        }
    }

    /// The camera that is shown at a time in seconds, and how far to look ahead of it, in seconds.
    pub(super) fn follow(&mut self, camera: &Camera, now: f64, horizon: f64) {
        let last = self.last.replace((*camera, now));
        let next = last.and_then(|(before, then)| {
            let step = now - then;
            // What takes less than a frame comes in time by itself.
            (step > 0.0 && horizon > step)
                .then(|| extrapolate(&before, camera, (horizon / step) as f32))
                .flatten()
        });
        // Until the new view has votes those of the one before stand for it.
        let votes = self.next.take().map(|view| view.votes).unwrap_or_default();
        self.next = next.map(|camera| self.view(camera, votes));
    }

    /// The view to look at next, and its tag. `pending` says that votes are on their way; without that, those that were
    /// asked for and have not come were lost.
    pub(super) fn next(&self, pending: bool) -> Option<(Camera, u64)> {
        let mut views = self.next.iter().chain(&self.named);
        let open = views.find(|view| if pending { !view.asked } else { !view.counted })?;
        Some((open.camera, open.tag))
    }

    /// The view with this tag was looked at.
    pub(super) fn asked(&mut self, tag: u64) {
        if let Some(view) = self.find(tag) {
            view.asked = true;
        }
    }

    fn find(&mut self, tag: u64) -> Option<&mut View> {
        let mut views = self.next.iter_mut().chain(&mut self.named);
        views.find(|view| view.tag == tag)
    }

    /// Takes votes of one of these views; gives back those of the view that is shown.
    pub(super) fn insert(&mut self, counted: Counted) -> Option<Counted> {
        if counted.tag & AHEAD == 0 {
            return Some(counted);
        }
        // The camera has moved on since, but not far: better late than none.
        let moved_on = |next: &&mut View| !next.counted && counted.tag < next.tag;
        let tag = match self.next.as_mut().filter(moved_on) {
            Some(next) if !self.named.iter().any(|view| view.tag == counted.tag) => {
                next.votes = counted.votes;
                return None;
            }
            _ => counted.tag,
        };
        if let Some(view) = self.find(tag) {
            (view.votes, view.counted) = (counted.votes, true);
        }
        None
    }

    /// Counters with their votes, of all views; a counter may come more than once.
    pub(super) fn votes(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        let views = self.next.iter().chain(&self.named);
        views.flat_map(|view| view.votes.iter().copied())
    }

    /// Whether all views have been looked at.
    pub(super) fn complete(&self) -> bool {
        self.next.iter().chain(&self.named).all(|view| view.counted)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn camera(x: f32) -> Camera {
        Camera {
            eye: Vec3::new(x, 0.0, 5.0),
            target: Vec3::new(x, 0.0, 0.0),
            up: Vec3::Y,
            fov_y: 0.8,
            near: 0.1,
        }
    }

    fn counted(tag: u64, votes: &[(u32, u32)]) -> Counted {
        Counted {
            tag,
            ahead: tag & AHEAD != 0,
            votes: votes.to_vec(),
        }
    }

    #[test]
    fn named_views_are_looked_at_once_and_lost_votes_asked_for_again() {
        let mut ahead = Ahead::default();
        (0..20).for_each(|x| ahead.add(camera(x as f32)));
        ahead.add(camera(19.0));
        let mut tags = Vec::new();
        while let Some((_, tag)) = ahead.next(true) {
            ahead.asked(tag);
            tags.push(tag);
        }
        assert_eq!(tags.len(), MAX_PREFETCHED_VIEWS);
        for &tag in &tags[1..] {
            assert_eq!(ahead.insert(counted(tag, &[(3, 2)])), None);
        }
        assert!(!ahead.complete());
        assert_eq!(ahead.next(false).unwrap().1, tags[0]);
        assert_eq!(ahead.insert(counted(tags[0], &[(1, 1)])), None);
        assert!(ahead.complete() && ahead.next(false).is_none());
        assert_eq!(ahead.votes().map(|(_, pixels)| pixels).sum::<u32>(), 15);
        ahead.ask_again();
        assert!(!ahead.complete() && ahead.next(true).is_some());
        ahead.cancel();
        assert!(ahead.complete() && ahead.votes().next().is_none());
        // Late ones, and those of the view that is shown.
        assert_eq!(ahead.insert(counted(tags[0], &[(1, 1)])), None);
        assert_eq!(ahead.votes().count(), 0);
        assert_eq!(ahead.insert(counted(7, &[])), Some(counted(7, &[])));
    }

    #[test]
    fn a_moving_camera_is_looked_ahead_of_until_it_stands() {
        let mut ahead = Ahead::default();
        ahead.follow(&camera(0.0), 0.0, 0.3);
        assert!(ahead.next(true).is_none());
        ahead.follow(&camera(0.1), 0.1, 0.3);
        let (next, tag) = ahead.next(true).unwrap();
        assert!((next.eye.x - 0.4).abs() < 1e-5);
        ahead.asked(tag);
        // Votes that come a frame late still help.
        ahead.follow(&camera(0.2), 0.2, 0.3);
        assert_eq!(ahead.insert(counted(tag, &[(4, 9)])), None);
        assert_eq!(ahead.votes().collect::<Vec<_>>(), [(4, 9)]);
        ahead.follow(&camera(0.3), 0.3, 0.3);
        assert_eq!(ahead.votes().collect::<Vec<_>>(), [(4, 9)]);
        ahead.follow(&camera(0.3), 0.4, 0.3);
        assert_eq!((ahead.votes().count(), ahead.complete()), (0, true));
        // Nothing to be ahead of if records come within a frame.
        ahead.follow(&camera(0.4), 0.5, 0.05);
        assert!(ahead.next(true).is_none());
    }
}
