//! Residency driven step by step beside a plain model, and what must hold after every step.

use engine::residency::{Item, Limits, MaterialId, Placement, Plan, Residency, Slot, Vote};
use tileset::PageId;

use crate::{plain::Plain, scene::Scene};

/// One step of a trace.
#[derive(Clone, Debug)]
pub(crate) enum Step {
    Votes(Vec<Vote>),
    /// Votes ahead, which stay until there are others.
    Ahead(Vec<Vote>),
    Limits(Limits),
    /// The n-th of what is in flight arrives.
    Arrive(usize),
    /// The n-th of what is in flight fails.
    Fail(usize),
    /// An item arrives whether or not anybody asked for it.
    Stray(Item),
    StrayFailure(Item),
}

/// The engine's side of the contract: what is in flight, and what is in which slot.
pub(crate) struct Driver {
    pub(crate) residency: Residency,
    pub(crate) plain: Plain,
    pub(crate) scene: Scene,
    pub(crate) limits: Limits,
    pub(crate) ahead: Vec<Vote>,
    pub(crate) in_flight: Vec<Item>,
    pub(crate) log: Vec<String>,
}

impl Driver {
    pub(crate) fn new(scene: &Scene, limits: Limits) -> Self {
        let mut residency = Residency::new(limits);
        for (at, info) in scene.materials.iter().enumerate() {
            assert_eq!(residency.add_material(info.clone()), MaterialId(at as u16));
        }
        Self {
            residency,
            plain: Plain::new(limits, &scene.materials),
            scene: scene.clone(),
            limits,
            ahead: Vec::new(),
            in_flight: Vec::new(),
            log: Vec::new(),
        }
    }

    pub(crate) fn update(&mut self, votes: &[Vote]) -> Plan {
        self.scene.votes = votes.to_vec();
        let ahead = self.ahead.clone();
        let plan = self.residency.update(votes, &ahead);
        let plain = self.plain.update(votes, &ahead);
        assert_eq!(plan.request, plain.request);
        let sorted = |plan: &Plan| {
            let mut cancel = plan.cancel.clone();
            cancel.sort();
            cancel
        };
        assert_eq!(sorted(&plan), sorted(&plain));
        let later = Scene {
            votes: ahead,
            ..self.scene.clone()
        };
        for item in &plan.cancel {
            let at = self
                .in_flight
                .iter()
                .position(|other| other == item)
                .expect("cancels what is in flight");
            self.in_flight.remove(at);
        }
        for item in &plan.request {
            assert!(!self.in_flight.contains(item), "asks once");
            assert_eq!(self.residency.slot(*item), None, "asks for what is not there");
            assert!(
                self.scene.is_useful(*item) || later.is_useful(*item),
                "{item:?} is asked for, but neither it nor what lies under it has worth"
            );
            self.check_reachable(*item);
            self.in_flight.push(*item);
        }
        self.log.push(format!("{plan:?}"));
        self.check();
        self.check_upcoming();
        plan
    }

    /// The list of what to fetch: that of the plain model; parents come before their pages, all of it would get a slot, and
    /// there is nothing on it where nothing moves any more.
    pub(crate) fn check_upcoming(&mut self) {
        for most in [3, 100] {
            let upcoming = self.residency.upcoming(most);
            assert_eq!(upcoming, self.plain.upcoming(most));
            let pages = upcoming.iter().filter(|item| matches!(item, Item::Page(..)));
            assert!(pages.count() <= most.min(self.limits.page_slots as usize));
            for (at, item) in upcoming.iter().enumerate() {
                assert_eq!(self.residency.slot(*item), None);
                let Item::Page(material, page) = *item else {
                    continue;
                };
                let pyramid = self.scene.materials[usize::from(material.0)].pyramid;
                if let Some(tile) = pyramid.parent(page.tile) {
                    let column = Item::Column(material, page.group);
                    let parent = Item::Page(material, PageId { tile, ..page });
                    for needed in [parent, column] {
                        let there = self.residency.slot(needed).is_some() || upcoming[..at].contains(&needed);
                        assert!(there, "{item:?} before {needed:?}");
                    }
                }
            }
            if self.residency.summary().settled && !self.residency.summary().prefetching {
                assert_eq!(upcoming, []);
            }
        }
        self.log.push(format!("{:?}", self.residency.upcoming(100)));
    }

