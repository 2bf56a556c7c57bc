//! One range on its way, and the records in it.

use std::{ops::Range, sync::Arc};

use bytes::Bytes;

use super::{
    super::{Ticket, transport::Head},
    load::WHOLE_BYTES,
    plan::Wanted,
    trouble::Trouble,
    version::{ContentRange, Version, check_encoding},
};

/// A range that was asked for. Records are handed out as soon as their last byte is there, so that what comes first
/// does not wait for what comes last, and what has come before a connection is lost is not lost.
pub(super) struct Fetch {
    pub(super) archive: Arc<str>,
    /// The file that it was asked of.
    pub(super) version: Version,
    pub(super) range: Range<u64>,
    /// Records that have not come yet, by where they end.
    pub(super) records: Vec<Wanted>,
    /// What has come of the range.
    buffer: Vec<u8>,
    /// Bytes of a whole file before the range that are still to be skipped.
    skip: u64,
    /// The body ends behind the range.
    ends: bool,
    /// Bytes on the wire that no answer has counted yet.
    uncounted: u64,
}

/// A record that has come: bytes, and bytes on the wire that are counted with it.
pub(super) type Came = (Wanted, Bytes, u64);

impl Fetch {
    pub(super) fn new(version: Version, range: Range<u64>, records: Vec<Wanted>) -> Option<Self> {
        let archive = Arc::clone(&records.first()?.archive);
        Some(Self {
            archive,
            version,
            range,
            records,
            buffer: Vec::new(),
            skip: 0,
            ends: true,
            uncounted: 0,
        })
    }

    pub(super) fn head(&mut self, head: &Head) -> Result<(), Trouble> {
        self.uncounted += head.wire_bytes;
        match head.status {
            206 => {
                check_encoding(head)?;
                self.version.check(&Version::of(head))?;
                let content = ContentRange::of(head)?;
                content.check(&self.range)?;
                if content.range.end < self.range.end {
                    return Err(Trouble::Changed(format!("it ends at {}", content.range.end)));
                }
                Ok(())
            }
            200 => {
                check_encoding(head)?;
                self.version.check(&Version::of(head))?;
                // The same file, but whole: a host, or a cache on the way, that ignores ranges now and then.
                if self.range.end > WHOLE_BYTES {
                    return Err(Trouble::passing("the host ignores the range (it answers 200)"));
                }
                (self.skip, self.ends) = (self.range.start, false);
                Ok(())
            }
            412 | 416 => Err(Trouble::Changed(format!("status {}", head.status))),
            _ => Err(Trouble::of_status(head)),
        }
    }

    /// Takes bytes; `came` gets the records that are whole now. Returns whether that was the last one.
    pub(super) fn body(&mut self, mut data: &[u8], mut came: impl FnMut(Came)) -> Result<bool, Trouble> {
        self.uncounted += data.len() as u64;
        let skipped = self.skip.min(data.len() as u64);
        self.skip -= skipped;
        data = &data[skipped as usize..];
        let length = self.range.end - self.range.start;
        let room = length - self.buffer.len() as u64;
        if data.len() as u64 > room {
            if self.ends {
                return Err(Trouble::Lasting(format!(
                    "the host sends more than the {length} bytes it announced"
                )));
            }
            data = &data[..room as usize];
        }
        self.buffer.extend_from_slice(data);
        let start = self.range.start;
        let end = start + self.buffer.len() as u64;
        let whole = self.records.partition_point(|record| record.range.end <= end);
        let last = self.records.last().map(|record| record.ticket);
        for record in self.records.drain(..whole) {
            let place = (record.range.start - start) as usize..(record.range.end - start) as usize;
            let bytes = Bytes::copy_from_slice(&self.buffer[place]);
            // Its own bytes; what has come beside the records counts for the last one.
            let last = last == Some(record.ticket);
            let counted = if last {
                self.uncounted
            } else {
                self.uncounted.min(bytes.len() as u64)
            };
            self.uncounted -= counted;
            came((record, bytes, counted));
        }
        Ok(self.records.is_empty())
    }

    /// Why records that have not come will not come any more.
    pub(super) fn short(&self) -> Trouble {
        Trouble::passing(format!(
            "the answer ends after {} of {} bytes",
            self.buffer.len(),
            self.range.end - self.range.start
        ))
    }

    /// Gives a record up. Returns whether it was the last one.
    pub(super) fn give_up(&mut self, ticket: Ticket) -> bool {
        self.records.retain(|record| record.ticket != ticket);
        self.records.is_empty()
    }

    pub(super) fn has(&self, ticket: Ticket) -> bool {
        self.records.iter().any(|record| record.ticket == ticket)
    }

    /// Bytes of the range that have not come.
    pub(super) fn left(&self) -> u64 {
        self.range.end - self.range.start - self.buffer.len() as u64
    }
}
