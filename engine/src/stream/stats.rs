//! What sources count.

use serde::Serialize;

/// What was asked of a source and what it took, since the start. Decorators add theirs to those of the source
/// inside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SourceStats {
    /// Requests that went to the host or the disk, attempts and parts of a coalesced range each.
    pub requested: u64,
    /// Exchanges with the host: fewer than requests where these were sent together.
    pub exchanges: u64,
    /// Bytes that were received, headers included.
    pub wire_bytes: u64,
    /// Requests that were given up before they were answered.
    pub cancelled: u64,
    /// Bytes of those that never crossed the wire.
    pub cancelled_bytes_saved: u64,
    /// Requests that were sent again after a failure that may pass.
    pub retried: u64,
    /// Records and indices that did not hold, and were asked for again.
    pub damaged: u64,
    /// Records from memory.
    pub from_ram: u64,
    /// Their bytes.
    pub from_ram_bytes: u64,
    /// Records from the disk cache.
    pub from_disk: u64,
    /// Their bytes.
    pub from_disk_bytes: u64,
    /// Indices from the disk cache because the host could not be reached: more than none means offline.
    pub offline: u64,
}
