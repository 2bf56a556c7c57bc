//! Records of archives: from memory if they were asked for lately, else read once for all who wait for them.

use std::{
    collections::HashMap,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
};

use bytes::Bytes;
use futures_util::{
    FutureExt,
    future::{BoxFuture, Shared, WeakShared},
};
use lru::LruCache;
use tileset::{PageId, Record, archive::Index};

use crate::{
    Options,
    budget::{Budget, Room},
    collection::Served,
    failure::Failure,
    metrics::Metrics,
    reads::Reads,
    store::StoreError,
};

/// Bytes that a cached record takes beside its own: key, links, and what the allocator rounds up.
const ENTRY_BYTES: u64 = 256;

/// A record of an archive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum What {
    /// Header, manifest and directory.
    Index,
    Column(u16),
    Page(PageId),
}

impl std::fmt::Display for What {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Index => f.write_str("index"),
            Self::Column(group) => write!(f, "column of group {group}"),
            Self::Page(page) => page.fmt(f),
        }
    }
}

/// Content is named by content: archives that are replaced, or served twice, cannot be taken for each other.
type Key = (u128, What);
/// A read is also of one archive in one store, by address: where that fails, the same content elsewhere may be at hand.
type FlightKey = (usize, Key);
type Landed = Result<Bytes, ReadError>;
type Flight = BoxFuture<'static, Landed>;

/// Why there is no record.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ReadError {
    /// The archive has been replaced and what it was cannot be read any more.
    Changed,
    /// The bytes are not those that the index announces, or cannot be read at all.
    Corrupt,
    /// The store does not answer.
    Unavailable,
}

/// Reads records, checks them and keeps them within [`Options::cache_bytes`].
pub(crate) struct Records {
    pub(crate) budget: Budget,
    pub(crate) reads: Arc<Reads>,
    metrics: Arc<Metrics>,
    cache: Mutex<Cache>,
    flights: Mutex<HashMap<FlightKey, (u64, WeakShared<Flight>)>>,
    next_flight: AtomicU64,
}

struct Cache {
    records: LruCache<Key, Bytes>,
    bytes: u64,
    limit: u64,
}

impl Records {
    pub(crate) fn new(options: &Options, metrics: Arc<Metrics>) -> Self {
        Self {
            budget: Budget::new(options),
            reads: Arc::new(Reads::new(options, Arc::clone(&metrics))),
            metrics,
            cache: Mutex::new(Cache {
                records: LruCache::unbounded(),
                bytes: 0,
                limit: options.cache_bytes,
            }),
            flights: Mutex::default(),
            next_flight: AtomicU64::new(0),
        }
    }

    /// Bytes that the cache takes.
    pub(crate) fn cached_bytes(&self) -> u64 {
        lock(&self.cache).bytes
    }

    /// Room for a record: before [`Self::get`], so that whoever has it needs nothing more to go on.
    pub(crate) async fn room(&self, served: &Served, what: What) -> Result<Room, Failure> {
        let length = served.record(what).map_or(0, |record| record.1);
        self.budget.room(length).await
    }

    /// A record, checked, in the room that was made for it.
    pub(crate) async fn get(self: &Arc<Self>, served: &Arc<Served>, what: What, room: Room) -> Landed {
        let key = (served.index.id, what);
        if let Some(bytes) = lock(&self.cache).records.get(&key).cloned() {
            self.metrics.cache_hits.add(1);
            return Ok(room.hold(bytes));
        }
        if matches!(served.record(what), Some((_, 0))) {
            return Ok(Bytes::new()); // A page that equals its up-sampled parent.
        }
        let flight = self.flight(served, key);
        flight.await.map(|bytes| room.hold(bytes))
    }

    /// The read that is under way, or a new one. It ends when nobody waits for it any more.
    fn flight(self: &Arc<Self>, served: &Arc<Served>, key: Key) -> Shared<Flight> {
        let flight_key = (Arc::as_ptr(served).addr(), key);
        let mut flights = lock(&self.flights);
        if let Some(flight) = flights.get(&flight_key).and_then(|(_, flight)| flight.upgrade()) {
            self.metrics.cache_joins.add(1);
            return flight;
        }
        self.metrics.cache_misses.add(1);
        let number = self.next_flight.fetch_add(1, Ordering::Relaxed);
        let landing = Landing {
            records: Arc::clone(self),
            key: flight_key,
            number,
        };
        let served = Arc::clone(served);
        let flight = async move {
            let bytes = landing.records.read(&served, key.1).await?;
            lock(&landing.records.cache).insert(key, bytes.clone());
            Ok(bytes)
        };
        let flight = flight.boxed().shared();
        if let Some(weak) = flight.downgrade() {
            flights.insert(flight_key, (number, weak));
        }
        flight
    }

