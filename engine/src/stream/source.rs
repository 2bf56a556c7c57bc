//! The contract of a source: requests in, answers out, without waiting.

use std::{cell::RefCell, fmt, rc::Rc, sync::Arc, time::Duration};

use bytes::Bytes;
use tileset::archive::{Index, Record};

use super::SourceStats;
use crate::{Error, Result};

/// What can be asked of a source. Archives are known by name.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Request {
    /// Header, manifest and directory of an archive: what [`tileset::archive::Index::parse`] takes.
    Index {
        /// Name of the archive in the collection, without extension.
        archive: Arc<str>,
    },
    /// A page's record.
    Page {
        /// Name of the archive.
        archive: Arc<str>,
        /// Which page.
        page: tileset::PageId,
    },
    /// An eigen-ABRDF column's record.
    Column {
        /// Name of the archive.
        archive: Arc<str>,
        /// Component group.
        group: u16,
    },
}

impl Request {
    /// Name of the archive that is asked.
    pub fn archive(&self) -> &Arc<str> {
        match self {
            Request::Index { archive } | Request::Page { archive, .. } | Request::Column { archive, .. } => {
                archive
            }
        }
    }

    /// The directory entry of what is asked for; `None` for the index itself.
    ///
    /// # Errors
    /// [`tileset::Error::NotFound`] if the archive has no such page or column.
    pub fn record(&self, index: &Index) -> Result<Option<Record>> {
        Ok(match self {
            Request::Index { .. } => None,
            Request::Page { page, .. } => Some(index.page(*page)?),
            Request::Column { group, .. } => Some(index.column(*group)?),
        })
    }
}

impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Request::Index { archive } => write!(f, "archive {archive:?}, index"),
            Request::Page { archive, page } => write!(f, "archive {archive:?}, {page}"),
            Request::Column { archive, group } => write!(f, "archive {archive:?}, column of group {group}"),
        }
    }
}

/// Refuses names that are none of a file in a folder. They come out of scene files, and could lead out of it.
///
/// # Errors
/// [`Error::NotFound`].
pub(super) fn plain_name(name: &str) -> Result<()> {
    if name.is_empty() || name == "." || name == ".." || name.contains(['/', '\\', '\0', ':']) {
        return Err(Error::NotFound(format!(
            "archive {name:?} (no name of a file in a folder)"
        )));
    }
    Ok(())
}

/// Names a submitted request. A source gives out each ticket once.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Ticket(pub u64);

/// What came back.
#[derive(Debug)]
pub struct Answer {
    /// The request's name.
    pub ticket: Ticket,
    /// What was asked.
    pub request: Request,
    /// The record's bytes with the checksum at their end, or why there are none.
    pub bytes: Result<Bytes>,
    /// The bytes have been held against the checksum at their end, or the index against its own; if not, that is left to whoever takes them.
    pub checked: bool,
    /// Bytes that crossed the wire for it; zero from a cache.
    pub wire_bytes: u64,
}

/// A source of records.
pub trait TileSource {
    /// Most requests that may be in flight.
    fn capacity(&self) -> usize;
    /// Requests in flight: submitted and neither answered nor cancelled.
    fn in_flight(&self) -> usize;
    /// Asks for a record. Returns `None`, and does nothing, when the capacity is used up. What is submitted in one go may
    /// be sent together, with the next `poll` or `wait`.
    fn submit(&mut self, request: Request) -> Option<Ticket>;
    /// Gives a request up; its answer, if any, will not be delivered. Unknown tickets are ignored.
    fn cancel(&mut self, ticket: Ticket);
    /// The next answer that is there, without waiting.
    fn poll(&mut self) -> Option<Answer>;
    /// Waits until an answer may be there or `limit` has passed. For programs without a frame to draw
    /// meanwhile; a source that is always ready returns at once.
    fn wait(&mut self, limit: Duration);
    /// As [`TileSource::submit`], past all caches on the way: what came before was damaged.
    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        self.submit(request)
    }
    /// Where the records come from, for messages: an address or a folder.
    fn origin(&self) -> String {
        "this program".into()
    }
    /// What was asked and what it took, since the start.
    fn stats(&self) -> SourceStats {
        SourceStats::default()
    }
}

impl<S: TileSource + ?Sized> TileSource for Box<S> {
    fn capacity(&self) -> usize {
        (**self).capacity()
    }
    fn in_flight(&self) -> usize {
        (**self).in_flight()
    }
    fn submit(&mut self, request: Request) -> Option<Ticket> {
        (**self).submit(request)
    }
    fn cancel(&mut self, ticket: Ticket) {
        (**self).cancel(ticket);
    }
    fn poll(&mut self) -> Option<Answer> {
        (**self).poll()
    }
    fn wait(&mut self, limit: Duration) {
        (**self).wait(limit);
    }
    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        (**self).submit_anew(request)
    }
    fn origin(&self) -> String {
        (**self).origin()
    }
    fn stats(&self) -> SourceStats {
        (**self).stats()
    }
}

/// A source that its user keeps a hand on, while something else asks of it.
impl<S: TileSource + ?Sized> TileSource for Rc<RefCell<S>> {
    fn capacity(&self) -> usize {
        self.borrow().capacity()
    }
    fn in_flight(&self) -> usize {
        self.borrow().in_flight()
    }
    fn submit(&mut self, request: Request) -> Option<Ticket> {
        self.borrow_mut().submit(request)
    }
    fn cancel(&mut self, ticket: Ticket) {
        self.borrow_mut().cancel(ticket);
    }
    fn poll(&mut self) -> Option<Answer> {
        self.borrow_mut().poll()
    }
    fn wait(&mut self, limit: Duration) {
        self.borrow_mut().wait(limit);
    }
    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        self.borrow_mut().submit_anew(request)
    }
    fn origin(&self) -> String {
        self.borrow().origin()
    }
    fn stats(&self) -> SourceStats {
        self.borrow().stats()
    }
}