    pub(crate) fn check_reachable(&self, item: Item) {
        let Item::Page(material, page) = item else { return };
        let pyramid = self.scene.materials[usize::from(material.0)].pyramid;
        if let Some(parent) = pyramid.parent(page.tile) {
            let parent = Item::Page(material, PageId { tile: parent, ..page });
            assert!(
                self.residency.slot(parent).is_some(),
                "{item:?} without its parent"
            );
            assert!(
                self.residency.slot(Item::Column(material, page.group)).is_some(),
                "{item:?} without its column"
            );
        }
    }

    pub(crate) fn arrive(&mut self, item: Item) -> Placement {
        let before = self.residency.resident();
        let expected = self.in_flight.iter().position(|other| *other == item);
        if let Some(at) = expected {
            self.in_flight.remove(at);
        }
        let placement = self.residency.arrived(item);
        assert_eq!(placement, self.plain.arrived(item));
        self.log.push(format!("{item:?} {placement:?}"));
        match placement {
            Placement::Place { slot, evicted } => {
                assert!(expected.is_some(), "{item:?} was placed, but nobody asked for it");
                let there = before
                    .iter()
                    .find(|(other, at)| same_cache(*other, item) && *at == slot);
                assert_eq!(there.map(|(other, _)| *other), evicted);
                assert_eq!(self.residency.slot(item), Some(slot));
                if let Some(evicted) = evicted {
                    assert_eq!(self.residency.slot(evicted), None);
                }
                self.check_reachable(item);
            }
            Placement::Drop => assert_eq!(before, self.residency.resident()),
        }
        self.check();
        placement
    }

    pub(crate) fn fail(&mut self, item: Item) {
        self.in_flight.retain(|other| *other != item);
        self.residency.failed(item);
        self.plain.failed(item);
        self.check();
    }

    /// New limits: what they say is followed, slot by slot.
    pub(crate) fn set_limits(&mut self, limits: Limits) {
        let mut slots = self.residency.resident();
        let resized = self.residency.set_limits(limits);
        assert_eq!(resized, self.plain.set_limits(limits));
        for (item, slot) in &resized.evicted {
            let at = slots
                .iter()
                .position(|there| there == &(*item, *slot))
                .expect("evicts what is there");
            slots.swap_remove(at);
        }
        for step in &resized.moved {
            let taken = slots
                .iter()
                .any(|(item, slot)| same_cache(*item, step.item) && *slot == step.to);
            assert!(!taken, "{step:?} into a slot that is taken");
            let there = slots.iter_mut().find(|there| **there == (step.item, step.from));
            there.expect("moves what is there").1 = step.to;
        }
        let key = |there: &(Item, Slot)| (matches!(there.0, Item::Column(..)), there.1);
        slots.sort_by_key(key);
        assert_eq!(slots, self.residency.resident());
        self.in_flight.retain(|item| !resized.cancel.contains(item));
        self.limits = limits;
        self.check();
    }

    pub(crate) fn run(&mut self, step: &Step) {
        let nth = |n: usize, items: &[Item]| (!items.is_empty()).then(|| items[n % items.len()]);
        match step {
            Step::Votes(votes) => {
                self.update(votes);
            }
            Step::Ahead(votes) => self.ahead = votes.clone(),
            Step::Limits(limits) => self.set_limits(*limits),
            Step::Arrive(n) => {
                nth(*n, &self.in_flight).map(|item| self.arrive(item));
            }
            Step::Fail(n) => {
                if let Some(item) = nth(*n, &self.in_flight) {
                    self.fail(item);
                }
            }
            Step::Stray(item) => {
                self.arrive(*item);
            }
            Step::StrayFailure(item) => self.fail(*item),
        }
    }

