//! Keeps records on disk, for the next run, for other programs, and for when there is no network.
//!
//! Records are kept by content: the identity of the archive, which covers the hashes of all its records, and which record it
//! is. An archive that changes never finds the records of its predecessor, and one that lies on two hosts is kept
//! once. In `FOLDER/v1/`:
//!
//! | file | what |
//! |---|---|
//! | `ID/index` | header, manifest, tables and directory of the archive with this identity |
//! | `ID/pG.M.X.Y`, `ID/cG` | a page, a column |
//! | `names/HASH` | the identity that the archive of this name had at this address, when the host was asked last |

mod store;
#[cfg(test)]
mod tests;

use std::{collections::VecDeque, path::PathBuf, sync::Arc, time::Duration};

use bytes::Bytes;
use tileset::archive::{Index, MAX_INDEX_BYTES};
use xxhash_rust::xxh3::xxh3_128;

use self::store::Store;
use super::{
    Answer, Request, SourceStats, Ticket, TileSource,
    directories::{Directories, parse_shared},
};
use crate::{Error, Result};

/// Failures of the disk after which nothing more is added in this run: it is full, or not ours.
const MAX_FAILURES: u32 = 8;

/// Where and how much a [`DiskCachedSource`] keeps.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DiskCacheOptions {
    /// Folder; it is made where it is missing.
    pub folder: PathBuf,
    /// Most bytes that its files take together, whoever wrote them, in blocks of 4 KiB.
    pub budget_bytes: u64,
}

impl DiskCacheOptions {
    /// What [`DiskCacheOptions::user`] keeps unless it is changed.
    pub const BUDGET_BYTES: u64 = 4 << 30;

    /// The cache of this user, by the conventions of the system: `$XDG_CACHE_HOME/eigentile` or `~/.cache/eigentile`,
    /// `~/Library/Caches/eigentile` on macOS, `%LOCALAPPDATA%\eigentile\cache` on Windows. `None` where the
    /// environment does not say where that is.
    pub fn user() -> Option<Self> {
        let at = |variable: &str| {
            let path = PathBuf::from(std::env::var_os(variable)?);
            path.is_absolute().then_some(path)
        };
        let folder = if cfg!(windows) {
            at("LOCALAPPDATA")?.join("eigentile").join("cache")
        } else if cfg!(target_os = "macos") {
            at("HOME")?.join("Library/Caches/eigentile")
        } else {
            at("XDG_CACHE_HOME")
                .or_else(|| Some(at("HOME")?.join(".cache")))?
                .join("eigentile")
        };
        Some(Self {
            folder,
            budget_bytes: Self::BUDGET_BYTES,
        })
    }
}

/// Answers records from a folder on disk, and asks the inner source for the others.
///
/// Only what holds against its archive's directory is kept, and what is read is checked again: a damaged file is
/// dropped, and its record asked for. Indices are always asked for, because they tell whether an archive has changed. Only
/// if the source cannot be reached ([`Error::Unavailable`]) the last index that came from there is taken, and
/// [`SourceStats::offline`] counts that; what is on disk can then be had as before.
///
/// Reads and writes files in `submit` and `poll`: put a [`super::BackgroundSource`] around it where that must not be waited for.
/// Several processes may share a folder. The disk failing is no failure of a request.
pub struct DiskCachedSource<S> {
    inner: S,
    store: Store,
    directories: Directories,
    hits: VecDeque<(Ticket, Request, Bytes)>,
    next_hit: u64,
    failures: u32,
    from_disk: u64,
    from_disk_bytes: u64,
    offline: u64,
}

impl<S: TileSource> DiskCachedSource<S> {
    /// Keeps records of `inner`, and finds those that earlier runs have kept.
    ///
    /// # Errors
    /// [`Error::Source`] if the folder cannot be made or read.
    pub fn new(inner: S, options: &DiskCacheOptions) -> Result<Self> {
        let folder = options.folder.join("v1");
        let store = Store::open(&folder, options.budget_bytes).map_err(|error| Error::Source {
            what: format!("the cache {}", options.folder.display()),
            detail: format!("{error}: choose another folder, or none"),
        })?;
        Ok(Self {
            inner,
            store,
            directories: Directories::default(),
            hits: VecDeque::new(),
            next_hit: 0,
            failures: 0,
            from_disk: 0,
            from_disk_bytes: 0,
            offline: 0,
        })
    }

    /// The source behind the cache.
    pub fn inner_mut(&mut self) -> &mut S {
        &mut self.inner
    }

    /// A record from disk, if it is there and holds.
    fn find(&mut self, request: &Request) -> Option<Bytes> {
        let index = self.directories.get(request.archive())?;
        let record = request.record(index).ok()??;
        if record.length == 0 {
            return Some(Bytes::new());
        }
        let name = file_name(index, request);
        let bytes = Bytes::from(self.store.read(&name, record.length.into())?);
        if !self.directories.holds(request, &bytes) {
            self.store.remove(&name);
            return None;
        }
        Some(bytes)
    }