    /// Reads and checks; what does not hold is read once more, because the fault may be that of the way.
    async fn read(&self, served: &Served, what: What) -> Landed {
        let Some((offset, length)) = served.record(what) else {
            return Err(ReadError::Corrupt); // Those who ask have looked.
        };
        let mut again = true;
        loop {
            let bytes = self.reads.read(&*served.version, offset..offset + length).await;
            let reason = match bytes {
                Ok(bytes) => match served.verify(what, &bytes) {
                    Ok(()) => return Ok(bytes.into()),
                    Err(reason) => reason,
                },
                Err(StoreError::Changed | StoreError::NotFound) => return Err(ReadError::Changed),
                Err(StoreError::Unavailable(_)) => return Err(ReadError::Unavailable),
                Err(StoreError::Refused(reason)) => reason,
            };
            if !again {
                tracing::error!(archive = served.name, id = served.id(), %what, reason, "a record does not hold");
                return Err(ReadError::Corrupt);
            }
            again = false;
        }
    }
}

impl Cache {
    fn insert(&mut self, key: Key, bytes: Bytes) {
        let cost = |bytes: &Bytes| bytes.len() as u64 + ENTRY_BYTES;
        // One record must not drive out all others.
        if cost(&bytes) > self.limit / 4 {
            return;
        }
        self.bytes += cost(&bytes);
        if let Some(old) = self.records.put(key, bytes) {
            self.bytes -= cost(&old);
        }
        while self.bytes > self.limit
            && let Some((_, old)) = self.records.pop_lru()
        {
            self.bytes -= cost(&old);
        }
    }
}

/// Takes a flight off the list when it has ended or nobody waits for it any more.
struct Landing {
    records: Arc<Records>,
    key: FlightKey,
    number: u64,
}

impl Drop for Landing {
    fn drop(&mut self) {
        let mut flights = lock(&self.records.flights);
        if flights
            .get(&self.key)
            .is_some_and(|(number, _)| *number == self.number)
        {
            flights.remove(&self.key);
        }
    }
}

impl Served {
    /// Offset and length of a record.
    fn record(&self, what: What) -> Option<(u64, u64)> {
        let of = |record: Record| (record.offset, record.length.into());
        match what {
            What::Index => Some((0, self.prefix_bytes)),
            What::Column(group) => self.index.column(group).ok().map(of),
            What::Page(page) => self.index.page(page).ok().map(of),
        }
    }

    /// Compares bytes with what the index says about them.
    fn verify(&self, what: What, bytes: &[u8]) -> Result<(), String> {
        let record = match what {
            What::Index => {
                let id = Index::parse(bytes).map_err(|error| error.to_string())?.id;
                return if id == self.index.id {
                    Ok(())
                } else {
                    Err(format!("content id {id:032x}, expected {}", self.id()))
                };
            }
            What::Column(group) => self.index.column(group),
            What::Page(page) => self.index.page(page),
        };
        record
            .and_then(|record| self.index.verify(&what.to_string(), record, bytes).map(drop))
            .map_err(|error| error.to_string())
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cache_keeps_its_limit_and_what_was_used_last() {
        let mut cache = Cache {
            records: LruCache::unbounded(),
            bytes: 0,
            limit: 10 * (1000 + ENTRY_BYTES),
        };
        let record = |length| Bytes::from(vec![0; length]);
        for group in 0..100 {
            cache.insert((1, What::Column(group)), record(1000));
            assert!(cache.bytes <= cache.limit);
            assert!(
                cache.records.get(&(1, What::Column(0))).is_some(),
                "used all the time"
            );
        }
        assert_eq!(cache.records.len(), 10);
        assert!(cache.records.contains(&(1, What::Column(99))));
        cache.insert((1, What::Column(99)), record(500));
        assert_eq!(cache.bytes, cache.limit - 500);
        cache.insert((1, What::Index), record(5000));
        assert!(
            !cache.records.contains(&(1, What::Index)),
            "too large to be worth it"
        );
        let mut none = Cache { limit: 0, ..cache };
        none.insert((2, What::Index), record(0));
        assert!(!none.records.contains(&(2, What::Index)));
    }
}
