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
    /// A bit for each counter: whether its sum is not zero.
    voted: Vec<u64>,
    /// First counter of each material.
    bases: Vec<u32>,
    /// The sums by material and tile, as long as they hold.
    votes: Option<Vec<Vote>>,
}

impl Window {
    /// A window for cells of `stride`² pixels, without counters.
    pub(super) fn new(stride: u32) -> Self {
        let phases = vec![Phase::default(); (stride * stride) as usize];
        Self {
            phases,
            next: 0,
            totals: Vec::new(),
            voted: Vec::new(),
            bases: Vec::new(),
            votes: None,
        }
    }

    /// Appends the counters of a material, one for each of its tiles.
    pub(super) fn add_material(&mut self, tiles: u32) {
        self.bases.push(self.totals.len() as u32);
        self.totals.resize(self.totals.len() + tiles as usize, 0);
        self.voted.resize(self.totals.len().div_ceil(64), 0);
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
        if old.votes == phase.votes {
            return;
        }
        self.votes = None;
        for (counter, pixels) in old.votes {
            let total = &mut self.totals[counter as usize];
            *total -= pixels;
            if *total == 0 {
                self.voted[counter as usize / 64] &= !(1 << (counter % 64));
            }
        }
        for &(counter, pixels) in &phase.votes {
            self.totals[counter as usize] += pixels;
            self.voted[counter as usize / 64] |= 1 << (counter % 64);
        }
    }

    /// Whether every pixel of a view has voted.
    pub(super) fn complete(&self, view: u64) -> bool {
        self.phases.iter().all(|phase| phase.counted == view)
    }

    /// The material and tile of a counter.
    pub(super) fn vote(&self, (counter, pixels): (u32, u32)) -> Vote {
        let material = self.bases.partition_point(|&base| base <= counter) - 1;
        Vote {
            material: MaterialId(material as u16),
            tile: counter - self.bases[material],
            pixels,
        }
    }

    /// The sums, by material and tile.
    pub(super) fn votes(&mut self) -> &[Vote] {
        let (totals, voted, bases) = (&self.totals, &self.voted, &self.bases);
        self.votes.get_or_insert_with(|| {
            let mut material = 0;
            let counters = (0..)
                .zip(voted)
                .flat_map(|(word, &bits)| ones(bits).map(move |bit| word * 64 + bit));
            let vote = |counter: u32| {
                while bases.get(material + 1).is_some_and(|&base| base <= counter) {
                    material += 1;
                }
                Vote {
                    material: MaterialId(material as u16),
                    tile: counter - bases[material],
                    pixels: totals[counter as usize],
                }
            };
            counters.map(vote).collect()
        })
    }
}

/// The places of the ones, the lowest first.
fn ones(mut bits: u64) -> impl Iterator<Item = u32> {
    std::iter::from_fn(move || {
        let lowest = (bits != 0).then(|| bits.trailing_zeros())?;
        bits &= bits - 1;
        Some(lowest)
    })
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
        let mut window = Window::new(2);
        window.add_material(3);
        window.add_material(2);
        answer(&mut window, 1, 0, &[(0, 3), (4, 1)]);
        answer(&mut window, 1, 1, &[(4, 2)]);
        let vote = |material, tile, pixels| Vote {
            material: MaterialId(material),
            tile,
            pixels,
        };
        assert_eq!(window.votes(), [vote(0, 0, 3), vote(1, 1, 3)]);
        answer(&mut window, 2, 0, &[(1, 7)]);
        assert_eq!(window.votes(), [vote(0, 1, 7), vote(1, 1, 2)]);
        // Late votes of an older view change nothing.
        answer(&mut window, 1, 0, &[(0, 9)]);
        assert_eq!(window.votes(), [vote(0, 1, 7), vote(1, 1, 2)]);
        // A material more: what is known of the others stays.
        window.add_material(200);
        answer(&mut window, 3, 2, &[(5, 1), (204, 6)]);
        let all = [vote(0, 1, 7), vote(1, 1, 2), vote(2, 0, 1), vote(2, 199, 6)];
        assert_eq!(window.votes(), all);
    }

    #[test]
    fn every_phase_is_asked_once_and_lost_ones_again() {
        let mut window = Window::new(2);
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
