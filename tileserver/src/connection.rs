//! Connections: how many, how long, and how they end.

use std::{
    future::Future,
    io,
    net::SocketAddr,
    pin::{Pin, pin},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    task::{Context, Poll, ready},
    time::Duration,
};

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use tokio::{
    io::{AsyncRead, AsyncWrite, ReadBuf},
    net::{TcpListener, TcpStream},
    sync::{Semaphore, watch},
    task::JoinSet,
    time::{Instant, sleep},
};

use crate::{Collection, Error, Options, Result, router};

/// Most bytes of a request's head. Addresses and the few fields that matter here are far shorter.
const MAX_HEAD_BYTES: usize = 16 << 10;
/// Most header fields of a request.
const MAX_FIELDS: usize = 64;
/// Pause after the system has refused a connection for want of something, such as open files.
const ACCEPT_PAUSE: Duration = Duration::from_millis(500);

/// Serves a collection on a socket until `shutdown` ends; then accepts nothing more, lets requests in progress
/// finish within [`Options::drain_timeout`], and returns.
///
/// # Errors
/// [`Error::Socket`] if the socket does not work at all.
pub async fn run(
    listener: TcpListener,
    collection: Collection,
    options: Options,
    shutdown: impl Future<Output = ()>,
) -> Result<()> {
    let address = listener.local_addr().map_err(Error::Socket)?;
    tracing::info!(%address, archives = collection.names().len(), "listening");
    let router = router(collection, &options);
    let (stop, stopping) = watch::channel(());
    let slots = Arc::new(Semaphore::new(
        options.connections.clamp(1, Semaphore::MAX_PERMITS),
    ));
    let mut connections = JoinSet::new();
    let mut shutdown = pin!(shutdown);
    loop {
        // A slot first: more connections wait in the system's queue.
        let accepted = async {
            let slot = Arc::clone(&slots).acquire_owned().await;
            (slot, accept(&listener).await)
        };
        tokio::select! {
            (slot, stream) = accepted => {
                let connection = serve(stream, router.clone(), options, stopping.clone());
                connections.spawn(async move {
                    let _slot = slot;
                    connection.await;
                });
            }
            Some(_) = connections.join_next() => {}
            () = &mut shutdown => break,
        }
    }
    drop(listener);
    drop(stop);
    tracing::info!(connections = connections.len(), "stopping");
    let drained = async { while connections.join_next().await.is_some() {} };
    if tokio::time::timeout(options.drain_timeout, drained)
        .await
        .is_err()
    {
        tracing::warn!(
            connections = connections.len(),
            "requests were still in progress and are broken off"
        );
        connections.shutdown().await;
    }
    Ok(())
}

/// The next connection. One that broke off before it was accepted is not an error of ours, and when the system
/// is out of something it gets time to have it again.
async fn accept(listener: &TcpListener) -> (TcpStream, SocketAddr) {
    loop {
        match listener.accept().await {
            Ok(accepted) => return accepted,
            Err(error) if is_of_one_connection(&error) => {}
            Err(error) => {
                tracing::error!(%error, "no connection can be accepted");
                sleep(ACCEPT_PAUSE).await;
            }
        }
    }
}

fn is_of_one_connection(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(
        error.kind(),
        ConnectionAborted | ConnectionRefused | ConnectionReset
    )
}

/// Serves one connection to its end, which comes when the client or the service wants it, or after silence.
async fn serve(
    (stream, client): (TcpStream, SocketAddr),
    router: Router,
    options: Options,
    stop: watch::Receiver<()>,
) {
    // Answers are written as a whole; waiting for more to send would only delay them.
    let _ = stream.set_nodelay(true);
    let progress = Arc::new(AtomicU64::new(0));
    let io = TokioIo::new(Watched {
        stream,
        progress: Arc::clone(&progress),
    });
    let mut builder = http1::Builder::new();
    builder
        .timer(TokioTimer::new())
        .header_read_timeout(options.header_timeout);
    builder.max_header_size(MAX_HEAD_BYTES).max_headers(MAX_FIELDS);
    let mut connection = pin!(builder.serve_connection(io, TowerToHyperService::new(router)));
    let mut stopped = pin!(stopped(stop));
    let mut stopping = false;
    let mut silent = pin!(silence(&progress, options.idle_timeout));
    loop {
        tokio::select! {
            result = &mut connection => {
                if let Err(error) = result {
                    tracing::debug!(%client, %error, "the connection broke off");
                }
                return;
            }
            () = &mut stopped, if !stopping => {
                stopping = true;
                connection.as_mut().graceful_shutdown();
            }
            () = &mut silent => {
                tracing::debug!(%client, "the connection was silent for too long");
                return;
            }
        }
    }
}

/// Ends when the sender is gone.
async fn stopped(mut stop: watch::Receiver<()>) {
    while stop.changed().await.is_ok() {}
}

/// Ends when there was no progress for `limit`, or at most a quarter longer.
async fn silence(progress: &AtomicU64, limit: Duration) {
    let (mut last, mut since) = (progress.load(Ordering::Relaxed), Instant::now());
    while since.elapsed() < limit {
        sleep(limit / 4).await;
        let now = progress.load(Ordering::Relaxed);
        if now != last {
            (last, since) = (now, Instant::now());
        }
    }
}

/// A stream that counts the bytes which go through it.
struct Watched {
    stream: TcpStream,
    progress: Arc<AtomicU64>,
}

impl Watched {
    fn written(&self, result: io::Result<usize>) -> io::Result<usize> {
        result.inspect(|&bytes| _ = self.progress.fetch_add(bytes as u64, Ordering::Relaxed))
    }
}

impl AsyncRead for Watched {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let result = ready!(Pin::new(&mut self.stream).poll_read(context, buffer));
        self.progress
            .fetch_add((buffer.filled().len() - before) as u64, Ordering::Relaxed);
        Poll::Ready(result)
    }
}

impl AsyncWrite for Watched {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let result = ready!(Pin::new(&mut self.stream).poll_write(context, bytes));
        Poll::Ready(self.written(result))
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let result = ready!(Pin::new(&mut self.stream).poll_write_vectored(context, parts));
        Poll::Ready(self.written(result))
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}
