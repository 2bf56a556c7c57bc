//! An archive, or a range of it, as a body that is read while it is sent.

use std::{
    future::Future,
    io,
    ops::Range,
    pin::Pin,
    sync::Arc,
    task::{Context, Poll},
};

use bytes::Bytes;
use hyper::body::{Body, Frame, SizeHint};
use tileset::ReadAt;

use crate::{budget::Budget, collection::Served};

/// Bytes that are read at once: enough to keep a disk and a socket busy.
const PART_BYTES: u64 = 256 << 10;

type Reading = Pin<Box<dyn Future<Output = io::Result<Bytes>> + Send>>;

/// The bytes of a range of an archive. A part is read when the connection has room for it, and not before.
pub(crate) struct ArchiveBody {
    served: Arc<Served>,
    budget: Arc<Budget>,
    left: Range<u64>,
    reading: Option<Reading>,
}

impl ArchiveBody {
    pub(crate) fn new(served: Arc<Served>, budget: Arc<Budget>, range: Range<u64>) -> Self {
        Self {
            served,
            budget,
            left: range,
            reading: None,
        }
    }

    /// Begins with the next part, `length` bytes long.
    fn read(&self, length: u64) -> Reading {
        let (served, budget, offset) = (
            Arc::clone(&self.served),
            Arc::clone(&self.budget),
            self.left.start,
        );
        Box::pin(async move {
            let part = move || {
                let mut bytes = vec![0; length as usize];
                served.archive.reader.read_exact_at(offset, &mut bytes).map(|()| bytes).inspect_err(|error| {
                    tracing::error!(archive = served.name, offset, length, %error, "the archive cannot be read");
                })
            };
            budget.read_part(length, part).await
        })
    }
}

impl Body for ArchiveBody {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        let length = (self.left.end - self.left.start).min(PART_BYTES);
        if length == 0 {
            return Poll::Ready(None);
        }
        let mut reading = match self.reading.take() {
            Some(reading) => reading,
            None => self.read(length),
        };
        let Poll::Ready(part) = reading.as_mut().poll(context) else {
            self.reading = Some(reading);
            return Poll::Pending;
        };
        // After an error there is nothing more to come.
        self.left.start = if part.is_ok() {
            self.left.start + length
        } else {
            self.left.end
        };
        Poll::Ready(Some(part.map(Frame::data)))
    }

    fn is_end_stream(&self) -> bool {
        self.left.is_empty()
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.left.end - self.left.start)
    }
}
