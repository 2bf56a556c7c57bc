//! Records and decoded pages on the host, least recently used first to go, in a budget of bytes.

use std::sync::Arc;

use bytes::Bytes;
use lru::LruCache;
use tileset::{Page, PageId};

use super::PAGE_BYTES;
use crate::residency::{Item, MaterialId};

/// Bytes that an entry of the store takes beside its contents.
pub(super) const ENTRY_BYTES: u64 = 128;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Key {
    Record(Item),
    Page(MaterialId, PageId),
}

enum Held {
    Record(Bytes),
    Page(Arc<Page>),
}

impl Held {
    fn bytes(&self) -> u64 {
        ENTRY_BYTES
            + match self {
                Held::Record(bytes) => bytes.len() as u64,
                Held::Page(_) => PAGE_BYTES,
            }
    }
}

/// Records and decoded pages on the host.
pub struct HostStore {
    held: LruCache<Key, Held>,
    bytes: u64,
    reserved_bytes: u64,
    budget_bytes: u64,
}

impl HostStore {
    /// An empty store that keeps at most `budget_bytes`.
    pub fn new(budget_bytes: u64) -> Self {
        Self {
            held: LruCache::unbounded(),
            bytes: 0,
            reserved_bytes: 0,
            budget_bytes,
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// A record that has been received, checked.
    pub fn record(&mut self, item: Item) -> Option<Bytes> {
        match self.held.get(&Key::Record(item))? {
            Held::Record(bytes) => Some(bytes.clone()),
            Held::Page(_) => None,
        }
    }

    /// Whether a record is here, which does not make it a younger one.
    pub fn has_record(&self, item: Item) -> bool {
        self.held.contains(&Key::Record(item))
    }

    /// A decoded page.
    pub fn page(&mut self, material: MaterialId, page: PageId) -> Option<Arc<Page>> {
        match self.held.get(&Key::Page(material, page))? {
            Held::Page(page) => Some(page.clone()),
            Held::Record(_) => None,
        }
    }

    /// Keeps a record. It must have been checked.
    pub fn put_record(&mut self, item: Item, bytes: Bytes) {
        self.put(Key::Record(item), Held::Record(bytes));
    }

    /// Keeps a page.
    pub fn put_page(&mut self, material: MaterialId, page: PageId, decoded: Arc<Page>) {
        self.put(Key::Page(material, page), Held::Page(decoded));
    }

    fn put(&mut self, key: Key, held: Held) {
        self.bytes += held.bytes();
        self.bytes -= self.held.put(key, held).map_or(0, |old| old.bytes());
        self.shrink();
    }

    /// Changes the budget.
    pub fn set_budget(&mut self, budget_bytes: u64) {
        self.budget_bytes = budget_bytes;
        self.shrink();
    }

    /// Leaves this much of the budget to others.
    pub fn reserve(&mut self, bytes: u64) {
        self.reserved_bytes = bytes;
        self.shrink();
    }

    fn shrink(&mut self) {
        while self.bytes.saturating_add(self.reserved_bytes) > self.budget_bytes {
            let Some((_, oldest)) = self.held.pop_lru() else {
                break;
            };
            self.bytes -= oldest.bytes();
        }
    }
}
