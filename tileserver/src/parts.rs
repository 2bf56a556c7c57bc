//! Ranges of a stored file as a body that is read while it is sent.

use std::{
    collections::VecDeque,
    future::Future,
    io,
    ops::Range,
    pin::Pin,
    sync::Arc,
    task::{Context, Poll},
};

use bytes::Bytes;

use crate::{records::Records, store::Version};

/// Bytes that are read at once: enough to keep a disk and a socket busy.
const PART_BYTES: u64 = 256 << 10;

type Reading = Pin<Box<dyn Future<Output = io::Result<Bytes>> + Send>>;

/// What a body is made of.
enum Piece {
    /// What stands between ranges.
    Text(Bytes),
    /// Bytes of the file.
    Range(Range<u64>),
}

impl Piece {
    fn bytes(&self) -> u64 {
        match self {
            Self::Text(text) => text.len() as u64,
            Self::Range(range) => range.end - range.start,
        }
    }
}

/// Pieces of a file. A part is read when the connection has room for it, and not before.
pub(crate) struct FileBody {
    version: Arc<dyn Version>,
    records: Arc<Records>,
    left: VecDeque<Piece>,
    left_bytes: u64,
    reading: Option<Reading>,
}

impl FileBody {
    /// One range.
    pub(crate) fn one(version: Arc<dyn Version>, records: Arc<Records>, range: Range<u64>) -> Self {
        Self::new(version, records, VecDeque::from([Piece::Range(range)]))
    }

    /// Several ranges as `multipart/byteranges` (RFC 9110, section 14.6) with this boundary.
    pub(crate) fn multipart(
        version: Arc<dyn Version>,
        records: Arc<Records>,
        ranges: Vec<Range<u64>>,
        kind: &str,
        boundary: &str,
    ) -> Self {
        let length = version.bytes();
        let mut pieces = VecDeque::new();
        for range in ranges {
            let head = format!(
                "\r\n--{boundary}\r\ncontent-type: {kind}\r\n\
                 content-range: bytes {}-{}/{length}\r\n\r\n",
                range.start,
                range.end - 1,
            );
            pieces.extend([Piece::Text(head.into()), Piece::Range(range)]);
        }
        pieces.push_back(Piece::Text(format!("\r\n--{boundary}--\r\n").into()));
        Self::new(version, records, pieces)
    }

    fn new(version: Arc<dyn Version>, records: Arc<Records>, left: VecDeque<Piece>) -> Self {
        Self {
            version,
            records,
            left_bytes: left.iter().map(Piece::bytes).sum(),
            left,
            reading: None,
        }
    }

    /// Bytes that are left.
    pub(crate) fn bytes(&self) -> u64 {
        self.left_bytes
    }

    /// Begins with the next part. An error can only be told by breaking off the connection.
    fn read(&self, range: Range<u64>) -> Reading {
        let (version, records) = (Arc::clone(&self.version), Arc::clone(&self.records));
        Box::pin(async move {
            let room = records.budget.room(range.end - range.start).await;
            let room = room.map_err(|_| io::Error::other("the server has no room to read on"))?;
            let bytes = records
                .reads
                .read(&*version, range.clone())
                .await
                .map_err(|error| {
                    tracing::error!(content = %version.identity(), ?range, %error, "a file cannot be read");
                    io::Error::other(error)
                })?;
            Ok(room.hold(bytes))
        })
    }
}

impl FileBody {
    /// The next part, once it is read; `None` at the end.
    pub(crate) fn poll_part(&mut self, context: &mut Context<'_>) -> Poll<Option<io::Result<Bytes>>> {
        let mut reading = match self.reading.take() {
            Some(reading) => reading,
            None => match self.left.pop_front() {
                None => return Poll::Ready(None),
                Some(Piece::Text(text)) => {
                    self.left_bytes -= text.len() as u64;
                    return Poll::Ready(Some(Ok(text)));
                }
                Some(Piece::Range(range)) => {
                    let end = range.end.min(range.start + PART_BYTES);
                    if end < range.end {
                        self.left.push_front(Piece::Range(end..range.end));
                    }
                    self.read(range.start..end)
                }
            },
        };
        let Poll::Ready(part) = reading.as_mut().poll(context) else {
            self.reading = Some(reading);
            return Poll::Pending;
        };
        match &part {
            Ok(bytes) => self.left_bytes -= bytes.len() as u64,
            Err(_) => self.left.clear(), // After an error there is nothing more to come.
        }
        Poll::Ready(Some(part))
    }
}
