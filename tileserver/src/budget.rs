//! Memory and disk: how much is read at the same time, however many ask.

use std::{io, sync::Arc};

use bytes::Bytes;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::{Options, failure::Failure};

/// Memory is counted in pieces of this size.
const PIECE_BYTES: u64 = 4096;

/// Reads archives on threads that may block, within [`Options::memory_bytes`] and [`Options::reads`].
pub(crate) struct Budget {
    memory: Arc<Semaphore>,
    pieces: u32,
    reads: Arc<Semaphore>,
}

/// Bytes that were read, and the memory they are accounted for in until they are sent.
struct Held {
    bytes: Vec<u8>,
    _memory: OwnedSemaphorePermit,
}

impl AsRef<[u8]> for Held {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

impl Budget {
    pub(crate) fn new(options: &Options) -> Self {
        let pieces = (options.memory_bytes / PIECE_BYTES)
            .clamp(1, Semaphore::MAX_PERMITS.min(u32::MAX as usize) as u64);
        Self {
            memory: Arc::new(Semaphore::new(pieces as usize)),
            pieces: pieces as u32,
            reads: Arc::new(Semaphore::new(options.reads.clamp(1, Semaphore::MAX_PERMITS))),
        }
    }

    /// Runs `read`, which returns about `bytes` bytes, when there is room for them.
    pub(crate) async fn read<E: Send + 'static>(
        &self,
        bytes: u64,
        read: impl FnOnce() -> Result<Vec<u8>, E> + Send + 'static,
    ) -> Result<Result<Bytes, E>, Failure> {
        let pieces = bytes.div_ceil(PIECE_BYTES).min(self.pieces.into()) as u32;
        let memory = Arc::clone(&self.memory)
            .acquire_many_owned(pieces)
            .await
            .map_err(|_| Failure::busy())?;
        self.blocking(move || {
            read().map(|bytes| {
                Bytes::from_owner(Held {
                    bytes,
                    _memory: memory,
                })
            })
        })
        .await
    }

    /// Runs something that may block.
    pub(crate) async fn blocking<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Failure> {
        let permit = Arc::clone(&self.reads)
            .acquire_owned()
            .await
            .map_err(|_| Failure::busy())?;
        let done = tokio::task::spawn_blocking(move || {
            let _permit = permit; // Until the work is done, even if nobody waits for it any more.
            work()
        });
        done.await.map_err(|error| {
            tracing::error!(%error, "a read failed");
            Failure::internal("the server failed to read the archive: its log says why")
        })
    }

    /// Runs `read` for the next part of a body, whose error can only be that the connection breaks off.
    pub(crate) async fn read_part(
        &self,
        bytes: u64,
        read: impl FnOnce() -> io::Result<Vec<u8>> + Send + 'static,
    ) -> io::Result<Bytes> {
        self.read(bytes, read)
            .await
            .unwrap_or_else(|_| Err(io::Error::other("the server could not read on")))
    }
}