    /// Keeps what came, if it holds.
    fn keep(&mut self, request: &Request, bytes: &Bytes, checked: bool) {
        let is_index = matches!(request, Request::Index { .. });
        if !(checked && !is_index || self.directories.holds(request, bytes)) {
            return;
        }
        let Some(index) = self.directories.get(request.archive()).cloned() else {
            return;
        };
        if bytes.is_empty() || self.failures >= MAX_FAILURES {
            return;
        }
        let name = file_name(&index, request);
        let mut written = self.store.write(&name, bytes);
        if let (Request::Index { archive }, Ok(true)) = (request, &written) {
            let name = self.link_name(archive);
            written = self.store.write(&name, format!("{:032x}", index.id).as_bytes());
        }
        self.failures += u32::from(written.is_err());
    }

    /// The file that says which archive was found under a name.
    fn link_name(&self, archive: &str) -> String {
        let place = format!("{}\n{archive}", self.inner.origin());
        format!("names/{:032x}", xxh3_128(place.as_bytes()))
    }

    /// The last index that came from the host under this name, if it is on disk and holds.
    fn last_known(&mut self, archive: &Arc<str>) -> Option<Bytes> {
        let link = String::from_utf8(self.store.read(&self.link_name(archive), 32)?).ok()?;
        let id = u128::from_str_radix(&link, 16).ok()?;
        let name = format!("{id:032x}/index");
        let bytes = Bytes::from(self.store.read(&name, MAX_INDEX_BYTES)?);
        match parse_shared(&bytes) {
            Ok(index) if index.id == id => {
                self.directories.learn(archive, &bytes).ok()?;
                Some(bytes)
            }
            _ => {
                self.store.remove(&name);
                None
            }
        }
    }
}

fn file_name(index: &Index, request: &Request) -> String {
    let id = index.id;
    match request {
        Request::Index { .. } => format!("{id:032x}/index"),
        Request::Page { page, .. } => {
            let tileset::Tile { mip, x, y } = page.tile;
            format!("{id:032x}/p{}.{mip}.{x}.{y}", page.group)
        }
        Request::Column { group, .. } => format!("{id:032x}/c{group}"),
    }
}

/// Tickets of the inner source become even, those of hits are odd: no table of them is needed.
fn outer(inner: Ticket) -> Ticket {
    Ticket(inner.0 * 2)
}

impl<S: TileSource> TileSource for DiskCachedSource<S> {
    fn capacity(&self) -> usize {
        self.inner.capacity()
    }

    fn in_flight(&self) -> usize {
        self.inner.in_flight() + self.hits.len()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        if self.in_flight() >= self.capacity() {
            return None;
        }
        let Some(bytes) = self.find(&request) else {
            return self.inner.submit(request).map(outer);
        };
        let ticket = Ticket(self.next_hit * 2 + 1);
        self.next_hit += 1;
        self.from_disk += 1;
        self.from_disk_bytes += bytes.len() as u64;
        self.hits.push_back((ticket, request, bytes));
        Some(ticket)
    }

    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        if self.in_flight() >= self.capacity() {
            return None;
        }
        self.inner.submit_anew(request).map(outer)
    }

    fn cancel(&mut self, ticket: Ticket) {
        if ticket.0.is_multiple_of(2) {
            self.inner.cancel(Ticket(ticket.0 / 2));
        } else {
            self.hits.retain(|(hit, ..)| *hit != ticket);
        }
    }

    fn poll(&mut self) -> Option<Answer> {
        if let Some((ticket, request, bytes)) = self.hits.pop_front() {
            return Some(Answer {
                ticket,
                request,
                bytes: Ok(bytes),
                checked: true,
                wire_bytes: 0,
            });
        }
        let mut answer = self.inner.poll()?;
        answer.ticket = outer(answer.ticket);
        match (&answer.bytes, &answer.request) {
            (Ok(bytes), _) => self.keep(&answer.request, bytes, answer.checked),
            (Err(Error::Unavailable { .. }), Request::Index { archive }) => {
                if let Some(bytes) = self.last_known(archive) {
                    self.offline += 1;
                    answer.bytes = Ok(bytes);
                }
            }
            (Err(_), _) => {}
        }
        Some(answer)
    }

    fn wait(&mut self, limit: Duration) {
        if self.hits.is_empty() {
            self.inner.wait(limit);
        }
    }

    fn origin(&self) -> String {
        self.inner.origin()
    }

    fn stats(&self) -> SourceStats {
        let stats = self.inner.stats();
        SourceStats {
            from_disk: stats.from_disk + self.from_disk,
            from_disk_bytes: stats.from_disk_bytes + self.from_disk_bytes,
            offline: stats.offline + self.offline,
            ..stats
        }
    }
}
