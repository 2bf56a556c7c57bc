//! What goes on on a connection, for those who wait for it or for its silence.

use std::{
    sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed},
    time::Duration,
};

use tokio::{
    sync::Notify,
    time::{Instant, sleep},
};

/// HTTP/2 hands frames to its connection through a queue, so that a flush may be one too early for the last of them.
const QUEUE: Duration = Duration::from_millis(50);

/// Shared by a connection and its requests.
#[derive(Default)]
pub(crate) struct Pulse {
    /// Grows with bytes that are taken, with requests, and with heads that begin.
    progress: AtomicU64,
    /// Bytes have come that are no request yet.
    begun: AtomicBool,
    /// Requests whose answers are not sent to their end.
    requests: AtomicU32,
    /// Somebody waits for a flush.
    awaited: AtomicBool,
    flushed: Notify,
}

impl Pulse {
    /// Bytes came. More of a head that has begun is no progress: who sends heads byte by byte is as good as silent.
    pub(crate) fn read(&self) {
        if !self.begun.load(Relaxed) {
            self.begun.store(true, Relaxed);
            self.progress.fetch_add(1, Relaxed);
        }
    }

    /// The client has taken bytes.
    pub(crate) fn written(&self, bytes: usize) {
        self.progress.fetch_add(bytes as u64, Relaxed);
    }

    /// A request is there.
    pub(crate) fn request(&self) {
        self.begun.store(false, Relaxed);
        self.requests.fetch_add(1, Relaxed);
        self.progress.fetch_add(1, Relaxed);
    }

    /// A request's answer was sent, or given up.
    pub(crate) fn answered(&self) {
        self.requests.fetch_sub(1, Relaxed);
    }

    /// Whether the client is in the middle of a head and nothing else goes on. (What comes before the answer to an earlier request was
    /// sent is not looked at yet.)
    pub(crate) fn in_head(&self) -> bool {
        self.begun.load(Relaxed) && self.requests.load(Relaxed) == 0
    }

    /// All that was written has gone to the system.
    pub(crate) fn flushed(&self) {
        if self.awaited.load(Relaxed) {
            self.flushed.notify_waiters();
        }
    }

    /// Ends when what was handed over before has left. A body that waits for this is what makes the connection flush;
    /// clients that take nothing are left after [`crate::Options::idle_timeout`] as always.
    pub(crate) async fn emptied(&self) {
        let flushed = self.flushed.notified();
        self.awaited.store(true, Relaxed);
        flushed.await;
        sleep(QUEUE).await;
    }

    /// Ends when there was no progress for `limit`, or at most a quarter longer.
    pub(crate) async fn silence(&self, limit: Duration) {
        let (mut last, mut since) = (self.progress.load(Relaxed), Instant::now());
        while since.elapsed() < limit {
            sleep(limit / 4).await;
            let now = self.progress.load(Relaxed);
            if now != last {
                (last, since) = (now, Instant::now());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_begin_with_their_first_byte_and_end_with_their_last() {
        let pulse = Pulse::default();
        assert!(!pulse.in_head());
        pulse.read();
        assert!(pulse.in_head());
        let before = pulse.progress.load(Relaxed);
        pulse.read();
        assert_eq!(
            pulse.progress.load(Relaxed),
            before,
            "further bytes are no progress"
        );
        pulse.request();
        assert!(!pulse.in_head());
        pulse.read();
        assert!(
            !pulse.in_head(),
            "of the next request, while this one is answered"
        );
        pulse.answered();
        assert!(pulse.in_head());
    }
}
