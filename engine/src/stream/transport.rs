//! What a source over HTTP needs of the machine it runs on: GETs of ranges that can be given up.
//!
//! A source decides what to ask for and what an answer means; a transport only carries it. Natively that is hyper on
//! a thread of its own; in a browser `fetch` with an `AbortController` does the same.

use std::{ops::Range, time::Duration};

use bytes::Bytes;

/// One GET.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Get {
    /// Where.
    pub url: String,
    /// Bytes that are asked for; `None` for all.
    pub range: Option<Range<u64>>,
    /// The range is wanted only while the resource has this validator.
    pub if_range: Option<String>,
    /// Caches on the way are to ask the host (`Cache-Control: no-cache`).
    pub anew: bool,
}

/// Status and fields of an answer.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Head {
    /// Status code.
    pub status: u16,
    /// Names in lower case, and values; those that are no ASCII are left out.
    pub fields: Vec<(String, String)>,
    /// Bytes that status line and fields took on the wire, about.
    pub wire_bytes: u64,
}

impl Head {
    /// The first field of a name, which is in lower case.
    pub fn field(&self, name: &str) -> Option<&str> {
        let (_, value) = self.fields.iter().find(|(known, _)| known == name)?;
        Some(value.trim())
    }

    /// Seconds of `Retry-After`. A date, which nobody uses for this, is not understood.
    pub(super) fn retry_after(&self) -> Option<Duration> {
        self.field("retry-after")?.parse().ok().map(Duration::from_secs)
    }
}

/// What becomes of a GET: a head, parts of the body, an end; or a failure at any time, and then nothing more.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// Status and fields.
    Head(Head),
    /// The next bytes of the body.
    Body(Bytes),
    /// The body was whole.
    End,
    /// The connection failed, broke off, or was silent for too long.
    Failed(String),
}

/// Names a GET.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GetId(pub u64);

/// Carries GETs. Nothing blocks. Redirections are followed, a few, and never from `https` to anything else; the head of one that is not
/// comes as it is.
pub trait Transport {
    /// Starts a GET. Whoever starts it bounds their number.
    fn start(&mut self, get: Get) -> GetId;
    /// Gives a GET up: the request ends on the wire, and no more events come. Unknown ones are ignored.
    fn abort(&mut self, id: GetId);
    /// The next event.
    fn poll(&mut self) -> Option<(GetId, Event)>;
    /// Waits until an event may be there or `limit` has passed.
    fn wait(&mut self, limit: Duration);
}

impl<T: Transport + ?Sized> Transport for Box<T> {
    fn start(&mut self, get: Get) -> GetId {
        (**self).start(get)
    }
    fn abort(&mut self, id: GetId) {
        (**self).abort(id);
    }
    fn poll(&mut self) -> Option<(GetId, Event)> {
        (**self).poll()
    }
    fn wait(&mut self, limit: Duration) {
        (**self).wait(limit);
    }
}
