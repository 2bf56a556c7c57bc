//! Votes of the last frames, each of which asked other pixels.
//!
//! In a static view the window ends with every pixel's vote and does not change any more: it settles.

use crate::{
    gpu::feedback::Counted,
    residency::{MaterialId, Vote},
};

#[derive(Clone, Default)]
struct Phase {
    /// View in which it was asked for, and that of the votes; 0 for none.
    asked: u64,
    counted: u64,
    votes: Vec<(u32, u32)>,
}

/// The newest votes of each phase.
pub(super) struct Window {
    phases: Vec<Phase>,
    next: usize,
    /// Sums over the phases.
    totals: Vec<u32>,
}

impl Window {
    /// A window for cells of `stride`² pixels and this many counters.
    pub(super) fn new(stride: u32, counters: u32) -> Self {
        let phases = vec![Phase::default(); (stride * stride) as usize];
        Self {
            phases,
            next: 0,
            totals: vec![0; counters as usize],
        }
    }

    /// The phase to ask for in a view, counted from 1; `None` if all have been. `pending` says that votes are on
    /// their way; without that, phases that were asked for and have not come were lost.
    pub(super) fn next(&mut self, view: u64, pending: bool) -> Option<u32> {
        let phases = self.phases.len();
        let open = (self.next..self.next + phases)
            .map(|phase| phase % phases)
            .find(|&phase| {
                let Phase { asked, counted, .. } = self.phases[phase];
                if pending { asked != view } else { counted != view }
            })?;
        Some(open as u32)
    }

    /// A phase was asked for.
    pub(super) fn asked(&mut self, view: u64, phase: u32) {
        self.phases[phase as usize].asked = view;
        self.next = (phase as usize + 1) % self.phases.len();
    }

    /// What comes back with the votes.
    pub(super) fn tag(&self, view: u64, phase: u32) -> u64 {
        view * self.phases.len() as u64 + u64::from(phase)
    }

    /// Votes that have come back replace the older ones of their phase.
    pub(super) fn insert(&mut self, counted: Counted) {
        let phases = self.phases.len() as u64;
        let (view, phase) = (
            counted.tag / phases,
            &mut self.phases[(counted.tag % phases) as usize],
        );
        if view < phase.counted {
            return;
        }
        let new = Phase {
            asked: phase.asked,
            counted: view,
            votes: counted.votes,
        };
        let old = std::mem::replace(phase, new);
        for (counter, pixels) in old.votes {
            self.totals[counter as usize] -= pixels;
        }
        for &(counter, pixels) in &phase.votes {
            self.totals[counter as usize] += pixels;
        }
    }

    /// Whether every pixel of a view has voted.
    pub(super) fn complete(&self, view: u64) -> bool {
        self.phases.iter().all(|phase| phase.counted == view)
    }

    /// The sums, by material and tile. `bases` are the first counters of the materials.
    pub(super) fn votes(&self, bases: &[u32]) -> Vec<Vote> {
        let ends = bases.iter().skip(1).copied().chain([self.totals.len() as u32]);
        let mut votes = Vec::new();
        for (material, (&base, end)) in (0..).map(MaterialId).zip(bases.iter().zip(ends)) {
            let totals = &self.totals[base as usize..end as usize];
            let wanted = (0..).zip(totals).filter(|&(_, &pixels)| pixels > 0);
            votes.extend(wanted.map(|(tile, &pixels)| Vote {
                material,
                tile,
                pixels,
            }));
        }
        votes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(window: &mut Window, view: u64, phase: u32, votes: &[(u32, u32)]) {
        let tag = window.tag(view, phase);
        window.insert(Counted {
            tag,
            ahead: false,
            votes: votes.to_vec(),
        });
    }

    #[test]
    fn phases_are_summed_and_replaced() {
        let mut window = Window::new(2, 5);
        answer(&mut window, 1, 0, &[(0, 3), (4, 1)]);
        answer(&mut window, 1, 1, &[(4, 2)]);
        let vote = |material, tile, pixels| Vote {
            material: MaterialId(material),
            tile,
            pixels,
        };
        assert_eq!(window.votes(&[0, 3]), [vote(0, 0, 3), vote(1, 1, 3)]);
        answer(&mut window, 2, 0, &[(1, 7)]);
        assert_eq!(window.votes(&[0, 3]), [vote(0, 1, 7), vote(1, 1, 2)]);
        // Late votes of an older view change nothing.
        answer(&mut window, 1, 0, &[(0, 9)]);
        assert_eq!(window.votes(&[0, 3]), [vote(0, 1, 7), vote(1, 1, 2)]);
    }

    #[test]
    fn every_phase_is_asked_once_and_lost_ones_again() {
        let mut window = Window::new(2, 1);
        let mut asked = Vec::new();
        while let Some(phase) = window.next(1, true) {
            window.asked(1, phase);
            asked.push(phase);
        }
        assert_eq!(asked, [0, 1, 2, 3]);
        for phase in [0, 1, 3] {
            answer(&mut window, 1, phase, &[]);
        }
        assert!(!window.complete(1));
        assert_eq!(window.next(1, true), None);
        assert_eq!(window.next(1, false), Some(2));
        answer(&mut window, 1, 2, &[]);
        assert!(window.complete(1));
        assert_eq!(window.next(1, false), None);
        assert_eq!(window.next(2, false), Some(0));
    }
}
