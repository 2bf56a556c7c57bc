//! Many records in one answer: a stream of frames in the order asked.

use std::{
    io,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use bytes::{BufMut, Bytes, BytesMut};
use futures_util::{Stream, StreamExt, stream};
use hyper::StatusCode;
use tileset::{PageId, Tile};
use xxhash_rust::xxh3::xxh3_128;

use crate::{
    body::Body,
    collection::Served,
    failure::Failure,
    pulse::Pulse,
    records::{Records, What},
    routes::number,
    service::read_failure,
};

/// Most records of one request.
pub(crate) const MAX_RECORDS: usize = 256;
/// Records that are read ahead of the one that is sent.
const AHEAD: usize = 8;
/// Bytes in front of each record.
const FRAME_BYTES: usize = 16;

/// A record that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wanted {
    Column(u16),
    Page(PageId),
}

/// Parses a list of records: `c3` is the column of group 3, `0.2.5.1` the page of group 0, mip 2, x 5, y 1.
pub(crate) fn wanted(list: &str) -> Result<Vec<Wanted>, Failure> {
    let mut all = Vec::new();
    for item in list.split(',') {
        if all.len() == MAX_RECORDS {
            let detail = format!("more than {MAX_RECORDS} records: ask for fewer at a time");
            return Err(Failure::bad_request(detail));
        }
        all.push(match item.strip_prefix('c') {
            Some(group) => Wanted::Column(number("group", group)?),
            None => {
                let mut parts = item.splitn(4, '.');
                let mut next = || parts.next().unwrap_or_default();
                let group = number("group", next())?;
                let tile = Tile {
                    mip: number("mip", next())?,
                    x: number("x", next())?,
                    y: number("y", next())?,
                };
                Wanted::Page(PageId { group, tile })
            }
        });
    }
    Ok(all)
}

/// The ETag of a batch: archive and list name its content.
pub(crate) fn etag(served: &Served, list: &str) -> String {
    format!(
        "\"{:032x}\"",
        xxh3_128(format!("{}/{list}", served.id()).as_bytes())
    )
}

/// The frames. A record is read when the connection has room for it, at most [`AHEAD`] early.
///
/// A record that the archive does not have is an error frame and may be kept by caches like everything else.
/// One that cannot be read now is an error frame as well, but then the connection is broken off behind the last
/// frame, when all has left it, so that no cache keeps the answer.
pub(crate) fn body(
    served: Arc<Served>,
    records: Arc<Records>,
    wanted: Vec<Wanted>,
    pulse: Arc<Pulse>,
) -> Body {
    let rooms = stream::iter(wanted).then({
        let (served, records) = (Arc::clone(&served), Arc::clone(&records));
        // One after the other: who has room needs nothing more to go on, so nobody waits in a circle.
        move |wanted| {
            let (served, records) = (Arc::clone(&served), Arc::clone(&records));
            async move {
                let there = match wanted {
                    Wanted::Column(group) => served.index.column(group).map(|_| What::Column(group)),
                    Wanted::Page(page) => served.index.page(page).map(|_| What::Page(page)),
                };
                let found = match there {
                    Err(error) => Err(Failure::not_found(error.to_string())),
                    Ok(what) => records.room(&served, what).await.map(|room| (what, room)),
                };
                (wanted, found)
            }
        }
    });
    let frames = rooms.map(move |(wanted, found)| {
        let (served, records) = (Arc::clone(&served), Arc::clone(&records));
        async move {
            let result = match found {
                Ok((what, room)) => {
                    let landed = records.get(&served, what, room).await;
                    landed.map_err(|error| read_failure(&served, what, error))
                }
                Err(failure) => Err(failure),
            };
            (wanted, result)
        }
    });
    Body::Stream(Box::pin(parts(frames.buffered(AHEAD), pulse)))
}

/// Heads and records, and an error at the end if one was for now only.
fn parts(
    frames: impl Stream<Item = (Wanted, Result<Bytes, Failure>)>,
    pulse: Arc<Pulse>,
) -> impl Stream<Item = io::Result<Bytes>> {
    let passing = Arc::new(AtomicBool::new(false));
    let end = stream::once({
        let passing = Arc::clone(&passing);
        async move {
            if !passing.load(Ordering::Relaxed) {
                return None;
            }
            // Breaking off throws away what is not sent.
            pulse.emptied().await;
            Some(Err(io::Error::other("records of the batch could not be read")))
        }
    });
    let frames = frames.flat_map(move |(wanted, result)| {
        let (status, bytes) = match result {
            Ok(bytes) => (200, bytes),
            Err(failure) => {
                passing.fetch_or(failure.status != StatusCode::NOT_FOUND, Ordering::Relaxed);
                (failure.status.as_u16(), failure.json().into())
            }
        };
        let parts = [head(wanted, status, bytes.len()), bytes];
        stream::iter(parts.into_iter().filter(|part| !part.is_empty()).map(Ok))
    });
    frames.chain(end.filter_map(std::future::ready))
}

/// Kind, mip, group, x, y, status, two bytes that are zero, length; little-endian.
fn head(wanted: Wanted, status: u16, length: usize) -> Bytes {
    let mut head = BytesMut::with_capacity(FRAME_BYTES);
    let (kind, mip, group, x, y) = match wanted {
        Wanted::Column(group) => (0, 0, group, 0, 0),
        Wanted::Page(PageId { group, tile }) => (1, tile.mip, group, tile.x, tile.y),
    };
    head.put_u8(kind);
    head.put_u8(mip);
    head.put_u16_le(group);
    head.put_u16_le(x);
    head.put_u16_le(y);
    head.put_u16_le(status);
    head.put_u16_le(0);
    head.put_u32_le(length as u32);
    head.freeze()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn lists_of_records() {
        let page = |group, mip, x, y| {
            Wanted::Page(PageId {
                group,
                tile: Tile { mip, x, y },
            })
        };
        assert_eq!(
            wanted("c0,0.3.0.0,65535.255.65535.1,c0").unwrap(),
            [
                Wanted::Column(0),
                page(0, 3, 0, 0),
                page(65535, 255, 65535, 1),
                Wanted::Column(0)
            ]
        );
        for list in [
            "",
            "c",
            "c0,",
            ",c0",
            "0.1.2",
            "0.1.2.3.4",
            "c00",
            "c-1",
            "c65536",
            "0.256.0.0",
            "C0",
            " c0",
        ] {
            assert!(wanted(list).is_err(), "{list:?}");
        }
        let many = |count: usize| wanted(&format!("c1{}", ",c1".repeat(count - 1)));
        assert_eq!(many(MAX_RECORDS).unwrap().len(), MAX_RECORDS);
        assert!(many(MAX_RECORDS + 1).is_err());
    }

    proptest! {
        #[test]
        fn any_list_is_read_or_refused(list in "[c0-9.,]{0,40}") {
            if let Ok(all) = wanted(&list) {
                let text: Vec<_> = all.iter().map(|wanted| match wanted {
                    Wanted::Column(group) => format!("c{group}"),
                    Wanted::Page(PageId { group, tile }) => format!("{group}.{}.{}.{}", tile.mip, tile.x, tile.y),
                }).collect();
                prop_assert_eq!(text.join(","), list);
            }
        }
    }
}
