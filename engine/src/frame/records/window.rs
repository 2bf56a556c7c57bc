//! How many bytes are worth having in flight: what the line brings in a round trip, and as much again.
//!
//! Less leaves the line idle; more only queues up, and what queues up can change its order no more when the view does. The line
//! is known by what it has brought: the largest rate of late, and the shortest time of late from a request to its record.
//!
//! Source: Cardwell, Cheng, Gunn, Yeganeh, Jacobson: BBR: Congestion-Based Congestion Control, 2016. Requests are held back
//! here, not packets, so that pacing and probing are left to the transport.

/// The window in parts of what a round trip brings.
const GAIN: f64 = 2.0;
/// Least window: some records, so that a line about which little is known is not idle.
const LEAST_BYTES: f64 = 32768.0;
/// Round trips for which a rate counts, and the least of that time in seconds.
const RATE_TRIPS: f64 = 10.0;
const RATE_SECONDS: f64 = 0.5;
/// Seconds in which no record came within this many times the round trip that is held to be one: then it is longer now.
const TRIP_SECONDS: f64 = 3.0;
const TRIP_SLACK: f64 = 2.0;

/// What was known when a record was asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sent {
    /// Seconds.
    at: f64,
    /// Bytes that had come by then.
    came: u64,
}

/// The line, as far as it is known.
#[derive(Clone, Debug, Default)]
pub(super) struct Window {
    came: u64,
    /// Bytes a second: the largest in the time before, and in the present one, which began then.
    rates: [f64; 2],
    rates_since: f64,
    /// Seconds of a round trip, and the shortest since then.
    trip: Option<f64>,
    shortest: f64,
    shortest_since: f64,
    /// In the present time of rates something had to wait for room: the line was in use all the time.
    in_use: bool,
    /// An answer came with its request: nothing is to be gained by holding back.
    at_once: bool,
}

impl Window {
    /// A request goes out.
    pub(super) fn sent(&self, now: f64) -> Sent {
        Sent {
            at: now,
            came: self.came,
        }
    }

    /// Something had to wait.
    pub(super) fn full(&mut self) {
        self.in_use = true;
    }

    /// The line has carried bytes for which nobody waited here: they count in the rates of what was waited for meanwhile.
    pub(super) fn carried(&mut self, bytes: u64) {
        self.came += bytes;
    }

    /// An answer came, after `bytes` on the wire.
    pub(super) fn came(&mut self, sent: Sent, bytes: u64, now: f64) {
        if bytes == 0 {
            return; // From a cache: it says nothing of the line.
        }
        self.came += bytes;
        let took = now - sent.at;
        self.at_once = took <= 0.0;
        if self.at_once {
            return;
        }
        self.learn_trip(took, now);
        let rate = (self.came - sent.came) as f64 / took;
        let span = RATE_SECONDS.max(RATE_TRIPS * self.trip.unwrap_or(0.0));
        if now - self.rates_since > span && self.in_use {
            self.rates = [self.rates[1], 0.0];
            (self.rates_since, self.in_use) = (now, false);
        }
        self.rates[1] = self.rates[1].max(rate);
    }

    fn learn_trip(&mut self, took: f64, now: f64) {
        let Some(trip) = &mut self.trip else {
            (self.trip, self.shortest, self.shortest_since) = (Some(took), took, now);
            return;
        };
        *trip = trip.min(took);
        self.shortest = self.shortest.min(took);
        if now - self.shortest_since > TRIP_SECONDS {
            // Requests queue up for as long as the window lets them, which is no longer trip.
            if self.shortest > TRIP_SLACK * GAIN * *trip {
                *trip = self.shortest;
            }
            (self.shortest, self.shortest_since) = (took, now);
        }
    }

