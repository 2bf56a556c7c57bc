//! The threads that serve connections: one for each core, each with a runtime of its own.
//!
//! A connection stays where it is, so that no request wakes another thread or is taken over by one. What connections share
//! (records, metrics, limits) is shared by all threads; reads of files go on threads of their own.

use std::{
    io,
    net::{SocketAddr, TcpStream as BlockingStream},
    num::NonZero,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering::Relaxed},
    },
    thread,
    time::Duration,
};

use tokio::{
    net::TcpStream,
    runtime::{Builder, Runtime},
    sync::{AcquireError, OwnedSemaphorePermit, mpsc, watch},
    task::JoinSet,
    time::timeout,
};

use crate::connection::Door;

/// Connections on their way to a thread.
const QUEUE: usize = 64;

/// All threads. When this is dropped they break off what they are at.
pub(crate) struct Workers {
    all: Vec<Worker>,
    /// Closed when the last thread has ended.
    ended: mpsc::Receiver<()>,
    /// Tells them to break off, by being dropped.
    _go_on: watch::Sender<()>,
}

struct Worker {
    queue: mpsc::Sender<Accepted>,
    connections: Arc<AtomicUsize>,
}

/// A connection that is not served yet, and its place among all.
struct Accepted {
    stream: BlockingStream,
    client: SocketAddr,
    place: Place,
}

/// Counts a connection for as long as it lives.
struct Place {
    _slot: Result<OwnedSemaphorePermit, AcquireError>,
    connections: Arc<AtomicUsize>,
}

impl Drop for Place {
    fn drop(&mut self) {
        self.connections.fetch_sub(1, Relaxed);
    }
}

impl Workers {
    pub(crate) fn start(door: Arc<Door>) -> io::Result<Self> {
        let (go_on, broken_off) = watch::channel(());
        let (ending, ended) = mpsc::channel(1);
        let mut all = Vec::new();
        for _ in 0..thread::available_parallelism().map_or(1, NonZero::get) {
            let (queue, accepted) = mpsc::channel(QUEUE);
            let runtime = Builder::new_current_thread().enable_all().build()?;
            let (door, broken_off, ending) = (Arc::clone(&door), broken_off.clone(), ending.clone());
            thread::Builder::new()
                .name("connections".to_owned())
                .spawn(move || work(&runtime, door, accepted, broken_off, ending))?;
            all.push(Worker {
                queue,
                connections: Arc::default(),
            });
        }
        Ok(Self {
            all,
            ended,
            _go_on: go_on,
        })
    }

    /// Hands a connection to the thread that has the fewest.
    pub(crate) async fn give(
        &self,
        stream: TcpStream,
        client: SocketAddr,
        slot: Result<OwnedSemaphorePermit, AcquireError>,
    ) {
        let Some(worker) = self
            .all
            .iter()
            .min_by_key(|worker| worker.connections.load(Relaxed))
        else {
            return;
        };
        let stream = match stream.into_std() {
            Ok(stream) => stream,
            Err(error) => return tracing::debug!(%client, %error, "the connection did not begin"),
        };
        worker.connections.fetch_add(1, Relaxed);
        let place = Place {
            _slot: slot,
            connections: Arc::clone(&worker.connections),
        };
        let accepted = Accepted {
            stream,
            client,
            place,
        };
        if worker.queue.send(accepted).await.is_err() {
            tracing::error!(%client, "a thread that serves connections is gone");
        }
    }

    /// Connections that are open.
    pub(crate) fn connections(&self) -> usize {
        self.all
            .iter()
            .map(|worker| worker.connections.load(Relaxed))
            .sum()
    }

    /// Waits until all connections have ended; breaks them off after `limit`.
    pub(crate) async fn end(mut self, limit: Duration) {
        let open: Vec<_> = self.all.drain(..).map(|worker| worker.connections).collect();
        if timeout(limit, self.ended.recv()).await.is_ok() {
            return;
        }
        let connections: usize = open.iter().map(|count| count.load(Relaxed)).sum();
        tracing::warn!(connections, "requests were still in progress and are broken off");
        let Self {
            mut ended, _go_on, ..
        } = self;
        drop(_go_on);
        let _ = timeout(limit.max(Duration::from_secs(1)), ended.recv()).await;
    }
}

/// Serves connections until no more can come and all have ended, or all are to be broken off.
fn work(
    runtime: &Runtime,
    door: Arc<Door>,
    mut accepted: mpsc::Receiver<Accepted>,
    mut broken_off: watch::Receiver<()>,
    ending: mpsc::Sender<()>,
) {
    runtime.block_on(async {
        let mut connections = JoinSet::new();
        let mut open = true;
        while open || !connections.is_empty() {
            tokio::select! {
                next = accepted.recv(), if open => match next {
                    Some(Accepted { stream, client, place }) => {
                        let door = Arc::clone(&door);
                        connections.spawn(async move {
                            let _place = place;
                            match TcpStream::from_std(stream) {
                                Ok(stream) => door.serve(stream, client).await,
                                Err(error) => tracing::debug!(%client, %error, "the connection did not begin"),
                            }
                        });
                    }
                    None => open = false,
                },
                Some(_) = connections.join_next() => {}
                _ = broken_off.changed() => break,
            }
        }
        connections.shutdown().await;
        drop(ending);
        // Others may be waiting for a read that uses this thread's timers.
        let _ = broken_off.changed().await;
    });
}
