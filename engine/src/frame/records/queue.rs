//! In which order records are asked for: what residency wants, and before that is asked for what it will want.

use std::{collections::HashSet, sync::Arc};

use bytes::Bytes;

use super::{
    Flight, Records, Waiting,
    items::{length, material_of, record_of, request},
};
use crate::{
    decode::Pending,
    frame::{policy::Policy, stats::Counters},
    gpu::materials::Btf,
    residency::{Item, MaterialId, Plan},
    stream::{Ticket, TileSource},
};

/// Records that are brought into the order of now: more than a line carries in a second, of which some are here already.
const MOST_UPCOMING: usize = 384;

/// Bytes in flight while indices are, which keep the line busy themselves: about the column and the root of one material.
const OPENING_BYTES: u64 = 16 << 10;
/// Seconds without another index after which those that are missing are not waited for.
const OPENING_SECONDS: f64 = 1.0;

impl Records {
    /// Starts what a plan asks for and gives up what it cancels; fetches in the order of [`Policy::upcoming`], also what
    /// is not asked for yet.
    pub(in crate::frame) fn follow(
        &mut self,
        plan: &Plan,
        residency: &mut dyn Policy,
        now: f64,
        btfs: &[Arc<Btf>],
        source: &mut dyn TileSource,
        counters: &mut Counters,
    ) {
        self.cancel(&plan.cancel, btfs, source, counters);
        self.request(&plan.request, now, btfs, counters);
        let upcoming = residency.upcoming(MOST_UPCOMING);
        self.arrange(&upcoming, btfs);
        self.abort_stale(residency, btfs, source, counters);
    }

    /// Brings what is to be submitted into the order of now: first ancestors that others wait for, then `upcoming`. What was
    /// queued early and is not among it any more is forgotten.
    fn arrange(&mut self, upcoming: &[Item], btfs: &[Arc<Btf>]) {
        self.order.clear();
        self.order.extend(upcoming.iter().copied().zip(1..));
        self.early.retain(|item| self.order.contains_key(item));
        let needed = self.needed();
        let mut queue: Vec<(usize, Item)> = Vec::new();
        // What was queued early and has been asked for since is there twice.
        let mut placed = HashSet::new();
        for item in std::mem::take(&mut self.queue) {
            if !placed.insert(item) {
                continue;
            }
            if needed.contains(&item) {
                queue.push((0, item));
            } else if self.wanted.contains_key(&item) {
                queue.push((self.order.get(&item).copied().unwrap_or(usize::MAX), item));
            }
        }
        let mut early_bytes = 0;
        for (&item, place) in upcoming.iter().zip(1..) {
            if self.wanted.contains_key(&item) || needed.contains(&item) {
                continue;
            }
            let bytes = length(item, btfs);
            early_bytes += bytes;
            if early_bytes > self.budgets.host_bytes / 4 {
                break; // The store would drop the first of them for the last.
            }
            let comes =
                self.flying.contains_key(&item) || self.early.contains(&item) || self.store.has_record(item);
            if bytes > 0 && !comes {
                queue.push((place, item));
            }
        }
        queue.sort_by_key(|(place, _)| *place);
        self.queue.extend(queue.into_iter().map(|(_, item)| item));
    }

    /// Gives up what is in flight early and not worth having any more. What others have only overtaken comes: to ask for it twice would
    /// cost more.
    fn abort_stale(
        &mut self,
        residency: &dyn Policy,
        btfs: &[Arc<Btf>],
        source: &mut dyn TileSource,
        counters: &mut Counters,
    ) {
        let needed = self.needed();
        let is_stale = |item: &Item| {
            let named = self.wanted.contains_key(item) || self.order.contains_key(item);
            !named && !needed.contains(item) && !residency.wants(*item)
        };
        let stale = self.tickets.iter().filter(|(_, flight)| is_stale(&flight.item));
        let mut stale: Vec<Ticket> = stale.map(|(ticket, _)| *ticket).collect();
        stale.sort_unstable();
        for ticket in stale {
            self.abort(ticket, btfs, source, counters);
        }
    }

    fn abort(
        &mut self,
        ticket: Ticket,
        btfs: &[Arc<Btf>],
        source: &mut dyn TileSource,
        counters: &mut Counters,
    ) {
        source.cancel(ticket);
        self.land(ticket, btfs);
        counters.requests_cancelled += 1;
    }

    /// Ancestors whose records pending pages wait for.
    fn needed(&self) -> HashSet<Item> {
        self.pending.iter().filter_map(|waiting| waiting.needs).collect()
    }

    /// Whether nobody has asked for an item yet.
    pub(super) fn is_early(&self, item: Item) -> bool {
        !self.wanted.contains_key(&item) && self.order.contains_key(&item)
    }

