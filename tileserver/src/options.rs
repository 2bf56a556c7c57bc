//! Limits of the service.

use std::time::Duration;

/// Limits of the service. Defaults work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Connections at the same time; more wait until one is closed.
    pub connections: usize,
    /// Requests at the same time, from their head to the last byte of their answer; more get 503 at once.
    pub requests: usize,
    /// Requests in progress at the same time on one connection of HTTP/2.
    pub streams: u32,
    /// Bytes of records and parts of archives that are in memory at the same time, read and not yet sent. A
    /// record larger than this is served alone.
    pub memory_bytes: u64,
    /// Bytes of records that are kept in memory for the next who asks; 0 for none.
    pub cache_bytes: u64,
    /// Reads from the store at the same time.
    pub reads: usize,
    /// For how long the list of the archives is taken to be right; then the store is asked again when a
    /// catalogue, a manifest, an archive or an id that is not open is asked for.
    pub list_age: Duration,
    /// Longest time a client may take for the head of a request from its first byte (HTTP/1.1), for the first byte of a connection, or for a
    /// TLS handshake.
    pub header_timeout: Duration,
    /// Longest time until an answer begins; then 503.
    pub request_timeout: Duration,
    /// Longest time for one read from the store; reads that fail in passing are tried three times.
    pub store_timeout: Duration,
    /// Longest silence on a connection, between requests and while a client does not take its answer.
    pub idle_timeout: Duration,
    /// How long `/ready` says no before connections are refused, once the service was told to stop.
    pub notice: Duration,
    /// How long requests in progress may go on after that.
    pub drain_timeout: Duration,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            connections: 16_384,
            requests: 2048,
            streams: 128,
            memory_bytes: 256 << 20,
            cache_bytes: 256 << 20,
            reads: 16,
            list_age: Duration::from_secs(1),
            header_timeout: Duration::from_secs(10),
            request_timeout: Duration::from_secs(30),
            store_timeout: Duration::from_secs(8),
            idle_timeout: Duration::from_secs(60),
            notice: Duration::ZERO,
            drain_timeout: Duration::from_secs(10),
        }
    }
}
