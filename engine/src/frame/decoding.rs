//! Records with the workers: what is being decoded, and how much memory that takes.

use std::{collections::HashSet, sync::Arc, time::Duration};

use tileset::{Page, PageId};

use super::workers::Workers;
use crate::{
    decode::{Done, Pending},
    gpu::materials::Btf,
    residency::{Item, MaterialId},
};

/// Items with the workers, or decoded and not taken back yet.
pub(super) struct Decoding {
    workers: Workers<(u64, Done)>,
    items: HashSet<Item>,
    /// Ancestors that are decoded on the way: nobody else need start with them.
    above: HashSet<Item>,
    bytes: u64,
}

impl Decoding {
    pub(super) fn new(workers: Workers<(u64, Done)>) -> Self {
        Self {
            workers,
            items: HashSet::new(),
            above: HashSet::new(),
            bytes: 0,
        }
    }

    /// Whether an item was handed out itself.
    pub(super) fn contains(&self, item: Item) -> bool {
        self.items.contains(&item)
    }

    /// Whether a page is being decoded, for itself or for a descendant.
    pub(super) fn is_busy(&self, item: Item) -> bool {
        self.items.contains(&item) || self.above.contains(&item)
    }

    /// Items with the workers, or decoded and not taken back yet.
    pub(super) fn count(&self) -> usize {
        self.items.len()
    }

    /// Whether nothing is with the workers.
    pub(super) fn idle(&self) -> bool {
        self.workers.unfinished() == 0
    }

    /// Most bytes that all of it takes, with its results.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Hands a record out, unless that takes more than `budget_bytes` together with all others; then gives it back. One
    /// always has room.
    pub(super) fn start(
        &mut self,
        pending: Pending,
        btf: &Arc<Btf>,
        parent: Option<Arc<Page>>,
        budget_bytes: u64,
    ) -> Result<(), Pending> {
        let bytes = pending.decoding_bytes(btf, parent.is_some());
        if !self.idle() && self.bytes + bytes > budget_bytes {
            return Err(pending);
        }
        self.bytes += bytes;
        self.items.insert(pending.item);
        self.above.extend(above(pending.item, pending.ancestors()));
        let job = pending.job(btf.clone(), parent);
        self.workers.start(move || (bytes, job.run()));
        Ok(())
    }

    /// Takes back what is done, at most so many.
    pub(super) fn finished(&mut self, most: usize) -> Vec<Done> {
        let mut finished = Vec::new();
        for (bytes, done) in self.workers.finished(most) {
            self.bytes -= bytes;
            self.items.remove(&done.item);
            for page in above(done.item, done.above.iter().copied()) {
                self.above.remove(&page);
            }
            finished.push(done);
        }
        finished
    }

    /// Waits until something may be done.
    pub(super) fn wait(&mut self, limit: Duration) {
        self.workers.wait(limit);
    }
}

fn above(item: Item, pages: impl Iterator<Item = PageId>) -> impl Iterator<Item = Item> {
    let material: MaterialId = match item {
        Item::Page(material, _) | Item::Column(material, _) => material,
    };
    pages.map(move |page| Item::Page(material, page))
}
