//! A client that asks over connections that stay, and takes the time of each answer. It knows as much of HTTP/1.1 as two servers use
//! who say the length of what they send.

use std::{
    io,
    net::SocketAddr,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
    task::JoinSet,
};

/// Longest head of an answer.
const MAX_HEAD_BYTES: usize = 8 << 10;

/// A connection that stays.
pub(super) struct Connection {
    stream: TcpStream,
    buffer: Vec<u8>,
}

impl Connection {
    pub(super) async fn open(address: SocketAddr) -> io::Result<Self> {
        let stream = TcpStream::connect(address).await?;
        stream.set_nodelay(true)?;
        Ok(Self {
            stream,
            buffer: Vec::new(),
        })
    }

    /// Asks, and reads the whole answer.
    ///
    /// # Errors
    /// If the connection breaks off, or the answer is not 200.
    pub(super) async fn ask(&mut self, request: &[u8]) -> io::Result<()> {
        self.stream.write_all(request).await?;
        self.buffer.clear();
        let end = loop {
            if self.stream.read_buf(&mut self.buffer).await? == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            match self.buffer.windows(4).position(|window| window == b"\r\n\r\n") {
                Some(at) => break at + 4,
                None if self.buffer.len() > MAX_HEAD_BYTES => {
                    return Err(io::Error::other("an endless head"));
                }
                None => {}
            }
        };
        let mut left = (end + length(&self.buffer[..end])?).saturating_sub(self.buffer.len());
        while left > 0 {
            self.buffer.clear();
            let read = self.stream.read_buf(&mut self.buffer).await?;
            if read == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            left = left.saturating_sub(read);
        }
        Ok(())
    }
}

/// The length in the head of an answer.
fn length(head: &[u8]) -> io::Result<usize> {
    if !head.starts_with(b"HTTP/1.1 200 ") {
        let line = head.split(|byte| *byte == b'\r').next().unwrap_or_default();
        return Err(io::Error::other(String::from_utf8_lossy(line).into_owned()));
    }
    let text = std::str::from_utf8(head).map_err(io::Error::other)?;
    let fields = text.lines().filter_map(|line| line.split_once(':'));
    let mut lengths = fields.filter(|(name, _)| name.eq_ignore_ascii_case("content-length"));
    let length = lengths.next().and_then(|(_, value)| value.trim().parse().ok());
    length.ok_or_else(|| io::Error::other("an answer without a length"))
}

/// What many connections were answered.
pub(super) struct Answers {
    /// Microseconds from the request to the last byte, sorted.
    pub(super) latencies: Vec<u32>,
    /// Requests without an answer.
    pub(super) failed: u64,
    pub(super) seconds: f64,
}

impl Answers {
    /// The time in milliseconds within which a share of all were answered.
    pub(super) fn quantile_ms(&self, share: f64) -> f64 {
        let at = (self.latencies.len().saturating_sub(1) as f64 * share).round() as usize;
        self.latencies
            .get(at)
            .map_or(0.0, |micros| f64::from(*micros) / 1e3)
    }

    pub(super) fn requests_per_second(&self) -> f64 {
        self.latencies.len() as f64 / self.seconds
    }
}

/// When a load ends.
#[derive(Clone, Copy)]
pub(super) enum Until {
    Requests(u64),
    After(Duration),
}

/// Requests, one for each address.
pub(super) fn requests(targets: &[String]) -> Arc<[Vec<u8>]> {
    let request = |target: &String| format!("GET {target} HTTP/1.1\r\nhost: load\r\n\r\n").into_bytes();
    targets.iter().map(request).collect()
}

/// Asks over `count` connections, each again as soon as it is answered. `done` counts answers as they come.
pub(super) async fn load(
    address: SocketAddr,
    requests: &Arc<[Vec<u8>]>,
    count: usize,
    until: Until,
    done: &Arc<AtomicU64>,
) -> io::Result<Answers> {
    let mut connections = Vec::with_capacity(count);
    for _ in 0..count {
        connections.push(Connection::open(address).await?);
    }
    let (begin, asked) = (Instant::now(), Arc::new(AtomicU64::new(0)));
    let mut tasks = JoinSet::new();
    for (at, mut connection) in connections.into_iter().enumerate() {
        let (requests, asked, done) = (Arc::clone(requests), Arc::clone(&asked), Arc::clone(done));
        tasks.spawn(async move {
            let mut next = at * requests.len() / count;
            let mut latencies = Vec::new();
            loop {
                let number = asked.fetch_add(1, Ordering::Relaxed);
                let ended = match until {
                    Until::Requests(requests) => number >= requests,
                    Until::After(time) => begin.elapsed() >= time,
                };
                if ended {
                    return (latencies, 0);
                }
                let asked_at = Instant::now();
                if connection.ask(&requests[next]).await.is_err() {
                    return (latencies, 1);
                }
                latencies.push(asked_at.elapsed().as_micros().min(u32::MAX.into()) as u32);
                done.fetch_add(1, Ordering::Relaxed);
                next = (next + 1) % requests.len();
            }
        });
    }
    let (mut latencies, mut failed) = (Vec::new(), 0);
    while let Some(ended) = tasks.join_next().await {
        let (of_one, failures) = ended.map_err(io::Error::other)?;
        latencies.extend(of_one);
        failed += failures;
    }
    let seconds = begin.elapsed().as_secs_f64();
    latencies.sort_unstable();
    Ok(Answers {
        latencies,
        failed,
        seconds,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_say_how_long_the_answer_is() {
        let head = |text: &str| length(text.as_bytes()).map_err(|error| error.to_string());
        assert_eq!(
            head("HTTP/1.1 200 OK\r\nServer: x\r\nContent-Length: 17\r\n\r\n"),
            Ok(17)
        );
        assert_eq!(
            head("HTTP/1.1 503 Service Unavailable\r\n\r\n"),
            Err("HTTP/1.1 503 Service Unavailable".into())
        );
        assert!(
            head("HTTP/1.1 200 OK\r\n\r\n")
                .unwrap_err()
                .contains("without a length")
        );
    }
}
