//! Archives in memory, answered in the order of the requests. For tests, and for what a program carries with it.

use std::{
    collections::{HashMap, VecDeque},
    sync::Arc,
    time::Duration,
};

use bytes::Bytes;
use tileset::archive::{HEADER_BYTES, Index};

use super::{Answer, Request, Ticket, TileSource};
use crate::{Error, Result};

/// Requests in flight, unless [`MemorySource::with_capacity`] says otherwise.
const CAPACITY: usize = 256;

struct Stored {
    index: Index,
    prefix_bytes: usize,
    bytes: Bytes,
}

/// Archives in memory. An answer is there as soon as it is asked for.
pub struct MemorySource {
    archives: HashMap<Arc<str>, Stored>,
    open: VecDeque<(Ticket, Request)>,
    next: u64,
    capacity: usize,
}

impl Default for MemorySource {
    fn default() -> Self {
        Self::with_capacity(CAPACITY)
    }
}

impl MemorySource {
    /// A source without archives.
    pub fn new() -> Self {
        Self::default()
    }

    /// A source without archives that accepts this many requests in flight, at least one.
    pub fn with_capacity(capacity: usize) -> Self {
        Self {
            archives: HashMap::new(),
            open: VecDeque::new(),
            next: 0,
            capacity: capacity.max(1),
        }
    }

    /// Adds an archive, all of it, under a name; an archive of that name is replaced.
    ///
    /// # Errors
    /// Those of [`Index::parse`], if the bytes are no archive.
    pub fn insert(&mut self, name: &str, bytes: impl Into<Bytes>) -> Result<()> {
        let bytes = bytes.into();
        let header = bytes.get(..HEADER_BYTES).unwrap_or(&bytes);
        let prefix_bytes = Index::prefix_bytes(header)?;
        let prefix =
            range(&bytes, 0, prefix_bytes).ok_or_else(|| truncated(name, 0, prefix_bytes, &bytes))?;
        let index = Index::parse(&prefix)?;
        self.archives.insert(
            name.into(),
            Stored {
                index,
                prefix_bytes: prefix.len(),
                bytes,
            },
        );
        Ok(())
    }

    fn read(&self, request: &Request) -> Result<Bytes> {
        let name = request.archive();
        let stored = self
            .archives
            .get(name)
            .ok_or_else(|| Error::NotFound(request.to_string()))?;
        match request.record(&stored.index)? {
            None => Ok(stored.bytes.slice(..stored.prefix_bytes)),
            Some(record) => range(&stored.bytes, record.offset, record.length.into()).ok_or_else(|| {
                truncated(
                    &request.to_string(),
                    record.offset,
                    record.length.into(),
                    &stored.bytes,
                )
            }),
        }
    }
}

/// `length` bytes from `offset` on, without copying; `None` if the archive ends before.
fn range(bytes: &Bytes, offset: u64, length: u64) -> Option<Bytes> {
    if length == 0 {
        return Some(Bytes::new());
    }
    let start = usize::try_from(offset).ok()?;
    let end = usize::try_from(offset.checked_add(length)?).ok()?;
    (end <= bytes.len()).then(|| bytes.slice(start..end))
}

fn truncated(what: &str, offset: u64, length: u64, bytes: &Bytes) -> Error {
    Error::Archive(tileset::Error::Corrupt {
        what: what.to_owned(),
        offset,
        detail: format!(
            "{length} bytes expected here, but the archive has {} bytes in all",
            bytes.len()
        ),
    })
}

impl TileSource for MemorySource {
    fn capacity(&self) -> usize {
        self.capacity
    }

    fn in_flight(&self) -> usize {
        self.open.len()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        if self.open.len() >= self.capacity {
            return None;
        }
        let ticket = Ticket(self.next);
        self.next += 1;
        self.open.push_back((ticket, request));
        Some(ticket)
    }

    fn cancel(&mut self, ticket: Ticket) {
        self.open.retain(|(open, _)| *open != ticket);
    }

    fn poll(&mut self) -> Option<Answer> {
        let (ticket, request) = self.open.pop_front()?;
        let bytes = self.read(&request);
        let wire_bytes = bytes.as_ref().map_or(0, |bytes| bytes.len() as u64);
        Some(Answer {
            ticket,
            request,
            bytes,
            checked: false,
            wire_bytes,
        })
    }

    fn wait(&mut self, _limit: Duration) {}
}
