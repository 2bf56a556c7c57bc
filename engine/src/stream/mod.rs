//! Where records come from: one trait, implementations and decorators.
//!
//! A source never blocks: requests are submitted, answers are polled. Everything is bounded: a source accepts
//! at most [`TileSource::capacity`] requests in flight. Answers may come in any order, late, twice or never;
//! the engine stays right.
//!
//! | sources | |
//! |---|---|
//! | [`MemorySource`] | archives in memory, answered in order |
//! | [`FolderSource`] | a folder of `.bsvtf` files, read on a thread of its own |
//! | [`HttpSource`] | a tile server, over HTTP/1.1, with TLS or without |
//! | [`RangeSource`] | `.bsvtf` files on any web server, by ranges, over any [`Transport`] |
//!
//! | decorators | |
//! |---|---|
//! | [`RetriedSource`] | checks every record against its hash, and asks again for what failed or came damaged |
//! | [`CachedSource`] | keeps compressed records in memory, up to a number of bytes |
//! | [`DiskCachedSource`] | keeps compressed records on disk, for other runs and for when there is no network |
//! | [`BackgroundSource`] | takes a source to a thread of its own |
//! | [`NetworkSource`] | bandwidth, round trips, loss and order of a [`Network`], in simulated time |
//! | [`FaultySource`] | fails, delays, repeats, reorders and loses answers, by seed |
//!
//! [`fn@open`] makes a source of what a user typed: `Background(Disk(Retried(host)))`. One conformance suite runs over all
//! of them, alone and on top of each other. Sources hand bytes on as they came; [`RetriedSource`] checks them, inside of everything
//! that keeps them, and says so ([`Answer::checked`]): every record is checked once.

#[cfg(not(target_arch = "wasm32"))]
mod background;
#[cfg(test)]
mod conformance;
mod directories;
#[cfg(not(target_arch = "wasm32"))]
mod disk;
#[cfg(not(target_arch = "wasm32"))]
mod either;
mod escape;
mod faulty;
#[cfg(not(target_arch = "wasm32"))]
mod folder;
#[cfg(not(target_arch = "wasm32"))]
mod http;
#[cfg(not(target_arch = "wasm32"))]
mod inbox;
mod lru;
mod memory;
mod network;
#[cfg(not(target_arch = "wasm32"))]
mod open;
mod random;
mod range;
mod retried;
mod room;
mod source;
mod stats;
mod together;
mod transport;

#[cfg(not(target_arch = "wasm32"))]
pub use background::BackgroundSource;
pub use directories::parse_shared;
#[cfg(not(target_arch = "wasm32"))]
pub use disk::{DiskCacheOptions, DiskCachedSource};
pub use faulty::{Faults, FaultySource};
#[cfg(not(target_arch = "wasm32"))]
pub use folder::FolderSource;
#[cfg(not(target_arch = "wasm32"))]
pub use http::{HttpOptions, HttpSource, HttpTransport};
pub use lru::CachedSource;
pub use memory::MemorySource;
pub use network::{Network, NetworkSource, NetworkStats};
#[cfg(not(target_arch = "wasm32"))]
pub use open::{OpenOptions, open, open_with};
pub use range::RangeSource;
pub use retried::{RetriedSource, RetryOptions};
pub use source::{Answer, Request, Ticket, TileSource};
pub use stats::SourceStats;
pub use transport::{Event, Get, GetId, Head, Transport};
