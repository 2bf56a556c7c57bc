//! Memory: how much is read and not yet sent, however many ask.

use std::sync::Arc;

use bytes::Bytes;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::{Options, failure::Failure};

/// Memory is counted in pieces of this size.
const PIECE_BYTES: u64 = 4096;

/// The memory of [`Options::memory_bytes`].
pub(crate) struct Budget {
    memory: Arc<Semaphore>,
    pieces: u32,
}

/// Memory that bytes are accounted for in.
pub(crate) struct Room(
    #[expect(dead_code, reason = "is given back when it is dropped")] OwnedSemaphorePermit,
);

/// Bytes, and the room they take until they are sent.
struct Held {
    bytes: Bytes,
    _room: Room,
}

impl AsRef<[u8]> for Held {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

impl Room {
    /// Bytes that give the room back when they are dropped.
    pub(crate) fn hold(self, bytes: impl Into<Bytes>) -> Bytes {
        Bytes::from_owner(Held {
            bytes: bytes.into(),
            _room: self,
        })
    }
}

impl Budget {
    pub(crate) fn new(options: &Options) -> Self {
        let pieces = (options.memory_bytes / PIECE_BYTES)
            .clamp(1, Semaphore::MAX_PERMITS.min(u32::MAX as usize) as u64);
        Self {
            memory: Arc::new(Semaphore::new(pieces as usize)),
            pieces: pieces as u32,
        }
    }

    /// Waits for room for `bytes` bytes; for more than there is, until all of it is free.
    pub(crate) async fn room(&self, bytes: u64) -> Result<Room, Failure> {
        let pieces = bytes.div_ceil(PIECE_BYTES).min(self.pieces.into()) as u32;
        let room = Arc::clone(&self.memory).acquire_many_owned(pieces).await;
        room.map(Room).map_err(|_| Failure::busy())
    }

    /// Bytes that are in use.
    pub(crate) fn used(&self) -> u64 {
        (u64::from(self.pieces) - self.memory.available_permits() as u64) * PIECE_BYTES
    }
}
