//! An answer on its way, and the connections that answers share.

use super::{
    super::{Answer, Ticket, random::SplitMix64},
    Network,
};

/// Payload of a segment, bytes: what an Ethernet frame of 1500 leaves after 40 bytes of IP and TCP.
const SEGMENT_BYTES: u64 = 1460;
/// Most times that a lost segment is lost again.
const MOST_LOSSES: u64 = 6;

/// What happens to an answer on the way, drawn when its size is known.
#[derive(Clone, Copy, Default)]
pub(super) struct Fate {
    /// Bytes that are sent again.
    pub(super) resent_bytes: u64,
    /// Later by this, and so is all that follows on the connection.
    pub(super) held_up: u64,
    /// Later by this, and overtaken meanwhile.
    pub(super) overtaken: u64,
}

impl Fate {
    /// Every answer of a size draws the same number of times.
    pub(super) fn draw(network: &Network, bytes: u64, random: &mut SplitMix64) -> Self {
        let jitter = (random.unit() * network.jitter() as f64) as u64;
        let overtaken = random.unit() < network.reorder;
        let (mut lost, mut rounds) = (0, 0);
        if network.loss > 0.0 {
            for segment in 0..bytes.div_ceil(SEGMENT_BYTES) {
                let length = SEGMENT_BYTES.min(bytes - segment * SEGMENT_BYTES);
                let mut times = 0;
                while times < MOST_LOSSES && random.unit() < network.loss {
                    times += 1;
                }
                lost += times * length;
                rounds = rounds.max(times);
            }
        }
        Self {
            resent_bytes: lost,
            held_up: jitter + rounds * network.trip(),
            overtaken: if overtaken { network.trip() / 2 } else { 0 },
        }
    }
}

/// A request that the client has sent, or is going to.
pub(super) struct Transfer {
    pub(super) ticket: Ticket,
    /// Where it was sent; `None` while all connections are busy.
    pub(super) connection: Option<usize>,
    /// When the answer can begin, on the clock of the server; all times are nanoseconds.
    pub(super) ready: u64,
    /// Known when the source behind the network has answered.
    pub(super) answer: Option<Answer>,
    /// Of the answer, with headers and what is sent again.
    pub(super) bytes: u64,
    /// Time that the line needs for it, and for what of it has not been sent yet.
    pub(super) length: u64,
    pub(super) left: u64,
    pub(super) started: bool,
    /// When the server learns that nobody wants it any more.
    pub(super) stop: u64,
    pub(super) fate: Fate,
}

impl Transfer {
    pub(super) fn new(ticket: Ticket) -> Self {
        Self {
            ticket,
            connection: None,
            ready: u64::MAX,
            answer: None,
            bytes: 0,
            length: 0,
            left: 0,
            started: false,
            stop: u64::MAX,
            fate: Fate::default(),
        }
    }

    /// Bytes that the line has carried.
    pub(super) fn sent(&self) -> u64 {
        if self.length == 0 {
            return if self.started { self.bytes } else { 0 };
        }
        let sent = u128::from(self.bytes) * u128::from(self.length - self.left) / u128::from(self.length);
        sent as u64
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

/// An answer between server and client.
pub(super) struct Landing {
    pub(super) due: u64,
    pub(super) ticket: Ticket,
    pub(super) connection: usize,
    /// `None` if it was given up meanwhile.
    pub(super) answer: Option<Answer>,
    pub(super) bytes: u64,
}
