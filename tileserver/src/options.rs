//! Limits of the service.

use std::time::Duration;

/// Limits of the service. Defaults work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Connections at the same time, and so requests at the same time; more wait until one is closed.
    pub connections: usize,
    /// Bytes of records and parts of archives that are in memory at the same time, read and not yet sent. A
    /// record larger than this is served alone.
    pub memory_bytes: u64,
    /// Reads from disk at the same time.
    pub reads: usize,
    /// Longest time a client may take for the head of a request.
    pub header_timeout: Duration,
    /// Longest time until an answer begins; then 503.
    pub request_timeout: Duration,
    /// Longest silence on a connection, between requests and while a client does not take its answer.
    pub idle_timeout: Duration,
    /// How long requests in progress may go on after the service was told to stop.
    pub drain_timeout: Duration,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            connections: 512,
            memory_bytes: 256 << 20,
            reads: 16,
            header_timeout: Duration::from_secs(10),
            request_timeout: Duration::from_secs(30),
            idle_timeout: Duration::from_secs(60),
            drain_timeout: Duration::from_secs(10),
        }
    }
}
