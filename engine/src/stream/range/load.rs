//! Loading what an archive begins with: a guess first, then exactly the rest.

use std::{ops::Range, sync::Arc};

use bytes::{Bytes, BytesMut};
use tileset::archive::{HEADER_BYTES, Index};

use super::{
    super::{directories::parse_shared, transport::Head},
    trouble::Trouble,
    version::{ContentRange, Version, check_encoding},
};

/// What is asked for first. Most indices fit, and the coarsest pages behind them as well: records are stored in
/// the order in which they are wanted.
pub(super) const GUESS_BYTES: u64 = 64 << 10;
/// Longest file that is taken whole from a host that ignores ranges.
pub(super) const WHOLE_BYTES: u64 = 64 << 20;

/// An archive on a host.
pub(super) struct Known {
    pub(super) index: Arc<Index>,
    pub(super) version: Version,
    /// The beginning of the file: its prefix, and the records that came with it. All of it, if the host ignores
    /// ranges.
    pub(super) head: Bytes,
    /// Bytes of header, manifest, tables and directory.
    pub(super) prefix_bytes: usize,
}

impl Known {
    /// The index as it stands in the file.
    pub(super) fn prefix(&self) -> Bytes {
        self.head.slice(..self.prefix_bytes)
    }

    /// A record, if it came with the index. Copied, because slots of a cache must not keep all of it alive.
    pub(super) fn at_hand(&self, range: &Range<u64>) -> Option<Bytes> {
        let range = usize::try_from(range.start).ok()?..usize::try_from(range.end).ok()?;
        self.head.get(range).map(Bytes::copy_from_slice)
    }
}

/// Bytes of the beginning that have come, over one or two GETs.
pub(super) struct Loading {
    /// What the GET on its way asks for.
    pub(super) asked: Range<u64>,
    version: Option<Version>,
    bytes: BytesMut,
    /// Where what is on its way ends.
    until: u64,
    /// It is the whole file that comes.
    whole: bool,
}

/// What is to be done after a GET.
pub(super) enum Next {
    /// The rest is to be asked for.
    Rest,
    Done(Known),
}

impl Loading {
    pub(super) fn new() -> Self {
        Self {
            asked: 0..GUESS_BYTES,
            version: None,
            bytes: BytesMut::new(),
            until: 0,
            whole: false,
        }
    }

    /// The validator of what came first.
    pub(super) fn validator(&self) -> Option<String> {
        self.version.as_ref()?.validator()
    }

    pub(super) fn head(&mut self, head: &Head) -> Result<(), Trouble> {
        let version = match head.status {
            200 | 206 => Version::of(head),
            416 => {
                let detail = "the file is empty, or ends before what it announces: upload it again";
                return Err(Trouble::Lasting(detail.into()));
            }
            _ => return Err(Trouble::of_status(head)),
        };
        check_encoding(head)?;
        if let Some(before) = &self.version {
            before.check(&version)?;
        }
        if head.status == 206 {
            let range = ContentRange::of(head)?;
            range.check(&self.asked)?;
            self.until = range.range.end;
        } else {
            if version.total.is_some_and(|total| total > WHOLE_BYTES) {
                let total = version.total.unwrap_or(0);
                return Err(Trouble::Lasting(too_long(&format!("{total} bytes"))));
            }
            self.bytes.clear();
            self.whole = true;
            self.until = version.total.unwrap_or(WHOLE_BYTES);
        }
        self.version = Some(version);
        Ok(())
    }

    pub(super) fn body(&mut self, data: &[u8]) -> Result<(), Trouble> {
        if (self.bytes.len() + data.len()) as u64 > self.until {
            let until = self.until;
            return Err(Trouble::Lasting(if self.whole {
                too_long(&format!("more than {until} bytes"))
            } else {
                format!("the host sends more than up to byte {until}, which it announced")
            }));
        }
        self.bytes.extend_from_slice(data);
        Ok(())
    }

    pub(super) fn end(&mut self) -> Result<Next, Trouble> {
        let length = self.bytes.len() as u64;
        let announced = !self.whole
            || self
                .version
                .as_ref()
                .is_some_and(|version| version.total.is_some());
        if announced && length < self.until {
            return Err(Trouble::passing(format!(
                "the answer ends after {length} of {} bytes",
                self.until
            )));
        }
        let header = self.bytes.get(..HEADER_BYTES).unwrap_or(&self.bytes);
        let lasting = |error: String| Trouble::Lasting(format!("{error}: is it an archive, and all of it?"));
        let prefix_bytes = Index::prefix_bytes(header).map_err(|error| lasting(error.to_string()))?;
        if prefix_bytes > length {
            let total = self.version.as_ref().and_then(|version| version.total);
            if self.whole || total.is_some_and(|total| total < prefix_bytes) {
                let detail = format!("its index takes {prefix_bytes} bytes, the file has {length}");
                return Err(lasting(detail));
            }
            self.asked = length..prefix_bytes;
            return Ok(Next::Rest);
        }
        let prefix_bytes = prefix_bytes as usize; // No more than what is in memory.
        let index = parse_shared(&self.bytes[..prefix_bytes]);
        // Damaged on the way or on the host: worth another attempt, and then said.
        let index = index.map_err(|error| Trouble::passing(error.to_string()))?;
        let version = self.version.take().unwrap_or_default();
        let total = if self.whole { Some(length) } else { version.total };
        if let Some(total) = total
            && total != index.file_bytes
        {
            let detail = format!("the file has {total} bytes, its header says {}", index.file_bytes);
            return Err(lasting(detail));
        }
        Ok(Next::Done(Known {
            index,
            version,
            head: std::mem::take(&mut self.bytes).freeze(),
            prefix_bytes,
        }))
    }
}

fn too_long(length: &str) -> String {
    format!(
        "the host ignores ranges (it answers 200), and the archive has {length}, more than the {} MiB that are \
         taken whole: use a host that does ranges, or eigentile serve",
        WHOLE_BYTES >> 20
    )
}
