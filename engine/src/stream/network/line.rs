//! What a network is like, and networks that have names.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::super::together::{CONNECTIONS, FRAME_BYTES, MAX_RECORDS};

/// What a network does to requests and answers. The default does nothing to them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Network {
    /// What the line to the client carries; 0 for as much as there is.
    pub bits_per_second: u64,
    /// From a request to the first byte of its answer, and once more for each new connection.
    pub round_trip: Duration,
    /// An answer is late by anything up to this.
    pub jitter: Duration,
    /// Chance, below 1, that a segment is lost. It is sent again a round trip later, and holds up all that follows on its
    /// connection.
    pub loss: f64,
    /// Chance that an answer takes another half of a round trip, and is overtaken.
    pub reorder: f64,
    /// Connections, at least one.
    pub connections: usize,
    /// Requests that can be under way on a connection, at least one: 1 is HTTP/1.1, more are HTTP/2.
    pub streams: usize,
    /// Most records of one archive that come in one answer, at least one; 1 where there are no batches.
    pub batch: usize,
    /// Bytes of the head of each answer. Requests go the other way, where they take nothing from answers.
    pub header_bytes: u64,
    /// Bytes in front of each record of an answer with several.
    pub frame_bytes: u64,
}

impl Default for Network {
    fn default() -> Self {
        Self {
            bits_per_second: 0,
            round_trip: Duration::ZERO,
            jitter: Duration::ZERO,
            loss: 0.0,
            reorder: 0.0,
            connections: 1,
            streams: usize::MAX,
            batch: 1,
            header_bytes: 0,
            frame_bytes: 0,
        }
    }
}

/// Head of a batch of the tile server over HTTP/1.1, as `tests/tests/hosts/wire.rs` holds it to.
const HEADER_BYTES: u64 = 316;

impl Network {
    /// Names of networks that have one.
    pub const NAMES: [&str; 5] = ["3g", "4g", "dsl", "wifi", "lan"];

    /// A line to a tile server, used as [`super::super::HttpSource`] does: HTTP/1.1, several connections, batches.
    pub fn line(bits_per_second: u64, round_trip: Duration, loss: f64) -> Self {
        Self {
            bits_per_second,
            round_trip,
            loss,
            connections: CONNECTIONS,
            streams: 1,
            batch: MAX_RECORDS,
            header_bytes: HEADER_BYTES,
            frame_bytes: FRAME_BYTES as u64,
            ..Self::default()
        }
    }

    /// The network of that name: one of [`Network::NAMES`].
    pub fn named(name: &str) -> Option<Self> {
        let line = |mbit: f64, milliseconds: u64, loss| {
            Self::line((mbit * 1e6) as u64, Duration::from_millis(milliseconds), loss)
        };
        let mobile = |line: Self, jitter: u64| Self {
            jitter: Duration::from_millis(jitter),
            reorder: 0.01,
            ..line
        };
        Some(match name {
            "3g" => mobile(line(1.6, 150, 0.01), 40),
            "4g" => mobile(line(20.0, 60, 0.005), 20),
            "dsl" => line(8.0, 50, 0.0),
            "wifi" => line(50.0, 20, 0.0),
            "lan" => line(1000.0, 1, 0.0),
            _ => return None,
        })
    }

    /// Nanoseconds that so many bytes keep the line busy.
    pub(super) fn nanoseconds(&self, bytes: u64) -> u64 {
        match self.bits_per_second {
            0 => 0,
            bits => u64::try_from(u128::from(bytes) * 8_000_000_000 / u128::from(bits)).unwrap_or(u64::MAX),
        }
    }

    /// Nanoseconds of a round trip, at most an hour.
    pub(super) fn trip(&self) -> u64 {
        nanoseconds(self.round_trip)
    }

    pub(super) fn jitter(&self) -> u64 {
        nanoseconds(self.jitter)
    }
}

/// At most an hour: sums of a few cannot overflow.
pub(super) fn nanoseconds(time: Duration) -> u64 {
    time.min(Duration::from_secs(3600)).as_nanos() as u64
}
