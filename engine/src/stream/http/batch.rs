//! Many records in one answer: docs/http.md, "Batches".

use std::sync::{
    Arc, OnceLock,
    atomic::{AtomicUsize, Ordering},
};

use bytes::{Buf, Bytes, BytesMut};
use tokio::task::AbortHandle;

use super::{
    super::{Request, together::FRAME_BYTES},
    fetch::Flight,
};
use crate::{Error, Result};

/// Largest error that stands for a record.
const MAX_MESSAGE_BYTES: u64 = 16 << 10;

/// What carries requests: given up when nobody waits for any of them.
pub(super) struct Carrier {
    task: OnceLock<AbortHandle>,
    /// Requests that are waited for.
    left: AtomicUsize,
}

impl Carrier {
    pub(super) fn of(flights: usize) -> Arc<Self> {
        Arc::new(Self {
            task: OnceLock::new(),
            left: AtomicUsize::new(flights),
        })
    }

    pub(super) fn set_task(&self, task: AbortHandle) {
        // Set once, by who has made it.
        let _ = self.task.set(task);
    }

    /// One of the requests less is waited for. Returns whether it was the last one.
    pub(super) fn leave(&self) -> bool {
        self.left.fetch_sub(1, Ordering::Relaxed) == 1
    }

    /// Ends it.
    pub(super) fn abort(&self) {
        if let Some(task) = self.task.get() {
            task.abort();
        }
    }
}

/// The list in a batch's address.
pub(super) fn list(flights: &[Arc<Flight>]) -> String {
    let name = |flight: &Arc<Flight>| match &flight.request {
        Request::Page { page, .. } => {
            let tileset::Tile { mip, x, y } = page.tile;
            format!("{}.{mip}.{x}.{y}", page.group)
        }
        Request::Column { group, .. } => format!("c{group}"),
        Request::Index { .. } => String::new(), // Never part of a batch.
    };
    flights.iter().map(name).collect::<Vec<_>>().join(",")
}

/// Reads a batch as it comes.
#[derive(Default)]
pub(super) struct Frames {
    buffer: BytesMut,
    /// Frames that have come.
    came: usize,
}

/// What a frame says about its record.
pub(super) type Frame = (u16, Bytes);

impl Frames {
    pub(super) fn push(&mut self, data: &[u8]) {
        self.buffer.extend_from_slice(data);
    }

    /// Bytes that a frame took.
    pub(super) fn taken(&self, (_, bytes): &Frame) -> u64 {
        (FRAME_BYTES + bytes.len()) as u64
    }

    /// The next frame that is whole: status and bytes. It must be about `request`, and no longer than `limit` if there is
    /// a record.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn next(
        &mut self,
        request: &Request,
        limit: u64,
    ) -> std::result::Result<Option<Frame>, String> {
        let Some(mut head) = self.buffer.get(..FRAME_BYTES) else {
            return Ok(None);
        };
        let (kind, mip, group) = (head.get_u8(), head.get_u8(), head.get_u16_le());
        let (x, y, status) = (head.get_u16_le(), head.get_u16_le(), head.get_u16_le());
        let _ = head.get_u16_le();
        let length = head.get_u32_le();
        let expected = match request {
            Request::Page { page, .. } => {
                let tileset::Tile { mip, x, y } = page.tile;
                (1, mip, page.group, x, y)
            }
            Request::Column { group, .. } => (0, 0, *group, 0, 0),
            Request::Index { .. } => return Err("an index is no part of a batch".into()),
        };
        if (kind, mip, group, x, y) != expected {
            return Err(format!(
                "frame {} is about kind {kind}, group {group}, mip {mip}, x {x}, y {y}, not about {request}",
                self.came
            ));
        }
        let limit = if status == 200 { limit } else { MAX_MESSAGE_BYTES };
        if u64::from(length) > limit {
            return Err(format!(
                "frame {} has {length} bytes, at most {limit} are expected",
                self.came
            ));
        }
        if self.buffer.len() - FRAME_BYTES < length as usize {
            return Ok(None);
        }
        self.buffer.advance(FRAME_BYTES);
        self.came += 1;
        // A copy of its own, so that a cache does not keep the whole batch alive.
        let bytes = Bytes::copy_from_slice(&self.buffer[..length as usize]);
        self.buffer.advance(length as usize);
        Ok(Some((status, bytes)))
    }
}

