//! One connection: TLS or not, HTTP/1.1 or 2, its limits, and how it ends.

use std::{
    io,
    net::SocketAddr,
    pin::{Pin, pin},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    task::{Context, Poll},
    time::Duration,
};

use axum::Router;
use hyper::{
    body::Incoming,
    server::conn::{http1, http2},
    service::{Service, service_fn},
};
use hyper_util::{
    rt::{TokioExecutor, TokioIo, TokioTimer},
    server::graceful::GracefulConnection,
    service::TowerToHyperService,
};
use tokio::{
    io::{AsyncRead, AsyncWrite, ReadBuf},
    net::TcpStream,
    sync::watch,
    time::{Instant, sleep, timeout},
};
use tokio_rustls::server::TlsStream;

use crate::{Options, Tls, metrics::Metrics, outlet::Outlet};

/// Most bytes of a request's head. The longest address, of a batch, has about 6 KiB.
const MAX_HEAD_BYTES: usize = 16 << 10;
/// Most header fields of a request.
const MAX_FIELDS: usize = 64;
/// Bytes of an answer that HTTP/2 takes over from us before the client has made room for them, by request.
const STREAM_BUFFER_BYTES: usize = 64 << 10;
/// What a connection of HTTP/2 without TLS begins with (RFC 9113, section 3.4); no method of HTTP/1.1 does.
const PREFACE: &[u8] = b"PRI ";

/// What connections need to be served.
pub(crate) struct Door {
    pub(crate) router: Router,
    pub(crate) tls: Option<Tls>,
    pub(crate) options: Options,
    pub(crate) metrics: Arc<Metrics>,
    /// Ends when the service does.
    pub(crate) stopping: watch::Receiver<()>,
}

impl Door {
    /// Serves a connection to its end, which comes when the client or the service wants it, or after silence.
    pub(crate) async fn serve(&self, stream: TcpStream, client: SocketAddr) {
        self.metrics.connections_begun.add(1);
        let _open = Open(&self.metrics);
        // Answers are written as a whole; waiting for more to send would only delay them.
        let _ = stream.set_nodelay(true);
        let begun = match &self.tls {
            None => {
                let http2 = self.in_time(begins_with_preface(&stream)).await;
                http2.map(|http2| (Stream::Plain(stream), http2))
            }
            Some(tls) => self.in_time(tls.acceptor().accept(stream)).await.map(|stream| {
                let http2 = stream.get_ref().1.alpn_protocol() == Some(b"h2");
                (Stream::Tls(Box::new(stream)), http2)
            }),
        };
        match begun {
            Ok((Stream::Plain(stream), http2)) => self.talk(stream, client, http2).await,
            Ok((Stream::Tls(stream), http2)) => self.talk(stream, client, http2).await,
            Err(error) => tracing::debug!(%client, %error, "the connection did not begin"),
        }
    }

    /// How a connection begins, if it does so in time and before the service ends.
    async fn in_time<T>(&self, begin: impl Future<Output = io::Result<T>>) -> io::Result<T> {
        tokio::select! {
            begun = timeout(self.options.header_timeout, begin) => {
                begun.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()))
            }
            () = stopped(self.stopping.clone()) => Err(io::Error::other("the service ends")),
        }
    }

    async fn talk<S>(&self, stream: S, client: SocketAddr, http2: bool)
    where
        S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
    {
        let (progress, outlet) = (Arc::new(AtomicU64::new(0)), Outlet::default());
        let io = TokioIo::new(Watched {
            stream,
            progress: Arc::clone(&progress),
            outlet: outlet.clone(),
        });
        let service = service_fn({
            let (service, progress) = (
                TowerToHyperService::new(self.router.clone()),
                Arc::clone(&progress),
            );
            move |mut request: hyper::Request<Incoming>| {
                progress.fetch_add(1, Ordering::Relaxed);
                request.extensions_mut().insert(outlet.clone());
                service.call(request)
            }
        });
        if http2 {
            let mut builder = http2::Builder::new(TokioExecutor::new());
            builder
                .timer(TokioTimer::new())
                .max_concurrent_streams(self.options.streams.max(1));
            builder
                .max_header_list_size(MAX_HEAD_BYTES as u32)
                .max_send_buf_size(STREAM_BUFFER_BYTES);
            self.drive(builder.serve_connection(io, service), client, &progress)
                .await;
        } else {
            let mut builder = http1::Builder::new();
            builder
                .timer(TokioTimer::new())
                .header_read_timeout(self.options.header_timeout);
            builder.max_header_size(MAX_HEAD_BYTES).max_headers(MAX_FIELDS);
            self.drive(builder.serve_connection(io, service), client, &progress)
                .await;
        }
    }

    async fn drive<C>(&self, connection: C, client: SocketAddr, progress: &AtomicU64)
    where
        C: GracefulConnection<Error = hyper::Error>,
    {
        let mut connection = pin!(connection);
        let mut stopped = pin!(stopped(self.stopping.clone()));
        let mut stopping = false;
        let mut silent = pin!(silence(progress, self.options.idle_timeout));
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
}

/// A connection that has begun.
enum Stream {
    Plain(TcpStream),
    Tls(Box<TlsStream<TcpStream>>),
}

/// Counts a connection's end.
struct Open<'a>(&'a Metrics);

impl Drop for Open<'_> {
    fn drop(&mut self) {
        self.0.connections_ended.add(1);
    }
}

/// Whether a connection begins with the preface of HTTP/2. Waits for its first bytes, and leaves them there.
async fn begins_with_preface(stream: &TcpStream) -> io::Result<bool> {
    let mut first = [0; PREFACE.len()];
    loop {
        let count = stream.peek(&mut first).await?;
        if count == 0 || first[..count] != PREFACE[..count] {
            return Ok(false);
        }
        if count == PREFACE.len() {
            return Ok(true);
        }
        sleep(Duration::from_millis(10)).await; // There is something to read, so waiting for that does not help.
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

/// A stream that counts the bytes which are written to it. Bytes that come are no progress before they are a
/// request: requests have no bodies here, and who sends heads byte by byte is as good as silent.
struct Watched<S> {
    stream: S,
    progress: Arc<AtomicU64>,
    outlet: Outlet,
}

impl<S> Watched<S> {
    fn written(&self, result: io::Result<usize>) -> io::Result<usize> {
        result.inspect(|&bytes| _ = self.progress.fetch_add(bytes as u64, Ordering::Relaxed))
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Watched<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Watched<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let result = Pin::new(&mut self.stream).poll_write(context, bytes);
        result.map(|result| self.written(result))
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let result = Pin::new(&mut self.stream).poll_write_vectored(context, parts);
        result.map(|result| self.written(result))
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let result = Pin::new(&mut self.stream).poll_flush(context);
        if result.is_ready() {
            self.outlet.flushed();
        }
        result
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}
