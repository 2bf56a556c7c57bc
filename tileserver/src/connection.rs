//! One connection: TLS or not, HTTP/1.1 or 2, its limits, and how it ends.

use std::{
    future::poll_fn,
    io,
    net::SocketAddr,
    pin::{Pin, pin},
    sync::Arc,
    task::{Context, Poll, ready},
    time::Duration,
};

use hyper::{
    server::conn::{http1, http2},
    service::service_fn,
};
use hyper_util::{
    rt::{TokioExecutor, TokioIo, TokioTimer},
    server::graceful::GracefulConnection,
};
use tokio::{
    io::{AsyncRead, AsyncWrite, ReadBuf},
    net::TcpStream,
    sync::watch,
    time::{Sleep, sleep, timeout},
};
use tokio_rustls::server::TlsStream;

use crate::{Tls, metrics::Metrics, pulse::Pulse, routes, service::Shared};

/// Most bytes of a request's head. The longest address, of a batch, has about 6 KiB.
const MAX_HEAD_BYTES: usize = 16 << 10;
/// Most header fields of a request.
const MAX_FIELDS: usize = 64;
/// Bytes of an answer that HTTP/2 takes over from us before the client has made room for them, by request.
const STREAM_BUFFER_BYTES: usize = 64 << 10;
/// How long a client may take to close a connection of which our side has ended.
const LINGER: Duration = Duration::from_secs(1);
/// What a connection of HTTP/2 without TLS begins with (RFC 9113, section 3.4); no method of HTTP/1.1 does.
const PREFACE: &[u8] = b"PRI ";

/// What connections need to be served.
pub(crate) struct Door {
    pub(crate) shared: Arc<Shared>,
    pub(crate) tls: Option<Tls>,
    /// Ends when the service does.
    pub(crate) stopping: watch::Receiver<()>,
}

impl Door {
    /// Serves a connection to its end, which comes when the client or the service wants it, or after silence.
    pub(crate) async fn serve(&self, stream: TcpStream, client: SocketAddr) {
        self.shared.metrics.connections_begun.add(1);
        let _open = Open(&self.shared.metrics);
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
            begun = timeout(self.shared.options.header_timeout, begin) => {
                begun.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()))
            }
            () = stopped(self.stopping.clone()) => Err(io::Error::other("the service ends")),
        }
    }

    async fn talk<S>(&self, stream: S, client: SocketAddr, http2: bool)
    where
        S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
    {
        let pulse = Arc::new(Pulse::default());
        let io = TokioIo::new(Watched {
            stream,
            pulse: Arc::clone(&pulse),
            linger: None,
        });
        let (shared, of_requests) = (Arc::clone(&self.shared), Arc::clone(&pulse));
        let service =
            service_fn(move |request| routes::answer(Arc::clone(&shared), Arc::clone(&of_requests), request));
        if http2 {
            let mut builder = http2::Builder::new(TokioExecutor::new());
            builder
                .timer(TokioTimer::new())
                .max_concurrent_streams(self.shared.options.streams.max(1));
            builder
                .max_header_list_size(MAX_HEAD_BYTES as u32)
                .max_send_buf_size(STREAM_BUFFER_BYTES);
            let connection = builder.serve_connection(io, service);
            self.drive(connection, client, &pulse, None).await;
        } else {
            let mut builder = http1::Builder::new();
            // Its own timer would be made anew for each request.
            builder.header_read_timeout(None);
            builder.max_header_size(MAX_HEAD_BYTES).max_headers(MAX_FIELDS);
            let connection = builder.serve_connection(io, service);
            let head_time = Some(self.shared.options.header_timeout);
            self.drive(connection, client, &pulse, head_time).await;
        }
    }

    /// Until the connection ends. A head may take `head_time`, if that can be told.
    async fn drive<C>(&self, connection: C, client: SocketAddr, pulse: &Pulse, head_time: Option<Duration>)
    where
        C: GracefulConnection<Error = hyper::Error>,
    {
        let mut connection = pin!(connection);
        let mut stopped = pin!(stopped(self.stopping.clone()));
        let mut stopping = false;
        let mut silent = pin!(pulse.silence(self.shared.options.idle_timeout));
        let mut head: Option<Pin<Box<Sleep>>> = None;
        let end = poll_fn(|context| {
            loop {
                if let Poll::Ready(result) = connection.as_mut().poll(context) {
                    return Poll::Ready(result.map_err(|error| error.to_string()));
                }
                if stopping || stopped.as_mut().poll(context).is_pending() {
                    break;
                }
                stopping = true;
                connection.as_mut().graceful_shutdown();
            }
            match head_time.filter(|_| pulse.in_head()) {
                None => head = None,
                Some(time) => {
                    let late = head.get_or_insert_with(|| Box::pin(sleep(time)));
                    if late.as_mut().poll(context).is_ready() {
                        return Poll::Ready(Err("the head of a request took too long".to_owned()));
                    }
                }
            }
            let silent = silent.as_mut().poll(context);
            silent.map(|()| Err("it was silent for too long".to_owned()))
        });
        if let Err(reason) = end.await {
            tracing::debug!(%client, reason, "the connection was broken off");
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

/// A stream that tells what goes on on it.
struct Watched<S> {
    stream: S,
    pulse: Arc<Pulse>,
    /// Since our side has ended: how long the client's may go on.
    linger: Option<Pin<Box<Sleep>>>,
}

impl<S> Watched<S> {
    fn written(&self, result: io::Result<usize>) -> io::Result<usize> {
        result.inspect(|&bytes| self.pulse.written(bytes))
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Watched<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let result = Pin::new(&mut self.stream).poll_read(context, buffer);
        if buffer.filled().len() > before {
            self.pulse.read();
        }
        result
    }
}

impl<S: AsyncRead + AsyncWrite + Unpin> AsyncWrite for Watched<S> {
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
            self.pulse.flushed();
        }
        result
    }

    /// Says that nothing more will be sent, and then drops what the client still sends until it closes, too. A socket that is closed with something
    /// unread is reset, and the client loses what it has not read yet (RFC 9112, section 9.6).
    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let this = &mut *self;
        if this.linger.is_none() {
            ready!(Pin::new(&mut this.stream).poll_shutdown(context))?;
        }
        let linger = this.linger.get_or_insert_with(|| Box::pin(sleep(LINGER)));
        if linger.as_mut().poll(context).is_ready() {
            return Poll::Ready(Ok(()));
        }
        let mut bytes = [0; 1024];
        loop {
            let mut dropped = ReadBuf::new(&mut bytes);
            let read = ready!(Pin::new(&mut this.stream).poll_read(context, &mut dropped));
            if read.is_err() || dropped.filled().is_empty() {
                return Poll::Ready(Ok(()));
            }
        }
    }
}
