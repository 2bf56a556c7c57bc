//! Reads from a store: how many at the same time, for how long, and how often they are tried.

use std::{
    collections::hash_map::RandomState, future::Future, hash::BuildHasher, ops::Range, sync::Arc,
    time::Duration,
};

use tokio::{
    sync::Semaphore,
    time::{sleep, timeout},
};

use crate::{
    Options,
    metrics::Metrics,
    store::{StoreError, Version},
};

/// How often a read is tried that fails in passing.
const TRIES: u32 = 3;
/// Pause before the second try; four times as long before each further one, and up to half of it more or less, so
/// that those who failed together do not come back together.
const PAUSE: Duration = Duration::from_millis(50);

/// Reads within [`Options::reads`] and [`Options::store_timeout`].
pub(crate) struct Reads {
    slots: Semaphore,
    timeout: Duration,
    metrics: Arc<Metrics>,
}

impl Reads {
    pub(crate) fn new(options: &Options, metrics: Arc<Metrics>) -> Self {
        Self {
            slots: Semaphore::new(options.reads.clamp(1, Semaphore::MAX_PERMITS)),
            timeout: options.store_timeout,
            metrics,
        }
    }

    /// Bytes of an archive.
    pub(crate) async fn read(&self, version: &dyn Version, range: Range<u64>) -> Result<Vec<u8>, StoreError> {
        self.ask(|| version.read(range.clone())).await
    }

    /// Asks a store, again if it fails in passing.
    pub(crate) async fn ask<T, F: Future<Output = Result<T, StoreError>>>(
        &self,
        question: impl Fn() -> F,
    ) -> Result<T, StoreError> {
        let mut tried = 0;
        loop {
            let slot = self.slots.acquire().await;
            let answer = timeout(self.timeout, question()).await;
            drop(slot);
            let answer = answer.unwrap_or_else(|_| {
                let detail = format!("no answer within {} s", self.timeout.as_secs_f64());
                Err(StoreError::Unavailable(detail))
            });
            self.metrics.store_reads.add(1);
            tried += 1;
            match answer {
                Err(StoreError::Unavailable(detail)) => {
                    self.metrics.store_failures.add(1);
                    tracing::warn!(detail, tried, "the store failed");
                    if tried == TRIES {
                        return Err(StoreError::Unavailable(detail));
                    }
                    sleep(pause(tried)).await;
                }
                answer => return answer,
            }
        }
    }
}

/// The pause after `tried` tries.
fn pause(tried: u32) -> Duration {
    // Between 0.5 and 1.5; the state of a hash table is random enough.
    let jitter = 0.5 + (RandomState::new().hash_one(tried) >> 11) as f64 / (1u64 << 53) as f64;
    PAUSE.mul_f64(4f64.powi(tried as i32 - 1) * jitter)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    #[tokio::test]
    async fn what_fails_in_passing_is_tried_again_and_nothing_else() {
        let options = Options {
            store_timeout: Duration::from_millis(20),
            ..Options::default()
        };
        let reads = Reads::new(&options, Arc::default());
        for (failures, error, tries, works) in [
            (2, StoreError::Unavailable("busy".into()), 3, true),
            (9, StoreError::Unavailable("busy".into()), 3, false),
            (1, StoreError::Changed, 1, false),
            (1, StoreError::NotFound, 1, false),
        ] {
            let count = AtomicU32::new(0);
            let answer = reads.ask(async || {
                if count.fetch_add(1, Ordering::Relaxed) < failures {
                    return Err(error.clone());
                }
                Ok(())
            });
            assert_eq!(answer.await.is_ok(), works, "{error:?}");
            assert_eq!(count.load(Ordering::Relaxed), tries, "{error:?}");
        }
        let silent = reads.ask(std::future::pending::<Result<(), _>>).await;
        assert!(silent.unwrap_err().to_string().contains("within 0.02 s"));
    }

    #[test]
    fn pauses_grow_and_differ() {
        for _ in 0..100 {
            assert!((25..=75).contains(&pause(1).as_millis()));
            assert!((100..=300).contains(&pause(2).as_millis()));
        }
        assert!((0..100).any(|_| pause(1) != pause(1)));
    }
}
