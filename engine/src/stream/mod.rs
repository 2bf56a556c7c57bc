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
//! | [`HttpSource`] | a tile server, over HTTP/1.1 |
//!
//! | decorators | |
//! |---|---|
//! | [`CachedSource`] | keeps compressed records in memory, up to a number of bytes |
//! | [`ThrottledSource`] | lets only so many bytes through, in simulated time |
//! | [`FaultySource`] | fails, delays, repeats, reorders and loses answers, by seed |
//!
//! [`fn@open`] makes a source of what a user typed. One conformance suite runs over all of them. Bytes are handed
//! on as they came: whoever decodes them checks them first, with [`tileset::archive::Index::verify`].

#[cfg(test)]
mod conformance;
mod faulty;
#[cfg(not(target_arch = "wasm32"))]
mod folder;
#[cfg(not(target_arch = "wasm32"))]
mod http;
#[cfg(not(target_arch = "wasm32"))]
mod inbox;
mod lru;
mod memory;
#[cfg(not(target_arch = "wasm32"))]
mod open;
mod source;
mod throttle;

pub use faulty::{Faults, FaultySource};
#[cfg(not(target_arch = "wasm32"))]
pub use folder::FolderSource;
#[cfg(not(target_arch = "wasm32"))]
pub use http::{HttpOptions, HttpSource};
pub use lru::CachedSource;
pub use memory::MemorySource;
#[cfg(not(target_arch = "wasm32"))]
pub use open::open;
pub use source::{Answer, Request, Ticket, TileSource};
pub use throttle::ThrottledSource;
