//! All sources and decorators, alone and on top of each other.

use std::{any::Any, time::Duration};

use super::{
    super::{either::EitherSource, *},
    Fixture, Host, fetch,
};

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
            tileserver::Options {
                list_age: std::time::Duration::ZERO, // tests replace archives
                ..tileserver::Options::default()
            },
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
    Subject::new(HttpSource::new(&served.url, &HttpOptions::default()).unwrap())
        .needing(served)
        .needing(folder)
}

fn ranges() -> Subject {
    let host = Host::start();
    let transport = HttpTransport::new(&HttpOptions::default()).unwrap();
    Subject::new(RangeSource::new(transport, &host.url)).needing(host)
}

/// Everything that is checked can be checked: indices come first.
fn retried<S: TileSource>(inner: S) -> RetriedSource<S> {
    let options = RetryOptions {
        attempts: 100,
        first_attempts: 100,
        damaged_attempts: 100,
        backoff: Duration::from_micros(10),
        longest_backoff: Duration::from_micros(100),
        ..RetryOptions::default()
    };
    let mut source = RetriedSource::new(inner, options);
    let requests = Fixture::get().requests();
    let indices = requests.into_iter();
    let indices: Vec<Request> = indices
        .filter(|request| matches!(request, Request::Index { .. }))
        .collect();
    fetch(&mut source, &indices);
    source
}

fn faulty<S: TileSource>(inner: S) -> FaultySource<S> {
    let faults = Faults {
        fail: 0.2,
        repeat: 0.2,
        damage: 0.2,
        reorder: 0.5,
        delay_polls: 3,
        ..Faults::default()
    };
    FaultySource::new(inner, faults, 5)
}

/// On disk, for so many bytes.
fn disk<S: TileSource>(inner: S, budget_bytes: u64) -> (DiskCachedSource<S>, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let options = DiskCacheOptions {
        folder: folder.path().to_owned(),
        budget_bytes,
    };
    (DiskCachedSource::new(inner, &options).unwrap(), folder)
}

fn on_disk<S: TileSource + 'static>(inner: S, budget_bytes: u64) -> Subject {
    let (source, folder) = disk(inner, budget_bytes);
    Subject::new(source).needing(folder)
}

fn opened(url: &str, needs: impl Any, cache: bool) -> Subject {
    let folder = tempfile::tempdir().unwrap();
    let disk = DiskCacheOptions {
        folder: folder.path().to_owned(),
        budget_bytes: 1 << 20,
    };
    let options = OpenOptions {
        disk: cache.then_some(disk),
        ..OpenOptions::default()
    };
    Subject::new(open_with(url, &options).unwrap())
        .needing(folder)
        .needing(needs)
}

/// A network whose simulated time goes on by a millisecond with every poll.
struct Ticking<S>(NetworkSource<S>);

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
        self.0.advance(Duration::from_millis(1));
        self.0.poll()
    }
    fn wait(&mut self, limit: Duration) {
        self.0.wait(limit);
    }
}

/// Slow, lossy, out of order.
fn networked<S: TileSource>(inner: S, bytes_per_poll: u64) -> Ticking<S> {
    let network = Network {
        bits_per_second: bytes_per_poll * 8000,
        round_trip: Duration::from_millis(3),
        jitter: Duration::from_millis(2),
        loss: 0.1,
        reorder: 0.2,
        connections: 2,
        streams: 3,
        batch: 3,
        header_bytes: 50,
        frame_bytes: 16,
    };
    Ticking(NetworkSource::new(inner, network, 5))
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
        ("network", || Subject::new(networked(memory(), 100))),
        ("reordered", || Subject::new(reordered(memory()))),
        ("range", ranges),
        ("retried", || Subject::new(retried(memory()))),
        ("retried over faulty", || Subject::new(retried(faulty(memory())))),
        ("background", || {
            Subject::new(BackgroundSource::new(memory()).unwrap())
        }),
        ("background over network", || {
            Subject::new(BackgroundSource::new(networked(memory(), 1000)).unwrap())
        }),
        ("disk", || on_disk(memory(), 1 << 20)),
        ("disk, little room", || on_disk(memory(), 5 * 4096)),
        ("disk over retried over faulty", || {
            on_disk(retried(faulty(memory())), 12 * 4096)
        }),
        ("cached over disk over retried over faulty", || {
            let (source, folder) = disk(retried(faulty(memory())), 12 * 4096);
            Subject::new(CachedSource::new(source, 2000)).needing(folder)
        }),
        ("retried over faulty over range", || {
            let Subject { source, _needs } = ranges();
            Subject {
                source: Box::new(retried(faulty(source))),
                _needs,
            }
        }),
        ("either, a tile server", || {
            let folder = Fixture::get().folder();
            let served = Served::start(folder.path());
            let source = EitherSource::new(&served.url, &HttpOptions::default()).unwrap();
            Subject::new(source).needing(served).needing(folder)
        }),
        ("either, a static host", || {
            let host = Host::start();
            Subject::new(EitherSource::new(&host.url, &HttpOptions::default()).unwrap()).needing(host)
        }),
        ("all of open, disk, range", || {
            let host = Host::start();
            let url = format!("{}/cloth.bsvtf", host.url);
            opened(&url, host, true)
        }),
        ("all of open, either, static", || {
            let host = Host::start();
            let url = host.url.clone();
            opened(&url, host, false)
        }),
        ("all of open, disk, http", || {
            let folder = Fixture::get().folder();
            let served = Served::start(folder.path());
            let url = served.url.clone();
            opened(&url, (served, folder), true)
        }),
        ("all of open, folder", || {
            let folder = Fixture::get().folder();
            let path = folder.path().to_str().unwrap().to_owned();
            opened(&path, folder, false)
        }),
        ("all decorators over a folder", || {
            let Subject { source, _needs } = folder();
            Subject {
                source: Box::new(CachedSource::new(networked(reordered(source), 200), 2000)),
                _needs,
            }
        }),
        ("all decorators over http", || {
            let Subject { source, _needs } = http();
            Subject {
                source: Box::new(CachedSource::new(networked(reordered(source), 200), 2000)),
                _needs,
            }
        }),
    ]
}