    /// Gives items up.
    pub(in crate::frame) fn cancel(
        &mut self,
        items: &[Item],
        btfs: &[Arc<Btf>],
        source: &mut dyn TileSource,
        counters: &mut Counters,
    ) {
        for &item in items {
            if self.wanted.remove(&item).is_some() {
                counters.requests_cancelled += 1;
                self.queue.retain(|&queued| queued != item);
                self.pending.retain(|waiting| waiting.pending.item != item);
                let needed = self.pending.iter().any(|waiting| waiting.needs == Some(item));
                if let Some(ticket) = self.flying.get(&item).copied().filter(|_| !needed) {
                    source.cancel(ticket);
                    self.land(ticket, btfs);
                }
            }
        }
    }

    /// Starts with items: those that the host still has can be decoded at once.
    fn request(&mut self, items: &[Item], now: f64, btfs: &[Arc<Btf>], counters: &mut Counters) {
        for &item in items {
            if self.wanted.insert(item, now).is_some() {
                continue;
            }
            if self.decoding.contains(item) {
                // Asked for before, given up, and wanted again: it is on its way.
                continue;
            }
            let stored = self.store.record(item);
            if record_of(item, btfs).is_ok_and(|record| record.length == 0) {
                counters.pages_not_stored += 1;
                self.pending.push_back(Waiting {
                    pending: Pending::new(item, Bytes::new(), self.on_gpu),
                    needs: None,
                });
            } else if let Some(record) = stored {
                match self.early.remove(&item) {
                    true => counters.records_early += 1,
                    false => counters.records_from_host += 1,
                }
                self.pending.push_back(Waiting {
                    pending: Pending::new(item, record, self.on_gpu),
                    needs: None,
                });
            } else if !self.flying.contains_key(&item) {
                self.queue.push_back(item);
            }
        }
    }

    /// Submits what waits, as far as the source, the line and the budgets allow; one record always if none is on its way. Nothing that is in flight and still of
    /// use gives way: what has been sent of it would be lost, for less than the round trips that the window holds. While some of
    /// the archives are `unknown` and go on coming, little goes out: their roots are worth more than details of the others.
    pub(in crate::frame) fn submit(
        &mut self,
        now: f64,
        unknown: usize,
        btfs: &[Arc<Btf>],
        source: &mut dyn TileSource,
    ) {
        let most = self.budgets.requests_in_flight.min(source.capacity());
        if self.unknown.0 != unknown {
            self.unknown = (unknown, now);
        }
        let opening = unknown > 0 && now - self.unknown.1 < OPENING_SECONDS;
        let line = match opening {
            true => self.window.bytes().min(OPENING_BYTES),
            false => self.window.bytes(),
        };
        let allowed = line.min(self.budgets.bytes_in_flight);
        // What has come and is not placed yet counts as well: more would only wait where its order cannot change any more.
        let most = most.saturating_sub(self.unplaced());
        while let Some(&item) = self.queue.front() {
            let bytes = length(item, btfs);
            if !self.has_room(bytes, most, allowed) {
                self.window.full();
                break;
            }
            let Some(ticket) = source.submit(request(item, btfs)) else {
                break;
            };
            self.bytes_in_flight += bytes;
            self.queue.pop_front();
            let sent = self.window.sent(now);
            self.tickets.insert(ticket, Flight { item, sent });
            self.flying.insert(item, ticket);
        }
    }

    /// Records that are here and can be decoded, or are with the decoder.
    fn unplaced(&self) -> usize {
        let ready = self.pending.iter().filter(|waiting| waiting.needs.is_none());
        ready.count() + self.decoding.count()
    }

    fn has_room(&self, bytes: u64, most: usize, allowed: u64) -> bool {
        let fits = self.bytes_in_flight.saturating_add(bytes) <= allowed;
        self.tickets.is_empty() || (self.tickets.len() < most && fits)
    }

    /// A request is in flight no more.
    pub(super) fn land(&mut self, ticket: Ticket, btfs: &[Arc<Btf>]) -> Option<Flight> {
        let flight = self.tickets.remove(&ticket)?;
        self.bytes_in_flight -= length(flight.item, btfs);
        self.flying.remove(&flight.item);
        Some(flight)
    }

    /// Gives up all that is on its way for a material but not with the decoder yet.
    pub(in crate::frame) fn forget(
        &mut self,
        material: MaterialId,
        btfs: &[Arc<Btf>],
        source: &mut dyn TileSource,
    ) {
        let is_of = |item: &Item| material_of(*item) == material;
        self.queue.retain(|item| !is_of(item));
        self.wanted.retain(|item, _| !is_of(item));
        self.pending.retain(|waiting| !is_of(&waiting.pending.item));
        self.order.retain(|item, _| !is_of(item));
        let mut flying: Vec<Ticket> = self
            .tickets
            .iter()
            .filter(|(_, flight)| is_of(&flight.item))
            .map(|(ticket, _)| *ticket)
            .collect();
        flying.sort_unstable();
        for ticket in flying {
            source.cancel(ticket);
            self.land(ticket, btfs);
        }
    }
}
