//! All sources and decorators, alone and on top of each other.

use std::{any::Any, time::Duration};

use super::{super::*, Fixture};

/// A source under test, and what it needs to live.
pub(super) struct Subject {
    pub(super) source: Box<dyn TileSource>,
    _needs: Vec<Box<dyn Any>>,
}

impl Subject {
    fn new(source: impl TileSource + 'static) -> Self {
        Self {
            source: Box::new(source),
            _needs: Vec::new(),
        }
    }

    fn needing(mut self, needed: impl Any) -> Self {
        self._needs.push(Box::new(needed));
        self
    }
}

/// A tile server on a free port, as long as it lives.
pub(in crate::stream) struct Served {
    pub(in crate::stream) url: String,
    runtime: Option<tokio::runtime::Runtime>,
}

impl Served {
    pub(in crate::stream) fn start(folder: &std::path::Path) -> Self {
        let runtime = tokio::runtime::Runtime::new().unwrap();
        let listener = runtime
            .block_on(tokio::net::TcpListener::bind("127.0.0.1:0"))
            .unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let collection = tileserver::Collection::open(folder).unwrap();
        let forever = std::future::pending();
        runtime.spawn(tileserver::run(
            listener,
            collection,
            tileserver::Options::default(),
            forever,
        ));
        Self {
            url,
            runtime: Some(runtime),
        }
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.runtime.take().unwrap().shutdown_background();
    }
}

fn folder() -> Subject {
    let folder = Fixture::get().folder();
    Subject::new(FolderSource::new(folder.path()).unwrap()).needing(folder)
}

fn http() -> Subject {
    let folder = Fixture::get().folder();
    let served = Served::start(folder.path());
    Subject::new(HttpSource::new(&served.url, HttpOptions::default()).unwrap())
        .needing(served)
        .needing(folder)
}

/// A throttled source whose simulated time goes on with every poll.
struct Ticking<S>(ThrottledSource<S>, u64);

impl<S: TileSource> TileSource for Ticking<S> {
    fn capacity(&self) -> usize {
        self.0.capacity()
    }
    fn in_flight(&self) -> usize {
        self.0.in_flight()
    }
    fn submit(&mut self, request: Request) -> Option<Ticket> {
        self.0.submit(request)
    }
    fn cancel(&mut self, ticket: Ticket) {
        self.0.cancel(ticket);
    }
    fn poll(&mut self) -> Option<Answer> {
        self.0.advance(self.1);
        self.0.poll()
    }
    fn wait(&mut self, limit: Duration) {
        self.0.wait(limit);
    }
}

fn throttled<S: TileSource>(inner: S, bytes_per_poll: u64) -> Ticking<S> {
    Ticking(ThrottledSource::with_latency(inner, 3), bytes_per_poll)
}

fn reordered<S: TileSource>(inner: S) -> FaultySource<S> {
    FaultySource::new(
        inner,
        Faults {
            reorder: 0.7,
            delay_polls: 9,
            ..Faults::default()
        },
        5,
    )
}

/// Makes a subject of its own for each test.
type Make = fn() -> Subject;

/// All sources and decorators, alone and on top of each other.
pub(super) fn subjects() -> Vec<(&'static str, Make)> {
    fn memory() -> MemorySource {
        Fixture::get().memory()
    }
    vec![
        ("memory", || Subject::new(memory())),
        ("folder", folder),
        ("http", http),
        ("cached", || Subject::new(CachedSource::new(memory(), 2000))),
        ("cached, nothing kept", || {
            Subject::new(CachedSource::new(memory(), 0))
        }),
        ("cached twice", || {
            Subject::new(CachedSource::new(CachedSource::new(memory(), 1 << 20), 1 << 20))
        }),
        ("throttled", || Subject::new(throttled(memory(), 100))),
        ("reordered", || Subject::new(reordered(memory()))),
        ("all decorators over a folder", || {
            let Subject { source, _needs } = folder();
            Subject {
                source: Box::new(CachedSource::new(throttled(reordered(source), 200), 2000)),
                _needs,
            }
        }),
        ("all decorators over http", || {
            let Subject { source, _needs } = http();
            Subject {
                source: Box::new(CachedSource::new(throttled(reordered(source), 200), 2000)),
                _needs,
            }
        }),
    ]
}
