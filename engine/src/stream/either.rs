//! A tile server or a static host: whichever is there.

use std::{
    collections::{HashMap, HashSet},
    time::Duration,
};

use super::{
    Answer, HttpOptions, HttpSource, HttpTransport, RangeSource, Request, SourceStats, Ticket, TileSource,
};
use crate::{Error, Result};

/// The archives at an address, from a tile server if there is one, else by ranges.
///
/// The first answer decides. Until then, what the address does not have as a tile server is asked for by ranges. A static
/// host costs one exchange more in this way, and a tile server none.
pub(super) struct EitherSource {
    server: HttpSource,
    ranges: RangeSource<HttpTransport>,
    decided: Option<Kind>,
    next: u64,
    /// Requests in flight, by the tickets of the source that has them.
    sent: HashMap<(Kind, Ticket), Sent>,
    open: HashSet<Ticket>,
}

struct Sent {
    ticket: Ticket,
    anew: bool,
    /// Bytes on the wire before.
    wire_bytes: u64,
    /// What the tile server said about it, if there is one.
    refused: Option<Error>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Kind {
    Server,
    Ranges,
}

impl EitherSource {
    pub(super) fn new(address: &str, options: &HttpOptions) -> Result<Self> {
        let server = HttpSource::new(address, options)?;
        let ranges = RangeSource::new(HttpTransport::new(options)?, &server.origin());
        Ok(Self {
            server,
            ranges,
            decided: None,
            next: 0,
            sent: HashMap::new(),
            open: HashSet::new(),
        })
    }

    fn source(&mut self, kind: Kind) -> &mut dyn TileSource {
        match kind {
            Kind::Server => &mut self.server,
            Kind::Ranges => &mut self.ranges,
        }
    }

    fn send(&mut self, kind: Kind, request: Request, sent: Sent) -> Option<Ticket> {
        let source = self.source(kind);
        let inner = match sent.anew {
            true => source.submit_anew(request),
            false => source.submit(request),
        }?;
        let ticket = sent.ticket;
        self.sent.insert((kind, inner), sent);
        Some(ticket)
    }

    fn begin(&mut self, request: Request, anew: bool) -> Option<Ticket> {
        if self.open.len() >= self.capacity() {
            return None;
        }
        let sent = Sent {
            ticket: Ticket(self.next),
            anew,
            wire_bytes: 0,
            refused: None,
        };
        let ticket = self.send(self.decided.unwrap_or(Kind::Server), request, sent)?;
        self.next += 1;
        self.open.insert(ticket);
        Some(ticket)
    }

    /// An answer of one of both; `None` if the other one is asked now.
    fn judge(&mut self, kind: Kind, answer: Answer) -> Option<Answer> {
        let mut sent = self.sent.remove(&(kind, answer.ticket))?;
        sent.wire_bytes += answer.wire_bytes;
        let bytes = match (answer.bytes, kind) {
            (Ok(bytes), _) => {
                self.decided = Some(kind);
                Ok(bytes)
            }
            // No tile server, or not this archive.
            (Err(error @ (Error::NotFound(_) | Error::Source { .. })), Kind::Server)
                if self.decided != Some(Kind::Server) =>
            {
                let (ticket, wire_bytes) = (sent.ticket, sent.wire_bytes);
                sent.refused = Some(error);
                if self.send(Kind::Ranges, answer.request.clone(), sent).is_some() {
                    return None;
                }
                // More than the other one takes: later.
                return Some(Answer {
                    ticket,
                    bytes: Err(Error::Unavailable {
                        what: answer.request.to_string(),
                        detail: "too many requests at once".into(),
                        retry_after: None,
                    }),
                    checked: false,
                    request: answer.request,
                    wire_bytes,
                });
            }
            // Neither of both has it: what the tile server says tells more, if it was one.
            (Err(Error::NotFound(_)), Kind::Ranges) if matches!(sent.refused, Some(Error::NotFound(_))) => {
                Err(sent.refused?)
            }
            (Err(error), _) => Err(error),
        };
        Some(Answer {
            ticket: sent.ticket,
            request: answer.request,
            bytes,
            checked: answer.checked,
            wire_bytes: sent.wire_bytes,
        })
    }
}

impl TileSource for EitherSource {
    fn capacity(&self) -> usize {
        match self.decided {
            Some(Kind::Ranges) => self.ranges.capacity(),
            Some(Kind::Server) | None => self.server.capacity().min(self.ranges.capacity()),
        }
    }

    fn in_flight(&self) -> usize {
        self.open.len()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        self.begin(request, false)
    }

    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        self.begin(request, true)
    }

    fn cancel(&mut self, ticket: Ticket) {
        if self.open.remove(&ticket) {
            let sent = self.sent.iter().find(|(_, sent)| sent.ticket == ticket);
            if let Some((kind, inner)) = sent.map(|(key, _)| *key) {
                self.sent.remove(&(kind, inner));
                self.source(kind).cancel(inner);
            }
        }
    }

    fn poll(&mut self) -> Option<Answer> {
        for kind in [Kind::Server, Kind::Ranges] {
            while let Some(answer) = self.source(kind).poll() {
                if let Some(answer) = self.judge(kind, answer) {
                    self.open.remove(&answer.ticket);
                    return Some(answer);
                }
            }
        }
        None
    }

    fn wait(&mut self, limit: Duration) {
        // Both only while it is not decided: in turns then.
        const TURN: Duration = Duration::from_millis(1);
        match (self.server.in_flight() > 0, self.ranges.in_flight() > 0) {
            (true, true) => {
                self.ranges.wait(TURN.min(limit));
                self.server.wait(TURN.min(limit));
            }
            (true, false) => self.server.wait(limit),
            (false, true) => self.ranges.wait(limit),
            (false, false) => {}
        }
    }

    fn origin(&self) -> String {
        self.server.origin()
    }

    fn stats(&self) -> SourceStats {
        let (a, b) = (self.server.stats(), self.ranges.stats());
        SourceStats {
            requested: a.requested + b.requested,
            exchanges: a.exchanges + b.exchanges,
            wire_bytes: a.wire_bytes + b.wire_bytes,
            cancelled: a.cancelled + b.cancelled,
            cancelled_bytes_saved: a.cancelled_bytes_saved + b.cancelled_bytes_saved,
            from_ram: a.from_ram + b.from_ram,
            from_ram_bytes: a.from_ram_bytes + b.from_ram_bytes,
            ..a
        }
    }
}