    /// Invariants that hold at any time.
    pub(crate) fn check(&self) {
        let resident = self.residency.resident();
        let pages = resident.iter().filter(|(item, _)| matches!(item, Item::Page(..)));
        let (pages, columns): (Vec<_>, Vec<_>) = (
            pages.collect(),
            resident
                .iter()
                .filter(|(item, _)| matches!(item, Item::Column(..)))
                .collect(),
        );
        assert!(
            pages.len() <= self.limits.page_slots as usize
                && columns.len() <= self.limits.column_slots as usize
        );
        assert_eq!(resident, self.plain.resident());
        assert!(self.in_flight.len() <= self.limits.in_flight);
        let bytes: u64 = self.in_flight.iter().map(|item| self.scene.bytes(*item)).sum();
        assert!(bytes <= self.limits.bytes_in_flight || self.in_flight.len() == 1);
        for (items, slots) in [
            (&pages, self.limits.page_slots),
            (&columns, self.limits.column_slots),
        ] {
            let mut used = vec![false; slots as usize];
            for (item, slot) in items {
                assert_eq!(self.residency.slot(*item), Some(*slot));
                assert!(
                    !std::mem::replace(&mut used[slot.0 as usize], true),
                    "one item in a slot"
                );
            }
        }
        for (item, _) in &pages {
            let Item::Page(material, page) = *item else {
                unreachable!()
            };
            let pyramid = self.scene.materials[usize::from(material.0)].pyramid;
            if let Some(tile) = pyramid.parent(page.tile) {
                let parent = Item::Page(material, PageId { tile, ..page });
                assert!(
                    self.residency.slot(parent).is_some(),
                    "{item:?} is resident without its parent"
                );
            }
        }
        let summary = self.residency.summary();
        assert_eq!(summary.in_flight as usize, self.in_flight.len());
        assert_eq!(
            (summary.pages_resident as usize, summary.columns_resident as usize),
            (pages.len(), columns.len())
        );
        let expected = self
            .scene
            .predicted_mse(|item| self.residency.slot(item).is_some());
        assert!(
            (summary.predicted_mse - expected).abs() <= 1e-9 * expected.max(1e-9),
            "{summary:?} {expected}"
        );
    }

    /// Lets everything arrive, in an order that `turn` chooses, until nothing moves. Panics if that takes
    /// more updates than there are items to move.
    pub(crate) fn settle(&mut self, mut turn: usize) {
        let votes = self.scene.votes.clone();
        let most = 20 + 4 * self.scene.items();
        for _ in 0..most {
            let plan = self.update(&votes);
            if self.in_flight.is_empty() && plan == Plan::default() {
                return;
            }
            while !self.in_flight.is_empty() {
                turn = turn.wrapping_mul(25_214_903_917).wrapping_add(11);
                let at = (turn >> 16) % self.in_flight.len();
                self.arrive(self.in_flight[at]);
                if turn.is_multiple_of(5) {
                    break;
                }
            }
        }
        panic!("not settled after {most} updates");
    }

    pub(crate) fn mse(&self) -> f64 {
        self.residency.summary().predicted_mse
    }
}

pub(crate) fn same_cache(a: Item, b: Item) -> bool {
    matches!(a, Item::Page(..)) == matches!(b, Item::Page(..))
}

pub(crate) fn item_material(item: Item) -> usize {
    match item {
        Item::Page(material, _) | Item::Column(material, _) => material.0.into(),
    }
}

impl Driver {
    pub(crate) fn residency_has_column(&self, item: Item) -> bool {
        match item {
            Item::Page(material, page) => self.residency.slot(Item::Column(material, page.group)).is_some(),
            Item::Column(..) => true,
        }
    }
}
