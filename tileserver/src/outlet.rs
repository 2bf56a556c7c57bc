//! When the bytes of an answer have left.

use std::{sync::Arc, time::Duration};

use tokio::{sync::Notify, time::sleep};

/// HTTP/2 hands frames to its connection through a queue, so that a flush may be one too early for the last of them.
const QUEUE: Duration = Duration::from_millis(50);

/// The way out of a connection; travels with each of its requests.
#[derive(Clone, Default)]
pub(crate) struct Outlet(Arc<Notify>);

impl Outlet {
    /// All that was written has gone to the system.
    pub(crate) fn flushed(&self) {
        self.0.notify_waiters();
    }

    /// Ends when what was handed over before has left. A body that waits for this is what makes the connection flush;
    /// clients that take nothing are left after [`crate::Options::idle_timeout`] as always.
    pub(crate) async fn emptied(&self) {
        self.0.notified().await;
        sleep(QUEUE).await;
    }
}