    /// Bytes that may be in flight; as many as there are while nothing is known.
    pub(super) fn bytes(&self) -> u64 {
        let Some(trip) = self.trip.filter(|_| !self.at_once) else {
            return u64::MAX;
        };
        let rate = self.rates[0].max(self.rates[1]);
        (GAIN * rate * trip).max(LEAST_BYTES) as u64
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;

    /// Asks for records of 1000 bytes as the window allows, over a line of this many bytes a second and this round trip,
    /// in frames of a sixtieth of a second. Returns bytes that came and the most that were in flight in the second half.
    fn replay(window: &mut Window, rate: f64, trip: f64, start: f64, seconds: f64) -> (u64, u64) {
        const BYTES: u64 = 1000;
        let mut flying: VecDeque<(f64, Sent)> = VecDeque::new();
        let (mut line, mut came, mut most) = (start, 0, 0);
        let frames = (seconds * 60.0) as usize;
        for frame in 0..frames {
            let now = start + frame as f64 / 60.0;
            while flying.front().is_some_and(|(due, _)| *due <= now) {
                let (_, sent) = flying.pop_front().unwrap();
                window.came(sent, BYTES, now);
                came += BYTES;
            }
            while (flying.len() as u64 + 1) * BYTES <= window.bytes().min(64_000_000)
                && flying.len() < 100_000
            {
                line = f64::max(line, now + trip / 2.0) + BYTES as f64 / rate;
                flying.push_back((line + trip / 2.0, window.sent(now)));
            }
            window.full();
            if frame > frames / 2 {
                most = most.max(flying.len() as u64 * BYTES);
            }
        }
        (came, most)
    }

    #[test]
    fn a_line_is_kept_busy_and_no_more() {
        for (rate, trip) in [
            (200e3, 0.15),
            (1e6, 0.05),
            (2.5e6, 0.06),
            (6e6, 0.02),
            (20e6, 0.1),
        ] {
            // What was known first is little: as if a few records had come.
            let mut window = Window::default();
            let sent = window.sent(0.0);
            window.came(sent, 4000, trip + 4000.0 / rate);
            let (came, most) = replay(&mut window, rate, trip, 1.0, 12.0);
            let whole = rate * 11.0;
            assert!(came as f64 > 0.9 * whole, "{rate} {trip}: {came} of {whole}");
            // Times are seen in frames, so a round trip may seem longer by one, and a rate larger by as much.
            let seen = trip + 2.0 / 60.0;
            let bound = (GAIN * rate * seen * (1.0 + 1.0 / 60.0 / trip)).max(LEAST_BYTES) * 1.2;
            assert!((most as f64) < bound, "{rate} {trip}: {most} of {bound}");
        }
    }

    #[test]
    fn a_line_that_changes_is_learnt_anew() {
        let mut window = Window::default();
        let sent = window.sent(0.0);
        window.came(sent, 4000, 0.06);
        replay(&mut window, 2.5e6, 0.05, 1.0, 5.0);
        let fast = window.bytes();
        replay(&mut window, 200e3, 0.05, 10.0, 10.0);
        assert!(window.bytes() < fast / 3, "{} of {fast}", window.bytes());
        let (came, _) = replay(&mut window, 2.5e6, 0.05, 30.0, 10.0);
        assert!(came as f64 > 0.8 * 25e6, "{came}");
        // A way round: the same line, but far.
        let (came, _) = replay(&mut window, 2.5e6, 0.5, 50.0, 40.0);
        assert!(came as f64 > 0.3 * 100e6, "{came}");
    }

    #[test]
    fn what_else_the_line_carries_counts_in_its_rate() {
        let mut window = Window::default();
        let sent = window.sent(0.0);
        window.carried(199_000);
        window.came(sent, 1000, 0.1);
        assert_eq!(window.bytes(), (GAIN * 200e3) as u64);
    }

    #[test]
    fn what_says_nothing_of_the_line_is_not_listened_to() {
        let mut window = Window::default();
        assert_eq!(window.bytes(), u64::MAX, "nothing is known");
        let sent = window.sent(1.0);
        window.came(sent, 0, 2.0);
        assert_eq!(window.bytes(), u64::MAX, "a cache");
        window.came(sent, 10, 1.0);
        assert_eq!(window.bytes(), u64::MAX, "at once");
        window.came(sent, 10, 2.0);
        assert_eq!(window.bytes(), LEAST_BYTES as u64);
        // While little is asked for, what is known of the line stays.
        let sent = window.sent(3.0);
        window.came(sent, 1_000_000, 3.5);
        let known = window.bytes();
        for second in 4..100 {
            let sent = window.sent(f64::from(second));
            window.came(sent, 10, f64::from(second) + 0.9);
        }
        assert!(window.bytes() >= known, "{} of {known}", window.bytes());
    }
}