/// The answer that a frame is; `None` if the record's own address says more: the archive may have changed.
pub(super) fn answer(request: &Request, url: &str, (status, bytes): Frame) -> Option<Result<Bytes>> {
    match status {
        200 => Some(Ok(bytes)),
        404 | 410 => None,
        _ => Some(Err(Error::Unavailable {
            what: format!("{request}, from {url}"),
            detail: format!("status {status} in a batch"),
            retry_after: None,
        })),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn column(group: u16) -> Request {
        Request::Column {
            archive: "a".into(),
            group,
        }
    }

    fn frame(group: u8, status: u16, bytes: &[u8]) -> Vec<u8> {
        let status = status.to_le_bytes();
        let head = [0, 0, group, 0, 0, 0, 0, 0, status[0], status[1], 0, 0];
        [&head[..], &(bytes.len() as u32).to_le_bytes(), bytes].concat()
    }

    #[test]
    fn frames_come_byte_by_byte() {
        let bytes = [frame(0, 200, b"zero"), frame(1, 404, b"{}"), frame(2, 200, b"")].concat();
        let mut frames = Frames::default();
        let mut came = Vec::new();
        for byte in bytes {
            frames.push(&[byte]);
            came.extend(frames.next(&column(frames.came as u16), 10).unwrap());
        }
        let expected = [(200, "zero"), (404, "{}"), (200, "")];
        assert_eq!(came, expected.map(|(status, bytes)| (status, Bytes::from(bytes))));
    }

    #[test]
    fn frames_that_cannot_be_are_refused() {
        let next = |bytes: &[u8]| {
            let mut frames = Frames::default();
            frames.push(bytes);
            frames.next(&column(0), 10)
        };
        assert!(next(&frame(1, 200, b"")).unwrap_err().contains("not about"));
        assert!(
            next(&frame(0, 200, b"eleven byte"))
                .unwrap_err()
                .contains("at most 10")
        );
        let mut endless = frame(0, 500, b"");
        endless[12..].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(next(&endless).is_err());
        assert_eq!(next(b"short").unwrap(), None);
    }

    /// All that is read until it is refused or ends, in parts of these lengths.
    fn read(bytes: &[u8], parts: &[usize]) -> (Vec<Frame>, Option<String>) {
        let (mut frames, mut came, mut rest) = (Frames::default(), Vec::new(), bytes);
        let mut parts = parts.iter().cycle();
        loop {
            match frames.next(&column(came.len() as u16), 64) {
                Ok(Some(frame)) => came.push(frame),
                Err(reason) => return (came, Some(reason)),
                Ok(None) if rest.is_empty() => return (came, None),
                Ok(None) => {
                    let part = parts.next().map_or(1, |part| *part).clamp(1, rest.len());
                    frames.push(&rest[..part]);
                    rest = &rest[part..];
                }
            }
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_refused_or_read_the_same_in_any_parts(
            good in proptest::collection::vec((any::<u16>(), proptest::collection::vec(any::<u8>(), 0..64)), 0..6),
            noise in proptest::collection::vec(any::<u8>(), 0..80),
            parts in proptest::collection::vec(1..40usize, 1..8),
        ) {
            let mut bytes: Vec<u8> = good
                .iter()
                .enumerate()
                .flat_map(|(group, (status, bytes))| frame(group as u8, *status, bytes))
                .collect();
            bytes.extend(noise);
            let (came, refused) = read(&bytes, &parts);
            prop_assert_eq!(&(came.clone(), refused), &read(&bytes, &[bytes.len()]));
            let expected = good.iter().map(|(status, bytes)| (*status, Bytes::copy_from_slice(bytes)));
            prop_assert!(came.iter().take(good.len()).cloned().eq(expected));
            let taken: u64 = came.iter().map(|frame| Frames::default().taken(frame)).sum();
            prop_assert!(taken <= bytes.len() as u64);
        }
    }

    #[test]
    fn lists() {
        let tile = tileset::Tile { mip: 2, x: 5, y: 1 };
        let page = Request::Page {
            archive: "a".into(),
            page: tileset::PageId { group: 0, tile },
        };
        let flights = [column(3), page].map(|request| Arc::new(Flight::new(request, false)));
        assert_eq!(list(&flights), "c3,0.2.5.1");
    }
}
