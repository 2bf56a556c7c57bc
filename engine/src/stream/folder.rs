//! A folder of `.bsvtf` files, read on a thread of its own, so that a slow disk does not hold up a frame.

use std::{
    collections::VecDeque,
    fs::File,
    io,
    num::NonZeroUsize,
    path::{Path, PathBuf},
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, mpsc::Sender},
    time::Duration,
};

use ::lru::LruCache;
use bytes::Bytes;
use tileset::{Archive, ReadAt, Record};

use super::{Answer, Request, SourceStats, Ticket, TileSource, inbox::Inbox, source::plain_name};
use crate::{Error, Result};

/// Requests in flight. The disk is the limit, not the queue: it only has to bridge a frame.
const CAPACITY: usize = 256;
/// Files that are kept open, the ones used last. Systems allow a process 256 open files and more.
const MAX_OPEN_FILES: NonZeroUsize = NonZeroUsize::new(64).unwrap();

/// A folder of archives: `NAME.bsvtf` is the archive NAME.
///
/// An archive is opened when its index is asked for and stays that file, even if another one replaces it in the
/// folder, until the index is asked for again.
pub struct FolderSource {
    inbox: Inbox<()>,
    queue: Arc<Queue>,
    folder: PathBuf,
    stats: SourceStats,
}

impl FolderSource {
    /// A source of the archives in `folder`. Nothing is read yet.
    ///
    /// # Errors
    /// [`Error::NotFound`] if there is no such folder, [`Error::Source`] if no thread can be started.
    pub fn new(folder: impl Into<PathBuf>) -> Result<Self> {
        let folder = folder.into();
        if !folder.is_dir() {
            return Err(Error::NotFound(format!("the folder {}", folder.display())));
        }
        let inbox = Inbox::new(CAPACITY);
        let queue = Arc::new(Queue::default());
        let reader = Reader {
            folder: folder.clone(),
            archives: LruCache::new(MAX_OPEN_FILES),
        };
        let (requests, answers) = (Arc::clone(&queue), inbox.sender());
        std::thread::Builder::new()
            .name("eigentile-folder".into())
            .spawn(move || reader.run(&requests, &answers))
            .map_err(|error| Error::Source {
                what: "reader thread".into(),
                detail: error.to_string(),
            })?;
        let stats = SourceStats::default();
        Ok(Self {
            inbox,
            queue,
            folder,
            stats,
        })
    }
}

impl TileSource for FolderSource {
    fn capacity(&self) -> usize {
        self.inbox.capacity()
    }

    fn in_flight(&self) -> usize {
        self.inbox.in_flight()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        let ticket = self.inbox.open(|ticket| self.queue.push(ticket, request))?;
        self.stats.requested += 1;
        Some(ticket)
    }

    fn cancel(&mut self, ticket: Ticket) {
        if self.inbox.give_up(ticket).is_some() {
            self.stats.cancelled += 1;
            self.queue.remove(ticket);
        }
    }

    fn poll(&mut self) -> Option<Answer> {
        let answer = self.inbox.poll()?;
        self.stats.wire_bytes += answer.wire_bytes;
        Some(answer)
    }

    fn wait(&mut self, limit: Duration) {
        self.inbox.wait(limit);
    }

    fn origin(&self) -> String {
        self.folder.display().to_string()
    }

    fn stats(&self) -> SourceStats {
        self.stats
    }
}

impl Drop for FolderSource {
    fn drop(&mut self) {
        self.queue.close();
    }
}

/// Requests that the thread has not begun with; as many as are in flight at most.
#[derive(Default)]
struct Queue {
    state: Mutex<QueueState>,
    changed: Condvar,
}

#[derive(Default)]
struct QueueState {
    waiting: VecDeque<(Ticket, Request)>,
    closed: bool,
}

