//! A record on its way, the exchange that it is part of, and the connections that exchanges share.

use super::{
    super::{Answer, Request, Ticket, random::SplitMix64, together::Waiting},
    Network,
};

/// Payload of a segment, bytes: what an Ethernet frame of 1500 leaves after 40 bytes of IP and TCP.
const SEGMENT_BYTES: u64 = 1460;
/// Most times that a lost segment is lost again.
const MOST_LOSSES: u64 = 6;

/// What happens to a record on the way.
#[derive(Clone, Copy, Default)]
pub(super) struct Fate {
    /// Bytes that are sent again.
    pub(super) resent_bytes: u64,
    /// Later by this, and so is all that follows on the connection.
    pub(super) held_up: u64,
    /// Later by this, and overtaken meanwhile.
    pub(super) overtaken: u64,
}

/// What happens to an answer on the way, drawn when its size is known: it is one stream of segments, whatever it holds.
pub(super) struct Stream {
    /// What holds for all of the answer.
    whole: Fate,
    /// Bytes that are still to come, and those of them whose segment has been drawn.
    bytes: u64,
    drawn: u64,
}

impl Stream {
    /// Every answer of a size draws the same number of times.
    pub(super) fn draw(network: &Network, bytes: u64, random: &mut SplitMix64) -> Self {
        let held_up = (random.unit() * network.jitter() as f64) as u64;
        let overtaken = random.unit() < network.reorder;
        let whole = Fate {
            resent_bytes: 0,
            held_up,
            overtaken: if overtaken { network.trip() / 2 } else { 0 },
        };
        Self {
            whole,
            bytes,
            drawn: 0,
        }
    }

    /// The next bytes of it. A segment that is lost holds up the record that it begins in, and so all behind that.
    pub(super) fn next(&mut self, network: &Network, bytes: u64, random: &mut SplitMix64) -> Fate {
        let mut fate = self.whole;
        let mut rounds = 0;
        while self.drawn < bytes {
            let length = SEGMENT_BYTES.min(self.bytes - self.drawn);
            let mut times = 0;
            while network.loss > 0.0 && times < MOST_LOSSES && random.unit() < network.loss {
                times += 1;
            }
            fate.resent_bytes += times * length;
            rounds = rounds.max(times);
            self.drawn += length;
        }
        self.drawn -= bytes;
        self.bytes -= bytes;
        fate.held_up += rounds * network.trip();
        fate
    }
}

/// A record that the client has asked for, or is going to.
pub(super) struct Transfer {
    pub(super) ticket: Ticket,
    pub(super) request: Request,
    /// It is to pass caches on the way.
    pub(super) anew: bool,
    /// What brings it; `None` while all connections are busy.
    pub(super) exchange: Option<u64>,
    /// Known when the source behind the network has answered.
    pub(super) answer: Option<Answer>,
    /// Nobody waits for it.
    pub(super) given_up: bool,
    /// With its frame, what is sent again, and for the first of an exchange the head.
    pub(super) bytes: u64,
    /// Time that the line needs for it, and for what of it has not been sent yet; all times are nanoseconds.
    pub(super) length: u64,
    pub(super) left: u64,
    pub(super) fate: Fate,
}

impl Transfer {
    pub(super) fn new(ticket: Ticket, request: Request, anew: bool) -> Self {
        Self {
            ticket,
            request,
            anew,
            exchange: None,
            answer: None,
            given_up: false,
            bytes: 0,
            length: 0,
            left: 0,
            fate: Fate::default(),
        }
    }

    /// Bytes that the line has carried.
    pub(super) fn sent(&self) -> u64 {
        if self.length == 0 {
            return 0; // All or nothing.
        }
        let sent = u128::from(self.bytes) * u128::from(self.length - self.left) / u128::from(self.length);
        sent as u64
    }
}

impl Waiting for Transfer {
    fn request(&self) -> &Request {
        &self.request
    }

    fn is_alone(&self) -> bool {
        self.anew
    }
}

/// A request on a connection, and its answer: one record or several.
pub(super) struct Exchange {
    pub(super) connection: usize,
    /// When the answer can begin, on the clock of the server.
    pub(super) ready: u64,
    /// All of it is known; before, it cannot begin.
    pub(super) known: bool,
    /// Some of it has left the server.
    pub(super) started: bool,
    /// Bytes that it has had of the line, and those that others had had when it began.
    pub(super) share: u64,
    /// When the server learns that nobody wants it any more.
    pub(super) stop: u64,
    /// Records that have neither landed nor been dropped.
    pub(super) left: usize,
    /// Those of them that somebody waits for.
    pub(super) wanted: usize,
}

impl Exchange {
    /// Its first bytes leave the server, when others have had so much.
    pub(super) fn start(&mut self, share: u64) {
        if !self.started {
            (self.started, self.share) = (true, share);
        }
    }
}

/// A connection. Its first request waits for the handshake.
#[derive(Clone, Copy, Default)]
pub(super) struct Connection {
    /// When the handshake is over.
    open: Option<u64>,
    /// Requests under way.
    pub(super) busy: usize,
    /// Nothing arrives in order before that.
    pub(super) in_order: u64,
}

impl Connection {
    /// When the server has a request that is sent now.
    pub(super) fn send(&mut self, now: u64, trip: u64) -> u64 {
        let open = *self.open.get_or_insert(now + trip);
        self.busy += 1;
        now.max(open) + trip / 2
    }
}

/// A record between server and client.
pub(super) struct Landing {
    pub(super) due: u64,
    pub(super) ticket: Ticket,
    pub(super) exchange: u64,
    /// `None` if it was given up meanwhile.
    pub(super) answer: Option<Answer>,
    pub(super) bytes: u64,
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn segments_are_lost_whole_and_cost_the_record_that_they_begin_in() {
        let network = Network {
            round_trip: Duration::from_nanos(1000),
            jitter: Duration::from_nanos(100),
            loss: 0.5,
            ..Network::default()
        };
        let mut lost = [false; 30];
        for seed in 0..50 {
            let mut random = SplitMix64(seed);
            let mut stream = Stream::draw(&network, 3000, &mut random);
            let fates: Vec<Fate> = (0..30).map(|_| stream.next(&network, 100, &mut random)).collect();
            for (at, fate) in fates.iter().enumerate() {
                // Segments begin at 0, 1460 and 2920; the last has 80 bytes.
                let segment = [(0, 1460), (14, 1460), (29, 80)]
                    .into_iter()
                    .find(|(first, _)| *first == at);
                match segment {
                    Some((_, length)) => assert_eq!(fate.resent_bytes % length, 0),
                    None => assert_eq!(fate.resent_bytes, 0, "{at}"),
                }
                lost[at] |= fate.resent_bytes > 0;
                let times = segment.map_or(0, |(_, length)| fate.resent_bytes / length);
                assert_eq!(fate.held_up, fates[1].held_up + 1000 * times);
            }
            assert!(fates[1].held_up <= 100);
        }
        assert_eq!(lost.iter().filter(|lost| **lost).count(), 3);
    }
}