impl Queue {
    fn lock(&self) -> MutexGuard<'_, QueueState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn push(&self, ticket: Ticket, request: Request) {
        self.lock().waiting.push_back((ticket, request));
        self.changed.notify_one();
    }

    fn remove(&self, ticket: Ticket) {
        self.lock().waiting.retain(|(waiting, _)| *waiting != ticket);
    }

    fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_one();
    }

    /// The next request; waits for one. `None` when the source is gone.
    fn pop(&self) -> Option<(Ticket, Request)> {
        let mut state = self.lock();
        loop {
            if state.closed {
                return None;
            }
            if let Some(next) = state.waiting.pop_front() {
                return Some(next);
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// The thread's side: the folder and the files that are open.
struct Reader {
    folder: PathBuf,
    archives: LruCache<Arc<str>, Archive<File>>,
}

impl Reader {
    fn run(mut self, requests: &Queue, answers: &Sender<Answer>) {
        while let Some((ticket, request)) = requests.pop() {
            let bytes = self.read(&request);
            let wire_bytes = bytes.as_ref().map_or(0, |bytes| bytes.len() as u64);
            if answers
                .send(Answer {
                    ticket,
                    request,
                    bytes,
                    checked: false,
                    wire_bytes,
                })
                .is_err()
            {
                return;
            }
        }
    }

    fn read(&mut self, request: &Request) -> Result<Bytes> {
        let name = request.archive();
        if matches!(request, Request::Index { .. }) {
            let archive = open(&self.folder, name)?;
            let prefix = archive.prefix()?;
            self.archives.put(Arc::clone(name), archive);
            return Ok(prefix.into());
        }
        let archive = self
            .archives
            .try_get_or_insert(Arc::clone(name), || open(&self.folder, name))?;
        let Some(record) = request.record(&archive.index)? else {
            return Ok(Bytes::new()); // An index, which is answered above.
        };
        // Bounded: the directory was checked against the length of the file.
        let mut bytes = vec![0; record.length as usize];
        archive
            .reader
            .read_exact_at(record.offset, &mut bytes)
            .map_err(|source| {
                let Record { offset, length, .. } = record;
                tileset::Error::Io {
                    what: format!("reading {request}, {length} bytes at {offset}"),
                    source,
                }
            })?;
        Ok(bytes.into())
    }
}

/// Opens an archive of the folder; errors name the file.
fn open(folder: &Path, name: &str) -> Result<Archive<File>> {
    let path = archive_path(folder, name)?;
    let failed = |source: io::Error| match source.kind() {
        io::ErrorKind::NotFound => Error::NotFound(format!("archive {name:?} ({})", path.display())),
        _ => Error::Archive(tileset::Error::Io {
            what: format!("opening {}", path.display()),
            source,
        }),
    };
    // Looked at before it is opened: opening a pipe would wait for its other end.
    if !std::fs::metadata(&path).map_err(failed)?.is_file() {
        return Err(Error::NotFound(format!(
            "archive {name:?}: {} is no file; it",
            path.display()
        )));
    }
    let file = File::open(&path).map_err(failed)?;
    Archive::open(file).map_err(|error| match error {
        tileset::Error::Corrupt { what, offset, detail } => tileset::Error::Corrupt {
            what: format!("{}: {what}", path.display()),
            offset,
            detail,
        }
        .into(),
        other => other.into(),
    })
}

/// The file of an archive.
fn archive_path(folder: &Path, name: &str) -> Result<PathBuf> {
    plain_name(name)?;
    Ok(folder.join(format!("{name}.bsvtf")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_do_not_lead_out_of_the_folder() {
        let folder = Path::new("/archives");
        for bad in [
            "",
            ".",
            "..",
            "../x",
            "a/b",
            "a/",
            "/etc/passwd",
            "..\\x",
            "C:x",
            "a\0b",
        ] {
            assert!(
                matches!(archive_path(folder, bad), Err(Error::NotFound(_))),
                "{bad:?}"
            );
        }
        for good in ["cloth", "wool 2", "stein.größe", "..."] {
            assert_eq!(
                archive_path(folder, good).unwrap(),
                folder.join(format!("{good}.bsvtf"))
            );
        }
    }

    #[test]
    fn a_missing_folder_is_named() {
        let error = FolderSource::new("/no/such/folder").err().unwrap();
        assert!(error.to_string().contains("/no/such/folder"), "{error}");
    }
}
